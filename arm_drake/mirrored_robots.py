"""Robots without physics: their hardware mirrors commands."""

from collections.abc import Sequence

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from arm_drake.control.drive_commands import DriveCommands
from arm_drake.hardware.mock_hardware import add_mock_hardware
from arm_drake.hardware.robot_sensors import report_blind
from arm_drake.hardware.robot_systems import RobotSystems
from arm_drake.manager.loaded_controllers import command_order
from arm_drake.manager.loading import report_motionless
from arm_drake.plant.kinematic import KinematicPlant
from arm_drake.plant.plant import link_bodies
from arm_drake.robot_parts import RobotParts


def add_mirrored_robots(
    systems: Sequence[RobotSystems],
    parts: Sequence[RobotParts],
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    models: Sequence[ModelInstanceIndex],
) -> None:
    """Add hardware and controllers of robots whose joints are where they should be.

    Args:
        systems: What adds the robots' systems.
        parts: Their controllers.
        plant: The finalized plant, which is in no builder.
        scene_graph: The scene graph that it is registered with.
        models: The robots' model instances.
    """
    builder = systems[0].builder
    joints = {
        system.robot.name: (
            model,
            [joint.name for joint in system.robot.description.movable_joints],
        )
        for system, model in zip(systems, models, strict=True)
    }
    kinematic = builder.AddNamedSystem("plant", KinematicPlant(plant, joints))
    for system, part, model in zip(systems, parts, models, strict=True):
        robot, (there, controllers, report, blocks) = system.robot, part
        moving: dict[str, tuple[str, ...]] = {}
        for info, block in zip(robot.description.hardware, blocks, strict=True):
            done, where = "as mock_components has it", f"ros2_control {info.name!r}"
            for text in block.warnings:
                report.add("warning", "ignored", text, done, where=where)
            moving |= dict.fromkeys((j.name for j in info.joints), block.calculated)
        report_motionless(controllers, moving, report)
        report_blind(robot, report)
        order = command_order(there, controllers)
        hardware = add_mock_hardware(
            builder, robot, blocks, order, there, system.prefix, system.period
        )
        builder.Connect(hardware.joint_motions, kinematic.GetInputPort(robot.name))
        drive = DriveCommands((), order, velocity_lead=0.0)
        poses = kinematic.GetOutputPort("body_poses")
        system.add_frames(poses, link_bodies(plant, model, robot.description.links))
        system.add(hardware, there, controllers, report, drive)
    kinematic.connect_geometry(builder, scene_graph)
    builder.ExportOutput(kinematic.GetOutputPort("state"), "state")
