"""Commands and states of controllers other than trajectories, and of their manager."""

import dataclasses as dc
from typing import Literal

from arm_drake.importing import dataclass
from arm_drake.messages.base import (
    Header,
    JointState,
    Message,
    check_type,
    take_numbers,
    to_floats,
    to_message,
    to_names,
)
from arm_drake.messages.geometry import (
    Quaternion,
    TransformStamped,
    Twist,
    TwistStamped,
    WrenchStamped,
)

# What `arm_drake.messages` has of it.
__all__ = [
    "AckermannDrive",
    "AdmittanceControllerState",
    "Bool",
    "DynamicInterfaceGroupValues",
    "DynamicJointState",
    "Float32",
    "Float64",
    "Float64MultiArray",
    "GripperCommand",
    "GripperCommandGoal",
    "GripperCommandResult",
    "Int8MultiArray",
    "InterfaceValue",
    "MecanumDriveControllerState",
    "MultiDOFCommand",
    "MultiDOFState",
    "MultiDOFStateStamped",
    "ParallelGripperCommandGoal",
    "ParallelGripperCommandResult",
    "ParametersRejected",
    "ResetOdometry",
    "SteeringControllerStatus",
    "Strictness",
    "String",
    "SwitchController",
    "SwitchControllerResult",
]

Strictness = Literal["strict", "best_effort"]
_STRICTNESS = ("strict", "best_effort", "")


@dataclass(frozen=True, eq=False)
class Float64MultiArray(Message, ros="std_msgs"):
    """Numbers in an agreed order (`std_msgs`); each message is one of its own."""

    data: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Take sequences as they come."""
        object.__setattr__(self, "data", to_floats(self.data, "data"))


@dataclass(frozen=True, eq=False)
class MultiDOFCommand(Message, ros="control_msgs"):
    """References of degrees of freedom, n of them (`control_msgs`)."""

    # Names; () stands for all, in the order of the controller.
    dof_names: tuple[str, ...] = ()

    # References, shape (n,), and their rates of change, shape (n,) or ().
    values: tuple[float, ...] = ()
    values_dot: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Take sequences as they come."""
        object.__setattr__(self, "dof_names", to_names(self.dof_names, "dof_names"))
        for field in ("values", "values_dot"):
            object.__setattr__(self, field, to_floats(getattr(self, field), field))


@dataclass(frozen=True)
class MultiDOFState(Message, ros="control_msgs/msg/SingleDOFState"):
    """State of one degree of freedom (`control_msgs/SingleDOFState`)."""

    name: str = ""
    reference: float = 0.0
    feedback: float = 0.0
    feedback_dot: float = 0.0
    error: float = 0.0
    error_dot: float = 0.0

    # Period of the controller [s].
    time_step: float = 0.0
    output: float = 0.0


@dataclass(frozen=True)
class MultiDOFStateStamped(Message, ros="control_msgs"):
    """States of degrees of freedom (`control_msgs`)."""

    header: Header = Header()
    dof_states: tuple[MultiDOFState, ...] = ()


@dataclass(frozen=True)
class ParametersRejected(Message):
    """Event: a controller didn't take parameters while it runs."""

    reason: str


@dataclass(frozen=True)
class InterfaceValue(Message, ros="control_msgs"):
    """Values of interfaces of one joint or other component (`control_msgs`)."""

    interface_names: tuple[str, ...] = ()

    # As many, each in the unit of its interface.
    values: tuple[float, ...] = ()


@dataclass(frozen=True)
class DynamicJointState(Message, ros="control_msgs"):
    """State of joints, sensors and GPIOs with any interfaces (`control_msgs`)."""

    header: Header = Header()
    joint_names: tuple[str, ...] = ()

    # As many.
    interface_values: tuple[InterfaceValue, ...] = ()


@dataclass(frozen=True, eq=False)
class SwitchController(Message):
    """Request of the service `controller_manager_msgs/SwitchController`."""

    activate_controllers: tuple[str, ...] = ()
    deactivate_controllers: tuple[str, ...] = ()

    # "strict": all or nothing; "best_effort": what is possible; "": as the manager's
    # parameter defaults.switch_controller.strictness says.
    strictness: Strictness | Literal[""] = ""

    def __post_init__(self) -> None:
        """Take sequences as they come, and refuse what no service would get."""
        for field in ("activate_controllers", "deactivate_controllers"):
            names = to_names(getattr(self, field), field, noun="names of controllers")
            object.__setattr__(self, field, names)
        if self.strictness not in _STRICTNESS:
            raise ValueError(
                f"strictness: expected one of {', '.join(map(repr, _STRICTNESS))}, "
                f"got {self.strictness!r}"
            )


