"""The structure of the package: directions of imports, circles, sizes."""

import ast
import functools
import graphlib
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

import arm_drake

PACKAGE = Path(arm_drake.__file__).parent

# From the ground up: a package imports only those before it. Imports for the type
# checker and imports inside functions count.
PACKAGES = [
    "messages",
    "description",
    "control",
    "plant",
    "controllers",
    "manager",
    "hardware",
    "worlds",
    "perception",
    "planning",
    "manipulation",
    "rollout",
    "simulation",
    "wire",
    "visualization",
    "batch",
    "environments",
    "launch",
    "commands",
]

# They are text and arrays alone.
WITHOUT_DRAKE = ["messages", "description", "control"]

# What a controller may know of the rest.
KNOWN_TO_CONTROLLERS = {"messages", "description", "control", "controllers"}

MAX_LINES = 800
MAX_FUNCTION_LINES = 60


class Import(NamedTuple):
    """One imported name or module."""

    module: str
    is_lazy: bool


@functools.cache
def modules() -> dict[str, Path]:
    """Return the files of all modules by dotted name, without the package's own."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        found[".".join(part for part in parts if part != "__init__")] = path
    return found


@functools.cache
def parse(module: str) -> ast.Module:
    return ast.parse(modules()[module].read_text(encoding="utf-8"))


@functools.cache
def imports(module: str) -> frozenset[Import]:
    """Return what a module imports, by full name, anywhere in it."""
    found = set()
    waiting: list[tuple[ast.AST, bool]] = [(parse(module), False)]
    while waiting:
        node, is_lazy = waiting.pop()
        if isinstance(node, ast.Import):
            found |= {Import(alias.name, is_lazy) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import"
            for alias in node.names:
                name = f"{node.module}.{alias.name}"
                is_module = name.removeprefix("arm_drake.") in modules()
                found.add(Import(name if is_module else str(node.module), is_lazy))
        elif isinstance(node, ast.stmt | ast.Module | ast.ExceptHandler):
            is_lazy |= isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
            waiting += [(child, is_lazy) for child in ast.iter_child_nodes(node)]
    return frozenset(found)


@functools.cache
def own_imports(module: str) -> frozenset[Import]:
    """Return the modules of ours that a module imports, as named here."""
    found = {
        Import(other.module.removeprefix("arm_drake."), other.is_lazy)
        for other in imports(module)
        if other.module.startswith("arm_drake.")
    }
    return frozenset(other for other in found if other.module != module)


def package_of(module: str) -> str:
    return module.partition(".")[0]


def importers() -> dict[str, set[Import]]:
    """Return who imports each module."""
    found: dict[str, set[Import]] = {module: set() for module in modules()}
    for module in modules():
        for other in own_imports(module):
            found[other.module].add(Import(module, other.is_lazy))
    return found


@pytest.mark.slow
def test_packages_import_in_one_order() -> None:
    wrong = [
        f"{module} imports {other.module}"
        for module in modules()
        for other in own_imports(module)
        if package_of(module) in PACKAGES
        and package_of(other.module) in PACKAGES
        and PACKAGES.index(package_of(other.module))
        > PACKAGES.index(package_of(module))
    ]

    assert not wrong


@pytest.mark.parametrize("level", ["module", "package"])
def test_imports_make_no_circle(level: str) -> None:
    graph: dict[str, set[str]] = {}
    for module in modules():
        name = module if level == "module" else package_of(module)
        others = {other.module for other in own_imports(module)}
        if level == "package":
            others = {package_of(other) for other in others}
        graph.setdefault(name, set()).update(others - {name})

    assert tuple(graphlib.TopologicalSorter(graph).static_order())


def test_every_package_has_its_place() -> None:
    folders = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}

    assert folders == set(PACKAGES)


def test_no_module_is_a_fragment_of_its_only_importer() -> None:
    # An import inside a function keeps what is heavy away until it is needed.
    fragments = [
        f"{module} <- {only.module}"
        for module, [only] in (
            (module, list(others))
            for module, others in importers().items()
            if len(others) == 1
        )
        if "." in module
        and not only.is_lazy
        and only.module.rpartition(".")[0] == module.rpartition(".")[0]
    ]

    assert not fragments


@pytest.mark.parametrize("package", WITHOUT_DRAKE)
def test_text_and_mathematics_know_no_drake(package: str) -> None:
    for module in modules():
        if package_of(module) == package:
            drake = [o for o in imports(module) if o.module.startswith("pydrake")]
            assert not drake, module


def test_controllers_know_neither_the_robot_nor_the_plant() -> None:
    for module in modules():
        if package_of(module) == "controllers":
            others = {package_of(o.module) for o in own_imports(module) if o.module}
            packages = others & set(PACKAGES)
            assert packages <= KNOWN_TO_CONTROLLERS, module
            names = {other.module for other in imports(module)}
            assert not any(n.startswith("pydrake.multibody") for n in names), module
            assert "arm_drake.description.urdf" not in names, module


def test_nothing_imports_all_of_drake() -> None:
    for module in modules():
        names = {other.module for other in imports(module)}
        assert not any(name.startswith("pydrake.all") for name in names), module


@pytest.mark.slow
@pytest.mark.parametrize("module", sorted(modules()))
def test_a_module_is_one_thing(module: str) -> None:
    text = modules()[module].read_text(encoding="utf-8")

    assert len(text.splitlines()) <= MAX_LINES


@pytest.mark.slow
def test_functions_fit_on_a_screen() -> None:
    long = [
        f"{module}.{node.name}: {node.end_lineno - node.lineno + 1} lines"
        for module in modules()
        for node in ast.walk(parse(module))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.end_lineno is not None
        and node.end_lineno - node.lineno + 1 > MAX_FUNCTION_LINES
    ]

    assert not long


@pytest.mark.slow
def test_a_headless_run_loads_nothing_large_that_it_does_not_need() -> None:
    command = "sim doosan_a0912 --headless --duration 0.1"

    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "arm_drake", *command.split()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )

    # import time: self [us] | cumulative | imported package
    loaded = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "pydrake.multibody.plant" in loaded
    assert "arm_drake.simulation.simulation" in loaded
    large = {"matplotlib", "scipy", "trimesh", "collada", "PIL", "tornado"}
    large |= {"http.client", "ssl"}
    large |= {
        "arm_drake.controllers.pid_controller",
        "arm_drake.description.perception_sensors",
        "arm_drake.hardware.mock_hardware",
    }
    assert not loaded & {"pydrake.all", *large}
