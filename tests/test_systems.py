"""Every Python system: its ports are documented, its state is in the Context."""

import ast
import dataclasses as dc
import importlib
import inspect
import itertools
import pkgutil
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia
from pydrake.systems.framework import LeafSystem

import arm_drake
import arm_drake as ad
from arm_drake import interfaces
from arm_drake.control.drive_commands import DriveCommands
from arm_drake.controllers import gazebo
from arm_drake.controllers.admittance_controller import (
    Admittance,
    AdmittanceController,
    AdmittanceControllerParameters,
    CoG,
    Frame,
    FtSensor,
    GravityCompensation,
    InFrame,
    Kinematics,
)
from arm_drake.controllers.bases.diff_drive_controller import (
    DiffDriveController,
    DiffDriveControllerParameters,
)
from arm_drake.controllers.bases.mecanum_drive_controller import (
    MecanumDriveController,
    MecanumDriveControllerParameters,
    MecanumKinematicsParameters,
)
from arm_drake.controllers.bases.omni_wheel_drive_controller import (
    OmniWheelDriveController,
    OmniWheelDriveControllerParameters,
)
from arm_drake.controllers.bases.steering_controllers import (
    BicycleSteeringControllerParameters,
    SteeringController,
)
from arm_drake.controllers.bases.swerve_drive_controller import (
    SwerveController,
    SwerveControllerParameters,
)
from arm_drake.controllers.bases.tricycle_controller import (
    TricycleController,
    TricycleControllerParameters,
)
from arm_drake.controllers.battery_state_broadcaster import (
    BatteryStateBroadcaster,
    BatteryStateBroadcasterParameters,
)
from arm_drake.controllers.chained_filter_controller import (
    ChainedFilter,
    ChainedFilterParameters,
)
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.force_torque_sensor_broadcaster import (
    ForceTorqueSensorBroadcaster,
    ForceTorqueSensorBroadcasterParameters,
)
from arm_drake.controllers.forward_command_controller import (
    ForwardCommandController,
    ForwardCommandControllerParameters,
    JointGroupController,
    JointGroupControllerParameters,
    MultiInterfaceForwardCommandController,
    MultiInterfaceForwardCommandControllerParameters,
)
from arm_drake.controllers.gpio_controllers import (
    GpioCommandController,
    GpioCommandControllerParameters,
    GpioInterfaces,
    InterfacesByGpio,
)
from arm_drake.controllers.gripper_controllers import (
    GripperActionController,
    GripperActionControllerParameters,
    ParallelGripperActionController,
    ParallelGripperActionControllerParameters,
)
from arm_drake.controllers.joint_state_broadcaster import (
    JointStateBroadcaster,
    JointStateBroadcasterParameters,
)
from arm_drake.controllers.joint_trajectory.controller import JointTrajectoryController
from arm_drake.controllers.joint_trajectory.parameters import (
    JointTrajectoryControllerParameters,
)
from arm_drake.controllers.passthrough_controller import (
    PassthroughController,
    PassthroughControllerParameters,
)
from arm_drake.controllers.pid_controller import PidController, PidControllerParameters
from arm_drake.controllers.sensor_broadcasters import (
    GPSSensorBroadcaster,
    GPSSensorBroadcasterParameters,
    IMUSensorBroadcaster,
    IMUSensorBroadcasterParameters,
    MagnetometerBroadcaster,
    MagnetometerBroadcasterParameters,
    PoseBroadcaster,
    PoseBroadcasterParameters,
    RangeSensorBroadcaster,
    RangeSensorBroadcasterParameters,
    SafetyInterfaces,
    StateInterfacesBroadcaster,
    StateInterfacesBroadcasterParameters,
    Vda5050SafetyStateBroadcaster,
    Vda5050SafetyStateBroadcasterParameters,
)
from arm_drake.description import gazebo_plugins as drives
from arm_drake.description import gazebo_plugins as tags
from arm_drake.description.gazebo_plugins import ContactSensorTag, ImuSensorTag
from arm_drake.description.perception_sensors import CameraSensor, LidarSensor
from arm_drake.description.sensors import SensorInfo
from arm_drake.hardware.mobile_bases import BaseServo, BaseTruth, Wheel
from arm_drake.hardware.mock_hardware import MockHardware
from arm_drake.hardware.noise_and_delay import DelayedCommands, MeasuredStates
from arm_drake.manager import ControllerManager
from arm_drake.manager.connections import SampledStates
from arm_drake.manager.hardware_interfaces import HardwareInterfaces
from arm_drake.perception.cameras import Camera
from arm_drake.perception.lidar import Lidar
from arm_drake.perception.scenery import Scenery
from arm_drake.perception.sensors import Place, SensorLog
from arm_drake.plant.contact import ContactForces
from arm_drake.plant.kinematics import BodyPoses, KinematicPlant, LinkFrames
from arm_drake.plant.sensor_readings import ContactReadings, SensorReadings
from arm_drake.python_system import PythonSystem
from arm_drake.simulation.recording import BuildInfo

