"""Launch files that write descriptions and parameters where ROS lets them."""

import tempfile
from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.errors import ArmDrakeError
from tests.launch.packages import describe, make_package


@pytest.fixture
def package(tmp_path: Path) -> Path:
    return make_package(tmp_path)


def test_what_is_written_is_used_by_what_is_started(
    package: Path, tmp_path: Path
) -> None:
    made, yaml = tmp_path / "out" / "robot.urdf", package / "config" / "all.yaml"
    before = f"""
    import shutil
    import xacro

    os.makedirs("{made.parent}", exist_ok=True)
    with open("{made}", "w") as file:
        file.write(xacro.process(XACRO[1]))
    shutil.copy(YAML, "{yaml}")
    with open("{yaml}", "a") as file:
        file.write("# " + str(os.path.exists("{yaml}")))
    """
    entities = f"""
    Node(package="robot_state_publisher", executable="robot_state_publisher",
         arguments=["{made}"]),
    Node(package="controller_manager", executable="ros2_control_node",
         parameters=["{yaml}"]),
    spawner("forward"),
    """

    plan = ad.load_launch(describe(package, entities, before))

    (robot,) = plan.load_scene().robots
    assert plan.robots[0].spawned == {"forward": "active"}
    assert len(robot.controllers.controllers) == 3
    assert plan.robots[0].source == package / "urdf" / "pendulum.urdf.xacro"
    assert not made.parent.exists()
    assert not yaml.exists()
    told = str(plan)
    assert f"parameters: {yaml}" in told
    for file in (made, yaml):
        assert f"it writes {file}; it is kept for this launch alone" in str(plan.report)


def test_an_argument_of_xacro_names_what_is_written(
    package: Path, tmp_path: Path
) -> None:
    made = tmp_path / "prefix.txt"
    xacro = package / "urdf" / "pendulum.urdf.xacro"
    name = "${xacro.load_yaml('$(arg prefix)')['prefix']}swing"
    text = xacro.read_text(encoding="utf-8").replace("$(arg prefix)swing", name)
    xacro.write_text(text, encoding="utf-8")
    before = f"""
    with open("{made}", "w") as file:
        file.write("prefix: left_")
    """
    path = describe(package, f'publisher([*XACRO, " prefix:={made}"]),', before)

    plan = ad.load_launch(path)

    (robot,) = plan.load_scene().robots
    assert robot.description.movable_joints[0].name == "left_swing"
    assert f"prefix:={made}" in str(plan)


def test_a_file_that_is_changed_stays_as_it_is(package: Path, tmp_path: Path) -> None:
    file = tmp_path / "notes"
    file.write_text("first ")
    before = f"""
    with open("{file}", "a") as stream:
        stream.write("second")
    said = open("{file}").read()
    os.remove("{file}")
    """
    path = describe(package, "publisher(), LogInfo(msg=said),", before)

    assert "first second; so says" in str(ad.load_launch(path).report)
    assert file.read_text() == "first "


def test_all_functions_of_python_find_what_is_kept(
    package: Path, tmp_path: Path
) -> None:
    old = tmp_path / "old"
    old.write_text("as it was")
    mode = old.stat().st_mode
    before = f"""
    import glob, shutil, tempfile
    from pathlib import Path
    here, said = Path("{tmp_path}"), []
    (here / "a").write_text("first")
    os.replace(here / "a", here / "b")
    os.makedirs(here / "c" / "d")
    shutil.move(here / "b", here / "c")
    said += [(here / "c" / "b").read_text(), str((here / "b").exists())]
    said += [str(sorted(os.listdir(here / "c"))), str(os.access(here / "c", os.R_OK))]
    said += [str(len(glob.glob("{tmp_path}/c/*"))), str(len(list(here.glob("c/*"))))]
    shutil.rmtree(here / "c")
    said += [str((here / "c").exists())]
    (here / "c").mkdir()
    os.rmdir(here / "c")
    (here / "e").touch()
    shutil.copy2("{old}", here / "e")
    os.truncate(here / "e", 2)
    said += [(here / "e").read_text()]
    old = here / "old"
    old.touch()
    old.chmod(0o600)
    os.truncate(old, 5)
    said += [old.read_text(), oct(old.stat().st_mode)]
    os.close(os.open("made", os.O_CREAT, dir_fd=os.open(here, os.O_RDONLY)))
    said += [str((here / "made").exists())]
    with tempfile.NamedTemporaryFile("w", dir=here, delete=False) as file:
        file.write("last")
    said += [open(file.name).read()]
    for each in (os.remove, os.rmdir, lambda name: os.chmod(name, 0)):
        try:
            each(here / "none")
        except FileNotFoundError as error:
            said += [os.path.basename(error.filename)]
    """
    expected = ["first", "False", "['b', 'd']", "True", "2", "2", "False", "as"]
    expected += ["as it", "0o100600", "True", "last", "none", "none", "none"]

    path = describe(package, "publisher(), LogInfo(msg=' '.join(said)),", before)
    report = str(ad.load_launch(path).report)

    assert f"{' '.join(expected)}; so says" in report
    assert "may not do" not in report
    assert sorted(p.name for p in tmp_path.iterdir()) == ["old", "pendulum_bringup"]
    assert old.read_text() == "as it was"
    assert old.stat().st_mode == mode


