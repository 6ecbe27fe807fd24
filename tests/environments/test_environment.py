"""Environments: what Gymnasium asks of one, and what can be learnt in it."""

import concurrent.futures
import math
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv
from pydrake.math import RigidTransform

import arm_drake as ad
from arm_drake.errors import InputError
from tests import models
from tests.snippets import read_blocks

REACH = "arm_drake.environments:ArmDrake/Reach-v0"

# Bent, for a stretched arm can't move along itself.
BENT = {"joint2": 0.2, "joint3": 1.5, "joint5": 1.4}


class Swing(ad.Task):
    """The joint comes to an angle; a task as a user writes it."""

    time_limit = 0.5

    def bounds(self, environment: ad.Environment) -> Any:
        return -np.ones(1), np.ones(1)

    def reset(
        self, environment: ad.Environment, generator: np.random.Generator
    ) -> None:
        self.angle = generator.uniform(-1.0, 1.0)

    def observe(self, environment: ad.Environment) -> Any:
        return np.array([self.angle])

    def evaluate(self, environment: ad.Environment) -> ad.Evaluation:
        position = environment.simulation.joint_states().position[0]
        return ad.Evaluation(-abs(position - self.angle))


def swing(tmp_path: Any, kind: str, interface: str, **options: Any) -> ad.Environment:
    limit = 'lower="-3" upper="3" effort="100" velocity="5"'
    control = models.ros2_control("swing", command=interface)
    urdf = models.pendulum(limit=limit, control=control)
    controllers = f"""
controller_manager: {{ros__parameters: {{update_rate: 100, forward: {{type: {kind}}}}}}}
forward: {{ros__parameters: {{joints: [swing]}}}}"""
    robot = models.load(tmp_path, urdf, controllers)
    return ad.make_env(robot, task=Swing(), **options)


@pytest.mark.slow
def test_it_is_what_gymnasium_asks_for() -> None:
    environment = gymnasium.make(REACH, robot="doosan_a0912").unwrapped

    check_env(environment)

    space = environment.observation_space
    assert space.shape == (18,)
    assert np.isfinite([space.low, space.high]).all()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bits_alone_and_among_others() -> None:
    def make() -> gymnasium.Env:
        return gymnasium.make(REACH, robot="doosan_a0912")

    actions = np.random.default_rng(1).uniform(-1, 1, (10, 6))

    def run(environment: Any, several: int | None = None) -> list[Any]:
        seen = [environment.reset(seed=7)[0]]
        for action in actions:
            given = action if several is None else np.tile(action, (several, 1))
            seen.append(environment.step(given)[0])
        environment.close()
        return seen if several is None else [each[0] for each in seen]

    alone = run(make())

    assert np.array_equal(alone, run(make()))
    assert np.array_equal(alone, run(SyncVectorEnv([make, make]), 2))
    context = "spawn" if sys.platform == "darwin" else None
    assert np.array_equal(alone, run(AsyncVectorEnv([make, make], context=context), 2))


@pytest.mark.slow
def test_the_sphere_is_where_the_picture_shows_it() -> None:
    environment = ad.make_env("doosan_a0912", render_mode="rgb_array")
    colors = []
    for seed in (1, 2):
        environment.reset(seed=seed)
        picture = environment.render().astype(int)
        is_green = (picture[..., 1] > 1.5 * picture[..., 0]) & (picture[..., 1] > 60)
        colors.append(np.argwhere(is_green).mean(axis=0))

    assert picture.shape == (480, 640, 3)
    assert np.isfinite(colors).all()
    # It went somewhere else, and is one.
    assert np.linalg.norm(colors[0] - colors[1]) > 10


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["meshcat", "human"])
def test_a_page_shows_the_sphere_and_a_human_sees_real_time(
    mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    environment = ad.make_env("doosan_a0912", render_mode=mode)
    environment.reset(seed=1)
    began = time.monotonic()

    for _ in range(10):
        environment.step(np.zeros(6))

    assert environment.meshcat is not None
    assert environment.meshcat.HasPath("task/0")
    if mode == "human":
        assert opened == [environment.meshcat.web_url()]
        # Ten steps are half a second.
        assert time.monotonic() - began > 0.45
    environment.close()


@pytest.mark.slow
def test_pictures_of_another_thread_are_the_same(
    capfd: pytest.CaptureFixture[str],
) -> None:
    def shoot(environment: ad.Environment) -> Any:
        environment.reset(seed=3)
        return environment.render()

    robot = ad.load_robot("doosan_a0912")
    environments = [ad.make_env(robot, render_mode="rgb_array") for _ in range(2)]
    expected = shoot(environments[0])
    with concurrent.futures.ThreadPoolExecutor(1) as other:
        found = other.submit(shoot, environments[1]).result()
        # The thread stays while the main one draws.
        again = [shoot(each) for each in environments]

    for picture in (found, *again):
        np.testing.assert_array_equal(picture, expected)
    assert "eglMakeCurrent" not in capfd.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("interface", "kind", "expected"),
    [
        # After 0.5 s of an action of 0.5, of a limit of 5 rad/s.
        ("position", "position_controllers/JointGroupPositionController", 1.25),
        ("velocity", "velocity_controllers/JointGroupVelocityController", 1.25),
    ],
)
def test_an_action_is_a_share_of_the_limit(
    tmp_path: Any, interface: str, kind: str, expected: float
) -> None:
    environment = swing(tmp_path, kind, interface)
    environment.reset(seed=0)

    for _ in range(10):
        _, _, is_terminated, is_truncated, _ = environment.step(np.array([0.5]))

    assert (is_terminated, is_truncated) == (False, True)
    for _ in range(10):  # It comes to rest there.
        environment.step(np.zeros(1))
    position = environment.simulation.joint_states().position[0]
    assert position == pytest.approx(expected, abs=0.01)