@dataclass(frozen=True)
class SwitchControllerResult(Message):
    """Result of a SwitchController request."""

    request: SwitchController
    ok: bool

    # Why not, or what was left out; empty if there is nothing to say.
    message: str = ""


@dataclass(frozen=True, eq=False)
class Float64(Message, ros="std_msgs"):
    """A number (`std_msgs`); each message is one of its own."""

    data: float = 0.0

    def __post_init__(self) -> None:
        """Take numbers as they come."""
        take_numbers(self, "data")


@dataclass(frozen=True, eq=False)
class Float32(Float64, ros="std_msgs"):
    """A number (`std_msgs`), kept with its own digits."""


@dataclass(frozen=True, eq=False)
class Bool(Message, ros="std_msgs"):
    """Yes or no (`std_msgs`); each message is one of its own."""

    data: bool = False

    def __post_init__(self) -> None:
        """Take nothing else."""
        check_type(self.data, bool, "data")


@dataclass(frozen=True)
class GripperCommand(Message, ros="control_msgs"):
    """Target of a gripper (`control_msgs/GripperCommand`)."""

    # [rad] or [m].
    position: float = 0.0

    # Largest effort on the way [N·m] or [N].
    max_effort: float = 0.0

    def __post_init__(self) -> None:
        """Take numbers as they come."""
        take_numbers(self, "position", "max_effort")


@dataclass(frozen=True)
class GripperCommandGoal(Message, ros="control_msgs/action/GripperCommand_Goal"):
    """Goal of the action `control_msgs/GripperCommand`."""

    command: GripperCommand = GripperCommand()

    def __post_init__(self) -> None:
        """Refuse anything but a command."""
        check_type(self.command, GripperCommand, "command")


@dataclass(frozen=True)
class GripperCommandResult(Message):
    """Result of the action `control_msgs/GripperCommand`."""

    # [rad] or [m].
    position: float = 0.0

    # [N·m] or [N].
    effort: float = 0.0

    # Whether the gripper stopped on the way, or got where it should.
    stalled: bool = False
    reached_goal: bool = False


@dataclass(frozen=True)
class ParallelGripperCommandGoal(
    Message, ros="control_msgs/action/ParallelGripperCommand_Goal"
):
    """Goal of the action `control_msgs/ParallelGripperCommand`."""

    # One position [rad] or [m]; at most one velocity and one effort, which limit the
    # motion [rad/s], [N·m] or [m/s], [N].
    command: JointState = dc.field(default_factory=JointState)

    def __post_init__(self) -> None:
        """Take sequences as they come."""
        command = self.command
        check_type(command, JointState, "command")
        name = to_names(command.name, "command.name")
        position, velocity, effort = (
            to_floats(getattr(command, field), f"command.{field}")
            for field in ("position", "velocity", "effort")
        )
        checked = JointState(command.header, name, position, velocity, effort)
        object.__setattr__(self, "command", checked)


@dataclass(frozen=True)
class ParallelGripperCommandResult(Message):
    """Result of the action `control_msgs/ParallelGripperCommand`."""

    # Position [rad] or [m] of the joint, if its controller knows it.
    state: JointState = dc.field(default_factory=JointState)

    # Whether the gripper stopped on the way, or got where it should.
    stalled: bool = False
    reached_goal: bool = False


@dataclass(frozen=True)
class Int8MultiArray(Message, ros="std_msgs"):
    """Small numbers in an agreed order (`std_msgs`)."""

    data: tuple[int, ...] = ()


@dataclass(frozen=True)
class String(Message, ros="std_msgs"):
    """A text (`std_msgs`)."""

    data: str = ""