def test_written_files_are_called_as_the_launch_file_calls_them(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = tmp_path / "places"
    (tmp_path / "real").mkdir()
    places.symlink_to(tmp_path / "real")
    monkeypatch.setattr(tempfile, "tempdir", str(places))
    made, folder = tmp_path / "made.urdf", tmp_path / "folder"
    before = f"""
    import xacro

    os.mkdir("{folder}")
    with open("{made}", "w") as file:
        file.write(xacro.process(XACRO[1]))
    os.chmod("{made}", 0o600)
    try:
        os.symlink("{made}", "{folder}/other")
    except OSError as error:
        said = str(error)
    """
    entities = f"""
    Node(package="robot_state_publisher", executable="robot_state_publisher",
         arguments=["{made}"]),
    Node(package="rviz2", executable="rviz2", arguments=["-d", "{made}"]),
    ExecuteProcess(cmd=["program", "{made}", "{folder}"]),
    LogInfo(msg="see {made}"), LogInfo(msg=said),
    """

    plan = ad.load_launch(describe(package, entities, before))

    told = f"{plan}\n{plan.report}"
    assert plan.robots[0].source == package / "urdf" / "pendulum.urdf.xacro"
    for line in (f"rviz: {made}", f"process program {made}", f"see {made};"):
        assert line in told
    assert "it changes: " in told
    assert "arm_drake_launch_" not in told
    assert not folder.exists()


def test_errors_call_written_files_as_the_launch_file_does(
    package: Path, tmp_path: Path
) -> None:
    made = tmp_path / "made.xacro"
    before = f"""
    with open("{made}", "w") as file:
        file.write('<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="a">')
        file.write('<xacro:include filename="none.xacro"/></robot>')
    """
    plan = ad.load_launch(
        describe(package, f'publisher(["xacro ", "{made}"]),', before)
    )
    gone = describe(package, "", f"{before}\n    os.remove('{made}'); open('{made}')")

    with pytest.raises(ArmDrakeError) as error:
        plan.load_scene()
    with pytest.raises(ArmDrakeError) as other:
        ad.load_launch(gone)

    assert str(error.value).startswith(str(made))
    for each in (error, other):
        assert str(tmp_path) in str(each.value)
        assert "arm_drake_launch_" not in str(each.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("open('{there}', 'x')", "FileExistsError: [Errno 17] File exists"),
        ("open('{none}', 'r+')", "FileNotFoundError: [Errno 2] No such file"),
        ("open('{none}/a', 'w')", "FileNotFoundError: [Errno 2] No such file"),
        ("open('{folder}', 'w')", "it writes: {folder}"),
        ("os.mkdir('{folder}')", "FileExistsError: [Errno 17] File exists"),
        ("os.mkdir('{none}/a')", "FileNotFoundError: [Errno 2] No such file"),
    ],
)
def test_what_can_not_be_written_is_refused_as_by_python(
    package: Path, tmp_path: Path, code: str, expected: str
) -> None:
    there = tmp_path / "there"
    there.write_text("as it was")
    places = {"there": there, "none": tmp_path / "none", "folder": package}

    with pytest.raises(ArmDrakeError) as error:
        ad.load_launch(describe(package, "", code.format(**places)))

    assert expected.format(**places) in str(error.value)
    assert there.read_text() == "as it was"
