"""OMPL's RRT-Connect on a CollisionModel; importing this needs the extra `planning`."""

from collections.abc import Callable, Sequence

import numpy as np
from ompl import base, geometric, util

from arm_drake.planning.collisions import CollisionModel

# Tries of each means of shortening a way. Twice as many, and a second round, made plans
# three times as slow and no shorter. A count, not a time: a plan is the same on every
# machine.
_TRIES = 30


class _EdgeChecker(base.MotionValidator):
    """Has Drake check whole edges."""

    def __init__(
        self, space: base.SpaceInformation, model: CollisionModel, step: float
    ) -> None:
        super().__init__(space)
        self._model, self._step = model, step
        self._size = len(model.joints)

    def checkMotion(self, one: base.State, other: base.State) -> bool:
        """Whether nothing collides between two states."""
        x, y = _values(one, self._size), _values(other, self._size)
        return self._model.is_edge_free(x, y, self._step)


def find_way(
    model: CollisionModel,
    start: np.ndarray,
    goals: Sequence[np.ndarray],
    bounds: tuple[np.ndarray, np.ndarray],
    *,
    step: float,
    is_over: Callable[[], bool],
    seed: int,
) -> np.ndarray | None:
    """Return the corners of a way from the start to a goal, shape (m, n), or None.

    Args:
        model: What can collide.
        start: Joint positions, shape (n,).
        goals: Joint positions, each of shape (n,); the way leads to one of them.
        bounds: Lower and upper ends of the joints.
        step: How far apart checks on an edge are, in the model's norm.
        is_over: Whether to give up.
        seed: Seed of the random search, above 0.
    """
    util.noOutputHandler()
    util.RNG.setSeed(seed)
    size = len(start)
    space = base.RealVectorStateSpace(size)
    box = base.RealVectorBounds(size)
    for index, (low, high) in enumerate(zip(*bounds, strict=True)):
        box.setLow(index, float(low))
        box.setHigh(index, float(high))
    space.setBounds(box)
    information = base.SpaceInformation(space)
    information.setStateValidityChecker(
        lambda state: model.is_free(_values(state, size))
    )
    checker = _EdgeChecker(information, model, step)
    information.setMotionValidator(checker)
    information.setup()
    problem = base.ProblemDefinition(information)
    problem.addStartState(_state(space, start))
    ends = base.GoalStates(information)
    for goal in goals:
        ends.addState(_state(space, goal))
    problem.setGoal(ends)
    planner = geometric.RRTConnect(information)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(is_over))
    if not problem.hasExactSolution():
        return None
    way = problem.getSolutionPath()
    simplifier = geometric.PathSimplifier(information)
    simplifier.reduceVertices(way, _TRIES, _TRIES)
    simplifier.partialShortcutPath(way, _TRIES, _TRIES)
    simplifier.reduceVertices(way, _TRIES, _TRIES)
    return np.array([_values(state, size) for state in way.getStates()])


def _state(space: base.StateSpace, x: np.ndarray) -> base.State:
    state = space.allocState()
    for index, value in enumerate(x):
        state[index] = float(value)
    return state


def _values(state: base.State, size: int) -> np.ndarray:
    return np.array([state[index] for index in range(size)])
