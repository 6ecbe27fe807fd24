"""Visual servoing: an arm keeps a thing in the middle of the picture of its camera.

The law is the classic image-based one (Chaumette and Hutchinson, Visual servo control,
part I, 2006): the error e of the middle of what is seen has the derivative
L J dq/dt, with the interaction matrix L of a point and the Jacobian J of the camera.
The joints are moved by dq/dt = -gain (L J)^+ e, so that e decays as exp(-gain t). For a
thing that moves at a speed v in the picture, e ends at v / gain.
"""

import dataclasses as dc
import math
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from arm_drake.arrays import Array
from arm_drake.description.joints import WORLD, joints_above
from arm_drake.description.perception_sensors import CameraSensor
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, quoted, suggest
from arm_drake.importing import dataclass
from arm_drake.manipulation.activities import (
    Activity,
    Drive,
    Runner,
    choose_robot,
    is_positive,
    perform,
    read_options,
)
from arm_drake.perception.cameras import CameraHandle
from arm_drake.planning.groups import find_group, joints_of, takes_positions
from arm_drake.planning.timing import motion_limits
from arm_drake.plant.joint_ranges import joint_ranges
from arm_drake.plant.kinematics import PlantKinematics

# With a delay d no error overshoots below a gain of 1 / (e d), and the gain that is
# taken where none is asked for [1/s].
_STEADY, _GAIN = 1.0 / math.e, 1.5

# Damping of the pseudo-inverse; singular values are near 1.
_DAMPING = 0.01

# Least number of pixels of a thing that is seen.
PIXELS = 12

# So close to the distance that is asked for is there, as a part of it.
_NEAR = 0.1

# A joint without a limit of velocity moves so fast [rad/s] or [m/s].
_SPEED = 1.0


class Observer(Runner, Protocol):
    """A simulation that returns the poses of links."""

    def link_poses(self, robot: str | None = None) -> dict[str, RigidTransform]:
        """Return the poses of links in the world."""


@dataclass(frozen=True, kw_only=True)
class FollowOptions:
    """Options of following: keyword arguments of `follow`."""

    # Which robot of the simulation; None is the first.
    robot: str | None = None

    # Planning group whose controller moves the camera; None is the controller of most
    # joints that carry it.
    group: str | None = None

    # A camera of the robot that joints move; None is the first one.
    camera: str | None = None

    # For how long [s].
    duration: float = 10.0

    # How fast the error decays [1/s]; None is 1.5, or what the delay of camera and
    # controller allows.
    gain: float | None = None

    # How far the thing is kept from the camera [m]; None is any distance.
    distance: float | None = None

    # Largest joint velocities, as a part of the joints' limits.
    velocity_scaling: float = 0.5

    def __post_init__(self) -> None:
        """Raise InputError if a number is none."""
        for name in ("duration", "gain", "distance", "velocity_scaling"):
            value = getattr(self, name)
            if value is None and name in ("gain", "distance"):
                continue
            if not is_positive(value):
                text = f"expected a number above 0, got {value!r}"
                raise InputError(f"{name}: {text}")
        if self.velocity_scaling > 1.0:
            text = f"expected more than 0, at most 1, got {self.velocity_scaling!r}"
            raise InputError(f"velocity_scaling: {text}")


@dataclass(frozen=True)
class FollowResult:
    """Result of following a thing."""

    # The name of the thing.
    thing: str

    # Whether it is seen in the end, at the distance that was asked for, within a tenth.
    success: bool

    # Why it isn't, in words.
    reason: str = ""

    # When it was seen [s], shape (n,), and how far it was from the picture's middle, to
    # the right and down, as tangents of angles, shape (n, 2).
    times: NDArray[np.float64] = dc.field(default_factory=lambda: np.zeros(0))
    errors: NDArray[np.float64] = dc.field(default_factory=lambda: np.zeros((0, 2)))

    # How far it was from the camera, along its axis, at these times [m], shape (n,);
    # empty if the camera measures no depths.
    distances: NDArray[np.float64] = dc.field(default_factory=lambda: np.zeros(0))

    # From when until when it wasn't seen [s]; the arm held still.
    lost: tuple[tuple[float, float], ...] = ()

    def __bool__(self) -> bool:
        """Return whether it is seen in the end, at the requested distance."""
        return self.success

    def describe(self) -> str:
        """Return what became of it, in words."""
        if not self.success:
            return self.reason
        away = math.degrees(math.atan(float(np.linalg.norm(self.errors[-1]))))
        text = f"seen in the end, {away:.1f} degrees from the middle of the picture"
        if self.distances.size:
            text += f" and {self.distances[-1]:.3f} m away"
        times = len(self.lost)
        return f"{text}; lost {times} times on the way" if times else text

    def to_json(self) -> dict[str, Any]:
        """Return the last errors (tangents of angles), distance [m], losses [s]."""
        return {
            "thing": self.thing,
            "error": self.errors[-1].tolist() if len(self.errors) else None,
            "distance": float(self.distances[-1]) if self.distances.size else None,
            "lost": [list(span) for span in self.lost],
        }


