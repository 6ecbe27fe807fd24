"""A base rests on the ground where its centre of mass is lowest."""

import numpy as np
import pytest
from pydrake.geometry import Cylinder, Ellipsoid, Sphere
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from arm_drake.plant.initial_poses import RestingShape, lowest_height, rest_on_ground

NO_CORNERS = np.empty((0, 3))


def ball(x: float, y: float, z: float, radius: float) -> RestingShape:
    return RestingShape(Sphere(radius), RigidTransform([x, y, z]), NO_CORNERS)


def wheel(x: float, y: float, z: float, radius: float) -> RestingShape:
    turned = RotationMatrix.MakeXRotation(np.pi / 2.0)
    pose = RigidTransform(turned, [x, y, z])
    return RestingShape(Cylinder(radius, 0.02), pose, NO_CORNERS)


def legs(*feet: tuple[float, float, float]) -> RestingShape:
    # What a mesh or a box is: the corners of its hull.
    return RestingShape(Sphere(1.0), RigidTransform(), np.array(feet))


def heights(shapes: list[RestingShape], X_WB: RigidTransform) -> list[float]:
    return [lowest_height(s._replace(X_BG=X_WB @ s.X_BG)) for s in shapes]


def test_a_base_on_level_wheels_stays_level() -> None:
    shapes = [wheel(0, 0.2, 0, 0.1), wheel(0, -0.2, 0, 0.1), ball(-0.3, 0, -0.05, 0.05)]

    X_WB = rest_on_ground(shapes, np.array([-0.05, 0.0, 0.1]))

    assert X_WB.IsExactlyEqualTo(RigidTransform([0.0, 0.0, 0.1]))


@pytest.mark.parametrize("lower", [-0.02, 0.001, 0.02])
def test_a_base_with_a_caster_of_another_height_tilts(lower: float) -> None:
    caster = ball(0.3, 0.0, -0.05 - lower, 0.05)
    shapes = [wheel(0, 0.2, 0, 0.1), wheel(0, -0.2, 0, 0.1), caster]

    X_WB = rest_on_ground(shapes, np.array([0.05, 0.0, 0.1]))

    # Both wheels and the caster touch the ground, to the solver's 1e-7, and the base
    # looks along x.
    assert heights(shapes, X_WB) == pytest.approx([0.0] * 3, abs=1e-7)
    rpy = RollPitchYaw(X_WB.rotation()).vector()
    assert rpy[[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-9)
    # The line that touches a circle of 0.1 m and one of 0.05 m, 0.3 m ahead and lower.
    a = -rpy[1]
    below = 0.3 * np.sin(a) + (-0.05 - lower) * np.cos(a)
    assert below == pytest.approx(0.05 - 0.1, abs=1e-7)
    assert X_WB.translation()[:2] == pytest.approx([0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize(("x", "lifted"), [(0.1, 2), (-0.1, 0)])
def test_of_four_legs_those_carry_that_are_below_the_centre_of_mass(
    x: float, lifted: int
) -> None:
    # Those on the left and on the right are the longest.
    legs_at = [(0.5, 0.0, 0.0), (0.0, 0.3, -0.01), (-0.5, 0.0, 0.0), (0.0, -0.3, -0.01)]
    shapes = [legs(foot) for foot in legs_at]
    shapes = [s._replace(shape=_Corners()) for s in shapes]

    X_WB = rest_on_ground(shapes, np.array([x, 0.0, 0.2]))

    found = heights(shapes, X_WB)
    assert [h for i, h in enumerate(found) if i != lifted] == pytest.approx(
        [0.0] * 3, abs=1e-7
    )
    # It tilts by 0.01 m on 0.5 m, so the leg behind is lifted by twice that.
    assert found[lifted] == pytest.approx(0.02, rel=1e-3)


def test_the_lowest_point_of_an_ellipsoid_is_where_its_normal_points_down() -> None:
    # Turned by 45 degrees about y: its height is that of its shadow on a wall.
    turned = RotationMatrix.MakeYRotation(np.pi / 4.0)
    shape = RestingShape(Ellipsoid(0.3, 0.1, 0.2), RigidTransform(turned), NO_CORNERS)

    assert lowest_height(shape) == pytest.approx(-np.sqrt((0.3**2 + 0.2**2) / 2.0))


class _Corners:
    """Stands for a shape that has corners alone."""


@pytest.mark.parametrize("x", [0.5, -0.2])
def test_a_base_that_would_fall_over_stays_level(x: float) -> None:
    # Wheels alone, and a centre of mass that isn't above them.
    shapes = [wheel(0, 0.2, 0, 0.1), wheel(0, -0.2, 0, 0.1)]

    X_WB = rest_on_ground(shapes, np.array([x, 0.0, 0.3]))

    assert X_WB.IsExactlyEqualTo(RigidTransform([0.0, 0.0, 0.1]))


def test_a_base_without_shapes_stays_where_it_is() -> None:
    assert rest_on_ground([], np.zeros(3)).IsExactlyEqualTo(RigidTransform())
