"""A Run gives what a program gives that loads, builds and simulates; bit by bit."""

import pickle
import re
from collections.abc import Iterator

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.batch.processes import close_server
from arm_drake.batch.runs import Runner
from arm_drake.errors import DescriptionError, InputError, MotionError
from arm_drake.simulation.motion_files import find_motion
from tests.batch import functions
from tests.batch.functions import final_position, simulate_an_arm

BACKENDS = ("serial", "threads", "processes", "auto")


@pytest.fixture(scope="module", autouse=True)
def no_server_stays() -> Iterator[None]:
    yield
    close_server()


def in_full(rollout: ad.Rollout) -> list[bytes]:
    """Return all numbers of a rollout."""
    references = [reference.position for reference in rollout.references.values()]
    arrays = (rollout.time, rollout.position, rollout.velocity, rollout.effort)
    return [array.tobytes() for array in (*arrays, *references)]


def simulate(run: ad.Run) -> ad.Rollout:
    """Return the rollout of a run, as a program makes it that knows no Run."""
    robot = ad.load_robot(run.robot, initial_positions=run.initial_positions)
    diagram = ad.build_diagram(robot, world=run.world, options=run.options)
    simulation = ad.Simulation(diagram)
    motion = run.motion and find_motion(run.motion, robot, run.parameters)
    simulation.run(run.duration or 0.0, motion)
    return simulation.rollout()


def mixed_runs() -> list[ad.Run]:
    """Return runs of which some share a simulation, if one worker gets them."""
    coarse = ad.SimulationOptions(time_step=0.005)
    arm = {"robot": "doosan_a0912", "motion": "tutorial", "options": coarse}
    hand = {"robot": "mycobot_280", "options": coarse, "duration": 0.2}
    start = {"joint2": 0.1}
    return [
        ad.Run(**arm, duration=0.4),
        ad.Run(**arm, duration=0.2),
        ad.Run(**arm, duration=0.2, initial_positions=start),
        ad.Run(**hand),
        ad.Run(**{**hand, "duration": 0.1}),
        ad.Run(**arm, duration=0.4),
    ]


@pytest.mark.slow
def test_each_backend_gives_the_bits_of_a_simple_program() -> None:
    runs = mixed_runs()
    expected = [in_full(simulate(run)) for run in runs]
    assert len({str(numbers) for numbers in expected}) == 5

    for backend in BACKENDS:
        results = ad.run_many(runs, backend=backend, workers=2)

        assert [in_full(value.rollout) for value in results.values] == expected, backend


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "world"),
    [("doosan_a0912", "house"), ("mycobot_280", "empty"), ("centauri", "empty")],
)
def test_a_simulation_that_is_used_again_gives_the_same_bits(robot, world) -> None:
    options = ad.SimulationOptions(time_step=0.005)
    runner = Runner()
    motion = "tutorial" if robot == "doosan_a0912" else None
    run = ad.Run(robot=robot, motion=motion, duration=0.3, options=options, world=world)

    first = runner(run)
    again = runner(run)
    assert runner._local.last is not None
    fresh = Runner()(run)

    assert in_full(again.rollout) == in_full(first.rollout) == in_full(fresh.rollout)


@pytest.mark.slow
def test_a_world_that_is_a_function_is_made_for_each_run() -> None:
    run = ad.Run(robot="lab5_arm", duration=0.02, world=functions.add_a_post)

    results = ad.run_many([run] * 2, keep=functions.has_second_post, backend="serial")

    assert results.values == [False, True]


@pytest.mark.slow
def test_what_keep_returns_is_of_its_own_run() -> None:
    runs = [ad.Run(robot="lab5_arm", duration=time) for time in (0.02, 0.03, 0.04)]

    for backend in ("serial", "threads"):
        results = ad.run_many(runs, keep=lambda s: s, backend=backend, workers=2)

        assert [simulation.time for simulation in results.values] == pytest.approx(
            [0.02, 0.03, 0.04], abs=1e-9
        )


@pytest.mark.slow
def test_what_keep_changes_is_of_its_own_run() -> None:
    run = ad.Run(robot="lab5_arm", duration=0.1)

    first, *others = ad.run_many(
        [run] * 3, keep=functions.turn_gravity_off, backend="serial"
    ).values

    assert first == -9.81
    assert others == [first] * 2


@pytest.mark.slow
def test_the_outcome_tells_of_goals_and_failures() -> None:
    options = ad.SimulationOptions(time_step=0.005)
    arm = {"robot": "doosan_a0912", "motion": "tutorial", "options": options}
    run, strict = ad.Run(**arm, name="as it is"), ad.Run(**arm, duration=1.0)

    done, short = ad.run_many([run, strict], workers=1)

    (goal,) = done.value.goals
    assert (goal.controller, goal.status) == (
        "joint_trajectory_controller",
        ad.GoalStatus.SUCCEEDED,
    )
    assert goal.result.error_code == 0
    assert goal.where.endswith("tutorial.yaml:6: [0].goal")
    assert done.value.failures == ()
    assert str(done.value.report) == "nothing to report"
    assert short.value.goals[0].status is ad.GoalStatus.EXECUTING
    assert done.input.name == "as it is"
    assert done.wall_time > 0.0


