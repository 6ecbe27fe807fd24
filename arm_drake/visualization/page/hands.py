"""Hands on a page: bodies are pulled by a spring with the mouse, and pushed."""

import dataclasses as dc
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import Rgba
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody
from pydrake.systems.framework import Context

from arm_drake.arrays import Array
from arm_drake.errors import check_known
from arm_drake.importing import dataclass
from arm_drake.options import GRAVITY
from arm_drake.visualization.page.parts import Live, Part
from arm_drake.visualization.page.widgets import (
    Button,
    Choice,
    Section,
    Slider,
    Text,
    Toggle,
)

# The diagram's input for forces on bodies.
_PORT = "applied_spatial_force"

# The spring: its frequency with the mass of what it pulls [rad/s], its damping ratio,
# the part of a model's mass that counts at least, and the largest force in weights.
_FREQUENCY, _DAMPING, _LEAST_PART, _MOST_WEIGHTS = 20.0, 0.7, 0.05, 10.0

# For so long a force stays as it is [s].
_HOLD = 0.002

# Where the spring is drawn, and how.
_PATH = "/hands/spring"
_COLOR, _WIDTH = Rgba(0.9, 0.35, 0.05), 4.0

DIRECTIONS: Mapping[str, tuple[float, float, float]] = {
    "+x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
    "+y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "+z": (0.0, 0.0, 1.0),
    "-z": (0.0, 0.0, -1.0),
}


@dc.dataclass
class _Pull:
    """A spring between a point of a body and one in the world."""

    path: str
    start: tuple[float, ...]
    body: RigidBody

    # Of the body, in its frame; and where it is pulled to [m].
    p_BoBq_B: Array
    target: Array


@dataclass(frozen=True)
class _Push:
    """A force on the center of mass of a body, in the world [N], up to a time [s]."""

    body: RigidBody
    force: Array
    until: float


