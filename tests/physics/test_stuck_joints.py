"""Joints whose effort limit is near their dry friction, or below it."""

from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from tests.models import joint, ros2_control

# Two links of 1 kg and 0.4 m, the first with friction.
LINK = """
  <link name="{}">
    <inertial>
      <origin xyz="0 0 0.2"/><mass value="1"/>
      <inertia ixx="0.0133" ixy="0" ixz="0" iyy="0.0133" iyz="0" izz="0.001"/>
    </inertial>
  </link>"""
WEIGHT = 9.81 * (0.2 + 0.6)
ENOUGH = 40.0

CONTROLLERS = """
controller_manager:
  ros__parameters:
    update_rate: 100
    forward: {{type: forward_command_controller/ForwardCommandController}}
forward:
  ros__parameters: {{joints: [shoulder, elbow], interface_name: {}}}
"""


def simulate(
    folder: Path,
    target: tuple[float, float],
    *,
    friction: float,
    effort: float,
    elbow_friction: float = 0.0,
    command: str = "position",
    start: tuple[float, float] = (0.0, 0.0),
    duration: float = 3.0,
    **options,
) -> tuple[ad.Simulation, ad.Rollout]:
    dynamics = [f'<dynamics friction="{f}"/>' for f in (friction, elbow_friction)]
    limits = [
        f'lower="-2" upper="2" effort="{e}" velocity="3"' for e in (effort, ENOUGH)
    ]
    elbow = joint(
        "elbow",
        "upper",
        "lower",
        xyz="0 0 0.4",
        limit=limits[1],
        inside=dynamics[1],
    )
    (folder / "a.urdf").write_text(
        f"""<robot name="two"><link name="world"/>{LINK.format("upper")}
        {LINK.format("lower")}
        {joint("shoulder", "world", "upper", limit=limits[0], inside=dynamics[0])}
        {elbow}
        {ros2_control("shoulder", "elbow", command=command)}
        </robot>"""
    )
    (folder / "a.yaml").write_text(CONTROLLERS.format(command))
    robot = ad.load_robot(
        folder / "a.urdf",
        controllers=folder / "a.yaml",
        initial_positions=dict(zip(("shoulder", "elbow"), start, strict=True)),
    )
    options = ad.SimulationOptions(**options)
    simulation = ad.Simulation(ad.build_diagram(robot, options=options))
    simulation.controller("forward").command(target)
    simulation.run(duration)
    return simulation, simulation.rollout()


@pytest.mark.parametrize(
    ("effort", "time_step"),
    [(2.0, 0.001), (5.0, 0.001), (5.0, 0.005), (9.0, 0.005), (9.0, 0.01), (9.9, 0.01)],
)
def test_a_stuck_joint_stays_and_its_neighbour_goes_where_it_is_told(
    tmp_path, effort, time_step
) -> None:
    _, rollout = simulate(
        tmp_path,
        (0.5, 0.0),
        friction=10.0,
        effort=effort,
        gravity=False,
        time_step=time_step,
    )

    assert np.abs(rollout.position[:, 0]).max() < 0.02
    assert np.abs(rollout.position[:, 1]).max() < 0.02


@pytest.mark.parametrize("effort", [10.1, 11.0, 12.0, 15.0])
def test_who_hardly_overcomes_its_friction_does_not_throw_its_neighbour(
    tmp_path, effort
) -> None:
    _, rollout = simulate(
        tmp_path, (0.5, 0.0), friction=10.0, effort=effort, gravity=False
    )

    assert np.abs(rollout.position[:, 1]).max() < 0.05
    assert 0.2 < rollout.position[-1, 0] < 0.51


def test_who_cannot_lift_itself_for_friction_does_not_let_its_neighbour_fall(
    tmp_path,
) -> None:
    # It lies level, and its limit bears its weight, but not its friction besides.
    horizontal = (np.pi / 2.0, 0.0)

    _, rollout = simulate(
        tmp_path, (0.0, 0.0), friction=6.0, effort=WEIGHT + 2.0, start=horizontal
    )

    assert np.abs(rollout.position[:, 1]).max() < 0.05
    assert rollout.position[-1, 0] > 1.4


@pytest.mark.parametrize("preset", ["accurate", "fast"])
def test_it_is_said_on_loading_and_fast_leaves_it_to_accurate(tmp_path, preset) -> None:
    simulation, rollout = simulate(
        tmp_path, (0.5, 0.0), friction=41.0, effort=40.0, preset=preset
    )

    texts = [str(entry) for entry in simulation.report]
    assert any(
        "joint 'shoulder': gravity asks for up to 7.8 N·m and dry friction for 41 N·m, "
        "the effort limit is 40 N·m; the joint may stick" in text
        for text in texts
    )
    is_refused = any("don't bear its weight and friction" in text for text in texts)
    assert is_refused == (preset == "fast")
    assert abs(rollout.position[-1, 0]) < 0.1


@pytest.mark.parametrize(("time_step", "is_soft"), [(0.001, False), (0.01, True)])
def test_friction_that_gives_way_under_efforts_is_told(
    tmp_path, time_step, is_soft
) -> None:
    simulation, rollout = simulate(
        tmp_path,
        (9.0, 0.0),
        friction=10.0,
        elbow_friction=10.0,
        effort=ENOUGH,
        command="effort",
        gravity=False,
        time_step=time_step,
    )

    texts = [str(entry) for entry in simulation.report]
    assert any("are large for its friction" in text for text in texts) == is_soft
    assert (abs(rollout.position[-1, 0]) > 0.05) == is_soft


def test_where_drives_make_up_for_it_nothing_is_reported(tmp_path) -> None:
    simulation, rollout = simulate(
        tmp_path, (0.5, 1.0), friction=10.0, effort=ENOUGH, time_step=0.01
    )

    assert not simulation.report
    assert rollout.position[-1] == pytest.approx([0.5, 1.0], abs=1e-3)
