"""Pick and place: a robot of a simulation takes a thing, and puts it somewhere.

A pick is: a pose before the grasp, which is planned for; a straight approach; fingers
that close until they stall; a look whether the thing is between them; a straight lift,
and a look whether it came along. What goes wrong is an outcome with its reason, and the
next grasp is tried.
"""

import contextlib
import dataclasses as dc
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from pydrake.math import RigidTransform

from arm_drake.importing import dataclass
from arm_drake.manipulation.activities import (
    Activity,
    Failure,
    Runner,
    perform,
    read_options,
)
from arm_drake.manipulation.hand import (
    Hand,
    PickOptions,
    Place,
    distance,
    read_goal,
    shifted,
)
from arm_drake.manipulation.visual_servoing import PIXELS, find_label
from arm_drake.perception.boxes import FoundBox, find_box
from arm_drake.perception.cameras import CameraHandle
from arm_drake.planning.grasps import Grasp
from arm_drake.plant.plant import pose_of

T = TypeVar("T")

# How much a thing may slip in the fingers while it is lifted [m], [rad].
_SLIP, _TURN = 0.01, 0.3

# How much a thing that was seen may move in the fingers on the way before it is told
# [m], [rad].
_MOVED, _MOVED_TURN = 2e-3, 0.05

# How far around a thing a cloud is looked at for it, and what it stands on [m].
_AROUND = 0.15

# How much above its pose a thing is let go [m].
_DROP = 3e-4


class Attempt(NamedTuple):
    """A grasp that was tried."""

    grasp: Grasp | None

    # What was done when it failed: "look", "reach", "approach", "close", "lift"; or "".
    stage: str

    # Why it failed, in words; nothing if it didn't.
    reason: str


@dataclass(frozen=True)
class PickResult:
    """Result of picking a thing."""

    # The name of the thing.
    thing: str

    # Whether the gripper holds it, lifted.
    success: bool

    # Why it doesn't, in words.
    reason: str = ""

    # What was tried, in order; the last one is the one that holds.
    attempts: tuple[Attempt, ...] = ()

    # The pose of the thing in the gripper's palm, if it is held; as the grasp has it if
    # it was seen.
    X_PO: RigidTransform | None = None

    # How long it took [s].
    duration: float = 0.0

    def __bool__(self) -> bool:
        """Return whether the thing is held."""
        return self.success

    def describe(self) -> str:
        """Return what became of it, in words."""
        if not self.success:
            return self.reason
        count = len([a for a in self.attempts if a.grasp is not None])
        which = "at the first grasp" if count == 1 else f"at grasp {count}"
        return f"held and lifted {which}, in {self.duration:.1f} s"

    def to_json(self) -> dict[str, Any]:
        """Return how often it was tried, and how long that took [s]."""
        count = len([a for a in self.attempts if a.grasp is not None])
        return {"thing": self.thing, "attempts": count, "duration": self.duration}


@dataclass(frozen=True)
class PlaceResult:
    """Result of placing a thing."""

    # The name of the thing, if any was held.
    thing: str

    # Whether the gripper has let go of it.
    success: bool

    # Why not, or what went wrong after that, in words.
    reason: str = ""

    # Where the thing is, and by how much it misses the pose asked for [m], [rad].
    pose: RigidTransform | None = None
    position_error: float = math.nan
    orientation_error: float = math.nan

    # How far it moved in the gripper on the way [m], [rad]. That is made up for, unless
    # `held` said how it lies there.
    slip_distance: float = math.nan
    slip_angle: float = math.nan

    # How long it took [s].
    duration: float = 0.0

    def __bool__(self) -> bool:
        """Return whether the thing was placed."""
        return self.success

    def describe(self) -> str:
        """Return what became of it, in words."""
        if not self.success or self.pose is None:
            return self.reason
        at = ", ".join(f"{value:.3f}" for value in self.pose.translation())
        miss = f"{1e3 * self.position_error:.1f} mm"
        turn = f"{math.degrees(self.orientation_error):.1f} degrees"
        note = self.reason
        if not note and (self.slip_distance > _MOVED or self.slip_angle > _MOVED_TURN):
            note = f"moved by {1e3 * self.slip_distance:.1f} mm in the gripper"
        text = f"placed at {at} m in {self.duration:.1f} s, {miss} and {turn} off"
        return f"{text}; {note}" if note else text

    def to_json(self) -> dict[str, Any]:
        """Return where the thing is, and by how much that misses [m], [rad], [s]."""
        names = ("position_error", "orientation_error", "slip_distance", "slip_angle")
        found: dict[str, Any] = {"thing": self.thing or None}
        if self.pose is not None:
            found["pose"] = list(pose_of(self.pose))
        for name in names:
            value = getattr(self, name)
            found[name] = value if math.isfinite(value) else None
        return {**found, "duration": self.duration}