PACKAGE = Path(arm_drake.__file__).parent

MODULES = {
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts): path
    for path in sorted(PACKAGE.rglob("*.py"))
}


def parse(module: str) -> ast.Module:
    return ast.parse(MODULES[module].read_text(encoding="utf-8"))


def system_classes() -> list[type[LeafSystem]]:
    """Return every LeafSystem that the package defines and that can be made.

    A plant that only tells what a world consists of becomes part of no diagram.
    """
    for info in pkgutil.walk_packages(arm_drake.__path__, "arm_drake."):
        if not info.name.endswith("__main__"):
            importlib.import_module(info.name)
    waiting, found = [LeafSystem], {}
    while waiting:
        for system in waiting.pop().__subclasses__():
            if system is MultibodyPlant:
                continue
            waiting.append(system)
            is_abstract = any(
                getattr(method, "__isabstractmethod__", False)
                for _, method in inspect.getmembers(system)
            )
            if system.__module__.startswith("arm_drake.") and not is_abstract:
                found[system.__name__] = system
    return list(found.values())


def controller_params() -> ControllerInterfaceParams:
    interfaces = ("joint/position", "joint/velocity", "joint/effort")
    return ControllerInterfaceParams(
        controller_name="controller",
        update_rate=100,
        period=0.01,
        joint_types={"joint": "revolute"},
        command_interfaces=frozenset(interfaces[:1]),
        state_interfaces=frozenset(interfaces),
        measured=interfaces,
    )


def gripper_params() -> ControllerInterfaceParams:
    return dc.replace(controller_params(), gripper_ranges={"joint": (0.0, 1.0)})


def make_manager() -> ControllerManager:
    robot = ad.load_robot("doosan_a0912")
    return ControllerManager(
        robot,
        (),
        robot.report,
        prefix="",
        period=0.01,
        log_period=0.01,
        drive=DriveCommands((), (), velocity_lead=0.05),
        hardware_interfaces=HardwareInterfaces({}, (), (), {}),
    )


def make_base_servo() -> BaseServo:
    plant = MultibodyPlant(1e-3)
    inertia = SpatialInertia.SolidSphereWithMass(1.0, 0.1)
    base = plant.AddRigidBody("base", plant.AddModelInstance("robot"), inertia)
    plant.Finalize()
    return BaseServo(plant, base.model_instance(), "base")


def make_plant() -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    plant.Finalize()
    return plant


class OneJoint:
    """Kinematics of a single joint."""

    def pose(self, q: np.ndarray, link: str) -> np.ndarray:
        return np.eye(4)

    def jacobian(self, q: np.ndarray, link: str) -> np.ndarray:
        return np.zeros((6, 1))

    def joints_to(self, link: str) -> tuple[str, ...]:
        return ("joint",)


def make_admittance_controller() -> AdmittanceController:
    frame, six = Frame("tip"), (1.0,) * 6
    parameters = AdmittanceControllerParameters(
        ("joint",),
        ("position",),
        ("position",),
        ("position", "velocity"),
        Kinematics("plugin", "package", "base", "tip"),
        FtSensor("s", frame),
        InFrame(frame),
        InFrame(Frame("base")),
        GravityCompensation(frame, CoG((0.0, 0.0, 0.0))),
        Admittance((True,) * 6, six, six, six),
    )
    params = dc.replace(
        controller_params(),
        links=("base", "tip"),
        make_kinematics=lambda joints, base: OneJoint(),
    )
    return AdmittanceController(parameters, params)


