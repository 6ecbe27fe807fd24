"""Packages and file names, as ROS tools resolve them."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from arm_drake.description.controllers import load_controllers
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.errors import PackageError
from tests.description.patience import within


@pytest.fixture(autouse=True)
def nothing_around(tmp_path, monkeypatch):
    """Leave neither ROS nor what other tests write to be found."""
    monkeypatch.setattr(Path, "home", lambda: tmp_path.parent)
    for name in ("AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH", "ROS_PACKAGE_PATH"):
        monkeypatch.delenv(name, raising=False)


def add_package(folder: Path, name: str | None = None) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    tag = f"<name> {name or folder.name} </name>"
    (folder / "package.xml").write_text(f"<package>{tag}</package>", encoding="utf-8")
    return folder


def entry_of(package: Path) -> Path:
    return package / "urdf" / "robot.urdf"


def test_the_entrys_own_package_is_found(tmp_path):
    package = add_package(tmp_path / "ws" / "src" / "arm")

    assert PackageFinder(entry_of(package)).find("arm") == package


def test_a_neighbour_of_the_package_is_found(tmp_path):
    package = add_package(tmp_path / "ws" / "arm")
    meshes = add_package(tmp_path / "ws" / "vendor" / "meshes")

    assert PackageFinder(entry_of(package)).find("meshes") == meshes


def test_the_package_nearest_to_the_entry_wins(tmp_path):
    package = add_package(tmp_path / "a" / "arm")
    near = add_package(tmp_path / "a" / "meshes")
    add_package(tmp_path / "meshes")
    add_package(tmp_path / "b" / "meshes")

    assert PackageFinder(entry_of(package)).find("meshes") == near


def test_of_two_below_one_folder_the_upper_one_wins(tmp_path):
    package = add_package(tmp_path / "arm")
    add_package(tmp_path / "a" / "deep" / "meshes")
    upper = add_package(tmp_path / "z" / "meshes")

    assert PackageFinder(entry_of(package)).find("meshes") == upper


def test_the_name_is_that_of_the_manifest_not_of_the_folder(tmp_path):
    package = add_package(tmp_path / "folder", "arm")

    assert PackageFinder(entry_of(package)).find("arm") == package


def test_a_manifest_without_a_name_means_the_folders_name(tmp_path):
    package = add_package(tmp_path / "arm")
    (package / "package.xml").write_text("<package/>", encoding="utf-8")

    assert PackageFinder(entry_of(package)).find("arm") == package


def test_a_relative_package_path_is_of_the_present_folder(tmp_path, monkeypatch):
    package = add_package(tmp_path / "others" / "arm")
    entry = entry_of(add_package(tmp_path / "ws" / "robot"))
    monkeypatch.chdir(tmp_path)

    found = PackageFinder(entry, [Path("others")]).find("arm")

    assert found == package
    assert found.is_absolute()


def test_package_paths_come_first(tmp_path):
    package = add_package(tmp_path / "ws" / "arm")
    other = add_package(tmp_path / "elsewhere" / "src" / "arm")

    finder = PackageFinder(entry_of(package), [tmp_path / "elsewhere"])

    assert finder.find("arm") == other


@pytest.mark.parametrize("own", ["one/arm", "two/src/arm", "a/b/c/arm"])
def test_of_copies_below_a_package_path_the_entrys_own_counts(tmp_path, own):
    for copy in ("one/arm", "two/src/arm", "a/b/c/arm", "arm"):
        add_package(tmp_path / copy)
    entry = entry_of(tmp_path / own)

    assert PackageFinder(entry, [tmp_path]).find("arm") == tmp_path / own


@pytest.mark.parametrize(
    ("variable", "paths", "folder"),
    [
        ("AMENT_PREFIX_PATH", "/nowhere:{}", "share/meshes"),
        ("COLCON_PREFIX_PATH", "/nowhere:{}", "share/meshes"),
        ("ROS_PACKAGE_PATH", ":{}", "meshes"),
    ],
)
def test_installed_packages_are_found_by_variables_of_ros(
    tmp_path, monkeypatch, variable, paths, folder
):
    installed = add_package(tmp_path / "ros" / folder)
    entry = tmp_path / "1" / "2" / "3" / "4" / "5" / "robot.urdf"
    monkeypatch.setenv(variable, paths.format(tmp_path / "ros"))

    assert PackageFinder(entry).find("meshes") == installed


def test_a_package_is_found_by_its_folders_name_too(tmp_path):
    package = add_package(tmp_path / "arm-data", "arm_descriptions")
    report = LoadReport()

    found = PackageFinder(entry_of(package), report=report).find("arm-data")

    assert found == package
    assert str(report) == (
        f"info: {entry_of(package)}: no package.xml says that it is the package "
        f"'arm-data'; the folder {str(package)!r} of that name is taken"
    )


@pytest.mark.parametrize("folder", ["arm", "x/arm", "arm_meshes/arm"])
def test_a_folder_without_a_manifest_is_taken_by_its_name(tmp_path, folder):
    (tmp_path / folder / "urdf").mkdir(parents=True)
    entry = tmp_path / folder / "urdf" / "robot.urdf"
    report = LoadReport()

    assert PackageFinder(entry, report=report).find("arm") == tmp_path / folder
    assert len(report) == 1


def test_a_folder_beside_the_entry_may_be_the_package(tmp_path):
    (tmp_path / "meshes").mkdir()

    found = PackageFinder(tmp_path / "robot.urdf").find("meshes")

    assert found == tmp_path / "meshes"


def test_a_manifests_name_comes_before_a_folders(tmp_path):
    entry = entry_of(add_package(tmp_path / "a", "x"))
    named = add_package(tmp_path / "b" / "deep", "arm")
    add_package(tmp_path / "arm", "other")

    assert PackageFinder(entry).find("arm") == named


@pytest.mark.parametrize("name", ["", "..", ".", "a/b"])
def test_a_name_that_is_no_name_is_no_folder(tmp_path, name):
    (tmp_path / "a" / "b").mkdir(parents=True)

    with pytest.raises(PackageError):
        PackageFinder(tmp_path / "robot.urdf").find(name)


def test_the_entrys_own_package_comes_before_the_installed_and_those_before_others(
    tmp_path, monkeypatch
):
    package = add_package(tmp_path / "ws" / "arm")
    add_package(tmp_path / "ws" / "meshes")
    for name in ("arm", "meshes"):
        add_package(tmp_path / "opt" / "share" / name)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "opt"))
    finder = PackageFinder(entry_of(package))

    assert finder.find("arm") == package
    assert finder.find("meshes") == tmp_path / "opt" / "share" / "meshes"


def test_the_surroundings_come_before_the_installed(tmp_path, monkeypatch):
    package = add_package(tmp_path / "ws" / "arm")
    add_package(tmp_path / "ros" / "share" / "arm")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ros"))

    assert PackageFinder(entry_of(package)).find("arm") == package


@pytest.mark.parametrize("folder", ["build", "install", "log", ".hidden"])
def test_output_folders_of_builds_are_not_searched(tmp_path, folder):
    workspace = tmp_path / "1" / "2" / "3"
    package = add_package(workspace / "arm")
    add_package(workspace / folder / "meshes")
    finder = PackageFinder(entry_of(package))

    with pytest.raises(PackageError):
        finder.find("meshes")


def test_the_search_doesnt_follow_links(tmp_path):
    package = add_package(tmp_path / "ws" / "arm")
    (package / "loop").symlink_to(tmp_path / "ws")

    assert PackageFinder(entry_of(package)).find("arm") == package


@pytest.mark.parametrize("end", ["home", "temporary files"])
def test_the_search_stops_at_the_folders_of_home_and_of_temporary_files(
    tmp_path, monkeypatch, end
):
    if end == "home":
        monkeypatch.setattr("pathlib.Path.home", lambda: tmp_path)
    else:
        monkeypatch.setenv("TMPDIR", str(tmp_path))
    package = add_package(tmp_path / "arm")
    add_package(tmp_path / "meshes")
    finder = PackageFinder(entry_of(package))

    with pytest.raises(PackageError):
        finder.find("meshes")


def test_the_search_of_a_folder_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr("arm_drake.description.packages._MAX_FOLDERS", 3)
    package = add_package(tmp_path / "ws" / "arm")
    for name in "abcd":
        (tmp_path / "ws" / "zoo" / name).mkdir(parents=True)
    add_package(tmp_path / "ws" / "zoo" / "d")
    finder = PackageFinder(entry_of(package))

    with pytest.raises(PackageError):
        finder.find("d")
    assert finder.find("arm") == package


def test_a_missing_package_is_named_with_the_nearest(tmp_path):
    entry = entry_of(add_package(tmp_path / "ws" / "arm_description"))

    with pytest.raises(PackageError) as caught:
        PackageFinder(entry, [tmp_path / "ws"]).find("arm_descriptions")

    assert str(caught.value).startswith(
        f"{entry}: package 'arm_descriptions' not found; name the folder that holds it "
        "with package_paths (--package-path); did you mean 'arm_description'? known: "
    )


@pytest.mark.parametrize(
    ("uri", "expected"),
    [
        ("package://arm/meshes/a.stl", "ws/arm/meshes/a.stl"),
        ("model://arm/meshes/a.stl", "ws/arm/meshes/a.stl"),
        ("package://arm/meshes/a%20b.stl", "ws/arm/meshes/a b.stl"),
        ("meshes/a%20b.stl", "ws/arm/urdf/meshes/a%20b.stl"),
        ("../meshes/a.stl", "ws/arm/meshes/a.stl"),
        ("package://größe zwei/a b.stl", "ws/größe zwei/a b.stl"),
        ("package://gr%C3%B6%C3%9Fe%20zwei/a.stl", "ws/größe zwei/a.stl"),
    ],
)
def test_a_uri_stands_for_a_path(tmp_path, uri, expected):
    package = add_package(tmp_path / "ws" / "arm")
    (tmp_path / "ws" / "größe zwei").mkdir()
    (tmp_path / "ws" / "größe zwei" / "package.xml").touch()
    finder = PackageFinder(entry_of(package))

    assert finder.resolve(uri, package / "urdf") == tmp_path / expected


@pytest.mark.parametrize(
    ("uri", "expected"),
    [
        ("file:///opt/a.stl", "/opt/a.stl"),
        ("file://opt/a.stl", "/opt/a.stl"),
        ("file:////opt/a.stl", "/opt/a.stl"),
        ("file:///opt/a%20b.stl", "/opt/a b.stl"),
        ("/opt/a.stl", "/opt/a.stl"),
    ],
)
def test_an_absolute_path_stays_what_it_is(tmp_path, uri, expected):
    finder = PackageFinder(tmp_path / "robot.urdf")

    assert finder.resolve(uri, tmp_path) == Path(expected)


@pytest.mark.parametrize(
    ("uri", "message"),
    [
        (
            "http://example.org/a.stl",
            "'http://example.org/a.stl' can't be loaded; expected a path, package://, "
            "model:// or file://",
        ),
        (
            "file:///a%00.stl",
            "'file:///a%00.stl' can't be loaded; no file name holds a null byte",
        ),
    ],
)
def test_another_uri_is_refused(tmp_path, uri, message):
    with pytest.raises(PackageError) as caught:
        PackageFinder(tmp_path / "robot.urdf").resolve(uri, tmp_path)

    assert str(caught.value) == message


# Runs as a user to whom the folder "closed" is closed, even where the tests are root's.
AS_NOBODY = """
import difflib, shlex, shutil, tempfile  # Later it can't read them.
import os, sys
from pathlib import Path
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
if os.geteuid() == 0:
    os.seteuid(65534)
