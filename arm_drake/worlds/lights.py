"""Lights of a world, which cameras see by; the page has its own lamps.

Sources: SDFormat, sdf/1.11/light.sdf; the sun is that of gz-sim's empty world.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Final

import numpy as np

from arm_drake.description.elements import parse_floats, parse_sdf_bool, text_of
from arm_drake.description.links import Vector
from arm_drake.importing import dataclass
from arm_drake.plant.plant import transform_of
from arm_drake.worlds.sdf_files import SdfFile


@dataclass(frozen=True)
class Light:
    """A light, as Drake's renderer takes it."""

    # "directional", "point" or "spot".
    type: str = "directional"

    # Red, green and blue from 0 to 1.
    color: Vector = (1.0, 1.0, 1.0)

    # Of a directional light nothing gets less by distance: constant, linear [1/m] and
    # quadratic [1/m^2].
    attenuation: Vector = (1.0, 0.0, 0.0)

    # In the world [m], or in the camera's frame.
    position: Vector = (0.0, 0.0, 0.0)
    frame: str = "world"

    intensity: float = 1.0

    # Where it shines to.
    direction: Vector = (0.0, 0.0, -1.0)

    # Half of the cone's angle [degrees].
    cone_angle: float = 0.0

    cast_shadows: bool = False


# Light of the sky, which comes from everywhere: what a camera sees is lit from there
# by one light of a kind that casts no shadows; each takes time for every pixel.
FILL: Final = (Light("point", frame="camera", intensity=0.5),)

# The sun of Gazebo's worlds.
SUN: Final = Light(direction=(-0.5, 0.1, -0.9), intensity=0.8, cast_shadows=True)

# Lights of a world that has none: Gazebo has a sun then, too.
DAYLIGHT: Final = (SUN, *FILL)

_TYPES: Final = ("directional", "point", "spot")


def read_lights(elements: Sequence[ET.Element], file: SdfFile) -> tuple[Light, ...]:
    """Return the lights of a world; without any those of a day."""
    lights = [_read_light(e, file) for e in elements if text_of(e, "light_on") != "0"]
    found = [light for light in lights if light is not None]
    return (*found, *FILL) if found else DAYLIGHT


def _read_light(element: ET.Element, file: SdfFile) -> Light | None:
    kind = element.get("type", "directional")
    where = f"light {element.get('name', '')!r}"
    if kind not in _TYPES:
        what = f"type: expected {', '.join(_TYPES)}, got {kind!r}"
        file.note("warning", "invalid", what, "left out", element, where)
        return None
    pose = _numbers(element, "pose", (0.0,) * 6, file)
    X_WL = transform_of(pose)
    direction = _numbers(element, "direction", (0.0, 0.0, -1.0), file)
    along = X_WL.rotation() @ np.array(direction)
    if not np.linalg.norm(along) > 0.0:
        what, done = "direction: expected one, got 0 0 0", "left out"
        file.note("warning", "invalid", what, done, element, where)
        return None
    diffuse = _numbers(element, "diffuse", (1.0, 1.0, 1.0, 1.0), file)
    r, g, b = (min(max(x, 0.0), 1.0) for x in diffuse[:3])
    [intensity] = _numbers(element, "intensity", (1.0,), file)
    terms = [
        _numbers(element, f"attenuation/{name}", (default,), file)[0]
        for name, default in (("constant", 1.0), ("linear", 0.0), ("quadratic", 0.0))
    ]
    [outer] = _numbers(element, "spot/outer_angle", (0.0,), file)
    is_directional = kind == "directional"
    x, y, z = (float(v) for v in along / np.linalg.norm(along))
    return Light(
        type=kind,
        color=(r, g, b),
        attenuation=(1.0, 0.0, 0.0) if is_directional else (*terms,),  # type: ignore[arg-type]
        position=(pose[0], pose[1], pose[2]),
        intensity=max(intensity, 0.0),
        direction=(x, y, z),
        cone_angle=min(max(math.degrees(outer) / 2.0, 1.0), 89.0),
        cast_shadows=is_directional
        and parse_sdf_bool(text_of(element, "cast_shadows")) is True,
    )


def _numbers(
    element: ET.Element, path: str, default: tuple[float, ...], file: SdfFile
) -> tuple[float, ...]:
    """Return the numbers of a child; the default, and a note, if it has others."""
    text = text_of(element, path)
    if not text:
        return default
    numbers = parse_floats(text)
    fits = numbers is not None and (
        len(numbers) == len(default) or (path == "diffuse" and len(numbers) == 3)
    )
    if numbers is None or not fits or not all(map(math.isfinite, numbers)):
        what = f"{path}: expected {len(default)} numbers, got {text!r}"
        where = f"light {element.get('name', '')!r}"
        file.note("warning", "invalid", what, "taken as not given", element, where)
        return default
    return numbers
