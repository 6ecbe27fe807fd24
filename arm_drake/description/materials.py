"""Colours of a URDF's visuals, spelled out one by one."""

import os
import xml.etree.ElementTree as ET
from pathlib import Path

from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.values import numbers
from arm_drake.errors import PackageError


def repair_materials(
    root: ET.Element, file: Path, packages: PackageFinder, report: LoadReport
) -> None:
    """Spell the colour of every visual out; remove materials that have none.

    Drake refuses two colours under one name, which ROS doesn't. A texture is replaced
    by its mean colour: most meshes of a URDF's textures have no texture coordinates.

    Args:
        root: The `<robot>` element, changed in place.
        file: File it came from; relative paths start in its folder.
        packages: What resolves package URIs.
        report: Where every change is recorded.

    Raises:
        DescriptionError: If a number is malformed.
    """
    colors: dict[str, str] = {}
    for material in root.iter("material"):
        name = material.get("name", "")
        if (rgba := material.find("color")) is not None:
            text = rgba.get("rgba", "")
            values = numbers(text, file, f"material {name!r}")
            if len(values) == 4 and all(0.0 <= value <= 1.0 for value in values):
                colors.setdefault(name, text)
            else:
                material.remove(rgba)
        for texture in material.findall("texture"):
            material.remove(texture)
            mean = _mean_color(
                texture.get("filename", ""), name, file, packages, report
            )
            if mean is not None and material.find("color") is None:
                ET.SubElement(material, "color", rgba=mean)
            colors.setdefault(name, mean or "")
    for material in root.findall("material"):
        root.remove(material)
    for visual in root.iter("visual"):
        for material in visual.findall("material"):
            _spell_out(visual, material, colors, file, report)


def _spell_out(
    visual: ET.Element,
    material: ET.Element,
    colors: dict[str, str],
    file: Path,
    report: LoadReport,
) -> None:
    name = material.attrib.pop("name", "")
    color = colors.get(name)
    if material.find("color") is not None:
        return
    if color:
        ET.SubElement(material, "color", rgba=color)
        return
    visual.remove(material)
    if color is None:
        what = f"material {name!r} has no colour of 4 numbers from 0 to 1"
        done = "the default colour is used"
        report.add("warning", "missing", what, done, file=file)


def _mean_color(
    uri: str, material: str, file: Path, packages: PackageFinder, report: LoadReport
) -> str | None:
    """Return the mean colour of a texture as a text, or None and a report line."""
    # Not at the top: few robots have textures.
    from PIL import Image

    place = f"material {material!r}"
    try:
        path = packages.resolve(uri, file.parent)
        if os.path.exists(path) and not os.path.isfile(path):
            raise OSError("not a regular file")  # A pipe would be read for ever.
        with Image.open(path) as image:
            pixel = image.convert("RGB").resize((1, 1), Image.Resampling.BOX)
            mean = [channel / 255.0 for channel in pixel.tobytes()]
    # What Pillow raises for a bad file is any of a dozen errors.
    except Exception as error:
        missing = isinstance(error, PackageError | FileNotFoundError)
        problem = "doesn't exist" if missing else "can't be read"
        what = f"the texture {uri!r} {problem}"
        done = "drawn without it, unless its mesh has one of its own"
        report.add("warning", "missing", what, done, where=place, file=file)
        return None
    what = f"the texture {uri!r}"
    done = "its mean colour is used, unless a mesh has a texture of its own"
    report.add("warning", "unsupported", what, done, where=place, file=file)
    return " ".join(f"{value:.4g}" for value in (*mean, 1.0))
