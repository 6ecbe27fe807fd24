"""Names and units of the standard ros2_control joint interfaces.

A *state interface* is a quantity that a joint reports, a *command interface* one that
it accepts. The names are the ``HW_IF_*`` constants of ros2_control's
``hardware_interface/types/hardware_interface_type_values.hpp``.
"""

from collections.abc import Iterable, Mapping
from typing import Final

POSITION: Final = "position"  # rad (revolute, continuous) or m (prismatic)
VELOCITY: Final = "velocity"  # rad/s or m/s
ACCELERATION: Final = "acceleration"  # rad/s^2 or m/s^2
EFFORT: Final = "effort"  # N·m or N

# What a simulated joint reports, in the order of the `joint_states` vector.
STATE_INTERFACES: Final = (POSITION, VELOCITY, EFFORT)

# What a joint can be told to do, one at a time.
MOTIONS: Final = (POSITION, VELOCITY, ACCELERATION, EFFORT)

# What sensors measure; units are those of `sensor_msgs` and `geometry_msgs`.
FORCES: Final = tuple(f"{p}.{axis}" for p in ("force", "torque") for axis in "xyz")
POSITIONS: Final = tuple(f"position.{axis}" for axis in "xyz")
ORIENTATIONS: Final = tuple(f"orientation.{axis}" for axis in "xyzw")
RATES: Final = tuple(f"angular_velocity.{axis}" for axis in "xyz")
ACCELERATIONS: Final = tuple(f"linear_acceleration.{axis}" for axis in "xyz")
RANGE: Final = "range"

# Those of an IMU.
IMU: Final = (*ORIENTATIONS, *RATES, *ACCELERATIONS)

# What the physics knows, a row for each kind: the state interfaces, and the types of
# Gazebo's sensors that measure the same.
SENSORS: Final[Mapping[tuple[str, ...], tuple[str, ...]]] = {
    FORCES: ("force_torque",),
    RATES: ("imu",),
    ACCELERATIONS: ("imu",),
    POSITIONS + ORIENTATIONS: (),
    (RANGE,): ("ray", "gpu_ray", "lidar", "gpu_lidar", "sonar"),
}
MEASURED: Final = frozenset(name for names in SENSORS for name in names)

_ANGULAR_UNITS = {POSITION: "rad", VELOCITY: "rad/s", EFFORT: "N·m"}
_LINEAR_UNITS = {POSITION: "m", VELOCITY: "m/s", EFFORT: "N"}


# Ports of a controller towards hardware and manager: all interfaces that it reads, all
# that it claims, what these hold, and when to run. One port for all interfaces, for
# every port costs time at every step of the plant.
STATE_PORT: Final = "state_interfaces"
COMMAND_PORT: Final = "command_interfaces"
VALUES_PORT: Final = "command_values"
MANAGER_PORT: Final = "controller_manager"
EXPORT_PORT: Final = "exported_state_interfaces"

# What the manager reads and keeps for its controllers, and what lies on their topics.
MOTIONS_PORT: Final = "joint_motions"
MEASURED_PORT: Final = "measured"
TICKS_PORT: Final = "ticks"
INBOX_PORT: Final = "inbox"

# Time of the tick in which a slow controller's state interfaces were sampled.
TICK_PORT: Final = "tick_time"

# Poses of the robot's links in the world, which only simulated hardware knows.
FRAMES_PORT: Final = "link_frames"

# What touches the robot, which only the physics knows.
CONTACTS_PORT: Final = "contacts"

# How a system moves a free base without wheels.
TWIST_PORT: Final = "held_twist"

# What a sensor measures that no state interface has, which only the physics knows.
READINGS_PORT: Final = "readings"

# Names of the command interfaces that are claimed.
CLAIMED_PORT: Final = "claimed"

# Parameters that take the place of those a controller was made with.
PARAMETERS_PORT: Final = "parameters"

# Start of the name of the port on which another controller commands references.
CHAIN_PORT: Final = "chain:"

_INTERNAL_PORTS: Final = frozenset(
    (
        *(STATE_PORT, COMMAND_PORT, VALUES_PORT, MANAGER_PORT, PARAMETERS_PORT),
        *(TICK_PORT, TICKS_PORT, INBOX_PORT, FRAMES_PORT, CONTACTS_PORT),
        *(TWIST_PORT, READINGS_PORT),
    )
)


def is_internal(port: str) -> bool:
    """Return whether a port of a controller is none of its topics."""
    return port in _INTERNAL_PORTS or port.startswith((EXPORT_PORT, CHAIN_PORT))


def interface_names(joints: Iterable[str], names: Iterable[str]) -> tuple[str, ...]:
    """Return "<joint>/<interface>" of all joints, one interface after the other."""
    order = tuple(joints)
    return tuple(f"{joint}/{name}" for name in names for joint in order)


def unit(interface: str, joint_type: str) -> str:
    """Return the unit of an interface of a joint of this URDF type."""
    units = _LINEAR_UNITS if joint_type == "prismatic" else _ANGULAR_UNITS
    return units[interface]


def unit_of_all(interface: str, joint_types: Iterable[str]) -> str:
    """Return the unit of an interface of joints: "rad", or "m or rad" of both kinds."""
    return " or ".join(sorted({unit(interface, type_) for type_ in joint_types}))
