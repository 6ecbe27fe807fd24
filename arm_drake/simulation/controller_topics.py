"""What a controller can be sent: its topics, and messages as it takes them."""

import dataclasses as dc
import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from arm_drake import interfaces
from arm_drake.controllers.controller_interface_part import ControllerInterface
from arm_drake.errors import InputError
from arm_drake.manager.exports import exported_name, with_prefix
from arm_drake.messages import (
    Float64MultiArray,
    FollowJointTrajectoryGoal,
    Goal,
    GripperCommand,
    GripperCommandGoal,
    GripperCommandResult,
    JointState,
    JointTrajectory,
    Message,
    MultiDOFCommand,
    ParallelGripperCommandGoal,
    ParallelGripperCommandResult,
    SpeedScalingFactor,
    Twist,
    TwistStamped,
)

# A class of messages; in a class with a field `type` it has no other name.
_Kind: TypeAlias = type[Message]

# Input ports of controllers.
ACTIONS: Mapping[str, tuple[type, ...]] = {
    "follow_joint_trajectory": (FollowJointTrajectoryGoal,),
    "gripper_cmd": (GripperCommandGoal, ParallelGripperCommandGoal),
}
TOPIC = "joint_trajectory"
COMMANDS = "commands"
REFERENCE = "reference"
VELOCITY = "cmd_vel"
SPEED_SCALING = "speed_scaling_input"


