"""Steered wheels without a joint to roll on, and axles of two driven wheels."""

from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.description.base_wheels import find_axles, find_bases, with_axles
from arm_drake.description.urdf import total_mass
from tests import models

CYLINDER = '<cylinder radius="0.1" length="0.05"/>'
LYING = '<origin xyz="0 0.02 0" rpy="1.5707963267948966 0 0"/>'

YAML = """
controller_manager:
  ros__parameters:
    car: {type: bicycle_steering_controller/BicycleSteeringController}
car:
  ros__parameters:
    wheelbase: 1.0
    traction_wheel_radius: 0.1
    traction_joints_names: [drive]
    steering_joints_names: [steer]
"""


def wheel(name: str, shape: str = CYLINDER, origin: str = LYING) -> str:
    return models.bob(
        name, "0 0 0", f"<collision>{origin}<geometry>{shape}</geometry></collision>"
    )


def car(
    steered: str = "",
    driven: str = "",
    *,
    more: str = "",
    steering_axis: str = "0 0 1",
) -> str:
    """Return a car whose front wheel is steered, and whose rear wheel is driven."""
    front = models.joint("steer", "base", "front", xyz="1 0 0", axis=steering_axis)
    rear = models.joint("drive", "base", "rear", type="continuous")
    control = models.ros2_control("steer", "drive")
    links = models.bob("base", "0.5 0 0.1") + (steered or wheel("front"))
    return (
        f'<robot name="car">{links}{driven or wheel("rear")}{front}{rear}{control}'
        f"{more}</robot>"
    )


def load(tmp_path: Path, urdf: str, yaml: str = YAML) -> ad.Robot:
    return models.load(tmp_path, urdf, yaml)


def axles_of(robot: ad.Robot) -> list:
    bases = find_bases(robot.description, robot.controllers)
    return find_axles(robot.description, bases)


def test_a_steered_cylinder_gets_an_axle_along_its_axis(tmp_path: Path) -> None:
    robot = load(tmp_path, car())

    (axle,) = axles_of(robot)

    assert (axle.link, axle.wheel, axle.other) == ("front", "front:wheel", "")
    assert axle.center == pytest.approx([0.0, 0.02, 0.0])
    # To the left, so that it turns positively when it rolls forwards.
    assert axle.axis == pytest.approx([0.0, 1.0, 0.0])


