"""Names and units of the standard ros2_control joint interfaces.

A *state interface* is a quantity that a joint reports, a *command interface* one that
it accepts. The names are the ``HW_IF_*`` constants of ros2_control's
``hardware_interface/types/hardware_interface_type_values.hpp``.
"""

from typing import Final

POSITION: Final = "position"  # rad (revolute, continuous) or m (prismatic)
VELOCITY: Final = "velocity"  # rad/s or m/s
ACCELERATION: Final = "acceleration"  # rad/s^2 or m/s^2
EFFORT: Final = "effort"  # N·m or N

# What a simulated joint reports, in the order of the `joint_states` vector.
STATE_INTERFACES: Final = (POSITION, VELOCITY, EFFORT)

_ANGULAR_UNITS = {POSITION: "rad", VELOCITY: "rad/s", EFFORT: "N·m"}
_LINEAR_UNITS = {POSITION: "m", VELOCITY: "m/s", EFFORT: "N"}


def state_port(interface: str) -> str:
    """Return the name of the input port that carries a state interface."""
    return f"{interface}_state"


def command_port(interface: str) -> str:
    """Return the name of the output port that carries a command interface."""
    return f"{interface}_command"


def unit(interface: str, joint_type: str) -> str:
    """Return the unit of an interface of a joint of this URDF type."""
    units = _LINEAR_UNITS if joint_type == "prismatic" else _ANGULAR_UNITS
    return units[interface]
