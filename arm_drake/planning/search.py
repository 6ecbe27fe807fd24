"""OMPL's RRT-Connect on a CollisionModel; importing this needs the extra `planning`."""

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
from ompl import base, geometric, util

from arm_drake.planning.collisions import CollisionModel
from arm_drake.planning.orientation_constraint import Tilt

# Tries of each means of shortening a way. Twice as many, and a second round, made plans
# three times as slow and no shorter. A count, not a time: a plan is the same on every
# machine.
_TRIES = 30

# How far joints go beyond both ends of a way [rad] or [m], search after search: ways
# seldom lead far around, and in all of what joints with several turns can do most
# samples are far from where a way is. Then everything, then all of it again, longer.
_BEYOND = 1.0, 2.0, math.inf

# The largest part of all that the joints can do, by volume, that has a search of its
# own: one in more of it finds little that the search in all of it doesn't.
_PART = 0.1

# Iterations of the first searches, which are begun anew with twice as many.
_ITERATIONS = 1000

# Iterations of all of them where no time is set: the same on every machine.
ITERATIONS = 21 * _ITERATIONS

# Trees grow by no longer steps [rad] or [m]: OMPL's fifth of the space would be 5 rad.
_GROWTH = 0.8

# How near to the cone of a constraint a step is brought [rad].
_IN_CONE = 1e-4

# Steps along the cone are no longer than this [rad] or [m].
_LONGEST_STEP = 0.1


class _Memory:
    """Cached collision checks: OMPL checks both ends of an edge, and edges, anew.

    Trees grow from states that are free, and of a way with few corners the same two are
    joined time and again.
    """

    def __init__(self, model: CollisionModel, step: float) -> None:
        """Remember nothing yet; edges are checked at steps in the model's norm."""
        self._model, self._step = model, step
        self._free: dict[bytes, bool] = {}
        self._edges: dict[tuple[bytes, bytes], bool] = {}

    def is_free(self, x: np.ndarray) -> bool:
        """Return whether nothing collides at joint positions."""
        key = x.tobytes()
        if key not in self._free:
            self._free[key] = self._model.is_free(x)
        return self._free[key]

    def is_edge_free(self, x: np.ndarray, y: np.ndarray) -> bool:
        """Return whether nothing collides on a line."""
        one, other = x.tobytes(), y.tobytes()
        if (one, other) not in self._edges:
            # The start is the last to be looked at, but for what is known of it.
            self._edges[one, other] = (
                self.is_free(y)
                and self._free.get(one, True)
                and self._model.is_inside_free(x, y, self._step)
                and self.is_free(x)
            )
        return self._edges[one, other]


class _EdgeChecker(base.MotionValidator):
    """Checks whole edges by Drake."""

    def __init__(self, space: base.SpaceInformation, memory: _Memory) -> None:
        super().__init__(space)
        self._memory = memory
        self._size = space.getStateDimension()

    def checkMotion(self, one: base.State, other: base.State) -> bool:
        """Return whether nothing collides between two states."""
        x, y = _values(one, self._size), _values(other, self._size)
        return self._memory.is_edge_free(x, y)


class _Cone(base.Constraint):
    """Keeps a link's axis in a cone: what it is out of it is to be none."""

    def __init__(self, tilt: Tilt, size: int) -> None:
        super().__init__(size, 1, _IN_CONE)
        self._tilt = tilt

    def function(self, x: np.ndarray, out: np.ndarray) -> None:
        """Set how far the axis is out of the cone [rad]."""
        out[0] = max(0.0, self._tilt.angle(x) - self._tilt.inner)

    def jacobian(self, x: np.ndarray, out: np.ndarray) -> None:
        """Set how that changes by the joints."""
        out[0] = self._tilt.gradient(x)


