"""Open, close and a slider for the action of a gripper."""

from typing import TYPE_CHECKING

from arm_drake import interfaces
from arm_drake.messages import GripperCommand
from arm_drake.visualization.page.axes import find_axis
from arm_drake.visualization.page.remote import Remote, shown
from arm_drake.visualization.page.widgets import Button, Buttons, Slider

if TYPE_CHECKING:
    from arm_drake.simulation.mailbox import GoalHandle
    from arm_drake.simulation.simulation import Simulation

# Effort of a gripper that commands efforts, where its joint has no limit [N·m] or [N].
_EFFORT = 10.0


class GripperRemote(Remote):
    """Moves the joint of a controller with the action `gripper_cmd`."""

    def __init__(self, simulation: "Simulation", controller: str) -> None:
        """Create it; `find_remotes` does that.

        Args:
            simulation: Where the controller runs.
            controller: Its name with its robot's prefix.
        """
        super().__init__(simulation, controller)
        system, params = self._system, self._system.params
        end = f"/{interfaces.POSITION}"
        name = next(n for n in system.state_interfaces if n.endswith(end))
        self._axis = find_axis(self._manager.robot, params, name)
        self._ends = params.gripper_ranges.get(self._axis.joint)
        # Without an effort, one that commands efforts does nothing; others take 0 for
        # their default.
        self._effort = 0.0
        if f"{self._axis.joint}/{interfaces.EFFORT}" == system.command_interfaces[0]:
            limit = params.effort_limits.get(self._axis.joint)
            self._effort = _EFFORT if limit is None else limit
        # Position of the last goal.
        self._goal: float | None = None
        joint, lower, upper = self._axis.joint, self._axis.lower, self._axis.upper
        slider = Slider(self._id("position"), joint, lower, upper, 0.0, self._axis.unit)
        self._layout = (slider,)
        if self._ends is not None:
            buttons = tuple(Button(self._id(t), t) for t in ("open", "close"))
            self._layout = (slider, Buttons(buttons))

    def move_to(self, position: float) -> "GoalHandle":
        """Send a goal.

        Args:
            position: Position of the gripper's joint [rad] or [m].

        Raises:
            InputError: If the controller isn't active, or the position isn't finite.
        """
        at = self._number(position, "position")
        self._prepare()
        goal = self._handle.send_goal(GripperCommand(at, self._effort))
        self._goal = at
        return goal

    def open(self) -> "GoalHandle":
        """Open it.

        Raises:
            InputError: As `move_to`, and if it isn't known where it is open.
        """
        return self._grip(0)

    def close(self) -> "GoalHandle":
        """Close it; raises as `open`."""
        return self._grip(1)

    def _grip(self, end: int) -> "GoalHandle":
        if self._ends is None:
            joint = self._axis.joint
            raise self._error(f"joint {joint!r} has no limits to tell open from closed")
        return self.move_to(self._ends[end])

    def _forget(self) -> None:
        self._goal = None

    def _values(self) -> dict[str, float]:
        if self._goal is not None:
            return {"position": self._goal}
        return {"position": shown(self._measured()[self._axis.joint])}

    def _act(self, part: str, value: float | None) -> None:
        if value is None:
            self._grip(("open", "close").index(part))
        else:
            self.move_to(value)
