"""Links of a robot: what they weigh, what is drawn of them and what they collide with.

All of it is read from a URDF whose numbers have been checked, see `repairs`.
"""

import dataclasses as dc
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Vector = tuple[float, float, float]


@dc.dataclass(frozen=True)
class Origin:
    """`<origin>` of a part in its link, or of a joint in its parent link."""

    # [m].
    xyz: Vector = (0.0, 0.0, 0.0)

    # Roll, pitch, yaw [rad].
    rpy: Vector = (0.0, 0.0, 0.0)

    @property
    def rotation(self) -> Array:
        """The rotation, shape (3, 3)."""
        (sx, sy, sz), (cx, cy, cz) = np.sin(self.rpy), np.cos(self.rpy)
        return np.array(
            [
                [cy * cz, sx * sy * cz - cx * sz, cx * sy * cz + sx * sz],
                [cy * sz, sx * sy * sz + cx * cz, cx * sy * sz - sx * cz],
                [-sy, sx * cy, cx * cy],
            ]
        )

    @property
    def position(self) -> Array:
        """The position [m], shape (3,)."""
        return np.array(self.xyz)


@dc.dataclass(frozen=True)
class Geometry:
    """What is in a `<geometry>`; of its fields those that its type has."""

    # box, sphere, cylinder, capsule or mesh.
    type: str

    # Of a box [m].
    size: Vector = (0.0, 0.0, 0.0)

    # [m].
    radius: float = 0.0
    length: float = 0.0

    # URI of a mesh.
    filename: str = ""


@dc.dataclass(frozen=True)
class ShapeInfo:
    """A `<visual>` or a `<collision>` of a link."""

    origin: Origin

    # None where there is none.
    geometry: Geometry | None

    @property
    def wheel_radius(self) -> float:
        """Radius of a cylinder or a sphere [m], 0 of other shapes."""
        shape = self.geometry
        is_round = shape is not None and shape.type in ("cylinder", "sphere")
        return shape.radius if shape is not None and is_round else 0.0


@dc.dataclass(frozen=True)
class LinkInfo:
    """A link of a robot, as it is simulated."""

    name: str

    # [kg]; 0 for a link without one.
    mass: float

    visuals: tuple[ShapeInfo, ...]
    collisions: tuple[ShapeInfo, ...]


def read_link(link: ET.Element) -> LinkInfo:
    """Return what a `<link>` element says."""
    mass = link.find("inertial/mass")
    return LinkInfo(
        name=link.get("name", ""),
        mass=0.0 if mass is None else float(mass.get("value", "0")),
        visuals=tuple(map(_read_shape, link.iterfind("visual"))),
        collisions=tuple(map(_read_shape, link.iterfind("collision"))),
    )


def read_origin(element: ET.Element) -> Origin:
    """Return the `<origin>` of an element, the identity where it has none."""
    origin = element.find("origin")
    if origin is None:
        return Origin()
    return Origin(*(_vector(origin.get(name, "0 0 0")) for name in ("xyz", "rpy")))


def read_axis(joint: ET.Element) -> Vector:
    """Return the `<axis>` of a `<joint>` element, of any length."""
    axis = joint.find("axis")
    return _vector("1 0 0" if axis is None else axis.get("xyz", "1 0 0"))


def _read_shape(element: ET.Element) -> ShapeInfo:
    shape, geometry = element.find("geometry/*"), None
    if shape is not None:
        geometry = Geometry(
            shape.tag,
            size=_vector(shape.get("size", "0 0 0")),
            radius=float(shape.get("radius", "0")),
            length=float(shape.get("length", "0")),
            filename=shape.get("filename", ""),
        )
    return ShapeInfo(read_origin(element), geometry)


def _vector(text: str) -> Vector:
    x, y, z = map(float, text.split())
    return x, y, z
