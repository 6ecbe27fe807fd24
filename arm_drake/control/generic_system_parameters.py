"""Parameters of `mock_components/GenericSystem`.

The rules are those of ros2_control's ``generic_system.cpp``, version 6.8.0.
"""

from collections.abc import Iterator
from math import isfinite
from typing import Final, NamedTuple, Self

from arm_drake.description.elements import parse_bool, parse_number
from arm_drake.description.hardware_info import HardwareInfo
from arm_drake.errors import DescriptionError
from arm_drake.interfaces import ACCELERATION, POSITION, VELOCITY

# What a joint can be commanded by with `calculate_dynamics`.
MODES: Final = (POSITION, VELOCITY, ACCELERATION)


class Parameters(NamedTuple):
    """Parameters of the `<hardware>`, named as there, and whose rules hold."""

    calculate_dynamics: bool
    disable_commands: bool
    mock_sensor_commands: bool
    mock_gpio_commands: bool
    position_state_following_offset: float
    custom_interface_with_following_offset: str
    humble: bool

    @classmethod
    def of(cls, block: HardwareInfo, *, humble: bool) -> Self:
        """Return the parameters of a block.

        Raises:
            DescriptionError: If one has no valid value.
        """
        offset = _number(block, "position_state_following_offset")
        custom = block.parameters.get("custom_interface_with_following_offset", "")
        return cls(
            _bool(block, "calculate_dynamics"),
            _bool(block, "disable_commands"),
            _bool(block, "mock_sensor_commands", "fake_sensor_commands"),
            _bool(block, "mock_gpio_commands", "fake_gpio_commands"),
            offset or 0.0,
            # Upstream reads it only beside an offset, be it 0.
            "" if offset is None else custom,
            humble,
        )

    @property
    def position_offset(self) -> float:
        """What is added to the positions themselves."""
        custom = self.custom_interface_with_following_offset
        return 0.0 if custom else self.position_state_following_offset

    @property
    def calculated(self) -> tuple[str, ...]:
        """Interfaces of joints that aren't simply mirrored."""
        return MODES if self.calculate_dynamics else (POSITION,)

    def warnings(self, block: HardwareInfo) -> Iterator[str]:
        """Yield what a user should be told about the parameters."""
        if self.disable_commands:
            yield "disable_commands is true: the states never change"
        custom = self.custom_interface_with_following_offset
        others = {i.name for c in block.joints for i in c.state_interfaces}
        others -= set(self.calculated)
        if custom and custom not in others:
            yield (
                f"custom_interface_with_following_offset is {custom!r}, which no joint "
                "mirrors as a state interface: the offset is added to nothing"
            )


def _bool(block: HardwareInfo, *names: str) -> bool:
    """Return the parameter of the first of these names that is given, or False."""
    for name in names:
        text = block.parameters.get(name)
        if text is not None:
            value = parse_bool(text)
            if value is None:
                raise _error(block, name, f"expected true or false, got {text!r}")
            return value
    return False


def _number(block: HardwareInfo, name: str) -> float | None:
    text = block.parameters.get(name)
    if text is None:
        return None
    value = parse_number(text)
    if value is None or not isfinite(value):
        raise _error(block, name, f"expected a finite number, got {text!r}")
    return value


def _error(block: HardwareInfo, name: str, problem: str) -> DescriptionError:
    where = f"ros2_control {block.name!r}, <hardware> parameter {name!r}"
    return DescriptionError(problem, where=where)
