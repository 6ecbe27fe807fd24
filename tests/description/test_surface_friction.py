"""Friction that `<gazebo>` tags of links state acts as in Gazebo."""

from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.plant.contact import for_drake
from tests import models

GRAVITY = 9.81


def feet(radius: float) -> str:
    """Return three balls to stand on."""
    places = ("0.2 0.2 0", "0.2 -0.2 0", "-0.2 0 0")
    return "".join(
        f'<collision><origin xyz="{xyz}"/><geometry><sphere radius="{radius}"/>'
        "</geometry></collision>"
        for xyz in places
    )


def sled(friction: str) -> str:
    """Return a body on the ground that nothing holds."""
    return f"""
<robot name="sled">
  {models.bob("sled", "0 0 0", feet(0.05))}
  <joint name="loose" type="floating">
    <parent link="world"/><child link="sled"/><origin xyz="0 0 0.05"/>
  </joint>
  <gazebo reference="sled">{friction}</gazebo>
</robot>"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("friction", "mu"),
    [
        ("<mu1>0.1</mu1><mu2>0.1</mu2>", 0.1),
        ("<mu1>0</mu1>", 0.0),
        ("<mu1> 0.4 </mu1>", 0.4),
        # The ground has 1, and the smaller coefficient counts.
        ("<mu1>30.0</mu1>", 1.0),
        ("", 1.0),
        # As SDF says it.
        (
            "<collision><surface><friction><ode><mu>0.2</mu></ode></friction>"
            "</surface></collision>",
            0.2,
        ),
        # No coefficients.
        ("<mu1>-1</mu1>", 1.0),
        ("<mu1>much</mu1>", 1.0),
    ],
)
def test_a_sled_slides_as_long_as_its_friction_says(
    tmp_path: Path, friction: str, mu: float
) -> None:
    robot = models.load(tmp_path, sled(friction))
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.run(0.1)
    plant = sim.diagram.GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(sim.simulator.get_mutable_context())
    plant.SetVelocities(context, np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]))

    sim.run(0.05)

    # It brakes by mu g; contact gives way a little at first.
    v = plant.GetVelocities(context)[3]
    assert v == pytest.approx(1.0 - mu * GRAVITY * 0.05, abs=0.01)


def test_two_that_state_nothing_less_than_one_keep_one() -> None:
    # Drake takes 2 a b / (a + b); with something of 1 it is to be the smaller one.
    for mu in (0.0, 0.01, 0.5, 1.0):
        a = for_drake(mu)
        assert 2.0 * a * 1.0 / (a + 1.0) == pytest.approx(mu)


def test_links_that_are_not_there_state_nothing(tmp_path: Path) -> None:
    urdf = sled("<mu1>0.3</mu1>").replace(
        "</robot>", '<gazebo reference="other"><mu1>0.5</mu1></gazebo></robot>'
    )

    assert models.load(tmp_path, urdf).description.friction == {"sled": 0.3}