@pytest.mark.slow
def test_only_what_is_kept_comes_back() -> None:
    run = ad.Run(robot="lab5_arm", duration=0.1)

    results = ad.run_many([run, run], keep=final_position, backend="processes")

    first, second = results.values
    assert isinstance(first, np.ndarray)
    assert first.shape == second.shape == simulate(run).position[-1].shape
    # No rollout comes along: its rows would be ten times this.
    assert len(pickle.dumps(results)) < len(pickle.dumps(simulate(run)))


@pytest.mark.slow
def test_a_program_of_ones_own_runs_in_processes_as_here() -> None:
    speeds = [0.05, 0.1, 0.15]

    results = ad.run_many(speeds, simulate_an_arm, backend="processes", workers=2)

    for speed, position in zip(speeds, results.values, strict=True):
        np.testing.assert_array_equal(position, simulate_an_arm(speed))


@pytest.mark.slow
def test_a_loaded_robot_and_motion_and_several_robots_can_be_sent() -> None:
    one = ad.load_robot("lab5_arm", name="one")
    other = ad.load_robot("lab5_arm", name="other", pose=(0, 2, 0, 0, 0, 0))
    arm = ad.load_robot("doosan_a0912")
    runs = [
        ad.Run(robot=[one, other], duration=0.1),
        ad.Run(robot=arm, motion=find_motion("tutorial", arm), duration=0.3),
    ]

    both, moved = ad.run_many(runs, backend="processes").values

    assert list(both.rollouts) == ["one", "other"]
    assert in_full(both.rollout) == in_full(both.rollouts["one"])
    assert in_full(moved.rollout) == in_full(
        simulate(ad.Run(robot="doosan_a0912", motion="tutorial", duration=0.3))
    )


@pytest.mark.slow
def test_a_run_that_fails_has_its_error_and_the_others_go_on() -> None:
    good = ad.Run(robot="lab5_arm", duration=0.1)
    runs = [
        good,
        ad.Run(robot="no_robot"),
        ad.Run(robot="lab5_arm", motion="no_motion"),
        good,
    ]

    for backend in BACKENDS:
        results = ad.run_many(runs, backend=backend, workers=2)

        errors = [type(result.error) for result in results]
        assert errors == [type(None), DescriptionError, MotionError, type(None)]
        assert str(results[1].error).startswith("unknown robot 'no_robot'")
        assert results[2].error.problem.startswith("no motion 'no_motion'")
        assert [result.index for result in results.failed] == [1, 2]
        with pytest.raises(MotionError):
            _ = results[2].value


@pytest.mark.slow
def test_what_a_run_leaves_behind_comes_through_a_pickle() -> None:
    robot = ad.load_robot("doosan_a0912")
    simulation = ad.Simulation(ad.build_diagram(robot))
    simulation.run(4.5, find_motion("tutorial", robot))
    (goal,) = simulation.goals
    rollout, options = simulation.rollout(), ad.SimulationOptions(time_step=0.002)

    robot2, goal2, rollout2, options2 = pickle.loads(  # noqa: S301  Our own.
        pickle.dumps((robot, goal, rollout, options))
    )

    assert options2 == options
    assert in_full(rollout2) == in_full(rollout)
    assert (goal2.status, goal2.result) == (goal.status, goal.result)
    assert [f.error for f in goal2.feedback] == [f.error for f in goal.feedback]
    assert len(goal.feedback) > 0
    rebuilt = ad.Simulation(ad.build_diagram(robot2))
    rebuilt.run(4.5, find_motion("tutorial", robot2))
    assert in_full(rebuilt.rollout()) == in_full(rollout)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"robot": "lab5_arm", "parameters": {"a": 1}},
            "parameters are for a motion by name or file, which the run loads; give "
            "motion, too",
        ),
        (
            {"robot": "lab5_arm", "duration": -1.0},
            "duration must be at least 0 s, got -1.0",
        ),
        (
            {"robot": "lab5_arm", "options": 0.001},
            "options: expected SimulationOptions, got 0.001",
        ),
        ({"robot": None}, "robot: expected a name, a file, or loaded robots, got None"),
        (
            {"robot": ["lab5_arm", "lab5_arm"]},
            "robot: expected loaded robots in a list, as of load_robot, got 'lab5_arm'",
        ),
        (
            {"robot": "lab5_arm", "motion": 3},
            "motion: expected a name, a file, or a loaded motion, got 3",
        ),
        (
            {"robot": "lab5_arm", "motion": "control", "parameters": [1]},
            "parameters: expected values by name, got [1]",
        ),
        (
            {"robot": "lab5_arm", "duration": "3"},
            "duration: expected a number of seconds, got '3'",
        ),
        (
            {"robot": "lab5_arm", "duration": True},
            "duration: expected a number of seconds, got True",
        ),
        (
            {"robot": "lab5_arm", "xacro_args": 3},
            "xacro_args: expected values by name, got 3",
        ),
        (
            {"robot": "lab5_arm", "initial_positions": [1.0]},
            "initial_positions: expected positions by joint, got [1.0]",
        ),
        (
            {"robot": [], "xacro_args": {"a": "b"}},
            "xacro_args is for a robot that the run loads; this one is loaded already, "
            "give it to load_robot(..., xacro_args=...)",
        ),
    ],
)
def test_what_cannot_be_used_or_has_no_effect_is_refused(arguments, message) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        ad.Run(**arguments)