def test_what_can_not_be_is_refused(tmp_path: Any) -> None:
    kind = "position_controllers/JointGroupPositionController"
    with pytest.raises(InputError, match="controller 'foward' isn't there; did you"):
        swing(tmp_path, kind, "position", controller="foward")
    with pytest.raises(InputError, match="unknown render_mode 'rgb'; "):
        swing(tmp_path, kind, "position", render_mode="rgb")
    with pytest.raises(InputError, match="no controller takes trajectories"):
        swing(tmp_path, "joint_state_broadcaster/JointStateBroadcaster", "position")
    environment = swing(tmp_path, kind, "position")
    environment.reset()
    with pytest.raises(InputError, match=r"action: expected \(1,\) finite numbers"):
        environment.step(np.array([np.nan]))
    with pytest.raises(InputError, match="no link 'hand'; known"):
        ad.make_env(environment.robot, task=ad.ReachTask(frame="hand"))
    with pytest.raises(InputError, match="expected a radius"):
        ad.ReachTask(radius=0.0)
    with pytest.raises(InputError, match="region: expected least and largest"):
        ad.ReachTask(region=((1.0, 0.0, 0.0), (0.0, 1.0, 1.0)))


@pytest.mark.parametrize(
    ("evaluation", "message"),
    [
        ((math.nan, False, {}), "expected a finite number as reward, got nan"),
        ((None, False, {}), "expected a finite number as reward, got None"),
        (1.0, "expected an Evaluation(reward, is_terminated, info), got 1.0"),
        ((1.0, False, None), "expected a mapping as info, got None"),
    ],
)
def test_what_is_no_evaluation_is_refused(
    tmp_path: Any, evaluation: Any, message: str
) -> None:
    class Odd(Swing):
        def evaluate(self, environment: Any) -> Any:
            return evaluation

    kind = "position_controllers/JointGroupPositionController"
    robot = swing(tmp_path, kind, "position").robot
    environment = ad.make_env(robot, task=Odd())

    with pytest.raises(InputError) as error:
        environment.reset()

    assert str(error.value) == f"Odd.evaluate: {message}"


@pytest.mark.filterwarnings("error::arm_drake.errors.ArmDrakeWarning")
def test_fast_actions_are_not_warned_of(tmp_path: Any) -> None:
    yaml = models.trajectory_controllers({"arm": ["swing"]})
    robot = models.load(tmp_path, models.pendulum(), yaml)
    environment = ad.make_env(robot, task=Swing())
    environment.reset(seed=1)

    # The joint lags behind what full speed has told it.
    for _ in range(8):
        environment.step(np.ones(1))

    assert environment.simulation.joint_states().position[0] > 0.1  # It moves.


def test_arguments_of_other_types_are_named(tmp_path: Any) -> None:
    kind = "position_controllers/JointGroupPositionController"
    environment = swing(tmp_path, kind, "position")

    with pytest.raises(InputError, match="no link 'nolink'; known"):
        environment.link_pose("nolink")
    for value in ("x", 0.0, math.nan, True):
        with pytest.raises(InputError, match="period: expected a time"):
            ad.make_env(environment.robot, period=value)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"task: expected a task, .* got 'reach'"):
        ad.make_env(environment.robot, task="reach")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"make_env: no option 'perod'; .*'period'"):
        ad.make_env("lab5_arm", perod=0.1)