@dc.dataclass(frozen=True)
class ControllerTopics:
    """Makes messages for one controller, or an error that says what it takes."""

    # Name of the controller with its robot's prefix, and its ros2_control type.
    name: str
    type: str

    system: ControllerInterface

    def check(self, port: str) -> None:
        """Raise InputError if the controller has no such input port."""
        if self.system.HasInputPort(port):
            return
        names = [
            self.system.get_input_port(index).get_name()
            for index in range(self.system.num_input_ports())
        ]
        topics = ", ".join(name for name in names if not interfaces.is_internal(name))
        takes = f"; it takes {topics}" if topics else ""
        raise InputError(
            f"controller {self.name!r} of type {self.type!r} has no {port}{takes}"
        )

    def exported_as(self, port: str) -> str:
        """Return the name in the diagram of a port of the controller."""
        own = self.system.params.controller_name
        return with_prefix(self.name.removesuffix(own), exported_name(port, own))

    def find_action(self) -> str:
        """Return the port of the controller's action.

        Raises:
            InputError: If it has none.
        """
        for port in ACTIONS:
            if self.system.HasInputPort(port):
                return port
        self.check(next(iter(ACTIONS)))
        raise AssertionError

    def make_goal(
        self, given: Goal | JointTrajectory | GripperCommand
    ) -> tuple[str, Goal]:
        """Return the port of the controller's action, and a goal as it takes it.

        Args:
            given: A goal, or its trajectory or command alone.

        Raises:
            InputError: If it has no action, or one of another kind.
        """
        goal: Any = given
        if isinstance(given, JointTrajectory):
            goal = FollowJointTrajectoryGoal(trajectory=given)
        elif isinstance(given, GripperCommand):
            goal = GripperCommandGoal(given)
        wanted = getattr(self.system, "goal_type", None)
        if wanted is ParallelGripperCommandGoal and isinstance(
            goal, GripperCommandGoal
        ):
            goal = _parallel_goal(goal.command)
        for port, kinds in ACTIONS.items():
            if isinstance(goal, kinds):
                self.check(port)
        if wanted is not None and not isinstance(goal, wanted):
            raise self._error(
                f"expected a {wanted.__name__}, got a {type(goal).__name__}"
            )
        return self.find_action(), goal

    def make_command(
        self, values: Sequence[float], values_dot: Sequence[float] = ()
    ) -> tuple[str, Float64MultiArray | MultiDOFCommand]:
        """Return the port on which the controller takes commands, and the message.

        Args:
            values: Commands of its interfaces, or references, in its order.
            values_dot: Rates of change of references, or none.

        Raises:
            InputError: If it takes none, others, or another number of them.
        """
        system = self.system
        if self._takes(COMMANDS, Float64MultiArray):
            if len(values_dot):
                raise self._error("it takes no rates (values_dot)")
            data = self._check_values(values, system.command_interfaces)
            return COMMANDS, Float64MultiArray(data)
        if not self._takes(REFERENCE, MultiDOFCommand):
            if system.HasInputPort(COMMANDS):
                raise self._error(f"its {COMMANDS} aren't numbers; see `sim.topic`")
            self.check(COMMANDS)
        # All names of the first interface come first.
        prefix = f"{system.params.controller_name}/"
        references = [n.removeprefix(prefix) for n in system.reference_interfaces]
        num_dofs = len(system.command_interfaces)
        dofs, rates = references[:num_dofs], references[num_dofs:]
        data = self._check_values(values, dofs)
        data_dot: tuple[float, ...] = ()
        if len(values_dot):
            if not rates:
                second = "a second one of reference_and_state_interfaces"
                raise self._error(f"it takes no rates (values_dot) without {second}")
            data_dot = self._check_values(values_dot, rates)
        names = tuple(dof.rpartition("/")[0] for dof in dofs)
        return REFERENCE, MultiDOFCommand(names, data, data_dot)

    def make_velocity(self, twist: Twist) -> tuple[str, Twist | TwistStamped]:
        """Return the port on which a base takes velocities, and the message.

        Args:
            twist: Velocity of the base, as of the tick that takes it.

        Raises:
            InputError: If it takes none.
        """
        message = TwistStamped(twist=twist)
        types = getattr(self.system, "message_types", {})
        for port in (VELOCITY, REFERENCE):
            if types.get(port) is TwistStamped:
                return port, message
        for port, kind in types.items():
            # Gazebo's plugins call their ports as their tags say.
            if kind is Twist and port.startswith("/"):
                return port, dc.replace(twist)
        self.check(VELOCITY)
        raise AssertionError

    def _takes(self, port: str, kind: _Kind) -> bool:
        """Return whether the controller has a port, and messages of a kind go there."""
        types = getattr(self.system, "message_types", {})
        return self.system.HasInputPort(port) and types.get(port, kind) is kind

    def make_speed_scaling(self, factor: float) -> SpeedScalingFactor:
        """Return a speed scaling.

        Args:
            factor: How fast time passes, at least 0.

        Raises:
            InputError: If it is something else.
        """
        if not _is_finite(factor) or factor < 0.0:
            raise self._error(
                f"expected a speed scaling factor of at least 0, got {factor!r}"
            )
        return SpeedScalingFactor(float(factor))

    def _check_values(
        self, values: Sequence[float], names: Sequence[str]
    ) -> tuple[float, ...]:
        """Return finite numbers, one for each name."""
        noun = "value" if len(names) == 1 else "values"
        expected = f"expected {len(names)} {noun} ({', '.join(names)})"
        try:
            given = list(values)
        except TypeError:
            raise self._error(f"{expected}, got {values!r}") from None
        if len(given) != len(names):
            raise self._error(f"{expected}, got {len(given)}")
        for name, value in zip(names, given, strict=True):
            if not _is_finite(value):
                raise self._error(f"{name}: expected a finite number, got {value!r}")
        return tuple(map(float, given))

    def _error(self, problem: str) -> InputError:
        return InputError(f"controller {self.name!r}: {problem}")


def _is_finite(value: Any) -> bool:
    """Return whether a value is a finite number."""
    try:
        return not isinstance(value, bool) and math.isfinite(value)
    except (TypeError, OverflowError):
        return False


def _parallel_goal(command: GripperCommand) -> ParallelGripperCommandGoal:
    """Return what a command is to a gripper with limits; no effort is the default."""
    effort = (command.max_effort,) if command.max_effort else ()
    state = JointState(position=(command.position,), effort=effort)
    return ParallelGripperCommandGoal(state)


def describe_grip(
    result: GripperCommandResult | ParallelGripperCommandResult,
    position: Sequence[float],
) -> str:
    """Return how a gripper's motion ended, if it did by itself.

    Args:
        result: Result of the action.
        position: Where it ended [rad] or [m].
    """
    if not (result.stalled or result.reached_goal):
        return ""
    how = "stalled" if result.stalled else "reached the goal"
    return f", {how} at {', '.join(f'{q:.4g}' for q in position)}"
