"""Every notebook runs from top to bottom, and keeps no outputs."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
import pytest

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


def test_there_are_notebooks():
    assert [path.stem for path in NOTEBOOKS] == [
        "01_quick_start",
        "02_from_urdf_to_diagram",
        "03_five_tutorial_robots",
        "04_controllers_compared",
        "05_bring_your_own_robot",
        "06_gripper_and_contact",
        "07_many_rollouts",
        "08_planning",
        "09_see_and_measure",
        "10_pick_and_place",
        "11_an_environment",
        "12_roslibpy",
        "13_study",
        "14_tune_and_analyze",
    ]


@pytest.fixture(scope="module")
def kernel() -> Iterator[Any]:
    """A kernel for all notebooks, which imports what they need once.

    `make docs` has one for each.
    """
    from jupyter_client.manager import KernelManager

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MPLBACKEND", "module://matplotlib_inline.backend_inline")
        client = "jupyter_client.asynchronous.AsyncKernelClient"
        manager = KernelManager(client_class=client)
        manager.start_kernel()
    yield manager
    manager.shutdown_kernel(now=True)


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
@pytest.mark.filterwarnings("default")
def test_the_notebook_runs(path, tmp_path, kernel):
    from nbclient import NotebookClient

    if not kernel.is_alive():
        kernel.restart_kernel()
    notebook = nbformat.read(path, as_version=4)
    # Nothing is known of the notebooks before it.
    anew = f"%reset -f\n%cd -q {tmp_path}"
    notebook.cells.insert(0, nbformat.v4.new_code_cell(anew))

    # No cell takes as long, on a busy machine either: it hangs [s].
    client = NotebookClient(notebook, timeout=300, km=kernel)
    try:
        client.execute()
    finally:
        client.kc.stop_channels()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_notebook_ends_with_what_it_has_shown(path):
    """Its last cell fails if that isn't so; a run alone would show little."""
    last = nbformat.read(path, as_version=4).cells[-1]

    assert last.cell_type == "code"
    checks = [
        node
        for node in ast.walk(ast.parse(last.source))
        if isinstance(node, ast.Assert)
    ]
    assert checks


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_notebook_keeps_no_outputs(path):
    notebook = nbformat.read(path, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not any(cell.outputs or cell.execution_count for cell in code)
    nbformat.validate(notebook)