def make_sensor_readings() -> SensorReadings:
    measured = tuple(sorted(interfaces.MEASURED))
    sensor = SensorInfo("s", measured, "child", joint="joint")
    plant = MultibodyPlant(0.0)
    body = plant.AddRigidBody("child", SpatialInertia.SolidSphereWithMass(1.0, 1.0))
    frames = (plant.world_frame(), body.body_frame())
    plant.AddJoint(PrismaticJoint("joint", *frames, [1.0, 0.0, 0.0]))
    plant.Finalize()
    model = plant.GetModelInstanceByName("DefaultModelInstance")
    return SensorReadings(plant, SceneGraph(), model, [sensor], ["joint"])


def make_contact_readings() -> ContactReadings:
    plant = make_plant()
    model = plant.GetModelInstanceByName("DefaultModelInstance")
    return ContactReadings(plant, SceneGraph(), model, [])


# How to make each system, small.
FACTORIES: dict[type[LeafSystem], Callable[[], LeafSystem]] = {
    BuildInfo: lambda: BuildInfo(ad.SimulationOptions(), "empty"),
    Camera: lambda: Camera(
        CameraSensor("c", "world", topic="<camera>", kind="rgbd"),
        Place("robot", "robot", "empty"),
        Scenery(None, None),
    ),
    Lidar: lambda: Lidar(
        LidarSensor("c", "world", topic="<lidar>"),
        Place("robot", "robot", "empty"),
        Scenery(None, None),
    ),
    SensorLog: lambda: SensorLog(
        cast(
            Any,
            SimpleNamespace(
                output_types=["<topic>"],
                topics={},
                pictures=(),
                params=SimpleNamespace(update_rate=10.0),
            ),
        ),
        "",
    ),
    ContactForces: lambda: ContactForces(["link"]),
    MockHardware: lambda: MockHardware(
        ad.load_robot("doosan_a0912"), [], [], [], period=0.01
    ),
    KinematicPlant: lambda: KinematicPlant(make_plant(), {}),
    BaseTruth: lambda: BaseTruth(
        "base", 1, RigidTransform(), [Wheel("j", 2, np.zeros(3), np.eye(3)[1], 0.1)]
    ),
    BaseServo: make_base_servo,
    LinkFrames: lambda: LinkFrames([0]),
    BodyPoses: lambda: BodyPoses({"<name>": 0}),
    SensorReadings: make_sensor_readings,
    ContactReadings: make_contact_readings,
    ControllerManager: make_manager,
    SampledStates: lambda: SampledStates("controller", 3, 0.01),
    JointStateBroadcaster: lambda: JointStateBroadcaster(
        JointStateBroadcasterParameters(), controller_params()
    ),
    ForwardCommandController: lambda: ForwardCommandController(
        ForwardCommandControllerParameters(("joint",), "position"), controller_params()
    ),
    MultiInterfaceForwardCommandController: lambda: (
        MultiInterfaceForwardCommandController(
            MultiInterfaceForwardCommandControllerParameters("joint", ("position",)),
            controller_params(),
        )
    ),
    JointGroupController: lambda: JointGroupController(
        JointGroupControllerParameters(("joint",)),
        controller_params(),
        interface="effort",
    ),
    GripperActionController: lambda: GripperActionController(
        GripperActionControllerParameters("joint"), gripper_params()
    ),
    ParallelGripperActionController: lambda: ParallelGripperActionController(
        ParallelGripperActionControllerParameters("joint"), gripper_params()
    ),
    gazebo.find_system(tags.JointPositionController): lambda: gazebo.make_plugin(
        [tags.JointPositionController(("joint",), topic="<topic>")], gripper_params()
    ),
    gazebo.find_system(tags.JointController): lambda: gazebo.make_plugin(
        [tags.JointController(("joint",), topic="<topic>")], controller_params()
    ),
    gazebo.find_system(tags.ApplyJointForce): lambda: gazebo.make_plugin(
        [tags.ApplyJointForce(("<joint>",))],
        dc.replace(controller_params(), robot_name="<model>"),
    ),
    gazebo.find_system(tags.JointTrajectoryController): lambda: gazebo.make_plugin(
        [tags.JointTrajectoryController(topic="<topic>")], controller_params()
    ),
    gazebo.find_system(tags.JointStatePublisher): lambda: gazebo.make_plugin(
        [tags.JointStatePublisher(topic="<topic>")], controller_params()
    ),
    gazebo.find_system(tags.OdometryPublisher): lambda: gazebo.make_plugin(
        [
            tags.OdometryPublisher(
                odom_topic="<odom_topic>", tf_topic="<tf_topic>", base_link="base"
            )
        ],
        dc.replace(controller_params(), links=("base",)),
    ),
    gazebo.find_system(ContactSensorTag): lambda: gazebo.make_plugin(
        [ContactSensorTag("s", "base", ("base::hull",), "<topic>", frame="base")],
        dc.replace(controller_params(), links=("base",)),
    ),
    gazebo.find_system(ImuSensorTag): lambda: gazebo.make_plugin(
        [ImuSensorTag("s", "base", topic="<topic>")], controller_params()
    ),
    gazebo.find_system(tags.GazeboRosJointPoseTrajectory): lambda: gazebo.make_plugin(
        [tags.GazeboRosJointPoseTrajectory()], controller_params()
    ),
    gazebo.find_system(tags.GazeboRosJointStatePublisher): lambda: gazebo.make_plugin(
        [tags.GazeboRosJointStatePublisher(("joint",))], controller_params()
    ),
    gazebo.find_system(drives.DiffDrive): lambda: gazebo.make_plugin(
        [
            drives.DiffDrive(
                ("joint",),
                ("joint",),
                topic="<topic>",
                odom_topic="<odom_topic>",
                tf_topic="<tf_topic>",
            )
        ],
        dc.replace(controller_params(), robot_name="<model>"),
    ),
    gazebo.find_system(drives.AckermannSteering): lambda: gazebo.make_plugin(
        [
            drives.AckermannSteering(
                *(("joint",),) * 4,
                topic="<topic>",
                odom_topic="<odom_topic>",
                tf_topic="<tf_topic>",
            )
        ],
        controller_params(),
    ),
    gazebo.find_system(drives.MecanumDrive): lambda: gazebo.make_plugin(
        [
            drives.MecanumDrive(
                *(("joint",),) * 4,
                topic="<topic>",
                odom_topic="<odom_topic>",
                tf_topic="<tf_topic>",
            )
        ],
        controller_params(),
    ),
    gazebo.find_system(tags.GazeboRosAckermannDrive): lambda: gazebo.make_plugin(
        [
            tags.GazeboRosAckermannDrive(
                *(("joint",),) * 7,
                publish_odom=True,
                publish_odom_tf=True,
                publish_distance=True,
                base_link="base",
                wheel_radius=0.1,
                wheel_separation=0.4,
                wheel_base=0.5,
            )
        ],
        dc.replace(controller_params(), links=("base",)),
    ),
    gazebo.find_system(tags.VelocityControl): lambda: gazebo.make_plugin(
        [tags.VelocityControl(topic="<topic>")], controller_params()
    ),
    gazebo.find_system(tags.GazeboRosPlanarMove): lambda: gazebo.make_plugin(
        [tags.GazeboRosPlanarMove(base_link="base")],
        dc.replace(controller_params(), links=("base",)),
    ),
    gazebo.find_system(drives.GazeboRosDiffDrive): lambda: gazebo.make_plugin(
        [
            drives.GazeboRosDiffDrive(
                ("joint",),
                ("joint",),
                publish_odom=True,
                publish_odom_tf=True,
                base_link="base",
            )
        ],
        dc.replace(controller_params(), links=("base",)),
    ),
    AdmittanceController: make_admittance_controller,
    DiffDriveController: lambda: DiffDriveController(
        DiffDriveControllerParameters(
            ("left",),
            ("right",),
            wheel_separation=1.0,
            wheel_radius=0.1,
            use_stamped_vel=False,
            publish_limited_velocity=True,
        ),
        controller_params(),
    ),
    SteeringController: lambda: SteeringController(
        BicycleSteeringControllerParameters(
            ("rear",), ("front",), wheelbase=1.0, traction_wheel_radius=0.1
        ),
        controller_params(),
    ),
    TricycleController: lambda: TricycleController(
        TricycleControllerParameters(
            "rear",
            "front",
            wheelbase=1.0,
            wheel_radius=0.1,
            enable_odom_tf=True,
            publish_ackermann_command=True,
        ),
        controller_params(),
    ),
    MecanumDriveController: lambda: MecanumDriveController(
        MecanumDriveControllerParameters(
            *"abcd",
            kinematics=MecanumKinematicsParameters(
                wheels_radius=0.1, sum_of_robot_center_projection_on_X_Y_axis=1.0
            ),
        ),
        controller_params(),
    ),
    OmniWheelDriveController: lambda: OmniWheelDriveController(
        OmniWheelDriveControllerParameters(
            ("a", "b", "c"), wheel_offset=0.0, robot_radius=1.0, wheel_radius=0.1
        ),
        controller_params(),
    ),
    SwerveController: lambda: SwerveController(
        SwerveControllerParameters(*"abcdefgh"), controller_params()
    ),
    GpioCommandController: lambda: GpioCommandController(
        GpioCommandControllerParameters(
            ("g",), InterfacesByGpio({"g": GpioInterfaces(("x",))})
        ),
        controller_params(),
    ),
    DelayedCommands: lambda: DelayedCommands(2, delay=3, period=0.01),
    MeasuredStates: lambda: MeasuredStates(np.ones(2), (1,), delay=3, period=0.01),
    ChainedFilter: lambda: ChainedFilter(
        ChainedFilterParameters(
            ("a/position",),
            ("a/filtered",),
            {
                "filter1.name": "mean",
                "filter1.type": "filters/MeanFilterDouble",
                "filter1.params.number_of_observations": 2,
            },
        ),
        controller_params(),
    ),
    IMUSensorBroadcaster: lambda: IMUSensorBroadcaster(
        IMUSensorBroadcasterParameters("s", "frame"), controller_params()
    ),
    ForceTorqueSensorBroadcaster: lambda: ForceTorqueSensorBroadcaster(
        ForceTorqueSensorBroadcasterParameters(
            "frame",
            "s",
            sensor_filter_chain={
                "filter1.name": "low_pass",
                "filter1.type": "control_filters/LowPassFilterWrench",
                "filter1.params.sampling_frequency": 100.0,
                "filter1.params.damping_frequency": 10.0,
                "filter1.params.damping_intensity": 1.0,
            },
        ),
        controller_params(),
    ),
    RangeSensorBroadcaster: lambda: RangeSensorBroadcaster(
        RangeSensorBroadcasterParameters("s", "frame"), controller_params()
    ),
    PoseBroadcaster: lambda: PoseBroadcaster(
        PoseBroadcasterParameters("frame", "s"), controller_params()
    ),
    GPSSensorBroadcaster: lambda: GPSSensorBroadcaster(
        GPSSensorBroadcasterParameters("s", "frame"), controller_params()
    ),
    MagnetometerBroadcaster: lambda: MagnetometerBroadcaster(
        MagnetometerBroadcasterParameters("s", "frame"), controller_params()
    ),
    BatteryStateBroadcaster: lambda: BatteryStateBroadcaster(
        BatteryStateBroadcasterParameters(sensor_name="s"), controller_params()
    ),
    StateInterfacesBroadcaster: lambda: StateInterfacesBroadcaster(
        StateInterfacesBroadcasterParameters(("joint/position",)), controller_params()
    ),
    Vda5050SafetyStateBroadcaster: lambda: Vda5050SafetyStateBroadcaster(
        Vda5050SafetyStateBroadcasterParameters(SafetyInterfaces(("a/field",))),
        controller_params(),
    ),
    PassthroughController: lambda: PassthroughController(
        PassthroughControllerParameters(("joint/position",)), controller_params()
    ),
    PidController: lambda: PidController(
        PidControllerParameters(
            ("joint",), "effort", ("position",), use_external_measured_states=True
        ),
        controller_params(),
    ),
    JointTrajectoryController: lambda: JointTrajectoryController(
        JointTrajectoryControllerParameters(("joint",), ("position",), ("position",)),
        controller_params(),
    ),
}