def find_way(
    model: CollisionModel,
    start: np.ndarray,
    goals: Sequence[np.ndarray],
    bounds: tuple[np.ndarray, np.ndarray],
    *,
    step: float,
    is_over: Callable[[], bool],
    is_timed: bool,
    seed: int,
    tilt: Tilt | None = None,
) -> np.ndarray | None:
    """Return the corners of a way from the start to one of the goals, shape (m, n).

    It is None where `is_over` says so before there is one; unless `is_timed`, a number
    of iterations ends the search, too. Checks on an edge are `step` apart, in the
    model's norm. With a `tilt`, how far a link may tilt on the way, its steps are the
    corners.
    """
    util.noOutputHandler()
    util.RNG.setSeed(seed)
    ends = np.array([start, *goals])
    boxes, way, left = _find_boxes(ends, bounds), None, ITERATIONS
    for search in itertools.count():
        again, stage = divmod(search, len(boxes))
        information = _find_information(model, boxes[stage], step, tilt)
        iterations = _ITERATIONS << again
        if not is_timed:
            iterations = min(iterations, left)
            left -= iterations
        if not iterations:
            break
        way = _search(information, ends, is_over, iterations)
        if way is not None or is_over():
            break
    if way is None:
        return None
    simplifier = geometric.PathSimplifier(information)
    simplifier.reduceVertices(way, _TRIES, _TRIES)
    simplifier.partialShortcutPath(way, _TRIES, _TRIES)
    simplifier.reduceVertices(way, _TRIES, _TRIES)
    if tilt is not None:
        way.interpolate()
    return np.array([_values(state, len(start)) for state in way.getStates()])


def _find_boxes(
    ends: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return where to search, the lower and upper ends of joints; the last is all."""
    boxes = []
    for beyond in _BEYOND:
        low = np.maximum(bounds[0], ends.min(axis=0) - beyond)
        high = np.minimum(bounds[1], ends.max(axis=0) + beyond)
        part = np.prod((high - low) / (bounds[1] - bounds[0]))
        if part < _PART or math.isinf(beyond):
            boxes.append((low, high))
    return boxes


def _search(
    information: base.SpaceInformation,
    ends: np.ndarray,
    is_over: Callable[[], bool],
    iterations: int,
) -> geometric.PathGeometric | None:
    """Return a way from the first of the ends to one of the others, or None."""
    information.setup()
    space = information.getStateSpace()
    problem = base.ProblemDefinition(information)
    problem.addStartState(_state(space, ends[0]))
    goals = base.GoalStates(information)
    for goal in ends[1:]:
        goals.addState(_state(space, goal))
    problem.setGoal(goals)
    planner = geometric.RRTConnect(information)
    planner.setRange(_GROWTH)
    planner.setProblemDefinition(problem)
    planner.setup()
    # OMPL asks in each iteration; a count is the same on every machine.
    count = itertools.count()
    planner.solve(
        base.PlannerTerminationCondition(lambda: is_over() or next(count) >= iterations)
    )
    return problem.getSolutionPath() if problem.hasExactSolution() else None


def _find_information(
    model: CollisionModel,
    bounds: tuple[np.ndarray, np.ndarray],
    step: float,
    tilt: Tilt | None,
) -> base.SpaceInformation:
    """Return what says whether states and edges within bounds are allowed."""
    size = len(model.joints)
    space = base.RealVectorStateSpace(size)
    box = base.RealVectorBounds(size)
    for index, (low, high) in enumerate(zip(*bounds, strict=True)):
        box.setLow(index, float(low))
        box.setHigh(index, float(high))
    space.setBounds(box)
    if tilt is None:
        information = base.SpaceInformation(space)
        memory = _Memory(model, step)
        information.setStateValidityChecker(
            lambda state: memory.is_free(_values(state, size))
        )
        information.setMotionValidator(_EdgeChecker(information, memory))
        return information
    cone = base.ProjectedStateSpace(space, _Cone(tilt, size))
    information = base.ConstrainedSpaceInformation(cone)
    cone.setDelta(min(_LONGEST_STEP, step / model.largest_weight))
    information.setStateValidityChecker(
        lambda state: _is_allowed(model, tilt, bounds, _values(state, size))
    )
    return information


def _is_allowed(
    model: CollisionModel,
    tilt: Tilt,
    bounds: tuple[np.ndarray, np.ndarray],
    x: np.ndarray,
) -> bool:
    """Return whether a step of a search in a cone is in it, within limits and free."""
    is_within = bool(np.all((bounds[0] <= x) & (x <= bounds[1])))
    return is_within and tilt.angle(x) <= tilt.most and model.is_free(x)


def _state(space: base.StateSpace, x: np.ndarray) -> base.State:
    state = space.allocState()
    if isinstance(space, base.ConstrainedStateSpace):
        state.copy(np.array(x, dtype=float))
        return state
    for index, value in enumerate(x):
        state[index] = float(value)
    return state


def _values(state: base.State, size: int) -> np.ndarray:
    return np.array([state[index] for index in range(size)])
