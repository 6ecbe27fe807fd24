"""A package outside the tree, as an installer leaves it, for importlib.metadata."""

from collections.abc import Mapping
from pathlib import Path

from arm_drake.controllers.registry import ENTRY_POINTS


def add_package(
    folder: Path, name: str, entry_points: Mapping[str, str], group: str = ENTRY_POINTS
) -> None:
    """Write the dist-info folder of a package that brings controller types.

    Args:
        folder: Where packages are installed; it is to be on Python's path.
        name: Name of the package.
        entry_points: "module:object" by ros2_control type.
        group: Group of the entry points.
    """
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", encoding="utf-8"
    )
    lines = [f"{type_} = {value}" for type_, value in entry_points.items()]
    (info / "entry_points.txt").write_text(
        "\n".join([f"[{group}]", *lines]) + "\n", encoding="utf-8"
    )