report = LoadReport()
finder = PackageFinder(Path(sys.argv[1]), report=report)
try:
    print(finder.find(sys.argv[2]))
except Exception as error:
    print(type(error).__name__)
print(report)
"""


@pytest.fixture
def as_nobody():
    """Return a function: entry, package -> what a user without rights is told."""
    # The folder of pytest is for its own user.
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)

    def run(entry: Path, name: str) -> list[str]:
        done = subprocess.run(
            [sys.executable, "-c", AS_NOBODY, str(entry), name],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert done.stderr == ""
        return done.stdout.splitlines()

    run.folder = folder
    yield run
    for path in folder.rglob("closed"):
        path.chmod(0o755)
    shutil.rmtree(folder)


def test_a_folder_that_cant_be_read_is_passed_by(as_nobody):
    package = add_package(as_nobody.folder / "ws" / "arm")
    closed = add_package(as_nobody.folder / "ws" / "closed")
    closed.chmod(0o000)

    assert as_nobody(entry_of(package), "arm")[0] == str(package)
    assert as_nobody(entry_of(package), "meshes")[0] == "PackageError"


def test_a_folder_that_cant_be_installed_is_reported(as_nobody):
    package = add_package(as_nobody.folder / "ws" / "arm")
    (package / "closed").mkdir()
    cmake = "install(DIRECTORY closed/ DESTINATION share/arm/x)"
    (package / "CMakeLists.txt").write_text(cmake, encoding="utf-8")
    (package / "closed").chmod(0o000)

    found, line = as_nobody(entry_of(package), "arm")

    assert found == str(package)
    assert "what package 'arm' installs can't be followed: Permission denied" in line


def test_a_package_whose_name_no_folder_can_have_is_missing(tmp_path):
    finder = PackageFinder(tmp_path / "robot.urdf")

    with pytest.raises(PackageError, match="not found"):
        finder.resolve(f"package://{'n' * 300}/a.stl", tmp_path)


def test_a_controllers_file_whose_name_no_file_can_have_is_missing(tmp_path):
    name = "n" * 300
    path = tmp_path / "0.yaml"
    path.write_text(
        "controller_manager:\n  ros__parameters:\n    arm: {type: a/A}\n"
        f"    arm.params_file: {name}\n",
        encoding="utf-8",
    )
    report = LoadReport()

    load_controllers([path], {}, report)

    assert f"no such file: {name!r}; it is left out" in str(report)


def test_a_user_without_a_home_folder_finds_packages_too(tmp_path, monkeypatch):
    def no_home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", no_home)
    package = add_package(tmp_path / "ws" / "arm")

    assert PackageFinder(entry_of(package)).find("arm") == package


def test_a_manifest_that_is_a_pipe_is_not_read(tmp_path):
    package = tmp_path / "ws" / "arm"
    package.mkdir(parents=True)
    os.mkfifo(package / "package.xml")

    with within(10.0):
        assert PackageFinder(entry_of(package)).find("arm") == package


def test_a_path_is_told_without_dots_but_behind_links(tmp_path):
    entry = entry_of(add_package(tmp_path / "arm"))
    entry.parent.mkdir()
    other = tmp_path / "other" / "inner"
    other.mkdir(parents=True)
    (entry.parent / "link").symlink_to(other)
    finder = PackageFinder(entry)

    plain = finder.resolve("none/../../meshes/a.stl", entry.parent)
    linked = finder.resolve("link/../a.stl", entry.parent)

    assert plain == entry.parent.parent / "meshes" / "a.stl"
    assert linked == entry.parent / "link" / ".." / "a.stl"
