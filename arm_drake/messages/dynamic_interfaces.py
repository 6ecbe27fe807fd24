"""Values of interfaces in groups, such as those of GPIOs (`control_msgs`)."""

import dataclasses as dc

from arm_drake.messages.base import Header, Message
from arm_drake.messages.checks import to_floats, to_message, to_names
from arm_drake.messages.control import InterfaceValue


@dc.dataclass(frozen=True, eq=False)
class DynamicInterfaceGroupValues(Message):
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
        values = self.__dict__
        values["header"] = to_message(self.header, Header, "header")
        values["interface_groups"] = to_names(self.interface_groups, "interface_groups")
        values["interface_values"] = _to_values(self.interface_values)


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
