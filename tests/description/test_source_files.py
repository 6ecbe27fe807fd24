"""The files that a robot is made of, and the changes of files."""

import os
import re
import shutil
import time
from pathlib import Path

import pytest
import xacro
from xacro import substitution_args

import arm_drake as ad
from arm_drake.description.packages import PackageFinder
from arm_drake.description.source_files import (
    FileWatcher,
    files_of_failed,
    watched_files,
)
from arm_drake.errors import ArmDrakeError
from tests.models import trajectory_controllers
from tests.robots import load_real_robot, read_index, robot_names, robots_folder

XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'

ENTRY = f"""<robot name="arm" {XACRO}>
  <xacro:arg name="variant" default="short"/>
  <xacro:include filename="parts/$(arg variant).xacro"/>
  <xacro:property name="q" value="${{xacro.load_yaml('../config/initial.yaml')}}"/>
  <!-- <xacro:include filename="parts/unused.xacro"/> -->
  <material name="painted">
    <texture filename="package://arm/meshes/a.png"/>
  </material>
  <link name="base">
    <visual><geometry><mesh filename="package://arm/meshes/a.obj"/></geometry></visual>
    <visual><geometry><mesh filename="package://arm/meshes/no.obj"/></geometry></visual>
    <visual><geometry><mesh filename="package://other/b.obj"/></geometry></visual>
    <collision>
      <geometry><mesh filename="../meshes/b.obj"/></geometry>
    </collision>
  </link>
  <link name="${{tip}}">
    <inertial><mass value="1"/>
      <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  </link>
  <joint name="swing" type="revolute">
    <parent link="base"/><child link="${{tip}}"/>
    <limit lower="-1" upper="1" effort="99" velocity="1"/>
  </joint>
  <ros2_control name="hardware" type="system">
    <hardware><plugin>gz_ros2_control/GazeboSimSystem</plugin></hardware>
    <joint name="swing">
      <command_interface name="position"/>
      <state_interface name="position">
        <param name="initial_value">${{q['swing']}}</param>
      </state_interface>
      <state_interface name="velocity"/>
    </joint>
  </ros2_control>
</robot>"""

SHORT = f'<robot {XACRO}><xacro:include filename="common/tip.xacro"/></robot>'
TIP = f'<robot {XACRO}><xacro:property name="tip" value="hand"/></robot>'
MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
SRDF = '<robot name="arm"/>'


def write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def package(tmp_path, monkeypatch) -> Path:
    """Return the folder of a robot's package, with all that a robot may be made of."""
    monkeypatch.setattr(Path, "home", lambda: tmp_path.parent)
    folder = tmp_path / "arm"
    controllers = trajectory_controllers({"controller": ["swing"]})
    for name, text in {
        "package.xml": "<name>arm</name>",
        "urdf/arm.urdf.xacro": ENTRY,
        "urdf/parts/short.xacro": SHORT,
        "urdf/parts/common/tip.xacro": TIP,
        "urdf/parts/unused.xacro": TIP,
        "config/initial.yaml": "swing: 0.5\n",
        "config/controllers.yaml": controllers,
        "config/unused.yaml": "a: 1\n",
        "meshes/a.obj": MESH,
        "meshes/a.png": "",
        "meshes/b.obj": MESH,
        "meshes/unused.obj": MESH,
        "srdf/arm.srdf": SRDF,
        "srdf/other.srdf": '<robot name="other"/>',
    }.items():
        write(folder / name, text)
    return folder


MADE_OF = [
    "config/controllers.yaml",
    "config/initial.yaml",
    "meshes/a.obj",
    "meshes/a.png",
    "meshes/b.obj",
    "urdf/arm.urdf.xacro",
    "urdf/parts/common/tip.xacro",
    "urdf/parts/short.xacro",
]


def names(files: tuple[Path, ...], folder: Path) -> list[str]:
    assert all(file.is_absolute() for file in files)
    return [str(file.relative_to(folder)) for file in files]


def fail(folder: Path, **options) -> tuple[Path, ...]:
    """Return what may mend the robot, which can't be loaded."""
    with pytest.raises(ArmDrakeError) as caught:
        ad.load_robot(folder, **options)
    return files_of_failed(folder, caught.value, **options)


def test_a_robot_is_made_of_what_it_was_read_from(package):
    robot = ad.load_robot(package)

    assert robot.initial_positions == {"swing": 0.5}
    assert names(robot.source_files, package) == MADE_OF


def test_a_relative_path_gives_absolute_files(package, monkeypatch):
    monkeypatch.chdir(package)

    robot = ad.load_robot("urdf/arm.urdf.xacro")

    assert names(robot.source_files, package) == MADE_OF


