"""Options of a simulation, with defaults that need no thought."""

import dataclasses as dc
import math
from collections.abc import Mapping
from numbers import Real
from types import NoneType
from typing import NamedTuple

from arm_drake.arrays import is_number
from arm_drake.errors import InputError, check_known, suggest
from arm_drake.importing import dataclass
from arm_drake.output_files import IMAGE_FORMATS

# A smaller step of the physics is a mistake [s].
SMALLEST_STEP = 1e-6

# Earth's gravity, as Drake has it [m/s^2].
GRAVITY = 9.81

# A longer delay is a mistake [cycles].
LONGEST_DELAY = 10_000


class _Preset(NamedTuple):
    """Settings of a preset."""

    # Largest step, where none is asked for [s].
    largest_step: float

    # What it leaves out.
    leaves_out: str = ""


_PRESETS: Mapping[str, _Preset] = {
    "accurate": _Preset(1e-3),
    # Its servo moves a joint to the same place whatever the step.
    "fast": _Preset(
        1e-2,
        "no contact: links pass through everything, contact sensors feel nothing; "
        "pushes and payloads leave an error; at its effort limit each joint is on its "
        "own; velocities are means of a step",
    ),
    "kinematic": _Preset(
        1e-3,
        "no physics: joints are where their commands say a cycle later, and there are "
        "no efforts",
    ),
}

PRESETS = tuple(_PRESETS)


@dataclass(frozen=True)
class SimulationOptions:
    """Options of a robot's simulation."""

    # "accurate": the dynamics, with everything. "fast": the dynamics of robots that
    # touch nothing, in steps as large as the controllers' period. "kinematic": none,
    # joints are where their commands say one cycle later, as
    # mock_components/GenericSystem has it.
    preset: str = "accurate"

    # Largest step of the physics [s]. The step that is used divides the period of the
    # controller manager evenly, so that a command acts on the step that starts with it.
    # None: 1 ms, or 10 ms with "fast".
    time_step: float | None = None

    # Whether gravity of 9.81 m/s^2 acts along -z of the world, or the acceleration of
    # gravity in the world [m/s^2]. None: that of the world's file, else 9.81 along -z.
    gravity: bool | tuple[float, float, float] | None = None

    # Bandwidth of the joint servo [rad/s]: a step settles in about 5.8 / bandwidth.
    servo_bandwidth: float = 40.0

    # Whether the servo knows the robot's weight, and its dry friction. What it doesn't
    # know, its observer has to find out.
    gravity_compensation: bool = True
    friction_compensation: bool = True

    # Whether the servo finds out what it doesn't know, such as payloads. If not, they
    # leave a position error.
    disturbance_observer: bool = True

    # Whether joints that are very light for their effort, and driven by the servo, get
    # the rotor that descriptions leave out: a payload on them may need it. It changes
    # the dynamics; the report says where. None: at steps of more than 2 ms, at which
    # the servo can't do without.
    reflected_inertia: bool | None = None

    # Whether the dry friction of `<dynamics friction>` acts.
    friction: bool = True

    # Whether links of one robot collide with each other; Gazebo's default is no.
    self_collision: bool = False

    # Rate at which the rollout is logged [Hz]; None means the manager's rate.
    log_rate: float | None = None

    # Whether the rollout has the contact forces on the robot's links, too.
    log_contacts: bool = False

    # Cameras and lidars whose messages the rollout has, too, as they publish them at
    # their `update_rate`; with several robots `<robot>/<sensor>`.
    log_images: tuple[str, ...] = ()

    # How the rollout has their pictures of colours: "raw", or "jpeg" or "png", as a
    # CompressedImage on `<topic>/compressed`.
    log_image_format: str = "raw"

    # Seed of all noise: of state interfaces, cameras and lidars.
    seed: int = 0

    # Standard deviations of white noise on what controllers read, by state interface:
    # "position" [rad, m], "velocity" and "effort" of all joints, "joint1/position",
    # "angular_velocity" of all sensors, "imu/angular_velocity", "imu/force.x".
    state_noise: Mapping[str, float] = dc.field(default_factory=dict)

    # How many cycles of the controller manager old it is what controllers read, and how
    # many later the hardware follows their commands.
    state_delay: int = 0
    command_delay: int = 0

    # Pictures per simulated second, in a diagram with a Meshcat [Hz]; 0 leaves it to
    # who runs the diagram.
    frame_rate: float = 30.0

    # Controllers to start besides, or instead of, those that would start; with several
    # robots `<robot>/<controller>`, or a name for all that have it.
    active: tuple[str, ...] = ()

    # Controllers to leave inactive.
    inactive: tuple[str, ...] = ()

    @property
    def largest_step(self) -> float:
        """Largest step of the physics [s]."""
        if self.time_step is None:
            return _PRESETS[self.preset].largest_step
        return self.time_step

    @property
    def leaves_out(self) -> str:
        """Parts that the preset leaves out; empty if none."""
        return _PRESETS[self.preset].leaves_out

    def __post_init__(self) -> None:
        """Reject what can't be simulated."""
        for field in dc.fields(self):
            _check_type(field.name, field.type, getattr(self, field.name))
        if isinstance(self.gravity, tuple):
            object.__setattr__(self, "gravity", _vector("gravity", self.gravity))
        check_known("preset", self.preset, PRESETS)
        if not SMALLEST_STEP <= self.largest_step < math.inf:
            raise InputError(
                f"time_step must be at least {SMALLEST_STEP} s, got {self.time_step!r}"
            )
        if not 0.0 < self.servo_bandwidth < math.inf:
            raise InputError(
                f"servo_bandwidth must be positive, got {self.servo_bandwidth!r}"
            )
        most = 1.0 / SMALLEST_STEP
        if self.log_rate is not None and not 0.0 < self.log_rate <= most:
            raise InputError(
                f"log_rate must be positive and at most {most:g} Hz, "
                f"got {self.log_rate!r}"
            )
        if self.log_image_format not in IMAGE_FORMATS:
            hint = suggest(self.log_image_format, IMAGE_FORMATS)
            raise InputError(f"log_image_format {self.log_image_format!r}; {hint}")
        if not 0.0 <= self.frame_rate < math.inf:
            raise InputError(
                f"frame_rate must be at least 0 Hz, got {self.frame_rate!r}"
            )
        if isinstance(self.seed, bool) or self.seed < 0:
            raise InputError(f"seed must be at least 0, got {self.seed!r}")
        for name in ("state_delay", "command_delay"):
            value = getattr(self, name)
            if isinstance(value, bool) or not 0 <= value <= LONGEST_DELAY:
                raise InputError(
                    f"{name} must be 0 to {LONGEST_DELAY} cycles, got {value!r}"
                )
        for name, value in self.state_noise.items():
            if not 0.0 <= value < math.inf:
                raise InputError(
                    f"state_noise: {name}: a standard deviation must be at least 0, "
                    f"got {value!r}"
                )
        both = [name for name in self.active if name in self.inactive]
        if both:
            raise InputError(
                f"controller {both[0]!r} can't be both active and inactive; "
                "name it once"
            )


