"""Lines of the load report about drives, dry friction, times, and the preset "fast"."""

from collections.abc import Collection, Sequence
from typing import Final

import numpy as np
from pydrake.geometry import Role, SceneGraph

from arm_drake import interfaces
from arm_drake.description.drive_gains import find_drive_gains, holds_joints
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.errors import quoted
from arm_drake.hardware.drives import (
    RobotDrive,
    can_move,
    claimed_interfaces,
    commanded_joints,
)
from arm_drake.hardware.joint_friction import find_friction
from arm_drake.manager.loaded_controllers import LoadedController
from arm_drake.options import SimulationOptions
from arm_drake.plant.contact import GROUND
from arm_drake.plant.joint_dynamics import sum_friction

# Place that these lines name: they tell of the simulation, not of a file.
SERVO: Final = "joint servo"

# A step of less than this part of the one that was asked for is worth a line.
_MUCH_LESS = 0.9

# Derivative gain times step over inertia beyond which a joint is unstable.
_UNSTABLE = 2.0

# Dry friction may give way by so much before it holds, in which unit; that of a
# revolute joint is first.
_SOFT = ((0.05, "rad"), (0.005, "m"))

# By which part a period may miss a whole number of steps.
_TOLERANCE = 1e-6


def report_drive(
    robot: Robot,
    drive: RobotDrive,
    controllers: Sequence[LoadedController],
    report: LoadReport,
    *,
    holds: bool,
) -> None:
    """Report what the drives of a robot do that its files don't say."""
    _report_rotors(drive, report)
    _report_gains(drive, report)
    _report_idle(robot, drive, controllers, report, holds=holds)
    locked = [
        name
        for name, lower, upper in zip(
            drive.names, drive.gains.lower, drive.gains.upper, strict=True
        )
        if lower == upper
    ]
    if locked:
        what = f"no room between its limits: {quoted(locked)}"
        _note(report, what, "they can't move")
    passive = [
        joint.name
        for joint in robot.description.movable_joints
        if joint.mimic is None and joint.name not in drive.names
    ]
    if passive:
        done = "it swings freely" if len(passive) == 1 else "they swing freely"
        _note(report, f"no command interface for {quoted(passive)}", done)
    _report_unlimited(drive, claimed_interfaces(robot, controllers), report)


def _report_idle(
    robot: Robot,
    drive: RobotDrive,
    controllers: Sequence[LoadedController],
    report: LoadReport,
    *,
    holds: bool,
) -> None:
    """Report joints that no active controller moves."""
    done = "they hold their positions" if holds else "they swing freely"
    active = [c for c in controllers if c.state == "active"]
    moved: set[str] = set()
    others: dict[str, set[str]] = {}
    for claim in claimed_interfaces(robot, active):
        joint, _, name = claim.rpartition("/")
        if name in interfaces.MOTIONS:
            moved.add(joint)
        else:
            others.setdefault(joint, set()).add(name)
    left = [name for name in drive.names if name not in moved]
    if idle := [name for name in left if name not in others]:
        _note(report, f"no active controller commands {quoted(idle)}", done)
    if kept := [name for name in left if name in others]:
        only = quoted(sorted(set().union(*(others[name] for name in kept))))
        what = f"no position, velocity or effort of {quoted(kept)} is commanded"
        _note(report, f"{what}, only {only}", done)


def _note(report: LoadReport, what: str, done: str) -> None:
    report.add("info", "repair", what, done, where=SERVO)


def _report_rotors(drive: RobotDrive, report: LoadReport) -> None:
    """Report links that are light for their drives."""
    lacking = dict(zip(drive.names, drive.lacking_inertia.tolist(), strict=True))
    light = {name: inertia for name, inertia in lacking.items() if inertia}
    if drive.rotor_inertia.any():
        step = f"{1e3 * drive.plant.time_step():.3g} ms"
        rotors = ", ".join(f"{name} {inertia:.2g}" for name, inertia in light.items())
        what = f"steps are {step}, links much lighter than drives of their efforts"
        done = f"the drives have rotors of their own [kg·m² or kg]: {rotors}"
        _note(report, what, done)
    elif light:
        what = f"links are much lighter than drives of {quoted(light)}"
        done = "they get no rotors; with SimulationOptions(reflected_inertia=True) "
        done += "they do, and carry heavier payloads"
        _note(report, what, done)


def _report_gains(drive: RobotDrive, report: LoadReport) -> None:
    """Report joints that follow gains of their description."""
    if drive.pid is not None:
        pairs = zip(drive.names, drive.pid.position, drive.pid.velocity, strict=True)
        own = [name for name, *gains in pairs if any(gains)]
        what = f"PID gains of the description drive {quoted(own)}"
        done = "as under Gazebo Classic, which knows nothing of the robot's weight"
        _note(report, what, done)
        _report_stiff(drive, report)
    if drive.rated:
        what = f"position_proportional_gain drives {quoted(drive.rated)}"
        done = "velocities become gain x update_rate x error, as in Gazebo Sim"
        _note(report, what, done)


