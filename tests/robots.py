"""Real robot packages, which tests use unchanged where they are installed.

`ARM_DRAKE_ROBOTS` is the folder that has them; by default `shared/robots` beside the
checkout. Without it the tests that need it are skipped; `ARM_DRAKE_NO_SKIP=1` makes
them fail instead, for a machine where every test must run.
"""

import contextlib
import functools
import os
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

import arm_drake as ad

BESIDE_THE_CHECKOUT = Path(__file__).parents[2] / "shared" / "robots"


# libyaml's, ten times as fast, where PyYAML is built with it.
_SafeLoader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def read_yaml(file: Path) -> Any:
    """Return what a YAML file says."""
    return yaml.load(file.read_text(encoding="utf-8"), Loader=_SafeLoader)  # noqa: S506


def robots_folder() -> Path:
    """Return the folder of real robot packages, or skip the test."""
    folder = Path(os.environ.get("ARM_DRAKE_ROBOTS") or BESIDE_THE_CHECKOUT)
    if not folder.is_dir():
        skip_or_fail(f"no folder {folder}; ARM_DRAKE_ROBOTS may name another")
    return folder.resolve()


def real_robot(relative: str) -> Path:
    """Return a robot's file, its path given relative to the folder, or skip."""
    path = robots_folder() / relative
    if not path.is_file():
        skip_or_fail(f"no file {path}")
    return path


def read_index() -> dict[str, dict[str, Any]]:
    """Return the rows of the folder's INDEX.yaml by the robots' names, or skip."""
    return pickle.loads(_pickled_index(real_robot("INDEX.yaml")))  # noqa: S301


@functools.cache
def _pickled_index(file: Path) -> bytes:
    """Return the rows, parsed once a process; each caller unpacks its own."""
    return pickle.dumps({row["name"]: row for row in read_yaml(file)["robots"]})


def load_real_robot(name: str, **options: Any) -> ad.Robot:
    """Return a robot of the index, loaded as its row says but for options, or skip.

    Without options it is loaded once a process.
    """
    return _load(name, options) if options else _load_once(name)


def _load(name: str, options: Mapping[str, Any]) -> ad.Robot:
    row, folder = read_index()[name], robots_folder()
    values = {
        "xacro_args": row["xacro_args"],
        "controllers": [folder / file for file in row["controllers_yaml"]] or None,
        "variables": row["launch_vars"],
        **options,
    }
    return ad.load_robot(folder / row["entry"], **values)


@functools.cache
def _load_once(name: str) -> ad.Robot:
    return _load(name, {})


def robot_names() -> list[str]:
    """Return the names in the index, or "none" without one: for parametrization."""
    with contextlib.suppress(pytest.skip.Exception, pytest.fail.Exception):
        return list(read_index())
    return ["none"]


def skip_or_fail(reason: str) -> None:
    """Skip the test; with `ARM_DRAKE_NO_SKIP=1`, fail it."""
    if os.environ.get("ARM_DRAKE_NO_SKIP") == "1":
        pytest.fail(reason)
    pytest.skip(reason)