def test_every_system_can_be_made_here() -> None:
    bases = {"ControllerInterface", "PythonSystem", "_Delay"}
    names = {system.__name__ for system in system_classes()} - bases
    assert names == {system.__name__ for system in FACTORIES}


def documented_ports(text: str, kind: str) -> list[str]:
    """Return the ports of a kind in Drake's `pydrake_system` block, in order."""
    lines = itertools.dropwhile(lambda line: f"{kind}:" not in line, text.splitlines())
    names = itertools.takewhile(lambda line: line.startswith("- "), _stripped(lines))
    return [name.removeprefix("- ") for name in names]


def _stripped(lines: Iterator[str]) -> Iterator[str]:
    next(lines, None)
    return (line.strip() for line in lines)


@pytest.mark.slow
@pytest.mark.parametrize("system_type", FACTORIES, ids=lambda type: type.__name__)
def test_a_system_documents_its_ports(system_type: type[LeafSystem]) -> None:
    system = FACTORIES[system_type]()

    ports: dict[str, list[Any]] = {
        "input_ports": [
            system.get_input_port(i) for i in range(system.num_input_ports())
        ],
        "output_ports": [
            system.get_output_port(i) for i in range(system.num_output_ports())
        ],
    }
    text = inspect.cleandoc(type(system).__doc__ or "")
    for kind, declared in ports.items():
        names = [port.get_name() for port in declared]
        assert documented_ports(text, kind) == names
        # Its row in the table.
        for name in names:
            assert re.search(rf"^{name}  ", text, re.MULTILINE), name
    assert f"name: {type(system).__name__}\n" in text


