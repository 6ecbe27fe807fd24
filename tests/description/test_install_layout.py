"""Packages whose files lie elsewhere once they are installed."""

import itertools
import os
from pathlib import Path

import pytest

from arm_drake.description import packages
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from tests.description.patience import within


def make_package(
    folder: Path, files: dict[str, str], report: LoadReport | None = None
) -> PackageFinder:
    """Write a source package called "arm" and return a finder that starts in it."""
    package = folder / "ws" / "arm"
    for name, text in {"package.xml": "<name>arm</name>", **files}.items():
        path = package / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return PackageFinder(package / "urdf" / "robot.urdf", report=report)


def test_a_package_that_installs_all_in_place_is_its_own_folder(tmp_path):
    cmake = "install(DIRECTORY urdf meshes DESTINATION share/${PROJECT_NAME})"
    finder = make_package(tmp_path, {"CMakeLists.txt": cmake, "urdf/a.xacro": "a"})

    assert finder.find("arm") == tmp_path / "ws" / "arm"


@pytest.mark.parametrize(
    ("cmake", "place"),
    [
        # A folder, its content, a file, a file under another name.
        ("install(DIRECTORY src/urdf DESTINATION share/arm)", "urdf/a.xacro"),
        ("install(DIRECTORY src/urdf/ DESTINATION share/arm/x)", "x/a.xacro"),
        ("install(DIRECTORY src/ DESTINATION share/arm/)", "urdf/a.xacro"),
        ("install(FILES src/urdf/a.xacro DESTINATION share/arm/x)", "x/a.xacro"),
        (
            "install(FILES src/urdf/a.xacro DESTINATION share/arm RENAME b.xacro)",
            "b.xacro",
        ),
        # Variables, comments, several lines, options, quotes, letter case.
        (
            "install(DIRECTORY src/urdf DESTINATION share/${PROJECT_NAME})",
            "urdf/a.xacro",
        ),
        (
            "project(arm)\nINSTALL(\n  DIRECTORY # all\n src/urdf\n  DESTINATION"
            ' "share/${PROJECT_NAME}/x"\n  PATTERN "*.in" EXCLUDE)',
            "x/urdf/a.xacro",
        ),
        (
            "set(TO share/${PROJECT_NAME}/x)\n"
            "install(DIRECTORY src/urdf DESTINATION ${TO})",
            "x/urdf/a.xacro",
        ),
        (
            "install(DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR}/src/urdf "
            "DESTINATION share/arm)",
            "urdf/a.xacro",
        ),
        ("ament_auto_package(INSTALL_TO_SHARE src/urdf)", "urdf/a.xacro"),
        ("add_subdirectory(src)", "y/a.xacro"),
        # Loops.
        (
            "foreach(dir nowhere urdf)\n  install(DIRECTORY src/${dir}\n"
            "    DESTINATION share/${PROJECT_NAME})\nendforeach()",
            "urdf/a.xacro",
        ),
        (
            "set(ALL nowhere urdf)\nforeach(dir IN LISTS ALL)\n"
            "install(DIRECTORY src/${dir} DESTINATION share/arm)\nendforeach(dir)",
            "urdf/a.xacro",
        ),
        (
            "foreach(a IN ITEMS x src)\nforeach(b IN ITEMS urdf y)\n"
            "install(DIRECTORY ${a}/${b} DESTINATION share/arm/${b})\nendforeach()\n"
            "endforeach()",
            "urdf/urdf/a.xacro",
        ),
        (
            "foreach(a RANGE 3)\nproject(other)\nendforeach()\n"
            "install(DIRECTORY src/urdf DESTINATION share/${PROJECT_NAME})",
            "urdf/a.xacro",
        ),
    ],
)
def test_cmake_says_where_files_are_installed(tmp_path, cmake, place):
    source = "src/urdf/a.xacro"
    sub = "install(DIRECTORY urdf/ DESTINATION share/${PROJECT_NAME}/y)"
    files = {"CMakeLists.txt": cmake, source: "a", "src/CMakeLists.txt": sub}
    finder = make_package(tmp_path, files)

    shown = finder.find("arm") / place

    assert shown.read_text(encoding="utf-8") == "a"
    assert finder.real(shown) == tmp_path / "ws" / "arm" / source
    assert finder.resolve(f"package://arm/{place}", tmp_path) == finder.real(shown)


