"""Planning problems: a robot, its joint positions, and the scene around it."""

import dataclasses as dc
import math
from collections.abc import Callable, Collection, Mapping, Sequence, Set
from numbers import Integral, Real
from typing import Any, NamedTuple, Protocol

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, Diagram

from arm_drake.description.robot import Robot
from arm_drake.errors import ArmDrakeError, InputError, check_known, check_type
from arm_drake.importing import dataclass
from arm_drake.messages import JointState
from arm_drake.planning.groups import find_mask
from arm_drake.planning.inverse_kinematics import complete_positions
from arm_drake.planning.orientation_constraint import OrientationConstraint
from arm_drake.planning.surroundings import PlacedShape, read_planning_scene
from arm_drake.plant.joint_ranges import joint_ranges
from arm_drake.plant.payloads import Payload
from arm_drake.plant.plant import pose_of
from arm_drake.worlds.world import World

# A joint is at rest below this [rad/s], [m/s].
_REST = 0.02

# How far beyond a limit a joint of a simulation may be [rad], [m].
_BEYOND = 0.02


# What options may be, for `isinstance`, and how that is called.
_KINDS: Mapping[str, tuple[Any, str]] = {
    "name": (str | None, "a robot's name"),
    "frame": (str | None, "a link's name"),
    "start": (Mapping | None, "joint positions by name"),
    "attached": (Mapping, "what is held by the link"),
    "ignore": ((list, tuple, Set), "names of bodies"),
    "straight": (bool | np.bool_, "True or False"),
    "path_constraint": (OrientationConstraint | None, "an OrientationConstraint"),
    "velocity_scaling": (Real | None, "a number"),
    "acceleration_scaling": (Real | None, "a number"),
    "padding": (Real, "a number"),
    "time_limit": (Real | None, "a number"),
    "should_stop": (Callable | None, "a function"),
}


class PlanningError(ArmDrakeError):
    """No plan was found, or the request can't be planned.

    Attributes:
        fraction: How much of a straight line is free, from 0 to 1.
    """

    def __init__(self, message: str, *, fraction: float = 0.0) -> None:
        """Create it."""
        super().__init__(message)
        self.fraction = fraction


class Running(Protocol):
    """Simulator of a diagram with robots: a Simulation."""

    diagram: Diagram

    @property
    def context(self) -> Context:
        """The root context of the diagram, as it is now."""

    @property
    def robots(self) -> Mapping[str, Robot]:
        """The robots by name."""

    def joint_states(self, robot: str | None = None) -> JointState:
        """Return where the joints of a robot are, and how fast they move."""


@dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """Options of planning: keyword arguments of `plan`."""

    # Which robot of a simulation; None is the first one.
    name: str | None = None

    # A planning group, or names of joints; None is the first group.
    group: str | Collection[str] | None = None

    # The link that poses are for; None is the group's tip.
    frame: str | None = None

    # What is around the robot, as that of `load_world`; None is the ground. What could
    # move stands where it is at the start. A simulation has its own.
    world: World | None = None

    # Joint positions at the start [rad] or [m]; joints that are left out are at the
    # initial ones, or at those of the simulation.
    start: Mapping[str, float] | None = None

    # What links hold, by link: a `Payload` with its shape and its mass; in a simulation
    # also the name of a body that is held where it is now. It may touch the links of
    # the robot that it touches at the start.
    attached: Mapping[str, Payload | str] = dc.field(default_factory=dict)

    # Bodies of a simulation that may be touched, as one to be grasped.
    ignore: Collection[str] = ()

    # Whether the frame moves on a straight line and turns evenly.
    straight: bool = False

    # What of poses counts, as that of `solve_ik`; None is all, or the position where
    # the `kinematics.yaml` beside the SRDF has `position_only_ik` for the group.
    mask: Sequence[bool] | None = None

    # How far a link may tilt along the way; None is as far as it likes.
    path_constraint: OrientationConstraint | None = None

    # Parts of the joints' speed and acceleration to use, above 0 and up to 1; None is
    # that of the `joint_limits.yaml` beside the SRDF, 1 where it says nothing.
    velocity_scaling: float | None = None
    acceleration_scaling: float | None = None

    # Distance that counts as a collision [m].
    padding: float = 0.005

    # How long to look for a way to each goal, by the clock [s]; None is for a number of
    # iterations, so that the outcome doesn't depend on the machine's speed.
    time_limit: float | None = None

    # Seed of the random search, at least 0.
    seed: int = 0

    # Asked again and again during the search; true ends it.
    should_stop: Callable[[], bool] | None = None

    def __post_init__(self) -> None:
        """Raise InputError for what can't be."""
        for name, (kind, expected) in _KINDS.items():
            check_type(name, getattr(self, name), kind, expected)
        for name in self.ignore:
            check_type("ignore", name, str, "names of bodies")
        find_mask(None, self.mask)
        for name in ("velocity_scaling", "acceleration_scaling"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value <= 1.0:
                raise InputError(
                    f"{name}: expected a number above 0, at most 1; {value}"
                )
        if not 0.0 <= self.padding < math.inf:
            expected = "expected a distance of at least 0 m"
            raise InputError(f"padding: {expected}, got {self.padding}")
        limit = self.time_limit
        if limit is not None and not 0.0 < limit < math.inf:
            expected = "expected a positive time [s]"
            raise InputError(f"time_limit: {expected}, got {limit}")
        seed = self.seed
        if isinstance(seed, bool) or not isinstance(seed, Integral) or seed < 0:
            raise InputError(f"seed: expected an integer of at least 0, got {seed!r}")


class Setting(NamedTuple):
    """A robot, where its joints are, and what is around it: can be pickled."""

    robot: Robot
    positions: dict[str, float]
    world: World
    things: tuple[PlacedShape, ...]
    payloads: Mapping[str, Payload]


def find_setting(robot: Robot | Running, options: PlanOptions) -> Setting:
    """Return what is planned with; the errors are those of `plan`."""
    if isinstance(robot, Robot):
        return _set_up(robot, options)
    if not hasattr(robot, "robots"):
        expected = "expected a Robot, as load_robot returns it, or a Simulation"
        raise InputError(f"robot: {expected}, got {robot!r}")
    return _set_up_running(robot, options)


def _set_up(robot: Robot, options: PlanOptions) -> Setting:
    """Return what is planned with for a robot that isn't simulated."""
    if options.name not in (None, robot.name):
        raise InputError(f"name: the robot is {robot.name!r}, not {options.name!r}")
    for link, payload in options.attached.items():
        if not isinstance(payload, Payload):
            raise InputError(
                f"attached: {link!r}: expected a Payload, got {payload!r}; a body is "
                "held in a simulation"
            )
    if options.ignore:
        raise InputError("ignore: bodies are those of a simulation; leave it out")
    payloads = _check_attached(robot, options.attached)
    return Setting(
        robot,
        complete_positions(robot, options.start or {}),
        "empty" if options.world is None else options.world,
        _shapes_of(payloads),
        payloads,
    )


def _set_up_running(running: Running, options: PlanOptions) -> Setting:
    """Return what is planned with for a robot of a simulation."""
    if options.world is not None:
        raise InputError("world: a simulation has its own; leave it out")
    robots, attached = running.robots, options.attached
    name = next(iter(robots)) if options.name is None else options.name
    check_known("robot", name, robots, argument="name")
    robot = robots[name]
    payloads = _check_attached(robot, attached)
    attached_bodies = {
        link: body for link, body in attached.items() if isinstance(body, str)
    }
    scene = read_planning_scene(
        running.diagram, running.context, robot, attached_bodies, options.ignore
    )
    X = scene.X_WB
    if X is not None:
        robot = dc.replace(robot, pose=pose_of(X))
    state = running.joint_states(name)
    positions = dict(zip(state.name, state.position, strict=True))
    if options.start is None:
        if moving := find_moving(state):
            raise PlanningError(
                f"{moving}; a plan begins at rest: simulate until the robot rests, or "
                "say with start= where it will be"
            )
        positions = _within_limits(robot, positions)
    else:
        own = {joint.name for joint in robot.description.independent_joints}
        measured = {joint: q for joint, q in positions.items() if joint in own}
        positions = complete_positions(robot, {**measured, **options.start})
    things = (*scene.things, *_shapes_of(payloads))
    return Setting(robot, positions, scene.world, things, payloads)


def find_moving(state: JointState) -> str:
    """Return which joint moves how fast, in words; nothing if all rest."""
    for joint, velocity in zip(state.name, state.velocity, strict=True):
        if not abs(velocity) <= _REST:
            return f"joint {joint!r} moves at {velocity:.3g} [rad/s or m/s]"
    return ""


def _check_attached(
    robot: Robot, attached: Mapping[str, Payload | str]
) -> dict[str, Payload]:
    """Return the payloads among what links hold, or raise InputError."""
    links = robot.description.links
    for link in attached:
        check_known("link", link, links, argument="attached")
    return {link: p for link, p in attached.items() if isinstance(p, Payload)}


def _shapes_of(payloads: Mapping[str, Payload]) -> tuple[PlacedShape, ...]:
    """Return the shapes of payloads, as links hold them."""
    return tuple(
        PlacedShape(
            f"what {link} holds",
            payload.shape,
            RigidTransform(np.array(payload.com, dtype=float)),
            link,
        )
        for link, payload in payloads.items()
        if payload.shape is not None
    )


def _within_limits(robot: Robot, positions: Mapping[str, float]) -> dict[str, float]:
    """Return measured positions, those a little beyond a limit at the limit."""
    found = dict(positions)
    for r in joint_ranges(robot.description):
        inside = min(max(found[r.name], r.lower), r.upper)
        if not r.wraps and abs(found[r.name] - inside) <= _BEYOND:
            found[r.name] = inside
    return found
