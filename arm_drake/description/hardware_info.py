"""`<ros2_control>` blocks as frozen dataclasses.

Names of classes and fields follow `hardware_interface/hardware_info.hpp` of
ros2_control.
"""

import dataclasses as dc
import math


@dc.dataclass(frozen=True)
class InterfaceInfo:
    """A command or state interface of a component."""

    # Such as "position".
    name: str

    # Limits of a command interface, in the unit of the interface.
    min: float | None = None
    max: float | None = None

    # Value at the start.
    initial_value: float | None = None

    # All `<param>` values, as text.
    parameters: dict[str, str] = dc.field(default_factory=dict)

    # Type of its value in C++, such as "double", and how many it has.
    data_type: str = "double"
    size: int = 1

    # Whether its limits hold, as `<limits enable>` says.
    enable_limits: bool = True


@dc.dataclass(frozen=True)
class PidGains:
    """Gains that `gazebo_ros2_control/GazeboSystem` gives a joint.

    Upstream's lower limit of the integral is DBL_MIN where none is given, which is the
    smallest positive number and no limit that was meant; here it is -inf.
    """

    kp: float = 0.0
    ki: float = 0.0
    kd: float = 0.0
    max_integral_error: float = math.inf
    min_integral_error: float = -math.inf


@dc.dataclass(frozen=True)
class ComponentInfo:
    """A `<joint>`, `<sensor>` or `<gpio>` of a hardware block."""

    name: str
    command_interfaces: tuple[InterfaceInfo, ...] = ()
    state_interfaces: tuple[InterfaceInfo, ...] = ()

    # All `<param>` values, as text.
    parameters: dict[str, str] = dc.field(default_factory=dict)

    # Attribute `mimic` of a joint, None where it is not given.
    is_mimic: bool | None = None

    # Whether limits hold for any of its interfaces, as `<limits enable>` says.
    enable_limits: bool = True

    # Gains of joint parameters such as `pos_kp` and `vel_kp`, None without any.
    position_pid: PidGains | None = None
    velocity_pid: PidGains | None = None


@dc.dataclass(frozen=True)
class TransmissionJointInfo:
    """A `<joint>` of a transmission."""

    name: str

    # Such as "joint1".
    role: str

    mechanical_reduction: float = 1.0

    # [rad] or [m].
    offset: float = 0.0

    read_only: bool = False


@dc.dataclass(frozen=True)
class ActuatorInfo:
    """An `<actuator>` of a transmission; fields as those of TransmissionJointInfo."""

    name: str
    role: str
    mechanical_reduction: float = 1.0
    offset: float = 0.0
    read_only: bool = False


@dc.dataclass(frozen=True)
class TransmissionInfo:
    """A `<transmission>` of a hardware block."""

    name: str

    # Plugin class, such as "transmission_interface/SimpleTransmission".
    type: str

    joints: tuple[TransmissionJointInfo, ...] = ()
    actuators: tuple[ActuatorInfo, ...] = ()
    parameters: dict[str, str] = dc.field(default_factory=dict)


@dc.dataclass(frozen=True)
class HardwareInfo:
    """A `<ros2_control>` block."""

    name: str

    # "system", "actuator" or "sensor".
    type: str

    # Plugin class of the real or simulated driver; the simulator stands in for it.
    plugin: str

    joints: tuple[ComponentInfo, ...] = ()
    sensors: tuple[ComponentInfo, ...] = ()
    gpios: tuple[ComponentInfo, ...] = ()

    # `<param>` values of `<hardware>`, as text.
    parameters: dict[str, str] = dc.field(default_factory=dict)

    transmissions: tuple[TransmissionInfo, ...] = ()

    # Group of blocks whose errors concern each other.
    group: str = ""

    # Rate of reading and writing [Hz]; 0 is the manager's.
    rw_rate: int = 0

    # How the driver's thread runs.
    is_async: bool = False
    thread_priority: int = 50