def assignments_to_self(method: ast.FunctionDef) -> Iterator[str]:
    """Yield what a method assigns to, of its own object."""
    this = method.args.args[0].arg if method.args.args else ""
    for node in ast.walk(method):
        if isinstance(node, ast.Attribute | ast.Subscript) and isinstance(
            node.ctx, ast.Store | ast.Del
        ):
            target: ast.AST = node
            while isinstance(target, ast.Attribute | ast.Subscript):
                target = target.value
            if isinstance(target, ast.Name) and target.id == this:
                yield f"line {node.lineno}: {ast.unparse(node)}"


def test_all_systems_are_freed_with_their_diagram() -> None:
    for system in system_classes():
        assert issubclass(system, PythonSystem), system.__name__


@pytest.mark.slow
def test_systems_keep_their_state_in_the_context() -> None:
    systems = {system.__name__ for system in system_classes()} | {"ControllerInterface"}
    systems -= {"PythonSystem"}  # Notes what it holds while a system is made.
    seen = set()
    for module in MODULES:
        for node in ast.walk(parse(module)):
            if not isinstance(node, ast.ClassDef) or node.name not in systems:
                continue
            seen.add(node.name)
            for method in node.body:
                # Ports and state are declared while a system is made.
                if isinstance(method, ast.FunctionDef) and not re.match(
                    "__init__$|_declare_", method.name
                ):
                    assert not list(assignments_to_self(method)), module

    assert seen == systems


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("self._a = 1", ["line 2: self._a"]),
        ("self._a += 1", ["line 2: self._a"]),
        ("self._a[0] = 1", ["line 2: self._a[0]"]),
        ("x, self.a.b = 1, 2", ["line 2: self.a.b"]),
        ("del self._a", ["line 2: self._a"]),
        ("x = self._a", []),
        ("x.a = self._a", []),
    ],
)
def test_an_assignment_to_self_is_found(text: str, found: list[str]) -> None:
    (method,) = ast.parse(f"def update(self, x):\n    {text}").body
    assert isinstance(method, ast.FunctionDef)

    assert list(assignments_to_self(method)) == found
