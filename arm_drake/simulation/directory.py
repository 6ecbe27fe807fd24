"""Directory of a diagram: its robots, their managers and controllers, by name."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, NamedTuple, get_args

from pydrake.systems.framework import Context, Diagram

from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.errors import InputError, suggest
from arm_drake.manager import ControllerManager
from arm_drake.manager.loaded_controllers import ControllerState, LoadedController
from arm_drake.messages import Strictness, SwitchController


class ControllerList(list[ControllerState]):
    """Controllers and their states; as text, a line for each."""

    def __str__(self) -> str:
        """Return what `ros2 control list_controllers` prints: name, type and state."""
        return _align((row.name, row.type, row.state) for row in self)


class TopicInfo(NamedTuple):
    """A row of the list of topics."""

    name: str

    # Class of its messages.
    type: str

    # Whether a controller takes its messages, or publishes them.
    direction: Literal["input", "output"]

    # Topics of Gazebo that a bridge connects it with.
    bridged_to: tuple[str, ...] = ()


class TopicList(list[TopicInfo]):
    """Topics and their types; as text, a line for each."""

    def __str__(self) -> str:
        """Return a table: name, type, direction, and what it is bridged to."""
        return _align(
            (row.name, row.type, f"{row.direction:6}  {', '.join(row.bridged_to)}")
            for row in self
        )


def _align(rows: Iterable[tuple[str, str, str]]) -> str:
    """Return rows as lines, in three columns."""
    rows = list(rows)
    name, kind = (max((len(row[k]) for row in rows), default=0) for k in (0, 1))
    return "\n".join(f"{a:{name}}  {b:{kind}}  {c}".rstrip() for a, b, c in rows)


def make_switch(
    activate: Sequence[str], deactivate: Sequence[str], strictness: Strictness
) -> SwitchController:
    """Return the request for a switch."""
    if strictness not in (known := get_args(Strictness)):
        hint = suggest(str(strictness), known)
        raise InputError(f"unknown strictness {strictness!r}; {hint}")
    fields: Any = (activate, deactivate, strictness)  # The request checks them.
    try:
        return SwitchController(*fields)
    except ValueError as error:
        raise InputError(str(error)) from None


class Directory:
    """Finds robots and controllers of a diagram.

    Where there are several robots, a controller's name is `<robot>/<name>`.
    """

    def __init__(self, diagram: Diagram) -> None:
        """Create it for a diagram; without a robot it is an InputError."""
        self.managers: Mapping[str, ControllerManager] = {
            system.robot.name: system
            for system in diagram.GetSystems()
            if isinstance(system, ControllerManager)
        }
        if not self.managers:
            raise InputError(
                "the diagram has no robot at its top; expected one of build_diagram"
            )
        self._controllers: Mapping[str, tuple[ControllerManager, LoadedController]] = {
            f"{manager.prefix}{controller.name}": (manager, controller)
            for manager in self.managers.values()
            for controller in manager.controllers
        }

    @staticmethod
    def checked(diagram: object) -> Diagram:
        """Return a diagram; an InputError if it is something else."""
        if isinstance(diagram, Diagram):
            return diagram
        got = f"got {type(diagram).__name__}"
        raise InputError(f"expected the Diagram of build_diagram(robot), {got}")

    def manager(self, robot: str | None) -> ControllerManager:
        """Return a robot's controller manager; that of the first one for None."""
        if robot is None:
            return next(iter(self.managers.values()))
        if not isinstance(robot, str) or robot not in self.managers:
            hint = suggest(str(robot), self.managers)
            raise InputError(f"no robot {robot!r}; {hint}")
        return self.managers[robot]

    def check_name(self, name: str) -> None:
        """Raise InputError if there is no controller of this name."""
        if not isinstance(name, str) or name not in self._controllers:
            hint = suggest(str(name), self._controllers)
            raise InputError(f"no controller {name!r}; {hint}")

    def find(
        self, name: str
    ) -> tuple[ControllerManager, LoadedController, ControllerInterface]:
        """Return a controller's manager, itself, and its system."""
        self.check_name(name)
        manager, controller = self._controllers[name]
        if controller.system is None:
            why = controller.problem or "see the report"
            raise InputError(f"controller {name!r} could not be loaded: {why}")
        return manager, controller, controller.system

    def list_controllers(self, context: Context) -> ControllerList:
        """Return the controllers and their states, in the order of the YAML."""
        return ControllerList(
            row._replace(name=f"{manager.prefix}{row.name}")
            for manager in self.managers.values()
            for row in manager.GetOutputPort("controllers").Eval(
                manager.GetMyContextFromRoot(context)
            )
        )

    def address(
        self, request: SwitchController, robot: str | None
    ) -> tuple[ControllerManager, SwitchController]:
        """Return a request's manager, and a new request with the names known to it.

        Its names are those of this robot, without it those of `find`, or else of the
        first robot. If there is none, or it is no such request, it is an InputError.
        """
        if not isinstance(request, SwitchController):
            raise InputError(f"expected a SwitchController, got {request!r}")
        lists = (request.activate_controllers, request.deactivate_controllers)
        manager, prefix = self.manager(robot), ""
        if robot is None:
            names = [name for names in lists for name in names]
            for other in self.managers.values():
                if names and all(name.startswith(other.prefix) for name in names):
                    manager, prefix = other, other.prefix
        activate, deactivate = (
            tuple(name.removeprefix(prefix) for name in names) for names in lists
        )
        return manager, SwitchController(activate, deactivate, request.strictness)
