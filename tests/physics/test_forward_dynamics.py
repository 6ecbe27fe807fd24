"""Robots accelerate as another library computes from the same URDF text."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio
import pytest
from pydrake.systems.framework import DiagramBuilder

import arm_drake as ad
from arm_drake.description.joints import JointInfo
from arm_drake.description.urdf import RobotDescription
from arm_drake.plant.plant import (
    add_actuators,
    add_plant,
    add_robot_model,
    state_indices,
)
from tests.robots import load_real_robot, read_index, robot_names

STEP = 1e-3
NUM_STATES = 50

# Largest error, as a part of the largest acceleration: rounding, 2e-16, times the
# condition of the worst mass matrix, 6e5, and a few.
TOLERANCE = 1e-9

# Positions are within this part of the joints' ranges, so that no limit acts, and at
# most so far from zero [rad]; velocities go up to a range per second, and this [rad/s].
INNER = 0.8
FAR = 3.0
SPEED = 2.0

# Efforts are what accelerates each joint alone by up to this [rad/s^2] or [m/s^2].
ACCELERATION = 20.0


class State(NamedTuple):
    """Of the m movable joints, in the order of the description: each of shape (m,)."""

    q: np.ndarray
    v: np.ndarray
    effort: np.ndarray


class OtherModel:
    """The robot in Pinocchio, without its mimic constraints."""

    def __init__(self, description: RobotDescription) -> None:
        joints = description.movable_joints
        self._model = pinocchio.buildModelFromXML(_without_shapes(description.urdf))
        self._data = self._model.createData()
        ids = [self._model.getJointId(joint.name) for joint in joints]
        self._at = [self._model.idx_vs[index] for index in ids]
        assert sorted(self._at) == list(range(self._model.nv))
        self._D = np.array([joint.damping for joint in joints])

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        M = pinocchio.crba(self._model, self._data, self._positions(q))
        M = np.triu(M) + np.triu(M, 1).T
        return M[np.ix_(self._at, self._at)]

    def accelerations(self, state: State, inertia: np.ndarray) -> np.ndarray:
        """Return the accelerations, shape (m,).

        Args:
            state: Where the joints are, and what acts on them besides damping.
            inertia: What is added to the mass matrix's diagonal, shape (m,).
        """
        # It reads the damping, and leaves it out.
        effort = state.effort - self._D * state.v
        self._model.armature = self._sort(inertia)
        v, effort = self._sort(state.v), self._sort(effort)
        q = self._positions(state.q)
        a = pinocchio.aba(self._model, self._data, q, v, effort)
        self._model.armature = np.zeros(self._model.nv)
        return a[self._at]

    def efforts(self, state: State, a: np.ndarray) -> np.ndarray:
        """Return what accelerations ask for besides the state's effort, shape (m,)."""
        q, v = self._positions(state.q), self._sort(state.v)
        requested = pinocchio.rnea(self._model, self._data, q, v, self._sort(a))
        return requested[self._at] + self._D * state.v - state.effort

    def _sort(self, values: np.ndarray) -> np.ndarray:
        vector = np.zeros(self._model.nv)
        vector[self._at] = values
        return vector

    def _positions(self, q: np.ndarray) -> np.ndarray:
        # An angle without limits is a point on a circle there.
        neutral = pinocchio.neutral(self._model)
        return pinocchio.integrate(self._model, neutral, self._sort(q))


def _without_shapes(urdf: str) -> str:
    """Return a URDF with efforts and velocities in its limits, as the standard asks."""
    root = ET.fromstring(urdf)  # noqa: S314  our own text.
    for link in root.iterfind("link"):
        for tag in ("visual", "collision"):
            for element in link.findall(tag):
                link.remove(element)
    for limit in root.iter("limit"):
        limit.attrib = {"effort": "0", "velocity": "0"} | limit.attrib
    return ET.tostring(root, encoding="unicode")


