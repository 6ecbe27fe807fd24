"""What the plant tells of a robot beside its joints: sensors, contacts."""

import dataclasses as dc

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.description.sensors import accelerating_joints
from arm_drake.hardware.hardware import Hardware
from arm_drake.plant.contact_readings import ContactReadings
from arm_drake.plant.sensor_readings import SensorReadings


def add_sensors(
    hardware: Hardware,
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    model: ModelInstanceIndex,
    robot: Robot,
    prefix: str,
) -> Hardware:
    """Add a robot's sensors, export its contacts, and return the hardware with them.

    Args:
        hardware: The robot's hardware, in the builder.
        builder: Where the plant is.
        plant: The finalized plant.
        scene_graph: Its scene graph.
        model: The robot's model instance.
        robot: The robot.
        prefix: Start of the names of its systems and ports.
    """
    felt = ContactReadings(plant, scene_graph, model, robot.description.links)
    builder.AddNamedSystem(f"{prefix}contacts", felt)
    felt.connect(builder)
    contacts = felt.get_output_port()
    # It costs nothing until somebody asks.
    builder.ExportOutput(contacts, f"{prefix}contacts")
    joints = accelerating_joints(robot.description)
    if not robot.sensors and not joints:
        return dc.replace(hardware, contacts=contacts)
    readings = SensorReadings(plant, scene_graph, model, robot.sensors, joints)
    builder.AddNamedSystem(f"{prefix}sensors", readings)
    readings.connect(builder)
    return dc.replace(hardware, contacts=contacts, readings=readings.get_output_port())


def report_blind(robot: Robot, report: LoadReport) -> None:
    """Record the sensors of a robot that has no physics to measure.

    Args:
        robot: The robot.
        report: Where they are recorded.
    """
    for sensor in robot.sensors:
        what = f"sensor {sensor.name!r} measures nothing without physics"
        done = "its states keep their initial values, or follow their commands"
        report.add("info", "unsupported", what, done, file=robot.description.file)