@pytest.mark.parametrize(
    "cmake",
    [
        "# install(DIRECTORY src/urdf DESTINATION share/arm)",
        "#[[\ninstall(DIRECTORY src/urdf DESTINATION share/arm)\n]]",
        "install(DIRECTORY src/urdf DESTINATION lib/arm)",
        "install(DIRECTORY src/urdf DESTINATION share/other)",
        "install(DIRECTORY src/urdf DESTINATION share/arm/../other)",
        "install(DIRECTORY nowhere DESTINATION share/arm)",
        "install(TARGETS src/urdf DESTINATION share/arm)",
        "install(DIRECTORY src/urdf)",
        "install(",
        'install(DIRECTORY "src/urdf DESTINATION share/arm)',
    ],
)
def test_what_isnt_installed_below_share_stays_where_it_is(tmp_path, cmake):
    files = {"CMakeLists.txt": cmake, "src/urdf/a.xacro": "a"}
    finder = make_package(tmp_path, files)

    assert finder.find("arm") == tmp_path / "ws" / "arm"


def test_folders_of_one_name_are_merged_and_the_rest_is_shown_in_place(tmp_path):
    cmake = """
      install(DIRECTORY a/urdf b/urdf DESTINATION share/arm)
      install(DIRECTORY b/deep/urdf/inner/ DESTINATION share/arm/urdf/sub)
    """
    files = {
        "CMakeLists.txt": cmake,
        "a/urdf/1.xacro": "1",
        "a/urdf/sub/2.xacro": "2",
        "b/urdf/3.xacro": "3",
        "b/deep/urdf/inner/4.xacro": "4",
        "config/c.yaml": "c",
        "urdf/0.xacro": "0",
    }
    root = make_package(tmp_path, files).find("arm")

    shown = [
        "urdf/0.xacro",
        "urdf/1.xacro",
        "urdf/sub/2.xacro",
        "urdf/3.xacro",
        "urdf/sub/4.xacro",
        "config/c.yaml",
        "a/urdf/1.xacro",
    ]
    # The finder is gone, and what it showed with it.
    assert not root.exists()
    finder = make_package(tmp_path, files)
    root = finder.find("arm")
    assert {name: (root / name).read_text() for name in shown} == {
        name: Path(name).stem for name in shown
    }
    # The package itself is as it was.
    assert not (tmp_path / "ws/arm/urdf/sub").exists()


SETUP = """
from glob import glob
import os
from setuptools import setup

package_name = 'arm'

setup(
    name=package_name,
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
        {rule},
    ],
    install_requires=[helper()],
)
"""


@pytest.mark.parametrize(
    ("rule", "place"),
    [
        ("('share/arm/urdf', ['src/urdf/a.xacro'])", "urdf/a.xacro"),
        (
            "(os.path.join('share', package_name, 'urdf'), glob('src/urdf/*.xacro'))",
            "urdf/a.xacro",
        ),
        (
            "(os.path.join('share', package_name), "
            "glob(os.path.join('src', 'urdf', '*.xacro')) + ['setup.py'])",
            "a.xacro",
        ),
        ("(f'share/{package_name}/x', glob('src/**/a.xacro'))", "x/a.xacro"),
        ("('share/' + package_name + '/y', ['src/urdf/a.xacro'])", "y/a.xacro"),
    ],
)
def test_setup_py_says_where_files_are_installed(tmp_path, rule, place):
    files = {"setup.py": SETUP.replace("{rule}", rule), "src/urdf/a.xacro": "a"}
    finder = make_package(tmp_path, files)

    shown = finder.find("arm") / place

    assert finder.real(shown) == tmp_path / "ws" / "arm" / "src" / "urdf" / "a.xacro"


