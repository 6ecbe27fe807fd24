"""Leave in a URDF only what Drake reads; say once what else there was.

Drake answers every unknown attribute and tag with a warning of its own, per element.
"""

import collections
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

from arm_drake.description.report import LoadReport

# Elements by their path below <robot>, with the attributes that are read.
_READ: Mapping[str, tuple[str, ...]] = {
    "material": ("name",),
    "material/color": ("rgba",),
    "material/texture": ("filename",),
    "link": ("name",),
    "link/inertial": (),
    "link/inertial/origin": ("xyz", "rpy"),
    "link/inertial/mass": ("value",),
    "link/inertial/inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    **{
        f"link/{tag}{path}": attributes
        for tag in ("visual", "collision")
        for path, attributes in {
            "": ("name",),
            "/origin": ("xyz", "rpy"),
            "/geometry": (),
            "/geometry/box": ("size",),
            "/geometry/sphere": ("radius",),
            "/geometry/cylinder": ("radius", "length"),
            "/geometry/capsule": ("radius", "length"),
            "/geometry/mesh": ("filename", "scale"),
        }.items()
    },
    "link/visual/material": ("name",),
    "link/visual/material/color": ("rgba",),
    "link/visual/material/texture": ("filename",),
    "joint": ("name", "type"),
    "joint/origin": ("xyz", "rpy"),
    "joint/parent": ("link",),
    "joint/child": ("link",),
    "joint/axis": ("xyz",),
    "joint/limit": ("lower", "upper", "effort", "velocity"),
    "joint/dynamics": ("damping", "friction"),
    "joint/mimic": ("joint", "multiplier", "offset"),
}

# Read elsewhere, and reported there.
_OTHERS = ("ros2_control", "gazebo", "joint/safety_controller")

# What is done about tags that mean something to others.
_MEANINGS = {
    "transmission": "actuators come from <ros2_control>",
    "joint/calibration": "joints are calibrated",
    "link/collision_checking": "collisions come from <collision>",
}

_NOTHING = "it has no effect"

# Paths of tags, and an attribute or "", with how often they were found.
_Ignored = collections.Counter[tuple[str, str]]


def clean(root: ET.Element, file: Path, report: LoadReport) -> None:
    """Remove from a URDF what isn't read, and record each kind of thing once.

    Args:
        root: The `<robot>` element.
        file: File it came from.
        report: Where it is recorded.
    """
    ignored: _Ignored = collections.Counter()
    for child in list(root):
        _clean(root, child, "", ignored)
    for (path, attribute), count in ignored.items():
        what = f"<{path} {attribute}=...>" if attribute else f"<{path}>"
        times = "" if count == 1 else f", {count} times"
        done = _MEANINGS.get(path) if not attribute else None
        report.add("info", "ignored", f"{what}{times}", done or _NOTHING, file=file)


def _clean(
    parent: ET.Element, element: ET.Element, above: str, ignored: _Ignored
) -> None:
    if not isinstance(element.tag, str):  # A comment.
        return
    path = f"{above}/{element.tag}" if above else element.tag
    is_shape = above.endswith("/geometry")  # One that is unknown is a repair.
    if path not in _READ and not is_shape:
        parent.remove(element)
        if path not in _OTHERS:
            ignored[path, ""] += 1
        return
    if element.get("name") == "" and above == "link":
        del element.attrib["name"]  # Drake takes no empty one.
    for name in list(element.attrib):
        if path in _READ and name not in _READ[path]:
            del element.attrib[name]
            if not name.startswith("{"):  # Of another name space.
                ignored[path, name] += 1
    for child in list(element):
        _clean(element, child, path, ignored)
