"""A robot in a few numbers, against those computed by hand."""

from pathlib import Path

import pytest

from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import RobotDescription, parse_urdf, reach, total_mass


def link(name: str, mass: float) -> str:
    inertia = 'ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"'
    return (
        f'<link name="{name}"><inertial><mass value="{mass}"/><inertia {inertia}/>'
        "</inertial></link>"
    )


def joint(name: str, kind: str, parent: str, child: str, xyz: str, more="") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{xyz}"/><axis xyz="0 0 1"/>{more}</joint>'
    )


def parse(body: str) -> RobotDescription:
    file = Path("arm.urdf")
    text = f'<robot name="r">{body}</robot>'
    return parse_urdf(text, file, PackageFinder(file), LoadReport())


LINKS = link("a", 1.5) + link("b", 2.0) + link("c", 0.25) + link("d", 0.25)


def test_the_mass_is_that_of_all_links():
    assert total_mass(parse(LINKS)) == 4.0


@pytest.mark.parametrize(
    ("joints", "expected"),
    [
        ("", 0.0),
        # What lies before the first movable joint doesn't count: 3-4-5 and 1.
        (
            joint("x", "fixed", "a", "b", "0 0 9")
            + joint("y", "revolute", "b", "c", "0 0 7")
            + joint("z", "fixed", "c", "d", "3 -4 0"),
            5.0,
        ),
        # The longer of two branches.
        (
            joint("x", "continuous", "a", "b", "0 0 9")
            + joint("y", "revolute", "b", "c", "0 2 0")
            + joint("z", "fixed", "b", "d", "0 0 3"),
            3.0,
        ),
        # A prismatic joint adds the longer way that it can go.
        (
            joint("x", "revolute", "a", "b", "0 0 0")
            + joint(
                "y", "prismatic", "b", "c", "1 0 0", '<limit lower="-0.5" upper="0.2"/>'
            ),
            1.5,
        ),
    ],
)
def test_the_reach_is_the_length_of_the_stretched_chain(joints, expected):
    assert reach(parse(LINKS + joints)) == pytest.approx(expected, rel=1e-12)