def _report_unlimited(
    drive: RobotDrive, claimed: Collection[str], report: LoadReport
) -> None:
    """Report joints that follow any velocity."""
    velocities = set(interfaces.interface_names(drive.names, [interfaces.VELOCITY]))
    commanded = {name.rpartition("/")[0] for name in velocities.intersection(claimed)}
    unlimited = [
        name
        for name, limit in zip(drive.names, drive.gains.velocity_limit, strict=True)
        if np.isinf(limit) and name in commanded
    ]
    if unlimited:
        what = f"no velocity limit: {quoted(unlimited)}"
        _note(report, what, "velocity commands are followed whatever they are")


def _report_stiff(drive: RobotDrive, report: LoadReport) -> None:
    """Report gains that make a joint swing from step to step."""
    h = drive.plant.time_step()
    assert drive.pid is not None
    for name, inertia, position, velocity in zip(
        drive.names,
        drive.min_inertia,
        drive.pid.position,
        drive.pid.velocity,
        strict=True,
    ):
        # What a change of velocity brings back a step later, 2 is too much.
        for gain, label in (
            (position and position.kd, "kd of positions"),
            (velocity and velocity.kp, "kp of velocities"),
        ):
            if gain and gain * h / inertia > _UNSTABLE:
                what = f"{label}, {gain:g}, is too much for steps of {1e3 * h:.3g} ms: "
                what += f"it may be {_UNSTABLE * inertia / h:.3g} at most"
                done, where = "the joint swings from step to step", f"joint {name!r}"
                report.add("warning", "invalid", what, done, where=where)


def report_friction(
    robot: Robot,
    drive: RobotDrive,
    controllers: Sequence[LoadedController],
    options: SimulationOptions,
    report: LoadReport,
) -> None:
    """Report dry friction that gives way at this step, and isn't made up for."""
    joints = {joint.name: joint for joint in robot.description.independent_joints}
    if not options.friction:
        return
    claimed = claimed_interfaces(robot, controllers)
    total = sum_friction(drive.plant, robot.description, list(joints.values()))
    limits = dict(zip(drive.names, drive.gains.effort_limit, strict=True))
    unopposed = {
        name
        for name, friction in zip(joints, total.tolist(), strict=True)
        if friction > 0.0
        and (
            not options.friction_compensation
            or f"{name}/{interfaces.EFFORT}" in claimed
            or friction >= limits.get(name, 0.0)
        )
    }
    if not unopposed:  # As with most robots, and what follows takes time.
        return
    found = find_friction(drive.plant, robot.description)
    step = drive.plant.time_step()
    for name, deflection in zip(found.names, found.deflection.tolist(), strict=True):
        largest, unit = _SOFT[joints[name].type == "prismatic"]
        if name not in unopposed or deflection <= largest:
            continue
        enough = 1e3 * step * (largest / deflection) ** 0.5
        what = f"steps of {1e3 * step:.3g} ms are large for its friction: "
        what += f"it gives way by {deflection:.2g} {unit} before it holds"
        done = f"it may creep; steps of {enough:.2g} ms are small enough"
        report.add("warning", "unsupported", what, done, where=f"joint {name!r}")


def report_times(
    step: float, period: float, options: SimulationOptions, report: LoadReport
) -> None:
    """Report a step and a manager's period [s] that differ from the options."""
    largest = options.largest_step
    is_requested = options.time_step is not None or options.preset != "fast"
    if is_requested and step < _MUCH_LESS * largest:
        what = f"steps of {1e3 * largest:.4g} ms don't fit into the controller "
        what += f"manager's period of {1e3 * period:.4g} ms"
        done = f"the physics takes steps of {1e3 * step:.4g} ms"
        report.add("info", "repair", what, done, where="time_step")
    if options.log_rate is None:
        return
    steps = 1.0 / options.log_rate / step
    if steps < 1.0 - _TOLERANCE or abs(steps - round(steps)) > _TOLERANCE * steps:
        what = f"{options.log_rate:.6g} Hz is no whole number of steps of "
        what += f"{1e3 * step:.4g} ms"
        done = "a row shows the state after the last step"
        report.add("info", "repair", what, done, where="log_rate")


# Place that the report's lines name.
PRESET: Final = "preset"


def report_fallback(obstacles: Sequence[str], report: LoadReport) -> None:
    """Record why a robot isn't simulated with "fast"; `find_obstacles` says it."""
    for obstacle in obstacles or ["another robot needs more"]:
        done = "everything is simulated with the preset accurate"
        report.add("warning", "unsupported", f"fast: {obstacle}", done, where=PRESET)


def find_world_obstacles(scene_graph: SceneGraph) -> list[str]:
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
    passive = [j.name for j in description.independent_joints if j.name not in driven]
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