@dataclass(frozen=True)
class AdmittanceControllerState(Message, ros="control_msgs"):
    """State of an AdmittanceController (`control_msgs`).

    What is given for six axes is along, then about x, y and z of the control frame.
    """

    # What joints are moved by beside their references; the efforts are accelerations.
    joint_state: JointState = dc.field(default_factory=JointState)

    # [N·s/m] and [N·m·s/rad], [kg] and [kg·m^2], each of six values.
    damping: Float64MultiArray = dc.field(default_factory=Float64MultiArray)
    mass: Float64MultiArray = dc.field(default_factory=Float64MultiArray)

    # 1 where the wrench counts.
    selected_axes: Int8MultiArray = dc.field(default_factory=Int8MultiArray)

    # [N/m] and [N·m/rad], six values.
    stiffness: Float64MultiArray = dc.field(default_factory=Float64MultiArray)

    # Filtered wrench, and how it moves the sensor's frame, in the base of the chain.
    wrench_base: WrenchStamped = dc.field(default_factory=WrenchStamped)
    admittance_acceleration: TwistStamped = dc.field(default_factory=TwistStamped)
    admittance_velocity: TwistStamped = dc.field(default_factory=TwistStamped)
    admittance_position: TransformStamped = dc.field(default_factory=TransformStamped)

    # Orientation of the control frame in the base.
    rot_base_control: Quaternion = dc.field(default_factory=Quaternion)

    # Where the sensor's frame is at the references.
    ref_trans_base_ft: TransformStamped = dc.field(default_factory=TransformStamped)

    ft_sensor_frame: String = dc.field(default_factory=String)


@dataclass(frozen=True)
class MecanumDriveControllerState(Message, ros="control_msgs"):
    """State of a MecanumDriveController (`control_msgs`)."""

    header: Header = Header()

    # Measured velocities of the wheels [rad/s].
    front_left_wheel_velocity: float = 0.0
    front_right_wheel_velocity: float = 0.0
    back_right_wheel_velocity: float = 0.0
    back_left_wheel_velocity: float = 0.0

    # What is asked for, before limits; NaN if there is nothing.
    reference_velocity: Twist = dc.field(default_factory=Twist)


@dataclass(frozen=True)
class SteeringControllerStatus(Message, ros="control_msgs"):
    """Measurements and commands of a steering controller (`control_msgs`).

    Of two wheels the right one comes first.
    """

    header: Header = Header()

    # Of the driven wheels: [rad] where positions are read, else (), and [rad/s] where
    # velocities are read, else ().
    traction_wheels_position: tuple[float, ...] = ()
    traction_wheels_velocity: tuple[float, ...] = ()

    # Of the steered wheels [rad].
    steer_positions: tuple[float, ...] = ()

    # Commands of the driven [rad/s] and of the steered wheels [rad]; NaN where there
    # was none yet.
    traction_command: tuple[float, ...] = ()
    steering_angle_command: tuple[float, ...] = ()


@dataclass(frozen=True)
class AckermannDrive(Message, ros="ackermann_msgs"):
    """Motion command of a steered base (`ackermann_msgs`)."""

    # [rad], and its rate of change [rad/s].
    steering_angle: float = 0.0
    steering_angle_velocity: float = 0.0

    # [m/s]; upstream's tricycle_controller puts the wheel's velocity here [rad/s].
    speed: float = 0.0

    # [m/s^2].
    acceleration: float = 0.0

    # [m/s^3].
    jerk: float = 0.0


@dataclass(frozen=True, eq=False)
class ResetOdometry(Message):
    """Request of the service `reset_odometry` (`std_srvs/Empty`), one of its own."""


@dataclass(frozen=True, eq=False)
class DynamicInterfaceGroupValues(Message, ros="control_msgs"):
    """Values of interfaces by group; each message is one of its own.

    Header and values may be given as mappings of their fields. Whether there are as
    many values as names is for who receives it to judge.
    """

    header: Header = Header()

    # Such as GPIOs.
    interface_groups: tuple[str, ...] = ()

    # Of each group.
    interface_values: tuple[InterfaceValue, ...] = ()

    def __post_init__(self) -> None:
        """Take sequences and mappings as they come."""
        groups = to_names(self.interface_groups, "interface_groups")
        object.__setattr__(self, "header", to_message(self.header, Header, "header"))
        object.__setattr__(self, "interface_groups", groups)
        object.__setattr__(self, "interface_values", _to_values(self.interface_values))


def _to_values(values: object) -> tuple[InterfaceValue, ...]:
    field = "interface_values"
    if not isinstance(values, list | tuple):
        raise ValueError(
            f"{field}: expected a sequence of InterfaceValue, got {values!r}"
        )
    taken = []
    for index, value in enumerate(values):
        place = f"{field}[{index}]"
        message = to_message(value, InterfaceValue, place)
        names = to_names(message.interface_names, f"{place}.interface_names")
        numbers = to_floats(message.values, f"{place}.values")
        taken.append(InterfaceValue(names, numbers))
    return tuple(taken)