@pytest.mark.slow
def test_files_that_are_given_and_a_plain_urdf_count(package, tmp_path, monkeypatch):
    urdf = write(tmp_path / "plain.urdf", ad.load_robot(package).description.source)
    shutil.copy(package / "config/controllers.yaml", tmp_path / "mine.yaml")
    write(
        tmp_path / "bridge.yaml",
        "- {ros_topic_name: a, gz_topic_name: b, ros_type_name: std_msgs/msg/Float64,"
        " gz_type_name: gz.msgs.Double, direction: ROS_TO_GZ}",
    )
    monkeypatch.chdir(tmp_path)

    robot = ad.load_robot(
        urdf, controllers=["mine.yaml", "bridge.yaml"], package_paths=package
    )

    # A relative mesh was relative to the other file.
    assert names(robot.source_files, tmp_path) == [
        "arm/meshes/a.obj",
        "arm/meshes/a.png",
        "bridge.yaml",
        "mine.yaml",
        "plain.urdf",
    ]


def test_files_of_a_package_that_is_laid_out_for_installation_are_the_real_ones(
    package,
):
    write(package / "src/more/extra.yaml", "swing: 0.25\n")
    write(
        package / "CMakeLists.txt",
        "project(arm)\n"
        "install(DIRECTORY src/more/ DESTINATION share/${PROJECT_NAME}/more)\n"
        "install(DIRECTORY config meshes urdf DESTINATION share/${PROJECT_NAME})\n",
    )
    entry = package / "urdf/arm.urdf.xacro"
    text = ENTRY.replace("../config/initial.yaml", "$(find arm)/more/extra.yaml")
    write(entry, text)

    robot = ad.load_robot(entry)

    assert robot.initial_positions == {"swing": 0.25}
    found = names(robot.source_files, package.resolve())
    expected = [n for n in MADE_OF if n != "config/initial.yaml"]
    assert found == sorted([*expected, "src/more/extra.yaml"])


def test_an_srdf_for_the_robot_is_watched(package):
    robot = ad.load_robot(package)

    watched = watched_files(robot)

    assert names(watched, package) == sorted([*MADE_OF, "srdf/arm.srdf"])


def test_a_file_that_is_missing_may_mend_a_robot(package):
    (package / "urdf/parts/common/tip.xacro").unlink()

    found = names(fail(package), package)

    assert found == [n for n in MADE_OF if n.startswith("urdf")]


@pytest.mark.slow
def test_a_missing_yaml_and_a_missing_variant_may_mend_a_robot(package):
    (package / "config/initial.yaml").unlink()

    assert "config/initial.yaml" in names(fail(package), package)
    # The name of this one is known to xacro alone.
    found = fail(package, xacro_args={"variant": "long"})
    assert names(found, package) == ["urdf/arm.urdf.xacro", "urdf/parts/long.xacro"]


def test_a_syntax_error_leaves_the_files_known(package):
    write(package / "urdf/parts/short.xacro", SHORT.replace("</robot>", "</robt>"))

    found = names(fail(package), package)

    assert found == ["urdf/arm.urdf.xacro", "urdf/parts/short.xacro"]


def test_all_files_that_are_missing_may_mend_a_robot(package):
    # xacro stops at the first; the others are known where names are plain.
    write(package / "urdf/arm.urdf.xacro", ENTRY.replace("$(arg variant)", "short"))
    includes = "".join(f'<xacro:include filename="{name}.xacro"/>' for name in "ab")
    write(package / "urdf/parts/short.xacro", f"<robot {XACRO}>{includes}</robot>")

    found = names(fail(package), package)

    assert found == [
        "urdf/arm.urdf.xacro",
        "urdf/parts/a.xacro",
        "urdf/parts/b.xacro",
        "urdf/parts/short.xacro",
    ]


def test_the_file_that_the_error_names_may_mend_a_robot(package):
    broken = package / "config/controllers.yaml"
    write(broken, "controller_manager: {ros__parameters: [")

    found = names(fail(package), package)

    assert found == [name for name in MADE_OF if not name.startswith("meshes")]


def test_files_that_are_given_may_mend_a_robot(package, monkeypatch):
    write(package / "urdf/parts/common/tip.xacro", "<robot")
    monkeypatch.chdir(package)

    found = names(fail(package, controllers="config/controllers.yaml"), package)

    assert "config/controllers.yaml" in found


def test_a_folder_of_several_robots_has_no_files(package):
    for name in ("other", "another"):
        text = f'<robot name="{name}"><link name="a"/></robot>'
        write(package / f"urdf/{name}.urdf", text)

    assert fail(package.parent) == ()


def test_no_robot_at_all_has_no_files(tmp_path):
    assert files_of_failed(tmp_path / "none.urdf") == ()
    assert files_of_failed("no_such_robot") == ()


@pytest.fixture
def file(tmp_path) -> Path:
    return write(tmp_path / "a.xacro", "old")