def test_a_steered_sphere_rolls_forwards(tmp_path: Path) -> None:
    # Its link is turned by a quarter against the base.
    urdf = car(wheel("front", '<sphere radius="0.1"/>', "")).replace(
        '<origin xyz="1 0 0"/>', '<origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/>'
    )

    (axle,) = axles_of(load(tmp_path, urdf))

    assert axle.axis == pytest.approx([1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    "urdf",
    [
        # It rolls on a joint of its own.
        car(
            models.bob("front", "0 0 0"),
            more=wheel("tyre")
            + models.joint("roll", "front", "tyre", type="continuous"),
        ),
        # A pivot, and what isn't round.
        car(wheel("front", origin="")),
        car(wheel("front", '<box size="1 1 1"/>')),
        # What collides is more than a wheel.
        car(
            wheel("front").replace(
                "<collision>",
                '<collision><geometry><box size="1 1 1"/></geometry></collision>'
                "<collision>",
                1,
            )
        ),
        car(models.bob("front", "0 0 0")),
        # The sphere of a joint that doesn't steer sideways.
        car(wheel("front", '<sphere radius="0.1"/>', ""), steering_axis="0 1 0"),
    ],
)
def test_what_rolls_or_is_no_wheel_gets_none(tmp_path: Path, urdf: str) -> None:
    assert axles_of(load(tmp_path, urdf)) == []


def test_bases_that_steer_nothing_get_none(tmp_path: Path) -> None:
    yaml = """
controller_manager:
  ros__parameters:
    car: {type: diff_drive_controller/DiffDriveController}
car:
  ros__parameters:
    left_wheel_names: [steer]
    right_wheel_names: [drive]
    wheel_separation: 1.0
    wheel_radius: 0.1
"""
    assert axles_of(load(tmp_path, car(), yaml)) == []


def test_two_wheels_of_one_joint_have_a_differential(tmp_path: Path) -> None:
    mimic = '<mimic joint="drive"/>'
    more = wheel("other") + models.joint(
        "follow", "base", "other", xyz="0 1 0", type="continuous", inside=mimic
    )

    robot = load(tmp_path, car(more=more))

    _, first, second = axles_of(robot)
    assert (first.link, first.other) == ("rear", "")
    assert (second.link, second.other) == ("other", "rear")
    assert first.axis == pytest.approx([0.0, 1.0, 0.0])
    whats = [(e.severity, e.kind, e.where, e.what, e.done) for e in robot.report]
    assert (
        "info",
        "repair",
        "link 'front'",
        "a steered wheel without a joint to roll on",
        "in the physics it turns freely about its axis",
    ) in whats
    for link in ("rear", "other"):
        assert (
            "info",
            "repair",
            f"link {link!r}",
            "one joint drives two wheels of an axle",
            "in the physics they have a differential",
        ) in whats


def test_three_wheels_of_one_joint_have_no_differential(tmp_path: Path) -> None:
    more = "".join(
        wheel(name)
        + models.joint(
            f"{name}_joint",
            "base",
            name,
            xyz="0 1 0",
            type="continuous",
            inside='<mimic joint="drive"/>',
        )
        for name in ("second", "third")
    )

    assert [axle.link for axle in axles_of(load(tmp_path, car(more=more)))] == ["front"]


@pytest.mark.slow
def test_an_axle_adds_no_mass_and_changes_no_joint(tmp_path: Path) -> None:
    robot = load(tmp_path, car())
    before = robot.description

    after = with_axles(before, axles_of(robot))

    assert total_mass(after) == pytest.approx(total_mass(before), rel=1e-12)
    assert after.joints[: len(before.joints)] == before.joints
    assert after.links[: len(before.links)] == before.links
    assert before.urdf.count("front:wheel") == 0
    assert after.urdf.count("front:wheel") == 2


def test_in_the_plant_it_turns_freely_and_joint_states_stay(tmp_path: Path) -> None:
    robot = load(tmp_path, car())
    diagram = ad.build_diagram(robot)
    plant = diagram.GetSubsystemByName("plant")
    context = diagram.CreateDefaultContext()

    joint = plant.GetJointByName("front:axle")

    assert diagram.GetOutputPort("joint_states").size() == 3 * 2
    assert len(diagram.GetOutputPort("frames").Eval(context)) == 3
    assert joint.child_body().name() == "front:wheel"
    assert joint.num_velocities() == 1
    # Half of 1 kg as a cylinder of 0.1 m: m r^2 / 2 about its axis.
    inertia = joint.child_body().default_spatial_inertia()
    assert inertia.get_mass() == pytest.approx(0.5)
    moments = inertia.CalcRotationalInertia().CopyToFullMatrix3()
    assert moments[1, 1] == pytest.approx(0.5 * 0.1**2 / 2.0)
    shapes = plant.GetCollisionGeometriesForBody(plant.GetBodyByName("front"))
    assert len(shapes) == 0
    assert np.isfinite(diagram.GetOutputPort("joint_states").Eval(context)).all()


def test_a_fixed_robot_keeps_its_wheels(tmp_path: Path) -> None:
    held = car().replace(
        '<robot name="car">',
        '<robot name="car"><link name="world"/><joint name="weld" type="fixed">'
        '<parent link="world"/><child link="base"/></joint>',
    )

    diagram = ad.build_diagram(load(tmp_path, held))

    assert not diagram.GetSubsystemByName("plant").HasJointNamed("front:axle")