class Plant:
    """The robot's plant, of which every joint has an actuator without limit."""

    def __init__(self, description: RobotDescription) -> None:
        names = [joint.name for joint in description.movable_joints]
        builder = DiagramBuilder()
        plant, _ = add_plant(builder, STEP, ad.SimulationOptions())
        # Without shapes, so that nothing touches.
        model = add_robot_model(plant, description, "robot", None, is_reduced=True)
        add_actuators(plant, model, names, [math.inf] * len(names))
        plant.Finalize()
        self._plant = plant
        self._diagram = builder.Build()
        root = self._diagram.CreateDefaultContext()
        self._root, self._context = root, plant.GetMyContextFromRoot(root)
        q_at, state_at = state_indices(plant, model, names)
        self._q_at = q_at
        self._v_at = [index - plant.num_positions() for index in state_at]
        self._state_at = state_at
        self.damping = np.array(
            [plant.GetJointByName(n).default_damping_vector()[0] for n in names]
        )

    def accelerations(self, state: State) -> np.ndarray:
        """Return the accelerations that its equations of motion give, shape (m,)."""
        self._set(state)
        plant, at = self._plant, self._v_at
        M = plant.CalcMassMatrix(self._context)[np.ix_(at, at)]
        Cv = plant.CalcBiasTerm(self._context)[at]
        gravity = plant.CalcGravityGeneralizedForces(self._context)[at]
        forces = state.effort - self.damping * state.v - Cv + gravity
        return np.linalg.solve(M, forces)

    def step(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and velocities a step later, each of shape (m,)."""
        self._set(state)
        x = self._plant.EvalUniquePeriodicDiscreteUpdate(self._context).value()
        return x[self._q_at], x[self._state_at]

    def _set(self, state: State) -> None:
        x = np.zeros(self._plant.num_multibody_states())
        x[self._q_at], x[self._state_at] = state.q, state.v
        self._plant.SetPositionsAndVelocities(self._context, x)
        # Actuators stand in the order in which they were added.
        self._plant.get_actuation_input_port().FixValue(self._context, state.effort)


class Case(NamedTuple):
    """A robot in both libraries."""

    joints: tuple[JointInfo, ...]
    plant: Plant
    other: OtherModel


def arms() -> list[str]:
    """Return the bundled robot, and the arms of the index."""
    names = robot_names()
    if names != ["none"]:
        index = read_index()
        names = [name for name in names if index[name]["kind"] == "arm"]
    return ["bundled", *names]


@pytest.fixture(scope="module", params=arms())
def case(request: pytest.FixtureRequest) -> Case:
    if request.param == "bundled":
        robot = ad.load_robot("doosan_a0912")
    else:
        robot = load_real_robot(request.param)
    description = robot.description
    joints = description.movable_joints
    return Case(joints, Plant(description), OtherModel(description))


def motions(joints: tuple[JointInfo, ...]) -> tuple[list[int], np.ndarray, np.ndarray]:
    """Return how joints move with those that nothing holds: q = N q[free] + b.

    Neither a mimic joint is free, nor one whose limits are equal.

    Returns:
        Which of the m joints are free, n of them; N, shape (m, n); b, shape (m,).
    """
    names = [joint.name for joint in joints]
    free = [
        row
        for row, joint in enumerate(joints)
        if joint.mimic is None
        and (joint.limits.lower is None or joint.limits.lower != joint.limits.upper)
    ]
    N, b = np.zeros((len(joints), len(free))), np.zeros(len(joints))
    for row in range(len(joints)):
        factor, master = 1.0, row
        while (mimic := joints[master].mimic) is not None:
            b[row] += factor * mimic.offset
            factor, master = factor * mimic.multiplier, names.index(mimic.joint)
        if master in free:
            N[row, free.index(master)] = factor
        else:
            b[row] += factor * (joints[master].limits.lower or 0.0)
    return free, N, b


def random_states(case: Case) -> Iterator[State]:
    """Yield states in which mimic joints follow and no limit acts."""
    free, N, b = motions(case.joints)
    limits = [joint.limits for joint in case.joints]
    lower = np.array([-FAR if x.lower is None else max(x.lower, -FAR) for x in limits])
    upper = np.array([FAR if x.upper is None else min(x.upper, FAR) for x in limits])
    middle, reach = (lower + upper) / 2.0, INNER * (upper - lower) / 2.0
    speed = np.minimum(SPEED, upper - lower)[free]
    random = np.random.default_rng(1)
    for _ in range(NUM_STATES):
        q = np.full(len(case.joints), np.inf)
        # What follows has limits too.
        while not (np.abs(q - middle) <= reach + 1e-12).all():
            drawn = middle + reach * random.uniform(-1.0, 1.0, len(middle))
            q = N @ drawn[free] + b
        v = N @ (speed * random.uniform(-1.0, 1.0, len(free)))
        a = ACCELERATION * random.uniform(-1.0, 1.0, len(q))
        yield State(q, v, np.diagonal(case.other.mass_matrix(q)) * a)


def test_accelerations_are_those_of_another_library(case: Case) -> None:
    nothing = np.zeros(len(case.joints))
    for state in random_states(case):
        expected = case.other.accelerations(state, nothing)

        a = case.plant.accelerations(state)

        tolerance = TOLERANCE * np.abs(expected).max()
        np.testing.assert_allclose(a, expected, rtol=0.0, atol=tolerance)


def test_steps_are_those_of_another_library(case: Case) -> None:
    free, N, _ = motions(case.joints)
    h_D = STEP * case.plant.damping
    for state in random_states(case):
        q, v = case.plant.step(state)

        np.testing.assert_allclose(q, state.q + STEP * v, rtol=0.0, atol=1e-12)
        # Damping is implicit: it acts at the end of the step, as an inertia of h D.
        a = (v - state.v) / STEP
        expected = case.other.accelerations(state, h_D)
        error = a - expected
        if len(free) < len(case.joints):
            # What holds joints does no work in motions that it allows.
            forces = case.other.efforts(state, a) + h_D * a
            M = case.other.mass_matrix(state.q) + np.diag(h_D)
            error = np.linalg.solve(N.T @ M @ N, N.T @ forces)
        assert np.abs(error).max() < TOLERANCE * np.abs(expected).max()
