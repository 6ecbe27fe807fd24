"""ROS 2 robot packages, unchanged, as Drake diagrams."""

import functools
import importlib
from collections.abc import Mapping
from typing import Any

from arm_drake.importing import without_collection


@functools.cache
def _modules() -> Mapping[str, str]:
    """Return where each public name is defined; `__init__.pyi` lists them."""
    import ast
    from pathlib import Path

    stub = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    return {name.name: str(node.module) for node in imports for name in node.names}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name == "__all__":
        return sorted(_modules())
    if name.startswith("__") or name not in _modules():
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    with without_collection():
        if _modules()[name] == __name__:  # A module of its own.
            value: Any = importlib.import_module(f"{__name__}.{name}")
        else:
            value = getattr(importlib.import_module(_modules()[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names."""
    return sorted(_modules())