@pytest.mark.parametrize(
    "text",
    [
        "import sys; sys.exit('executed')",
        SETUP.replace("{rule}", "(where(), ['src/urdf/a.xacro'])"),
        SETUP.replace("{rule}", "('share/arm/x', [f for f in files()])"),
        SETUP.replace("{rule}", "('share/arm/x', a)").replace("import os", "a = a"),
        "def (",
        "\0",
    ],
)
def test_a_setup_py_that_isnt_understood_changes_nothing(tmp_path, text):
    finder = make_package(tmp_path, {"setup.py": text, "src/urdf/a.xacro": "a"})

    assert finder.find("arm") == tmp_path / "ws" / "arm"


def test_made_up_paths_in_a_text_become_real_ones(tmp_path):
    cmake = "install(DIRECTORY src/urdf DESTINATION share/arm)"
    finder = make_package(tmp_path, {"CMakeLists.txt": cmake, "src/urdf/a.xacro": ""})
    shown = finder.find("arm") / "urdf" / "a.xacro"

    text = finder.real_paths(f'<mesh filename="file://{shown}"/> {shown}')

    real = tmp_path / "ws" / "arm" / "src" / "urdf" / "a.xacro"
    assert text == f'<mesh filename="file://{real}"/> {real}'


@pytest.mark.parametrize(
    "name",
    ["{victim}", "../../../../../../../../../../../..{victim}", "..", "x/../../y"],
)
def test_a_package_replaces_no_file_outside_of_itself(tmp_path, name):
    victim = tmp_path / "victim.txt"
    victim.write_text("mine", encoding="utf-8")
    name = name.format(victim=victim)
    cmake = f"install(FILES src/evil RENAME {name} DESTINATION share/arm)"
    files = {"CMakeLists.txt": cmake, "src/evil": "evil"}

    assert make_package(tmp_path, files).find("arm") == tmp_path / "ws" / "arm"

    assert victim.read_text(encoding="utf-8") == "mine"
    assert not victim.is_symlink()


@pytest.mark.parametrize("depth", range(1, 4))
def test_a_place_outside_is_refused_before_anything_is_made_there(tmp_path, depth):
    source = tmp_path / "evil"
    source.write_text("evil", encoding="utf-8")
    victim = tmp_path / "victim"
    package = tmp_path / "arm"
    package.mkdir()
    places = (Path("../" * depth, "victim"), Path("a", "../" * depth, "victim"), victim)

    for number, place in enumerate(places):
        shown = tmp_path / "1" / "2" / str(number)
        with pytest.raises(ValueError, match="lies outside of the package"):
            packages.show_as_installed(package, [(place, source)], shown)

    assert not victim.exists()
    assert {path.name for path in tmp_path.iterdir()} == {"1", "arm", "evil"}


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("CMakeLists.txt", "install(DIRECTORY src/.. DESTINATION share/arm)"),
        ("CMakeLists.txt", "install(FILES .. DESTINATION share/arm)"),
        ("setup.py", "data_files=[('share/arm', ['src/..'])]"),
        ("setup.py", "data_files=[('share/arm', ['..'])]"),
    ],
)
def test_what_is_called_like_the_folder_above_is_not_installed(tmp_path, file, text):
    finder = make_package(tmp_path, {file: text, "src/a": "a"})

    assert finder.find("arm") == tmp_path / "ws" / "arm"