class Feature(NamedTuple):
    """Seen feature of a thing."""

    # Its middle in the picture, to the right and down, as tangents of angles.
    x: float
    y: float

    # How far it is along the axis [m].
    depth: float


def follow(simulation: Observer, thing: str, **options: Any) -> FollowResult:
    """Have an arm keep a thing in the middle of its camera's picture, for a while.

    The thing is told from the rest by the labels of the picture. While it isn't seen
    the arm holds still; it goes on when it is seen again.

    Args:
        simulation: The simulation; its robot rests.
        thing: The name of a thing, or "<robot>::<link>", as in the camera's labels.
        options: The fields of `FollowOptions`.

    Returns:
        Whether it is seen in the end, the errors, and when it was lost.

    Raises:
        InputError: If there is no camera on the arm, no such thing, no controller, or
            an argument can't be used.
        ArmDrakeError: If the renderer's libraries are missing.
    """
    return perform(simulation, following(simulation, thing, **options))


def following(
    simulation: Observer, thing: str, **options: Any
) -> Activity[FollowResult]:
    """Return what `follow` does, for those who simulate by themselves."""
    chosen = read_options(FollowOptions, "follow", options)
    return _follow(Servo(simulation, thing, chosen))


def _follow(servo: "Servo") -> Activity[FollowResult]:
    simulation = servo.simulation
    end = simulation.time + servo.options.duration
    times: list[float] = []
    errors: list[tuple[float, float]] = []
    distances: list[float] = []
    lost: list[tuple[float, float]] = []
    lost_at: float | None = None
    while simulation.time < end - 1e-9:
        seen, now = servo.look(), simulation.time
        if seen is None:
            lost_at = now if lost_at is None else lost_at
        else:
            if lost_at is not None:
                lost.append((lost_at, now))
                lost_at = None
            times.append(now)
            errors.append((seen.x, seen.y))
            distances.append(seen.depth)
            servo.move(seen)
        yield min(now + servo.period, end)
    reason = ""
    if lost_at is not None:
        lost.append((lost_at, simulation.time))
        since = f"since {lost_at:.2f} s" if times else "at all"
        reason = f"{servo.thing!r} isn't seen {since}; the arm holds still"
    elif distances:
        reason = servo.find_miss(distances[-1])
    return FollowResult(
        servo.thing,
        not reason,
        reason,
        np.array(times),
        np.array(errors).reshape(-1, 2),
        np.array(distances if servo.camera.has("depth") else []),
        tuple(lost),
    )


def interaction_matrix(seen: Feature) -> Array:
    """Return the derivative of x, y and the logarithm of depth, shape (3, 6).

    It is by the velocity of the camera along its x, y and z [m/s], then about them
    [rad/s], of a point that stands still.
    """
    x, y, z = seen
    return np.array(
        [
            [-1.0 / z, 0.0, x / z, x * y, -(1.0 + x * x), y],
            [0.0, -1.0 / z, y / z, 1.0 + y * y, -x * y, -x],
            [0.0, 0.0, -1.0 / z, -y, x, 0.0],
        ]
    )


