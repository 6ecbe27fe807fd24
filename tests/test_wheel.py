"""The built wheel is all that one needs: in an empty environment the README works."""

import os
import shutil
import subprocess
import sys
import venv
import zipfile
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.snippets import ROOT, read_blocks
from tests.test_snippets import FILES

pytestmark = pytest.mark.slow

# What is packed, or says how.
SOURCES = ("arm_drake", "configs", "models", "LICENSE", "README.md", "pyproject.toml")

BLOCKS = list(read_blocks(ROOT / "README.md"))

# So long a simulation of a command line takes here [s].
DURATION = "0.2"


def run(words: Sequence[str | Path], folder: Path) -> str:
    """Return what a program prints that knows nothing of this tree and its cache."""
    hidden = ("PYTHONPATH", "VIRTUAL_ENV")
    environment = {k: value for k, value in os.environ.items() if k not in hidden}
    done = subprocess.run(
        words,
        cwd=folder,
        env={**environment, "ARM_DRAKE_CACHE": str(folder / ".cache")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the wheel, made by the build backend that pyproject.toml names."""
    source = tmp_path_factory.mktemp("source")
    for name in SOURCES:
        if (ROOT / name).is_dir():
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / name, source / name, ignore=ignored)
        else:
            shutil.copy(ROOT / name, source)
    program = "import hatchling.build; print(hatchling.build.build_wheel('dist'))"
    (source / "dist").mkdir()
    name = run([sys.executable, "-c", program], source).split()[-1]
    return source / "dist" / name


@pytest.fixture(scope="module")
def programs(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of programs of an environment with the wheel in it.

    Its dependencies, those that it names and no others, are links to what is installed
    here, for that needs no network.
    """
    folder = tmp_path_factory.mktemp("environment") / "venv"
    venv.create(folder, with_pip=True)
    install = ["install", "--quiet", "--no-deps", "--no-index", wheel]
    run([folder / "bin/pip", *install], folder)
    (site,) = folder.glob("lib/python*/site-packages")
    (info,) = site.glob("arm_drake-*.dist-info")
    needed = metadata.Distribution.at(info).requires or []
    for distribution in list_dependencies(needed).values():
        for top in {file.parts[0] for file in distribution.files or ()} - {".."}:
            if not (site / top).exists():
                (site / top).symlink_to(distribution.locate_file(top))
    return folder / "bin"


def list_dependencies(needed: Sequence[str]) -> dict[str, metadata.Distribution]:
    """Return what requirements need, and what that needs, without any extra."""
    found: dict[str, metadata.Distribution] = {}
    waiting = list(needed)
    while waiting:
        requirement = Requirement(waiting.pop())
        name, marker = canonicalize_name(requirement.name), requirement.marker
        if name not in found and (marker is None or marker.evaluate({"extra": ""})):
            found[name] = metadata.distribution(name)
            waiting += found[name].requires or []
    return found


def test_the_wheel_is_the_package_and_the_robots(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as file:
        names = set(file.namelist())

    for folder in ("arm_drake", "models", "configs"):
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                name = path.relative_to(ROOT).as_posix().removeprefix("arm_drake/")
                assert f"arm_drake/{name}" in names
    tops = {name.partition("/")[0] for name in names}
    assert {top.partition("-")[0] for top in tops} == {"arm_drake"}


def test_the_readmes_program_runs_where_the_wheel_is(
    programs: Path, tmp_path: Path
) -> None:
    text = "\n".join(b.text for b in BLOCKS if b.language == "python")
    where = "import arm_drake; print(arm_drake.__file__)"

    assert run([programs / "python", "-c", where], tmp_path).startswith(
        str(programs.parent)
    )
    printed = run([programs / "python", "-c", text], tmp_path)

    succeeded = "GoalStatus.SUCCEEDED\n"
    assert printed == f"nothing to report\n{succeeded}{succeeded}"
    files = {path.name for path in tmp_path.iterdir()}
    assert files == {".cache", "arm.html", "run.npz", "run.png"}


def test_the_readmes_commands_run_where_the_wheel_is(
    programs: Path, tmp_path: Path
) -> None:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    blocks = [b for b in BLOCKS if b.language == "sh" and not b.not_run]
    # `make` is for a checkout, and pip's work is `programs`.
    commands = [
        words
        for block in blocks
        for words in block.commands()
        if words[0] not in ("make", "pip")
    ]

    # A viewer waits for somebody; what it shows, `check` reads.
    for words in (words for words in commands if words[1] != "view"):
        extra = ["--duration", DURATION] if words[1] == "sim" else []
        run([programs / words[0], *words[1:], *extra], tmp_path)

    assert {words[1] for words in commands} == {"check", "graph", "list", "sim", "view"}
    files = {path.name for path in tmp_path.iterdir()}
    assert files >= {"diagram.svg", "run.npz"}
