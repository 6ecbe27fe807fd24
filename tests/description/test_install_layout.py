"""Packages whose files lie elsewhere once they are installed."""

from pathlib import Path

import pytest

from arm_drake.description.packages import PackageFinder


def make_package(folder: Path, files: dict[str, str]) -> PackageFinder:
    """Write a source package called "arm" and return a finder that starts in it."""
    package = folder / "ws" / "arm"
    for name, text in {"package.xml": "<name>arm</name>", **files}.items():
        path = package / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return PackageFinder(package / "urdf" / "robot.urdf")


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
