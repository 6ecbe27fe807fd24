"""Commands and states of controllers other than trajectories, and of their manager."""

import dataclasses as dc
from typing import Literal

from arm_drake.messages.base import Header, Message
from arm_drake.messages.checks import to_floats, to_names

Strictness = Literal["strict", "best_effort"]
_STRICTNESS = ("strict", "best_effort", "")


@dc.dataclass(frozen=True, eq=False)
class Float64MultiArray(Message):
    """Numbers in an agreed order (`std_msgs`); each message is one of its own."""

    data: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Take sequences as they come."""
        object.__setattr__(self, "data", to_floats(self.data, "data"))


@dc.dataclass(frozen=True, eq=False)
class MultiDOFCommand(Message):
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


@dc.dataclass(frozen=True)
class MultiDOFState(Message):
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


@dc.dataclass(frozen=True)
class MultiDOFStateStamped(Message):
    """States of degrees of freedom (`control_msgs`)."""

    header: Header = Header()
    dof_states: tuple[MultiDOFState, ...] = ()


@dc.dataclass(frozen=True)
class ParametersRejected(Message):
    """News of parameters that a controller didn't take while it runs."""

    reason: str


@dc.dataclass(frozen=True)
class InterfaceValue(Message):
    """Values of interfaces of one joint or other component (`control_msgs`)."""

    interface_names: tuple[str, ...] = ()

    # As many, each in the unit of its interface.
    values: tuple[float, ...] = ()


@dc.dataclass(frozen=True)
class DynamicJointState(Message):
    """State of joints, sensors and GPIOs with any interfaces (`control_msgs`)."""

    header: Header = Header()
    joint_names: tuple[str, ...] = ()

    # As many.
    interface_values: tuple[InterfaceValue, ...] = ()


@dc.dataclass(frozen=True, eq=False)
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


@dc.dataclass(frozen=True)
class SwitchControllerResult(Message):
    """What became of a SwitchController request."""

    request: SwitchController
    ok: bool

    # Why not, or what was left out; empty if there is nothing to say.
    message: str = ""
