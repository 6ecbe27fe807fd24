"""Collisions that MoveIt's files disable."""

from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.description.report import LoadReport
from arm_drake.description.srdf import find_disabled_collisions
from tests import models

SRDF = """<robot name="{name}">
  <disable_collisions link1="last" link2="first" reason="Never"/>
  <disable_collisions link1="first" link2="elsewhere" reason="Never"/>
</robot>"""

# Two balls that overlap by 0.2 mm.
TOUCHING = models.OVERLAPPING.replace("0.05 0 0", "0.0999 0 0")


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


@pytest.fixture
def robot(tmp_path, monkeypatch) -> ad.Robot:
    """Return a robot of two balls in a package of its own."""
    monkeypatch.setattr(Path, "home", lambda: tmp_path.parent)
    write(tmp_path / "arm/package.xml", "<name>arm</name>")
    write(tmp_path / "arm/urdf/arm.urdf", TOUCHING)
    write(tmp_path / "arm_moveit_config/package.xml", "<name>arm_moveit_config</name>")
    return ad.load_robot(tmp_path / "arm")


@pytest.mark.parametrize(
    "place", ["arm/srdf/arm.srdf", "arm_moveit_config/config/arm.srdf"]
)
def test_the_files_of_the_package_and_of_moveit_are_read(robot, tmp_path, place):
    write(tmp_path / place, SRDF.format(name="overlapping"))
    report = LoadReport()

    pairs = find_disabled_collisions(robot, report)

    assert pairs == {("first", "last")}
    assert len(report) == 0


def test_moveit_packages_elsewhere_are_found_by_package_paths(robot, tmp_path):
    elsewhere = tmp_path.parent / f"{tmp_path.name}_elsewhere"
    write(elsewhere / "m/package.xml", "<name>my_moveit_config</name>")
    write(elsewhere / "m/config/arm.srdf", SRDF.format(name="overlapping"))

    other = ad.load_robot(tmp_path / "arm", package_paths=elsewhere)

    assert find_disabled_collisions(robot, LoadReport()) == frozenset()
    assert find_disabled_collisions(other, LoadReport()) == {("first", "last")}


def test_the_file_of_another_robot_says_nothing(robot, tmp_path):
    write(tmp_path / "arm/srdf/arm.srdf", SRDF.format(name="other"))

    assert find_disabled_collisions(robot, LoadReport()) == frozenset()


def test_a_broken_file_is_reported(robot, tmp_path):
    write(tmp_path / "arm/srdf/arm.srdf", "<robot")
    report = LoadReport()

    assert find_disabled_collisions(robot, report) == frozenset()
    assert str(report).startswith(f"warning: {tmp_path / 'arm/srdf/arm.srdf'}: the SRD")


@pytest.mark.parametrize(("name", "contacts"), [("overlapping", 0), ("other", 1)])
def test_disabled_links_pass_through_each_other(robot, tmp_path, name, contacts):
    write(tmp_path / "arm/srdf/arm.srdf", SRDF.format(name=name))
    options = ad.SimulationOptions(self_collision=True)
    diagram = ad.build_diagram(robot, world="void", options=options)

    plant = diagram.GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    results = plant.get_contact_results_output_port().Eval(context)

    assert results.num_point_pair_contacts() == contacts