@pytest.mark.slow
def test_a_link_to_a_folder_above_is_not_followed_for_ever(tmp_path):
    cmake = "install(DIRECTORY a/ b/ DESTINATION share/arm/c)"
    report = LoadReport()
    files = {"CMakeLists.txt": cmake, "a/1": "1", "b/2": "2"}
    finder = make_package(tmp_path, files, report)
    for name in "ab":
        (tmp_path / "ws" / "arm" / name / "up").symlink_to("..")

    with within(20.0):
        root = finder.find("arm")

    assert {path.name for path in (root / "c").iterdir()} == {"1", "2", "up"}
    assert not len(report)


FALLS_BACK = {
    "file as folder": {
        "CMakeLists.txt": "install(DIRECTORY src DESTINATION share/arm/config/sub)",
        "config": "",
    },
    "folder as file": {
        "CMakeLists.txt": "install(FILES src/a DESTINATION share/arm RENAME b)\n"
        "install(DIRECTORY src DESTINATION share/arm/b)\n"
        "install(FILES src/a DESTINATION share/arm RENAME b)",
    },
    "long name": {
        "CMakeLists.txt": f"install(DIRECTORY src DESTINATION share/arm/{'n' * 300})",
    },
    "long source": {
        "CMakeLists.txt": f"install(DIRECTORY {'n' * 300} DESTINATION share/arm)",
    },
    "endless variable": {
        "CMakeLists.txt": "set(A aaaaaaaa)\n"
        + "set(A ${A}${A})\n" * 60
        + "install(DIRECTORY src DESTINATION share/arm/${A})",
    },
    "endless loops": {
        "CMakeLists.txt": f"foreach(a {'a ' * 100})\n" * 9
        + "install(DIRECTORY src DESTINATION share/arm/x)\n"
        + "endforeach()\n" * 9,
    },
    "itself": {"CMakeLists.txt": "add_subdirectory(.)\n" * 1000},
    "large file": {"CMakeLists.txt": "# " * 1_000_000},
    "nested texts": {
        "setup.py": "a = 'x'\n"
        + "".join(
            f"{new} = f'" + f"{{{old}}}" * 20 + "'\n"
            for old, new in itertools.pairwise("abcdefg")
        )
        + "data_files=[('share/arm/' + g, ['src/a'])]",
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("case", FALLS_BACK)
def test_install_rules_that_cant_be_followed_are_reported(tmp_path, case):
    report = LoadReport()
    files = {"src/a": "a", **FALLS_BACK[case]}
    finder = make_package(tmp_path, files, report)
    package = tmp_path / "ws" / "arm"

    with within(20.0):
        found = finder.find("arm")

    assert found == package
    assert str(report).startswith(
        f"warning: {package / 'urdf' / 'robot.urdf'}: what package 'arm' installs "
        "can't be followed: "
    )
    assert str(report).endswith(
        f"; its source folder {str(package)!r} is taken as it is"
    )
    assert len(report) == 1


def test_a_file_over_a_folder_of_the_package_is_shown_in_its_place(tmp_path):
    cmake = "install(FILES src/a DESTINATION share/arm RENAME urdf)"
    files = {"CMakeLists.txt": cmake, "src/a": "a", "urdf/b": "b"}
    finder = make_package(tmp_path, files)

    assert (finder.find("arm") / "urdf").read_text(encoding="utf-8") == "a"


def test_a_setup_py_with_a_deep_expression_is_read(tmp_path):
    # A chain this long is read, and taken apart it would be too deep.
    deep = ".".join(["a"] * 1500)
    text = f"b = {deep}('x')\ndata_files=[(b, []), ('share/arm/u', ['src/a'])]"
    report = LoadReport()
    finder = make_package(tmp_path, {"setup.py": text, "src/a": "a"}, report)

    finder.find("arm")

    assert not len(report)


@pytest.mark.parametrize("name", ["CMakeLists.txt", "setup.py"])
def test_a_pipe_is_not_read(tmp_path, name):
    finder = make_package(tmp_path, {"src/a": "a"})
    package = tmp_path / "ws" / "arm"
    os.mkfifo(package / name)

    with within(10.0):
        assert finder.find("arm") == package
