"""Descriptions without folders of the machine."""

import hashlib
import shutil
from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.description.entry import models_folder
from arm_drake.description.robot import make_portable

MANIFEST = "<package><name>pkg</name></package>"


@pytest.fixture(params=["plain", "with spaces"])
def file(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """An entry file in a package `pkg`, whose folder is called otherwise."""
    folder = tmp_path / request.param / "folder"
    (folder / "urdf").mkdir(parents=True)
    (folder / "package.xml").write_text(MANIFEST)
    return folder / "urdf" / "a.urdf"


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('<mesh filename="file://{}/meshes/a.stl"/>', '"package://pkg/meshes/a.stl"'),
        ('<mesh filename="file:///{}/a.stl"/>', '"package://pkg/a.stl"'),
        ("<p>{}/config/c.yaml</p>", "<p>package://pkg/config/c.yaml</p>"),
        ("<p>{}/../../c.yaml</p>", "<p>package://pkg/../../c.yaml</p>"),
        ("<p>{}</p>", "<p>package://pkg</p>"),
        ('<p v="{0}/a b.c,{0}/d"/>', 'v="package://pkg/a b.c,package://pkg/d"'),
        ("<p>{0}/a:{0}/b {0}</p>", "package://pkg/a:package://pkg/b package://pkg<"),
        ('<mesh filename="file:{}/a.stl"/>', '"package://pkg/a.stl"'),
    ],
)
def test_paths_into_packages_become_uris(file: Path, before: str, after: str) -> None:
    text = make_portable(before.format(file.parents[1]), file)

    assert after in text
    assert str(file.parents[1]) not in text


def test_the_comment_that_xacro_writes_names_the_package(tmp_path: Path) -> None:
    (tmp_path / "package.xml").write_text(MANIFEST)
    file = tmp_path / "a.xacro"

    text = make_portable(f"<!-- |  made from {file} | -->", file)

    assert text == "<!-- |  made from package://pkg/a.xacro | -->"


def test_files_beside_the_entry_file_are_named_from_the_package(file: Path) -> None:
    (file.parent / "a b.stl").write_text("")
    text = '<mesh filename="a b.stl"/><plugin filename="libx.so"/>'

    assert make_portable(text, file) == (
        '<mesh filename="package://pkg/urdf/a b.stl"/><plugin filename="libx.so"/>'
    )


def test_without_a_package_the_entry_file_has_its_name(tmp_path: Path) -> None:
    file = tmp_path / "c.urdf"
    mesh = f'<mesh filename="{tmp_path}/a/b.stl"/>'

    assert make_portable(f"<!-- from {file} | -->{mesh}", file) == (
        f"<!-- from c.urdf | -->{mesh}"
    )


@pytest.mark.parametrize(
    "text",
    [
        '<mesh filename="package://pkg/a.stl"/>',
        '<mesh filename="../meshes/a.stl"/>',
        '<mesh filename="/no/such/folder/a.stl"/>',
        '<a b="https://example.org/a"/>',
        "<topic>/joint_states</topic>",
        "<r>1/2 a/b</r>",
        "</joint><link/>",
    ],
)
def test_all_else_stays(file: Path, text: str) -> None:
    assert make_portable(text, file) == text


@pytest.mark.slow
def test_a_robot_is_the_same_in_every_folder(tmp_path: Path) -> None:
    hashes = set()
    for name in ("here", "somewhere else"):
        folder = tmp_path / name
        shutil.copytree(models_folder() / "doosan_a0912", folder / "doosan_a0912")
        entry = folder / "doosan_a0912" / "urdf" / "doosan_a0912.urdf.xacro"
        robot = ad.load_robot(entry)
        assert str(folder) not in robot.portable_source
        hashes.add(hashlib.sha256(robot.portable_source.encode()).hexdigest())

    assert len(hashes) == 1