class Servo:
    """A camera on an arm, and the law that moves it."""

    def __init__(
        self, simulation: Observer, thing: str, options: FollowOptions
    ) -> None:
        """Take an arm with a camera, or raise InputError."""
        self.simulation, self.options = simulation, options
        self.robot, prefix = choose_robot(simulation, options.robot)
        camera, link = _find_camera(self.robot, options.camera)
        self.camera = simulation.camera(f"{prefix}{camera}")
        self._link = link
        group = options.group
        wanted = None if group is None else find_group(self.robot, group).joints
        self._drive = _find_drive(self.robot, prefix, link, wanted)
        self.joints = self._drive.joints
        self.thing, self._label = find_label(self.camera, thing)
        if options.distance is not None and not self.camera.has("depth"):
            text = f"camera {camera!r} measures none"
            raise InputError(f"distance: it is kept by depths, and {text}")
        self._set_gain()
        self._set_limits()
        base = next(iter(self.robot.description.links))
        self._kinematics = PlantKinematics(
            self.robot.description, self.robot.initial_positions, self.joints, base
        )
        poses = simulation.link_poses(self.robot.name)
        self._X_LC = poses[link].inverse() @ self.camera.pose
        self._command = self._measured()

    def _set_gain(self) -> None:
        """Choose period and gain, or raise InputError if that can't be stable."""
        tick = 1.0 / self.robot.controllers.update_rate
        self.period = max(1.0 / self.camera.sensor.update_rate, tick)
        most = _STEADY / (self.period + tick)
        gain = self.options.gain
        self.gain = min(_GAIN, most) if gain is None else gain
        if self.gain > most * (1.0 + 1e-9):
            raise InputError(
                f"gain: expected at most {most:.3g} 1/s, where camera and controller "
                f"are {1e3 * (self.period + tick):.0f} ms late; got {gain!r}"
            )

    def _set_limits(self) -> None:
        limits = motion_limits(self.robot)
        speeds = [limits[n].velocity or _SPEED for n in self.joints]
        self._speeds = self.options.velocity_scaling * np.array(speeds, float)
        ranges = {each.name: each for each in joint_ranges(self.robot.description)}
        self._lower = np.array([ranges[name].lower for name in self.joints])
        self._upper = np.array([ranges[name].upper for name in self.joints])

    def _measured(self) -> Array:
        states = self.simulation.joint_states(self.robot.name)
        at = [states.name.index(name) for name in self.joints]
        return np.take(np.asarray(states.position, float), at)

    def look(self) -> Feature | None:
        """Return where the thing is in the picture, by image moments, if it is seen."""
        rows, columns = np.nonzero(self.camera.labels() == self._label)
        if len(rows) < PIXELS:
            return None
        k = self.camera.info.k
        x, y = (columns.mean() - k[2]) / k[0], (rows.mean() - k[5]) / k[4]
        depth = self.options.distance or 1.0
        if self.camera.has("depth"):
            depths = self.camera.depth()[rows, columns]
            depths = depths[np.isfinite(depths)]
            depth = float(np.median(depths)) if depths.size else depth
        return Feature(float(x), float(y), depth)

    def find_miss(self, distance: float) -> str:
        """Return what is wrong with the distance in the end [m], if anything is."""
        wanted = self.options.distance
        if wanted is None or abs(distance / wanted - 1.0) <= _NEAR:
            return ""
        at = (self._command <= self._lower) | (self._command >= self._upper)
        names = [name for name, is_at in zip(self.joints, at, strict=True) if is_at]
        why = f"; at their limits: {quoted(names)}" if names else ""
        text = f"{self.thing!r} is {distance:.3f} m away in the end"
        return f"{text}, not {wanted:g} m{why}"

    def move(self, seen: Feature) -> None:
        """Send the joints to where the law has them in a period."""
        step = self._step(seen)
        self._command = np.clip(self._command + step, self._lower, self._upper)
        goal = dict(zip(self.joints, self._command.tolist(), strict=True))
        self._drive.send(self.simulation, goal, self.period)

    def _step(self, seen: Feature) -> Array:
        """Return by how much joints move in a period [rad] or [m], shape (n,)."""
        errors, count = np.array([seen.x, seen.y, 0.0]), 2
        if self.options.distance is not None:
            errors[2], count = math.log(seen.depth / self.options.distance), 3
        rows = (interaction_matrix(seen) @ self._camera_jacobian())[:count]
        part = 1.0 - math.exp(-self.gain * self.period)
        free = np.ones(len(self.joints), bool)
        for _ in self.joints:
            J = rows * free
            damped = J @ J.T + _DAMPING**2 * np.eye(count)
            step = -part * (J.T @ np.linalg.solve(damped, errors[:count]))
            target = self._command + step
            # What is at a limit leaves the rest to others.
            stuck = free & ((target < self._lower) | (target > self._upper))
            if not stuck.any():
                break
            free &= ~stuck
        excess = float((np.abs(step) / (self._speeds * self.period)).max())
        return np.asarray(step / max(1.0, excess))

    def _camera_jacobian(self) -> Array:
        """Return the Jacobian of the camera's frame, in that, shape (6, n)."""
        q = self._measured()
        J = self._kinematics.jacobian(q, self._link)
        R_BL = self._kinematics.pose(q, self._link)[:3, :3]
        lever = R_BL @ self._X_LC.translation()
        R_CB = (R_BL @ self._X_LC.rotation().matrix()).T
        moved = J[:3] + np.cross(J[3:], lever, axisa=0, axisb=0, axisc=0)
        return np.vstack([R_CB @ moved, R_CB @ J[3:]])