def pick(simulation: Runner, thing: str, **options: Any) -> PickResult:
    """Have a robot grasp a thing and lift it; simulate until it is done.

    Args:
        simulation: The simulation; its robot rests.
        thing: The name of a body of the world that can move.
        options: The fields of `PickOptions`.

    Returns:
        Whether the thing is held, else why not.

    Raises:
        InputError: If there is no such thing, no gripper, or an argument can't be used.
    """
    return perform(simulation, picking(simulation, thing, **options))


def place(
    simulation: Runner, pose: RigidTransform | Sequence[float], **options: Any
) -> PlaceResult:
    """Have a robot put down what its gripper holds; simulate until it is done.

    Args:
        simulation: The simulation; its robot rests and holds something.
        pose: Where the thing should be in the world, as a transform or as x, y, z [m],
            roll, pitch, yaw [rad]. With x, y, z alone it may be turned about the
            vertical.
        options: The fields of `PickOptions`.

    Returns:
        Whether the thing was let go, where it is, else why not.

    Raises:
        InputError: If there is no gripper, or an argument can't be used.
    """
    return perform(simulation, placing(simulation, pose, **options))


def held_thing(
    simulation: Runner, *, robot: str | None = None, group: str | None = None
) -> str | None:
    """Return the name of the thing that both fingers of a gripper press on, if any.

    Args:
        simulation: The simulation.
        robot: Which robot; None is the first one.
        group: Planning group of the arm; None is the first one with a gripper.
    """
    return Hand(simulation, PickOptions(robot=robot, group=group)).find_held()


def picking(simulation: Runner, thing: str, **options: Any) -> Activity[PickResult]:
    """Return what `pick` does, for those who simulate by themselves."""
    hand = Hand(simulation, read_options(PickOptions, "pick", options))
    body = hand.find_thing(thing)
    return _pick(hand, body)


def placing(
    simulation: Runner, pose: RigidTransform | Sequence[float], **options: Any
) -> Activity[PlaceResult]:
    """Return what `place` does, for those who simulate by themselves."""
    hand = Hand(simulation, read_options(PickOptions, "pick", options))
    return _place(hand, read_goal(pose))


def _pick(hand: "Hand", thing: str) -> Activity[PickResult]:
    began = hand.simulation.time
    attempts: list[Attempt] = []

    def result(reason: str) -> PickResult:
        duration = hand.simulation.time - began
        X_PO = None if reason else hand.pose_in_palm(thing)
        if X_PO is not None and hand.seen is not None:
            assert attempts[-1].grasp is not None
            X_PO = attempts[-1].grasp.X_OP.inverse()
        return PickResult(thing, not reason, reason, tuple(attempts), X_PO, duration)

    grasped = hand.find_held()
    if grasped is not None:
        return result(f"the gripper holds {grasped!r}")
    while len([a for a in attempts if a.stage != "reach"]) < hand.options.tries:
        tried = [a.grasp for a in attempts if a.grasp is not None]
        if hand.camera is not None:
            seen = see_box(hand.camera, thing, hand.robot.name)
            if not seen:
                attempts.append(Attempt(None, "look", seen.reason))
                break
            hand.seen = seen
        found = hand.choose(thing, tried)
        if isinstance(found, str):
            attempts.append(Attempt(None, "reach", found))
            break
        grasp, before = found
        try:
            yield from _grasp(hand, thing, grasp, before)
        except Failure as failure:
            attempts.append(Attempt(grasp, failure.stage, failure.reason))
            yield from _give_up(hand, thing)
            continue
        attempts.append(Attempt(grasp, "", ""))
        return result("")
    last = attempts[-1]
    failed = [a for a in attempts if a.grasp is not None] or [last]
    tries = "" if len(failed) < 2 else f"{len(failed)} grasps failed, the last one: "
    return result(f"{tries}{failed[-1].reason}")


def see_box(camera: CameraHandle, thing: str, robot: str) -> FoundBox:
    """Return the box that a camera sees where its labels show a thing.

    Pixels that show the robot are left out. InputError if the camera measures no
    depths, or there is no such thing.
    """
    points, names = camera.points(), camera.label_names
    _, label = find_label(camera, thing)
    labels = camera.labels()[np.isfinite(camera.depth())]
    on_thing = points[labels == label]
    if len(on_thing) < PIXELS:
        text = f"camera {camera.sensor.name!r} doesn't see {thing!r}"
        return FoundBox(success=False, reason=text)
    own = [n for n, name in enumerate(names) if name.startswith(f"{robot}::")]
    middle = np.median(on_thing, axis=0)
    found = find_box(
        points[~np.isin(labels, own)],
        region=(tuple(middle - _AROUND), tuple(middle + _AROUND)),
        near=middle,
    )
    if found.pose is None or found.size is None:
        text = f"what camera {camera.sensor.name!r} sees of {thing!r} is no box"
        return dc.replace(found, reason=f"{text}: {found.reason}")
    away = np.abs(found.pose.inverse() @ middle) - 0.5 * found.size
    if away.max() > _SLIP:
        text = f"camera {camera.sensor.name!r} sees too little of {thing!r}"
        return FoundBox(success=False, reason=f"{text}: {len(on_thing)} points")
    return found


