"""`arm-drake cache`: what is kept, and how to get rid of it."""

import json

import pytest

from arm_drake.cli import main


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A cache of 2.5 MB, and a file in it that isn't ours."""
    monkeypatch.setenv("ARM_DRAKE_CACHE", str(tmp_path))
    folder = tmp_path / "meshes"
    folder.mkdir()
    (folder / f"{'0' * 64}.gltf").write_bytes(b"x" * 2_000_000)
    (folder / f"{'0' * 64}.gltf.json").write_bytes(b"x" * 400_000)
    (folder / "note.txt").write_bytes(b"x" * 100_000)
    return folder


def test_the_folder_and_its_size_are_printed(folder, capsys):
    assert main(["cache"]) == 0

    assert capsys.readouterr().out == f"{folder}: 3 files, 2.5 MB\n"


def test_json_counts_bytes(folder, capsys):
    assert main(["cache", "--json"]) == 0

    assert json.loads(capsys.readouterr().out) == {
        "folder": str(folder),
        "files": 3,
        "bytes": 2_500_000,
    }


def test_clear_removes_converted_meshes_and_nothing_else(folder, capsys):
    assert main(["cache", "--clear"]) == 0

    assert capsys.readouterr().out == f"{folder}: 2 files removed\n"
    assert [path.name for path in folder.iterdir()] == ["note.txt"]


def test_clear_as_json_says_how_many(folder, capsys):
    assert main(["cache", "--clear", "--json"]) == 0

    content = json.loads(capsys.readouterr().out)
    assert content == {"folder": str(folder), "removed": 2}


def test_a_cache_that_does_not_exist_is_empty(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("ARM_DRAKE_CACHE", str(tmp_path / "none"))

    assert main(["cache"]) == 0
    assert main(["cache", "--clear"]) == 0

    place = tmp_path / "none" / "meshes"
    assert capsys.readouterr().out == (
        f"{place}: 0 files, 0.0 MB\n{place}: 0 files removed\n"
    )
