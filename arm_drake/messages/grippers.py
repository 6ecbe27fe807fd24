"""Actions that move grippers, and plain numbers on topics."""

import dataclasses as dc

from arm_drake.messages.base import JointState, Message
from arm_drake.messages.checks import check_type, to_float, to_floats, to_names


@dc.dataclass(frozen=True, eq=False)
class Float64(Message):
    """A number (`std_msgs`); each message is one of its own."""

    data: float = 0.0

    def __post_init__(self) -> None:
        """Take numbers as they come."""
        object.__setattr__(self, "data", to_float(self.data, "data"))


@dc.dataclass(frozen=True, eq=False)
class Float32(Float64):
    """A number (`std_msgs`), kept with the digits that it is given."""


@dc.dataclass(frozen=True, eq=False)
class Bool(Message):
    """Yes or no (`std_msgs`); each message is one of its own."""

    data: bool = False

    def __post_init__(self) -> None:
        """Take nothing else."""
        check_type(self.data, bool, "data")


@dc.dataclass(frozen=True)
class GripperCommand(Message):
    """Where a gripper is to go (`control_msgs/GripperCommand`)."""

    # [rad] or [m].
    position: float = 0.0

    # Largest effort on the way [N·m] or [N].
    max_effort: float = 0.0

    def __post_init__(self) -> None:
        """Take numbers as they come."""
        for field in ("position", "max_effort"):
            number = to_float(getattr(self, field), field)
            object.__setattr__(self, field, number)


@dc.dataclass(frozen=True)
class GripperCommandGoal(Message):
    """Goal of the action `control_msgs/GripperCommand`."""

    command: GripperCommand = GripperCommand()

    def __post_init__(self) -> None:
        """Refuse anything but a command."""
        check_type(self.command, GripperCommand, "command")


@dc.dataclass(frozen=True)
class GripperCommandResult(Message):
    """Result of the action `control_msgs/GripperCommand`."""

    # [rad] or [m].
    position: float = 0.0

    # [N·m] or [N].
    effort: float = 0.0

    # Whether the gripper stopped on the way, or got where it should.
    stalled: bool = False
    reached_goal: bool = False


@dc.dataclass(frozen=True)
class ParallelGripperCommandGoal(Message):
    """Goal of the action `control_msgs/ParallelGripperCommand`."""

    # One position [rad] or [m]; at most one velocity and one effort, which limit the
    # motion [rad/s], [N·m] or [m/s], [N].
    command: JointState = dc.field(default_factory=JointState)

    def __post_init__(self) -> None:
        """Take sequences as they come."""
        given = self.command
        check_type(given, JointState, "command")
        name = to_names(given.name, "command.name")
        position, velocity, effort = (
            to_floats(getattr(given, field), f"command.{field}")
            for field in ("position", "velocity", "effort")
        )
        checked = JointState(given.header, name, position, velocity, effort)
        object.__setattr__(self, "command", checked)


@dc.dataclass(frozen=True)
class ParallelGripperCommandResult(Message):
    """Result of the action `control_msgs/ParallelGripperCommand`."""

    # Position [rad] or [m] of the joint, if its controller knows it.
    state: JointState = dc.field(default_factory=JointState)

    # Whether the gripper stopped on the way, or got where it should.
    stalled: bool = False
    reached_goal: bool = False