def _joints_of(robot: Robot, link: str) -> set[str]:
    """Return the movable joints that carry a link; of the world there are none."""
    description = robot.description
    movable = {joint.name for joint in description.movable_joints}
    if link == WORLD:
        return set()
    return movable & {each.name for each in joints_above(description.joints, link)}


def _find_camera(robot: Robot, name: str | None) -> tuple[str, str]:
    """Return a camera that joints move, and its link, or raise InputError."""
    cameras = {
        sensor.name: sensor.link
        for sensor in robot.description.perception_sensors
        if isinstance(sensor, CameraSensor)
    }
    moving = {n: link for n, link in cameras.items() if _joints_of(robot, link)}
    if name is not None and name not in moving:
        if name in cameras:
            raise InputError(f"camera {name!r} isn't moved by the arm")
        raise InputError(f"no camera {name!r}; {suggest(name, moving)}")
    if not moving:
        raise InputError(
            f"robot {robot.name!r} has no camera that its arm moves; "
            "arm_drake.add_camera adds one"
        )
    chosen = next(iter(moving)) if name is None else name
    return chosen, moving[chosen]


def find_label(camera: CameraHandle, thing: str) -> tuple[str, int]:
    """Return the name and the label of a thing, or raise InputError."""
    names = camera.label_names
    ends = [n for n in names if n.rpartition("::")[2] == thing or n == thing]
    if len(ends) != 1:
        if ends:
            raise InputError(f"{thing!r} is one of several: {quoted(ends)}")
        known = [n.rpartition("::")[2] for n in names[1:]]
        raise InputError(f"no thing {thing!r}; {suggest(str(thing), known)}")
    return thing, names.index(ends[0])


def _find_drive(
    robot: Robot, prefix: str, link: str, wanted: tuple[str, ...] | None
) -> Drive:
    """Return the controller that moves a camera; names begin with the prefix.

    It is that of exactly the joints that are asked for, else the one of most joints
    that carry the camera's link.
    """
    carriers, found = _joints_of(robot, link), []
    for controller in robot.controllers.controllers:
        names, is_forward = joints_of(controller), takes_positions(controller)
        is_trajectory = controller.type.endswith("JointTrajectoryController")
        moved = len(carriers & set(names))
        is_meant = bool(moved) if wanted is None else set(names) == set(wanted)
        if is_meant and (is_forward or is_trajectory):
            kind = "trajectory" if is_trajectory else "commands"
            drive = Drive(f"{prefix}{controller.name}", kind, names)
            found.append((moved, is_trajectory, drive))
    if not found:
        known = [each.name for each in robot.controllers.controllers]
        order = [j.name for j in robot.description.joints if j.name in carriers]
        which = "joints that move the camera: " if wanted is None else "exactly "
        raise InputError(
            f"no controller takes positions of {which}{quoted(wanted or order)}; "
            f"there are {quoted(known) or 'none'}"
        )
    return max(found, key=lambda each: each[:2])[2]
