"""Payloads: things on links that neither description nor servo knows of."""

import copy
from collections.abc import Iterable, Mapping, Sequence
from typing import TypeAlias

import numpy as np
from pydrake.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import (
    CalcSpatialInertia,
    ModelInstanceIndex,
    RigidBody,
    RotationalInertia,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.framework import Context

from arm_drake.arrays import is_finite
from arm_drake.description.joints import WORLD
from arm_drake.errors import InputError, check_known
from arm_drake.importing import dataclass

_SHAPES = (Box, Capsule, Cylinder, Ellipsoid, Sphere)

# How a payload with a shape looks, and how it slides.
_COLOR = np.array([0.85, 0.55, 0.2, 1.0])
_FRICTION = CoulombFriction(0.8, 0.8)


@dataclass(frozen=True)
class Payload:
    """A thing that is fixed to a link."""

    # Mass [kg].
    mass: float

    # Center of mass in the frame of the link [m].
    com: Sequence[float] = (0.0, 0.0, 0.0)

    # Moments and products of inertia about the center of mass, along the axes of the
    # link [kg·m^2]: Ixx, Iyy, Izz, Ixy, Ixz, Iyz. By default that of the shape, filled
    # evenly, or 0 without one.
    inertia: Sequence[float] | None = None

    # What is seen of it and collides, around its center of mass, along the axes of the
    # link: Drake's Box, Capsule, Cylinder, Ellipsoid or Sphere.
    shape: Box | Capsule | Cylinder | Ellipsoid | Sphere | None = None

    def __post_init__(self) -> None:
        """Raise InputError for what no thing has."""
        if not (is_finite(self.mass) and self.mass >= 0.0):
            raise InputError(f"mass: expected at least 0 kg, got {self.mass!r}")
        for name, values, size in (("com", self.com, 3), ("inertia", self.inertia, 6)):
            if values is None:
                continue
            is_list = isinstance(values, Sequence | np.ndarray)
            if not is_list or len(values) != size or not all(map(is_finite, values)):
                raise InputError(f"{name}: expected {size} numbers, got {values!r}")
        if not isinstance(self.shape, (*_SHAPES, type(None))):
            names = ", ".join(kind.__name__ for kind in _SHAPES)
            raise InputError(f"shape: expected one of {names}, got {self.shape!r}")
        try:
            self.spatial_inertia()
        except RuntimeError:  # Drake says why in ten lines.
            values = list(self.inertia or ())
            raise InputError(f"inertia: no thing of its mass has {values}") from None

    def spatial_inertia(self) -> SpatialInertia:
        """Return the inertia about the link's origin, along its axes."""
        if self.inertia is not None:
            central = RotationalInertia(*map(float, self.inertia))
        elif self.shape is not None:
            whole = CalcSpatialInertia(self.shape, 1.0)
            central = whole.CalcRotationalInertia() * (self.mass / whole.get_mass())
        else:
            central = RotationalInertia(0.0, 0.0, 0.0)
        com = np.array(self.com, dtype=float)
        if self.mass == 0.0:
            return SpatialInertia(0.0, com, UnitInertia(0.0, 0.0, 0.0))
        return SpatialInertia.MakeFromCentralInertia(float(self.mass), com, central)


# Payloads, or their masses [kg], by link.
Payloads: TypeAlias = Mapping[str, Payload | float]


def read_payload(link: str, payload: Payload | float) -> Payload:
    """Return the payload of a link, which may be a mass alone [kg]."""
    if isinstance(payload, Payload):
        return payload
    if not is_finite(payload):
        problem = f"expected a Payload or a mass [kg], got {payload!r}"
        raise InputError(problem, where=f"payload of link {link!r}")
    return Payload(payload)


def check_link(name: str, links: Iterable[str], where: str | None = None) -> None:
    """Raise InputError if a name is none of the links, or that of the world.

    With several robots a link is called `<robot>/<link>`.
    """
    if name.rpartition("/")[2] == WORLD:
        text = f"{name!r} is the world itself, it carries nothing"
        raise InputError(text, where=where)
    known = [each for each in links if each.rpartition("/")[2] != WORLD]
    check_known("link", name, known, where=where)


def split_payloads(
    payloads: Payloads, links: Mapping[str, Sequence[str]]
) -> dict[str, dict[str, Payload]]:
    """Return payloads by robot and link; `links` are those of robots, by name.

    With several robots a link is called `<robot>/<link>`.
    """
    if not isinstance(payloads, Mapping):
        raise InputError(f"payloads: expected them by link, got {payloads!r}")
    many = len(links) > 1
    owners = {
        f"{robot}/{link}" if many else link: (robot, link)
        for robot, names in links.items()
        for link in names
    }
    found: dict[str, dict[str, Payload]] = {robot: {} for robot in links}
    for name, payload in payloads.items():
        check_link(name, owners, "payload")
        robot, link = owners[name]
        found[robot][link] = read_payload(name, payload)
    return found


def _name(link: str) -> str:
    return f"{link}/payload"


def add_payloads(
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    payloads: Mapping[str, Payload],
    *,
    collides: bool,
) -> None:
    """Fix payloads to links of a robot, in a plant that isn't finalized."""
    for link, payload in payloads.items():
        body = plant.AddRigidBody(_name(link), model, payload.spatial_inertia())
        parent = plant.GetBodyByName(link, model)
        plant.WeldFrames(parent.body_frame(), body.body_frame())
        # What touches the payload pushes the link.
        if payload.shape is not None and plant.geometry_source_is_registered():
            X_BG = RigidTransform(np.array(payload.com, dtype=float))
            name, shape = "payload", payload.shape
            plant.RegisterVisualGeometry(parent, X_BG, shape, name, _COLOR)
            if collides:
                plant.RegisterCollisionGeometry(parent, X_BG, shape, name, _FRICTION)


def set_payload(
    plant: MultibodyPlant,
    context: Context,
    model: ModelInstanceIndex,
    link: str,
    payload: Payload,
) -> None:
    """Let a link have a payload from now on, in place of the one that it has.

    Shapes stay as they are.
    """
    if plant.HasBodyNamed(_name(link), model):
        body: RigidBody = plant.GetBodyByName(_name(link), model)
        body.SetSpatialInertiaInBodyFrame(context, payload.spatial_inertia())
        return
    body = plant.GetBodyByName(link, model)
    # What Drake returns is the body's own.
    inertia = copy.copy(body.default_spatial_inertia())
    inertia += payload.spatial_inertia()
    body.SetSpatialInertiaInBodyFrame(context, inertia)