def _grasp(
    hand: "Hand", thing: str, grasp: Grasp, before: Mapping[str, float]
) -> Activity[None]:
    """Go to a thing, close, and lift it, or raise Failure."""
    X_WP = hand.known_pose_of(thing) @ grasp.X_OP
    yield from hand.move_gripper(grasp.pre_grasp, "approach")
    yield from hand.move(before, "reach")
    yield from hand.move(X_WP, "approach", straight=True, ignore=[thing])
    yield from hand.move_gripper(1.0, "close", needs_stall=True)
    if hand.find_held() != thing:
        raise Failure(
            "close",
            f"the fingers don't both press on {thing!r}: they came to rest "
            f"{1e3 * hand.width():.1f} mm apart, and it is {1e3 * grasp.width:.1f} mm "
            "wide there",
        )
    start, height = hand.pose_in_palm(thing), hand.pose_of(thing).translation()[2]
    lift = hand.options.lift
    up = shifted(hand.palm(), [0.0, 0.0, lift])
    yield from hand.move(up, "lift", straight=True, ignore=[thing])
    end, lifted = hand.pose_in_palm(thing), hand.pose_of(thing).translation()[2]
    away, turn = distance(start, end)
    if hand.find_held() != thing or lifted - height < 0.5 * lift:
        raise Failure("lift", f"{thing!r} was lost while it was lifted")
    if away > _SLIP or turn > _TURN:
        raise Failure(
            "lift",
            f"{thing!r} slipped by {1e3 * away:.1f} mm and {turn:.2f} rad while it "
            "was lifted",
        )


def _give_up(hand: "Hand", thing: str) -> Activity[None]:
    """Open the gripper and draw back, as far as that is possible."""
    with contextlib.suppress(Failure):  # The next grasp will tell.
        yield from hand.move_gripper(0.0, "")
        yield from hand.draw_back(thing)


def _place(hand: "Hand", target: Place) -> Activity[PlaceResult]:
    began = hand.simulation.time
    thing = hand.find_held()
    if thing is None:
        return PlaceResult("", False, "the gripper holds nothing")
    first = hand.pose_in_palm(thing)
    slip = 0.0, 0.0

    def result(reason: str, *, success: bool = False) -> PlaceResult:
        duration = hand.simulation.time - began
        X = hand.pose_of(thing)
        misses = distance(X, goal)
        return PlaceResult(thing, success, reason, X, *misses, *slip, duration)

    reasons: list[str] = []
    goal, is_at_goal = target.X_WG, False
    X_WO = hand.palm() @ hand.known_pose_in_palm(thing)
    for goal in target.poses(X_WO, hand.base()):
        try:
            slip = yield from _carry(hand, thing, goal)
        except Failure as failure:
            reasons.append(failure.reason)
            if failure.stage == "lost":
                break
            continue
        is_at_goal = True
        break
    # What stands on something too early is pushed back.
    slip = max(slip, distance(first, hand.pose_in_palm(thing)))
    if not is_at_goal:
        return result(reasons[-1])
    try:
        yield from hand.move_gripper(hand.release(), "")
    except Failure as failure:
        return result(f"it isn't let go: {failure.reason}")
    try:
        yield from hand.draw_back(thing)
    except Failure as failure:
        return result(f"it doesn't get away: {failure.reason}", success=True)
    if hand.find_held() is not None:
        return result(f"{thing!r} sticks to the fingers")
    note = ""
    if hand.options.held is not None and (slip[0] > _MOVED or slip[1] > _MOVED_TURN):
        note = (
            f"{thing!r} moved by {1e3 * slip[0]:.1f} mm and {slip[1]:.2f} rad in the "
            "gripper on the way, and was placed as it was seen"
        )
    return result(note, success=True)


def _carry(
    hand: "Hand", thing: str, goal: RigidTransform
) -> Activity[tuple[float, float]]:
    """Carry a thing to its goal and put it down, or raise Failure.

    Returns by how much it moved in the fingers on the way [m], [rad].
    """
    first = hand.pose_in_palm(thing)
    X_WO = shifted(goal, [0.0, 0.0, _DROP])
    X_WP = X_WO @ hand.known_pose_in_palm(thing).inverse()
    above = hand.find_way(hand.solve(X_WP), hand.retreat_poses(X_WP), thing)
    yield from hand.move(above, "reach", attached=thing)
    if hand.find_held() != thing:
        raise Failure("lost", f"{thing!r} was lost on the way")
    slip = distance(first, hand.pose_in_palm(thing))
    X_WP = X_WO @ hand.known_pose_in_palm(thing).inverse()
    yield from hand.move(X_WP, "lower", straight=True, ignore=[thing])
    return slip