class Hands(Part):
    """The section that pulls and pushes bodies of a simulation."""

    word = "hands"

    def __init__(self, live: Live) -> None:
        """Create it for the simulation's plant."""
        self._live = live
        self.is_dragging, self.force, self.duration = False, 10.0, 0.5
        self.direction = next(iter(DIRECTIONS))
        self._pull: _Pull | None = None
        self._pushes: list[_Push] = []
        self._has_forces = False
        # What the spring pulls with [N].
        self._size = 0.0
        self.bodies = self._find_bodies()
        self.body = next(reversed(self.bodies), "")

    @property
    def _plant(self) -> MultibodyPlant:
        return self._live.simulation.plant

    @property
    def _context(self) -> Context:
        return self._plant.GetMyContextFromRoot(self._live.simulation.context)

    def _find_bodies(self) -> dict[str, BodyIndex]:
        """Return the bodies that can move by name: `<model>/<body>`, or the model's."""
        plant, robots = self._plant, self._live.simulation.robots
        found = {}
        for index in map(BodyIndex, range(1, plant.num_bodies())):
            body = plant.get_body(index)
            if plant.IsAnchored(body) or body.name().endswith("/payload"):
                continue
            model = plant.GetModelInstanceName(body.model_instance())
            is_alone = len(plant.GetBodyIndices(body.model_instance())) == 1
            only = len(robots) == 1 and model in robots
            name = body.name() if only else model
            found[name if only or is_alone else f"{model}/{body.name()}"] = index
        return found

    def pull(self, body: str, start: Sequence[float], target: Sequence[float]) -> None:
        """Pull one of `bodies` by a spring, until `release`.

        It is fixed at `start` on the body, and its other end at `target` now, both in
        the world [m].
        """
        self._hold(body, self._find(body), start, target)

    def release(self) -> None:
        """Pull no more."""
        self._pull = None
        self._live.page.meshcat.Delete(_PATH)

    def push(self, body: str, force: Sequence[float], duration: float) -> None:
        """Push the center of mass of one of `bodies` from now on for a while [s].

        The force is in the world, along x, y and z [N].
        """
        until = self._live.simulation.time + duration
        self._pushes.append(_Push(self._find(body), np.array(force, float), until))
        self._live.note(f"{body}: pushed with {np.linalg.norm(force):.4g} N")

    def advance(self) -> float:
        """Set the forces as they are now."""
        now = self._live.simulation.time
        self._pushes = [push for push in self._pushes if push.until > now]
        if not (self._pull or self._pushes or self._has_forces):
            return math.inf
        forces = [self._pushed(push) for push in self._pushes]
        if self._pull is not None:
            forces.append(self._pulled(self._pull))
        port = self._live.simulation.diagram.GetInputPort(_PORT)
        self._has_forces = bool(forces)
        # Drake can't tell an empty list of forces from any other.
        nothing = [_force(self._plant.get_body(BodyIndex(1)), np.zeros(3), np.zeros(3))]
        value = AbstractValue.Make(forces or nothing)
        port.FixValue(self._live.simulation.context, value)
        if self._pull is None:
            ends = [push.until - now for push in self._pushes]
            return min(ends, default=math.inf)
        return max(_HOLD, self._plant.time_step())

    def reset(self) -> None:
        """Let go of all: the simulation begins anew."""
        self.release()
        self._pushes, self._has_forces = [], False

    def act(self, what: str, value: object) -> None:
        """Do what one of its widgets stands for."""
        if what == "pull":
            self._drag(value)
        elif what == "release":
            self.release()
        elif what == "drag":
            self.is_dragging = bool(value)
        elif what == "push":
            force = self.force * np.array(DIRECTIONS[self.direction])
            self.push(self.body, force.tolist(), self.duration)
        elif what == "body":
            self._find(str(value))
            self.body = str(value)
        elif what == "direction":
            if value in DIRECTIONS:
                self.direction = str(value)
        elif what in ("force", "duration") and isinstance(value, int | float):
            setattr(self, what, max(float(value), 0.0))

    def changes(self) -> dict[str, dict[str, Any]]:
        """Return present fields of its widgets, and draw the spring."""
        self._draw()
        text = f"{self._size:.1f} N" if self._pull is not None else "–"
        return {
            "hands:pulling": {"value": text},
            "hands:drag": {"value": self.is_dragging},
            "hands:body": {"value": self.body},
            "hands:direction": {"value": self.direction},
            "hands:force": {"value": self.force},
            "hands:duration": {"value": self.duration},
        }

    def section(self) -> Section:
        """Return its part of the panel."""
        if not self.bodies:
            return Section("Pull and push", ())
        weight = self._plant.CalcTotalMass(self._context) * GRAVITY
        hint = "or hold shift: what is dragged in the scene is pulled by a spring"
        return Section(
            "Pull and push",
            (
                Toggle("hands:drag", "drag in the scene pulls", self.is_dragging, hint),
                Text("hands:pulling", "pulled with", "–"),
                Choice("hands:body", "push", tuple(self.bodies), self.body),
                Choice("hands:direction", "towards", tuple(DIRECTIONS), self.direction),
                Slider("hands:force", "force", 0.0, _ceil(weight), self.force, "N"),
                Slider("hands:duration", "for", 0.05, 5.0, self.duration, "s"),
                Button("hands:push", "push", "at its center of mass"),
            ),
            is_open=False,
        )

    def _find(self, name: str) -> RigidBody:
        check_known("body", name, self.bodies)
        return self._plant.get_body(self.bodies[name])

    def _drag(self, value: object) -> None:
        """Pull what is dragged in the scene."""
        try:
            drag: Any = value
            path = str(drag["path"])
            start, target = (np.array(drag[end], dtype=float) for end in ("from", "to"))
        except (TypeError, KeyError, ValueError, OverflowError):
            return
        if any(e.shape != (3,) or not np.isfinite(e).all() for e in (start, target)):
            return
        if (body := self._body_at(path)) is not None:
            self._hold(path, body, start, target)

    def _hold(
        self, path: str, body: RigidBody, start: Sequence[float] | Array, target: Any
    ) -> None:
        """Pull a body at a point, which stays the same while the start does."""
        key = tuple(map(float, start))
        if self._pull is None or (self._pull.path, self._pull.start) != (path, key):
            X_WB = self._plant.EvalBodyPoseInWorld(self._context, body)
            point = X_WB.inverse() @ np.array(start, dtype=float)
            self._pull = _Pull(path, key, body, np.asarray(point), np.zeros(3))
        self._pull.target = np.array(target, dtype=float)

    def _body_at(self, path: str) -> RigidBody | None:
        """Return the body that can move and is drawn at a Meshcat path."""
        below, best, length = f"{path}/", None, 0
        graph = self._live.simulation.diagram.GetSubsystemByName("scene_graph")
        inspector = graph.model_inspector()
        for index in self.bodies.values():
            frame = self._plant.GetBodyFrameIdIfExists(index)
            if frame is None:
                continue
            own = f"/{inspector.GetName(frame).replace('::', '/')}/"
            if own in below and len(own) > length:
                best, length = self._plant.get_body(index), len(own)
        return best

    def _pushed(self, push: _Push) -> ExternallyAppliedSpatialForce:
        com = push.body.CalcCenterOfMassInBodyFrame(self._context)
        return _force(push.body, com, push.force)

    def _pulled(self, pull: _Pull) -> ExternallyAppliedSpatialForce:
        plant, context = self._plant, self._context
        total = plant.CalcTotalMass(context, [pull.body.model_instance()])
        mass = max(pull.body.get_mass(context), _LEAST_PART * total, 1e-3)
        X_WB = plant.EvalBodyPoseInWorld(context, pull.body)
        V_WB = plant.EvalBodySpatialVelocityInWorld(context, pull.body)
        p_BoBq_W = X_WB.rotation() @ pull.p_BoBq_B
        velocity = V_WB.translational() + np.cross(V_WB.rotational(), p_BoBq_W)
        stretch = pull.target - X_WB.translation() - p_BoBq_W
        force = mass * _FREQUENCY**2 * stretch
        force -= 2.0 * _DAMPING * mass * _FREQUENCY * velocity
        largest = _MOST_WEIGHTS * max(total, mass) * GRAVITY
        size = float(np.linalg.norm(force))
        force *= min(1.0, largest / max(size, 1e-9))
        self._size = min(size, largest)
        return _force(pull.body, pull.p_BoBq_B, force)

    def _draw(self) -> None:
        if self._pull is not None:
            X_WB = self._plant.EvalBodyPoseInWorld(self._context, self._pull.body)
            ends = np.column_stack([X_WB @ self._pull.p_BoBq_B, self._pull.target])
            self._live.page.meshcat.SetLine(_PATH, ends, _WIDTH, _COLOR)


def _force(
    body: RigidBody, point: Array, force: Array
) -> ExternallyAppliedSpatialForce:
    """Return a force [N] in the world at a point of a body, in its frame."""
    applied = ExternallyAppliedSpatialForce()
    applied.body_index, applied.p_BoBq_B = body.index(), point
    applied.F_Bq_W = SpatialForce(np.zeros(3), force)
    return applied


def _ceil(force: float) -> float:
    """Return 1, 2 or 5 times a power of ten, not less than a force and 20 N."""
    force = max(force, 20.0)
    power = 10.0 ** math.floor(math.log10(force))
    return next(k * power for k in (1.0, 2.0, 5.0, 10.0) if k * power >= force)


def make_hands(live: Live) -> Hands | None:
    """Return the section of a simulation with physics; None where there is none."""
    is_open = live.simulation.diagram.HasInputPort(_PORT)
    return Hands(live) if is_open and live.views.has_physics else None