@pytest.mark.slow
def test_goals_of_a_region_lie_in_it() -> None:
    task = ad.ReachTask(region=((0.4, 0.0, 0.3), (0.5, 0.1, 0.4)))
    environment = ad.make_env("doosan_a0912", task=task)

    goals = []
    for seed in range(20):
        environment.reset(seed=seed)
        goals.append(task.goal)

    assert np.all(np.min(goals, axis=0) >= [0.4, 0.0, 0.3])
    assert np.all(np.max(goals, axis=0) <= [0.5, 0.1, 0.4])
    assert len(np.unique(goals, axis=0)) == 20
    assert isinstance(environment.link_pose("link6"), RigidTransform)


@pytest.mark.slow
def test_the_programs_of_the_page_run(capsys: pytest.CaptureFixture[str]) -> None:
    page = Path(__file__).parents[2] / "docs" / "environments.md"
    names: dict[str, Any] = {}

    for block in read_blocks(page):
        if block.language == "python":
            exec(compile(block.text, str(page), "exec"), names)  # noqa: S102

    assert float(capsys.readouterr().out) == names["info"]["distance"]
    _, info = names["env"].reset(seed=0)
    assert info == {"is_success": True}  # It begins upright.


# From the way to the sphere, and a constant, to the joints' actions: what was learnt.
LEARNT = [
    [0.1, 3.8, -1.0, 0.1],
    [0.4, -0.8, -1.1, -0.1],
    [-1.7, 1.4, -3.6, -0.7],
    [0.2, -0.2, 0.2, 2.0],
    [1.7, -1.6, 1.0, 1.6],
    [-1.3, -0.5, 0.2, -3.7],
]

Run = Callable[[Any, int], tuple[float, bool]]


@pytest.fixture(scope="module")
def run() -> Run:
    """Runs an episode with a linear policy; returns its reward, and if it got there."""
    task = ad.ReachTask(region=((0.45, -0.3, 0.3), (0.8, 0.3, 0.75)), time_limit=2.5)
    environment = ad.make_env(
        "doosan_a0912", task=task, period=0.1, initial_positions=BENT
    )

    def run(weights: Any, seed: int) -> tuple[float, bool]:
        seen, _ = environment.reset(seed=seed)
        total = 0.0
        while True:
            action = np.tanh(weights @ np.append(seen[12:15], 0.1))
            seen, reward, is_terminated, is_truncated, info = environment.step(action)
            total += float(reward)
            if is_terminated or is_truncated:
                return total, info["is_success"]

    return run


@pytest.mark.slow
def test_a_linear_policy_reaches_the_sphere(run: Run) -> None:
    learnt, nothing = np.array(LEARNT), np.zeros((6, 4))

    episodes = [run(learnt, 1_000_000 + trial) for trial in range(20)]

    assert np.mean([is_success for _, is_success in episodes]) > 0.9
    # Without, the arm stays where it is, and gets less.
    for seed in range(1_000_000, 1_000_005):
        reward, is_success = run(nothing, seed)
        assert not is_success
        assert reward < episodes[seed - 1_000_000][0]


@pytest.mark.slow
@pytest.mark.long
def test_a_linear_policy_learns_to_reach_the_sphere(run: Run) -> None:
    """The cross-entropy method finds the 24 numbers."""
    generator = np.random.default_rng(1)
    mean, spread = np.zeros((6, 4)), np.full((6, 4), 3.0)
    for round_ in range(6):
        tried = mean + spread * generator.normal(size=(20, 6, 4))
        seeds = [int(s) for s in generator.integers(1_000_000, size=3)]
        totals = [np.mean([run(each, s)[0] for s in seeds]) for each in tried]
        best = tried[np.argsort(totals)[-5:]]
        mean = 0.3 * mean + 0.7 * best.mean(axis=0) if round_ else best.mean(axis=0)
        spread = best.std(axis=0) + 0.5 * 0.8**round_

    successes = [run(mean, 1_000_000 + trial)[1] for trial in range(200)]

    assert np.mean(successes) > 0.9


@pytest.mark.slow
def test_nothing_of_it_is_imported_by_who_does_not_learn() -> None:
    code = "import arm_drake as ad, sys; ad.load_robot; ad.Simulation; "
    code += "assert 'gymnasium' not in sys.modules"

    subprocess.run([sys.executable, "-c", code], check=True)
