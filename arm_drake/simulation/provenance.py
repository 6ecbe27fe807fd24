"""What made a rollout: versions, files with their hashes, options, motions."""

import functools
import hashlib
import importlib.metadata
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.systems.framework import Diagram

from arm_drake.description.portable import name_portably
from arm_drake.description.robot import Robot
from arm_drake.rollout.records import to_plain
from arm_drake.simulation.build_info import find_build_info
from arm_drake.simulation.motion import Motion


def describe_provenance(
    robot: Robot, diagram: Diagram, motions: Sequence[Motion]
) -> dict[str, Any]:
    """Return what made a rollout, as plain data without folders of this machine.

    Args:
        robot: The robot.
        diagram: Its diagram.
        motions: The motions that were played, in order.
    """
    found: dict[str, Any] = {
        "versions": dict(_versions()),
        "robot": dict(_describe_robot(robot)),
        "motions": [_describe_motion(motion) for motion in motions],
    }
    build = find_build_info(diagram)
    if build is not None:
        found["world"] = build.world
        found["options"] = to_plain(build.options)
    return found


@functools.cache
def _versions() -> dict[str, str]:
    return {
        "arm_drake": importlib.metadata.version("arm-drake"),
        "drake": importlib.metadata.version("drake"),
        "numpy": np.__version__,
        "python": platform.python_version(),
    }


@functools.lru_cache(maxsize=8)
def _describe_robot(robot: Robot) -> dict[str, Any]:
    """Return what a robot was made of; a hash is of a file as it is now."""
    return {
        "name": robot.name,
        "bundled": robot.bundled,
        "distro": robot.distro,
        "description": {
            "file": robot.description.file.name,
            "sha256": _hash(robot.portable_source.encode()),
        },
        "pose": to_plain(robot.pose),
        "initial_positions": to_plain(robot.initial_positions),
        "files": [
            {"file": _name(file), "sha256": _hash_file(file)}
            for file in robot.source_files
        ],
    }


def _describe_motion(motion: Motion) -> dict[str, Any]:
    file = motion.file
    return {
        "file": file.name if file else None,
        "sha256": _hash_file(file) if file else None,
        "parameters": to_plain(motion.parameters),
    }


def _name(file: Path) -> str:
    """Return the package URI of a file, or its name if it is in no package."""
    name = name_portably(str(file))
    return file.name if name == str(file) else name


def _hash_file(file: Path) -> str | None:
    try:
        known = file.stat()
        return _hash_content(file, known.st_mtime_ns, known.st_size)
    except OSError:  # It has gone since it was loaded.
        return None


@functools.lru_cache(maxsize=1000)
def _hash_content(file: Path, time_ns: int, size: int) -> str:
    """Return the hash of a file that was changed last at this time."""
    return _hash(file.read_bytes())


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