# What an option may be, by how its field is declared, and how that is called.
_KINDS: Mapping[object, tuple[tuple[type, ...], str]] = {
    bool: ((bool,), "True or False"),
    bool | None: ((bool, NoneType), "True, False or None"),
    bool | tuple[float, float, float] | None: (
        (bool, tuple, NoneType),
        "True, False, (x, y, z) [m/s^2] or None",
    ),
    int: ((int,), "an integer of at least 0"),
    float: ((Real,), "a number"),
    float | None: ((Real, NoneType), "a number or None"),
    str: ((str,), "a text"),
    Mapping[str, float]: ((Mapping,), "numbers by name"),
}


def _check_type(name: str, kind: object, value: object) -> None:
    what = "cameras and lidars" if name == "log_images" else "controllers"
    types, expected = _KINDS.get(kind, ((tuple, list), f"names of {what}"))
    is_wrong = not isinstance(value, types)
    is_wrong |= Real in types and isinstance(value, bool)
    if types == (tuple, list) and not is_wrong:
        is_wrong = not all(isinstance(item, str) for item in value)  # type: ignore[attr-defined]
    if isinstance(value, Mapping):
        is_wrong = not all(map(is_number, value.values()))
    if is_wrong:
        raise InputError(f"{name}: expected {expected}, got {value!r}")


def _vector(name: str, value: tuple[float, ...]) -> tuple[float, float, float]:
    """Return three finite numbers, or raise InputError."""
    is_number = [isinstance(x, Real) and math.isfinite(x) for x in value]
    if len(value) != 3 or not all(is_number):
        raise InputError(f"{name}: expected three finite numbers, got {value!r}")
    x, y, z = map(float, value)
    return (x, y, z)
