"""Packages and file names, as ROS tools resolve them."""

from pathlib import Path

import pytest

from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.errors import PackageError


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


def test_package_paths_come_first(tmp_path):
    package = add_package(tmp_path / "ws" / "arm")
    other = add_package(tmp_path / "elsewhere" / "src" / "arm")

    finder = PackageFinder(entry_of(package), [tmp_path / "elsewhere"])

    assert finder.find("arm") == other


@pytest.mark.parametrize("variable", ["AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH"])
def test_installed_packages_are_found_in_share(tmp_path, monkeypatch, variable):
    installed = add_package(tmp_path / "ros" / "share" / "meshes")
    entry = tmp_path / "1" / "2" / "3" / "4" / "5" / "robot.urdf"
    monkeypatch.setenv(variable, f"/nowhere:{tmp_path / 'ros'}")

    assert PackageFinder(entry).find("meshes") == installed


def test_ros_package_path_is_searched(tmp_path, monkeypatch):
    installed = add_package(tmp_path / "ros" / "meshes")
    entry = tmp_path / "1" / "2" / "3" / "4" / "5" / "robot.urdf"
    monkeypatch.setenv("ROS_PACKAGE_PATH", f":{tmp_path / 'ros'}")

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


def test_the_search_stops_at_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
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
        ("../meshes/a.stl", "ws/arm/urdf/../meshes/a.stl"),
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