def test_nothing_changes_by_itself(file):
    watcher = FileWatcher([file, file.with_name("none")])

    assert watcher.changed() == ()
    assert watcher.changed() == ()


def test_changes_are_reported_once_in_the_order_of_the_files(tmp_path):
    files = [write(tmp_path / name, "old") for name in "cab"]
    watcher = FileWatcher(files)

    for path in (files[2], files[0]):
        write(path, "newer")

    assert watcher.changed() == (files[0], files[2])
    assert watcher.changed() == ()


def test_a_change_of_time_or_size_or_by_a_new_file_alone_is_a_change(file):
    watcher, status = FileWatcher([file]), file.stat()

    os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns + 1))
    assert watcher.changed() == (file,)

    write(file, "older")
    os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns + 1))
    assert watcher.changed() == (file,)

    # As editors save.
    other = write(file.with_suffix(".tmp"), "newer")
    os.utime(other, ns=(status.st_atime_ns, status.st_mtime_ns + 1))
    os.replace(other, file)
    assert watcher.changed() == (file,)
    assert watcher.changed() == ()


def test_a_file_that_is_missing_for_a_moment_has_changed_when_it_is_back(file):
    watcher, away = FileWatcher([file]), file.with_suffix(".bak")

    file.rename(away)
    assert watcher.changed() == ()
    away.rename(file)
    assert watcher.changed() == (file,)
    assert watcher.changed() == ()


def test_a_file_that_is_gone_is_a_change_and_its_return_another(file):
    watcher = FileWatcher([file])

    file.unlink()
    assert [watcher.changed() for _ in range(3)] == [(), (file,), ()]
    write(file, "old")
    assert [watcher.changed() for _ in range(2)] == [(file,), ()]


def test_a_file_that_appears_is_a_change(tmp_path):
    path = tmp_path / "new" / "part.xacro"
    watcher = FileWatcher([path])

    write(path, "")

    assert watcher.changed() == (path,)
    assert watcher.changed() == ()


def test_a_link_changes_with_its_target(file):
    link = file.with_name("link")
    link.symlink_to(file)
    watcher = FileWatcher([link])

    write(file, "newer")

    assert watcher.changed() == (link,)


def test_other_files_may_be_watched_without_losing_a_change(tmp_path):
    kept, dropped, new = (write(tmp_path / name, "old") for name in "abc")
    watcher = FileWatcher([kept, dropped])
    write(kept, "newer")
    write(new, "newer")

    watcher.watch([new, kept])
    write(dropped, "newer")

    # What happened to a file before it was watched is no change.
    assert watcher.changed() == (kept,)
    assert watcher.changed() == ()


@pytest.mark.slow
@pytest.mark.parametrize("name", robot_names())
def test_files_of_real_robots_are_those_that_xacro_and_the_urdf_name(name, monkeypatch):
    row, folder = read_index()[name], robots_folder()
    inputs = [folder / file for file in row["controllers_yaml"]]
    # xacro keeps a list of its own, for build tools.
    monkeypatch.setattr(xacro, "all_includes", [])
    packages = PackageFinder(folder / row["entry"])

    def find(package: str) -> str:
        return str(packages.find(package))

    monkeypatch.setattr(substitution_args, "_eval_find", find)
    monkeypatch.setitem(substitution_args._eval_dict, "find", find)
    xacro.process_file(str(folder / row["entry"]), mappings=row["xacro_args"])
    robot = load_real_robot(name)

    files = robot.source_files

    assert {folder / row["entry"], *inputs} <= set(files)
    assert all(file.is_file() and file.is_absolute() for file in files)
    assert list(files) == sorted(set(files))
    found = {file.name for file in files}
    included = {Path(path).name for path in xacro.all_includes}
    assert included <= found
    read = {(folder / row["entry"]).name, *included}
    assert {n for n in found if n.endswith(".xacro")} == {
        n for n in read if n.endswith(".xacro")
    }
    source = re.sub(r"<!--.*?-->", "", robot.description.source, flags=re.DOTALL)
    meshes = set(re.findall(r'<mesh[^>]*filename="(?:[^"]*/)?([^"/]+)"', source))
    lines = [entry.what for entry in robot.report if entry.kind == "missing"]
    missing = {mesh for mesh in meshes if any(mesh in line for line in lines)}
    assert meshes - missing <= found


def test_a_new_file_that_came_while_it_was_looked_for_has_changed(tmp_path):
    file, other = tmp_path / "file", tmp_path / "other"
    start = time.time_ns() - 1_000_000_000
    file.touch()
    other.touch()
    os.utime(other, ns=(start - 10**9, start - 10**9))
    watcher = FileWatcher()

    watcher.watch([file, other], start)

    assert watcher.changed() == (file,)
    assert watcher.changed() == ()
