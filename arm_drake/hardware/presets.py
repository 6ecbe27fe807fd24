"""Reasons why a robot can't have the preset "fast", and their report."""

from collections.abc import Sequence
from typing import Final

from pydrake.geometry import Role, SceneGraph
from pydrake.multibody.plant import MultibodyPlant

from arm_drake import interfaces
from arm_drake.description.drive_gains import find_drive_gains, holds_joints
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.errors import quoted
from arm_drake.hardware.drives import can_move, claimed_interfaces, commanded_joints
from arm_drake.manager.loaded_controllers import LoadedController
from arm_drake.options import SimulationOptions
from arm_drake.plant.contact import GROUND

# Place that the report's lines name.
PRESET: Final = "preset"


def report_fallback(obstacles: Sequence[str], report: LoadReport) -> None:
    """Record why a robot isn't simulated with "fast"; `find_obstacles` says it."""
    for obstacle in obstacles or ["another robot needs more"]:
        done = "everything is simulated with the preset accurate"
        report.add("warning", "unsupported", f"fast: {obstacle}", done, where=PRESET)


def find_world_obstacles(plant: MultibodyPlant, scene_graph: SceneGraph) -> list[str]:
    """Return why nothing can be simulated with "fast" in a world; empty if it can."""
    inspector = scene_graph.model_inspector()
    names = [
        inspector.GetName(shape).rpartition("::")[2]
        for shape in inspector.GetAllGeometryIds(Role.kProximity)
    ]
    touchable = [name for name in names if name != GROUND]
    return ["the world has things that can be touched"] if touchable else []


def find_obstacles(
    robot: Robot,
    controllers: Sequence[LoadedController],
    options: SimulationOptions,
) -> list[str]:
    """Return why a robot can't be simulated with the preset "fast"; empty if it can."""
    description = robot.description
    movable = description.movable_joints
    driven = {joint.name for joint in commanded_joints(description)}
    claimed = claimed_interfaces(robot, controllers)
    others = sorted({name.rpartition("/")[2] for name in claimed} - {"position"})
    systems = [c.system for c in controllers if c.system is not None]
    ranging = [s.name for s in robot.sensors if interfaces.RANGE in s.interfaces]
    passive = [j.name for j in movable if j.mimic is None and j.name not in driven]
    # What finds drive gains records what is wrong with them; that comes once more.
    ignored_report = LoadReport()
    declared_gains = find_drive_gains(robot, ignored_report)
    has_friction = options.friction and any(joint.friction for joint in movable)
    facts = {
        "its base stands on the ground, or links are free": bool(robot.free_links),
        "self_collision is contact": options.self_collision,
        f"{quoted(ranging)} measures distances to links": bool(ranging),
        "joints are coupled by mimic": any(joint.mimic for joint in movable),
        f"nothing drives {quoted(passive)}": bool(passive),
        f"controllers command {', '.join(others)}": bool(others),
        "a gripper has limits at run time": any(s.limit_interfaces for s in systems),
        "joints that nobody commands are not held": not holds_joints(
            robot, ignored_report
        ),
        "effort limits don't bear its weight and friction": not can_move(
            robot, options
        ),
        f"gains of the description drive {quoted(declared_gains)}": bool(
            declared_gains
        ),
        "weight that the drives don't know needs their observer": (
            not options.gravity_compensation
        ),
        "friction that the drives don't know needs their observer": (
            has_friction and not options.friction_compensation
        ),
    }
    return [text for text, applies in facts.items() if applies]
