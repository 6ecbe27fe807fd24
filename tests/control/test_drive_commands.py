"""Commands for the servo, from the values of command interfaces."""

from typing import Any

import numpy as np
import pytest

from arm_drake.control.drive_commands import NUM_PARTS, DriveCommands, DriveMode

JOINTS = ("a", "b")
KINDS = ("position", "velocity", "acceleration", "effort")
ORDER = tuple(f"{joint}/{kind}" for joint in JOINTS for kind in KINDS)
RATE = 100.0
LEAD = 0.05


def make_drive(**changes: Any) -> DriveCommands:
    return DriveCommands(JOINTS, ORDER, **{"velocity_lead": LEAD, **changes})


def mode_of(*claims: str, drive: DriveCommands | None = None) -> DriveMode:
    return (drive or make_drive()).mode(dict.fromkeys(claims, RATE))


def values_of(**values: float) -> np.ndarray:
    """Return values of the interfaces, such as a_velocity=0.5; the others are 0."""
    found = np.zeros(len(ORDER))
    for name, value in values.items():
        found[ORDER.index(name.replace("_", "/"))] = value
    return found


def parts(drive: np.ndarray) -> list[list[float]]:
    """Return the parts that the servo is told, each a list of a number per joint."""
    return make_drive().servo_input(drive).reshape(-1, len(JOINTS)).tolist()


def moving(drive: np.ndarray, *rates: float) -> np.ndarray:
    """Return a drive vector after a cycle in which positions changed at these rates."""
    return np.concatenate([drive[: -len(JOINTS)], rates])


def test_at_first_positions_are_held():
    assert parts(make_drive().initial([0.3, -0.4])) == [[0.3, -0.4]] + [[0.0, 0.0]] * 6


@pytest.mark.parametrize("claims", [("a/position", "b/position"), ("b/position",)])
@pytest.mark.parametrize("has_modes", [False, True])
def test_plain_numbers_and_numpy_give_the_same_bits(
    has_modes: bool, claims: tuple[str, ...]
) -> None:
    stops = np.array([-0.5, 0.0]), np.array([-0.0, 0.25])
    drive = make_drive(has_modes=has_modes, stops=stops)
    mode = mode_of(*claims, drive=drive)
    numbers = [0.0, -0.0, 0.1, -0.2, 0.5, 7.0, -7.0, 1e308, np.inf, -np.inf, np.nan]
    choose, nobody = np.random.default_rng(1).choice, np.zeros(len(JOINTS), dtype=bool)
    n, size = len(JOINTS), len(make_drive(has_modes=has_modes).initial([0.0, 0.0]))

    for _ in range(200):
        rows, last = choose(numbers, (5, len(ORDER))), choose(numbers, size)
        ahead = drive.go_on_for(mode, rows, last[:n].tolist(), last[-n:].tolist())
        for values, told in zip(rows, np.concatenate(ahead, axis=1), strict=True):
            with np.errstate(all="ignore"):
                in_numpy = drive.write(mode, values, last, skipped=nobody)
            last = drive.write(mode, values, last)
            for other in (in_numpy, told):
                np.testing.assert_array_equal(other, last)
                is_number = ~np.isnan(last)
                signs = np.signbit(other), np.signbit(last)
                assert (signs[0] == signs[1])[is_number].all()


def test_without_modes_there_are_positions_and_velocities_alone():
    drive = make_drive(has_modes=False)
    mode = mode_of("a/position", "b/position", drive=drive)

    start = drive.initial([0.0, 0.0])
    values = values_of(a_position=0.1, b_position=-0.2)
    servo_input = drive.write(mode, values, moving(start, 10.0, -20.0))

    assert start.shape == (3 * len(JOINTS),)
    start, servo_input = (
        drive.servo_input(vector).reshape(-1, 2) for vector in (start, servo_input)
    )
    assert start.tolist() == [[0.0, 0.0]] * 2
    np.testing.assert_allclose(servo_input, [[0.1, -0.2], [10.0, -20.0]], rtol=1e-12)


@pytest.mark.parametrize(
    ("claims", "expected"),
    [
        ((), None),
        (("position",), "position"),
        (("velocity",), "velocity"),
        (("acceleration",), "acceleration"),
        (("effort",), "effort"),
        (("effort", "acceleration"), "acceleration"),
        (("effort", "velocity"), "velocity"),
        (("acceleration", "velocity"), "velocity"),
        (KINDS, "position"),
    ],
)
def test_of_the_claims_of_a_joint_one_is_followed(claims, expected):
    mode = mode_of(*(f"b/{kind}" for kind in claims))

    for kind in KINDS:
        followed = getattr(mode, f"is_{kind}").tolist()
        assert followed == [False, kind == expected], kind


@pytest.mark.parametrize(
    ("claims", "is_guided"),
    [
        (("a/position", "b/position"), [False, False]),
        (("a/position",), [False, False]),
        (("a/position", "b/position", "b/velocity"), [False, True]),
        (("a/position", "b/velocity"), [False, False]),
    ],
)
def test_a_position_may_come_with_its_velocity(claims, is_guided):
    mode = mode_of(*claims)

    assert mode.is_guided.tolist() == is_guided


def test_a_joint_has_the_rate_of_the_controller_that_commands_it():
    mode = make_drive().mode({"b/position": 25.0, "chain/a/position": 50.0})

    assert mode.rate.tolist() == [0.0, 25.0]


def test_each_joint_is_told_what_it_follows():
    drive = make_drive()
    values = values_of(a_velocity=0.7, a_position=9.0, b_effort=-3.0, b_velocity=9.0)
    mode = mode_of("a/velocity", "b/effort")

    servo_input = drive.write(mode, values, drive.initial([0.1, 0.2]))

    assert parts(servo_input) == [
        [0.1, 0.2],
        [0.7, 0.0],
        [0.0, 0.0],
        [0.0, -3.0],
        [1.0, 0.0],
        [0.0, 0.0],
        [0.0, 1.0],
    ]


def test_an_acceleration_is_told_as_one():
    drive = make_drive()
    values = values_of(a_acceleration=2.5, b_effort=9.0)

    servo_input = drive.write(
        mode_of("a/acceleration"), values, drive.initial([0.1, 0.2])
    )

    nothing = [0.0, 0.0]
    expected = [[0.1, 0.2], nothing, [2.5, 0.0], nothing, nothing, [1.0, 0.0], nothing]
    assert parts(servo_input) == expected


def test_what_is_claimed_beside_a_position_is_reported_too():
    drive = make_drive()
    values = values_of(a_position=0.1, a_acceleration=2.5, b_position=0.2, b_effort=3.0)
    mode = mode_of("a/position", "a/acceleration", "b/position", "b/effort")

    servo_input = parts(drive.write(mode, values, drive.initial([0.1, 0.2])))

    assert servo_input[2:4] == [[2.5, 0.0], [0.0, 3.0]]
    # Both follow their positions.
    assert servo_input[4:] == [[0.0, 0.0]] * 3


@pytest.mark.parametrize("kind", ["acceleration", "effort"])
def test_what_comes_with_a_position_starts_from_zero(kind):
    values, _ = seed(mode_of("a/effort"), mode_of("a/position", f"a/{kind}"))

    assert values[f"a/{kind}"] == 0.0


def test_a_joint_that_nobody_commands_may_be_left_to_swing():
    drive = make_drive(holds=False)
    values = values_of(a_position=0.1, b_effort=9.0)

    servo_input = parts(
        drive.write(mode_of("a/position", drive=drive), values, drive.initial([0, 0.2]))
    )

    # It follows an effort of none.
    assert servo_input[3] == [0.0, 0.0]
    assert servo_input[6] == [0.0, 1.0]


def test_a_joint_that_swung_holds_where_it_comes_to_rest():
    drive = make_drive(holds=False)

    values, servo_input = drive.seed(
        mode_of(drive=drive),
        mode_of("a/position", drive=drive),
        np.full(len(ORDER), 99.0),
        drive.initial([0.1, 0.2]),
        MEASURED,
    )

    assert values[ORDER.index("a/position")] == pytest.approx(REST[0], rel=1e-15)
    assert servo_input[:2].tolist() == [pytest.approx(REST[0], rel=1e-15), 0.2]


def test_a_joint_that_nobody_commands_holds():
    drive = make_drive()
    values = values_of(a_position=0.5, b_position=9.0, b_velocity=9.0, b_effort=9.0)
    last = drive.write(mode_of(), values, drive.initial([0.1, 0.2]))

    servo_input = drive.write(mode_of("a/position"), values, moving(last, 40.0, 0.0))

    assert parts(last) == [[0.1, 0.2]] + [[0.0, 0.0]] * 6
    np.testing.assert_allclose(
        parts(servo_input)[:2], [[0.5, 0.2], [40.0, 0.0]], rtol=1e-12
    )
    assert parts(servo_input)[2:] == [[0.0, 0.0]] * 5


def test_a_velocity_that_is_commanded_counts_instead_of_the_rate_of_positions():
    drive = make_drive()
    values = values_of(a_position=0.5, a_velocity=0.25, b_position=0.2)
    mode = mode_of("a/position", "a/velocity", "b/position")

    last = moving(drive.initial([0.0, 0.0]), 0.0, 20.0)
    servo_input = parts(drive.write(mode, values, last))

    assert servo_input[0] == [0.5, 0.2]
    np.testing.assert_allclose(servo_input[1], [0.25, 20.0], rtol=1e-12)
    # It follows the position: no part says otherwise.
    assert servo_input[2:] == [[0.0, 0.0]] * 5


@pytest.mark.parametrize("extra", [(), ("b/velocity",)])
def test_the_rate_of_positions_is_that_of_the_controller(extra):
    drive = make_drive()
    mode = drive.mode(
        {"a/position": 25.0, "b/position": 50.0} | dict.fromkeys(extra, 50.0)
    )

    servo_input = drive.write(
        mode,
        values_of(a_position=0.01, b_position=0.02),
        moving(drive.initial([0.0, 0.01]), 0.25, 0.5),
    )

    assert parts(servo_input)[1][0] == pytest.approx(0.25, rel=1e-12)
    if not extra:
        assert parts(servo_input)[1][1] == pytest.approx(0.5, rel=1e-12)


def test_the_first_position_of_a_controller_has_no_speed():
    drive = make_drive()
    mode = mode_of("a/position", "b/position")

    servo_input = drive.write(
        mode,
        values_of(a_position=0.5, b_position=0.5),
        moving(drive.initial([0.0, 0.0]), 50.0, 50.0),
        fresh=np.array([True, False]),
    )

    assert parts(servo_input)[:2] == [[0.5, 0.5], [0.0, 50.0]]


def test_a_step_has_no_speed():
    drive, mode = make_drive(), mode_of("a/position", "b/position")
    last = drive.initial([0.0, 0.0])

    speeds = []
    for position in (0.01, 0.01, 0.01):
        values = values_of(a_position=position, b_position=-position)
        last = drive.write(mode, values, last)
        speeds.append(parts(last)[1])

    assert speeds == [[0.0, 0.0]] * 3


def test_a_motion_has_its_speed_from_the_second_cycle_on():
    drive, mode = make_drive(), mode_of("a/position", "b/position")
    last = drive.initial([0.0, 0.0])

    speeds = []
    for k in (1, 2, 3, 4):
        # A ramp, and a motion that starts with a constant acceleration.
        values = values_of(a_position=0.01 * k, b_position=-0.01 * k**2)
        last = drive.write(mode, values, last)
        speeds.append(parts(last)[1])

    assert speeds[0] == [0.0, 0.0]
    expected = [[1.0, -3.0], [1.0, -5.0], [1.0, -7.0]]
    np.testing.assert_allclose(speeds[1:], expected, rtol=1e-9)


def test_what_speeds_up_like_a_step_is_not_believed():
    drive, mode = make_drive(), mode_of("a/position", "b/position")
    last = moving(drive.initial([0.0, 0.0]), 0.1, -0.1)

    servo_input = drive.write(mode, values_of(a_position=0.5, b_position=0.5), last)

    # Three times as fast as before at most, and never the other way at once.
    np.testing.assert_allclose(parts(servo_input)[1], [0.3, 0.0], rtol=1e-12)


def test_between_ticks_of_its_controller_a_joint_keeps_its_speed():
    drive = make_drive()
    mode = mode_of("a/position", "b/position")
    last = drive.initial([0.5, 0.5])
    last[2:4] = 0.3

    servo_input = drive.write(
        mode,
        values_of(a_position=0.5, b_position=0.5),
        last,
        skipped=np.array([True, False]),
    )

    assert parts(servo_input)[:2] == [[0.5, 0.5], [0.3, 0.0]]


def test_writing_leaves_its_arguments_alone():
    drive = make_drive()
    values, last = values_of(a_position=0.5, b_effort=2.0), drive.initial([0.1, 0.2])
    before = values.copy(), last.copy()

    drive.write(mode_of("a/position", "b/effort"), values, last)
    drive.seed(
        mode_of("a/position", "b/effort"),
        mode_of("a/velocity", "b/position"),
        values,
        last,
        MEASURED,
    )

    np.testing.assert_array_equal(values, before[0])
    np.testing.assert_array_equal(last, before[1])


# Positions, velocities and efforts of a and b.
MEASURED = (np.array([1.0, 2.0]), np.array([0.4, -0.6]), np.array([5.0, -7.0]))
# Where they come to rest: lead times velocity further on.
REST = [1.0 + LEAD * 0.4, 2.0 - LEAD * 0.6]

# What each kind of command starts with on joint a.
SEEDS = {"position": REST[0], "velocity": 0.4, "acceleration": 0.0, "effort": 5.0}


def seed(
    old: DriveMode, new: DriveMode, values: np.ndarray | None = None
) -> tuple[dict[str, float], list[list[float]]]:
    """Return the values by name and the drive vector after a switch."""
    drive = make_drive()
    found, servo_input = drive.seed(
        old,
        new,
        np.full(len(ORDER), 99.0) if values is None else values,
        drive.initial([0.1, 0.2]),
        MEASURED,
    )
    return dict(zip(ORDER, found.tolist(), strict=True)), parts(servo_input)


@pytest.mark.parametrize("old", ["velocity", "acceleration", "effort"])
@pytest.mark.parametrize("new", KINDS)
def test_a_new_kind_of_command_starts_with_what_the_joint_does(old, new):
    values, servo_input = seed(mode_of(f"a/{old}"), mode_of(f"a/{new}"))

    assert servo_input[0] == [REST[0] if new == "position" else 0.1, 0.2]
    # Those that aren't followed stay as they are, and so does what goes on.
    expected = dict.fromkeys(ORDER, 99.0)
    if new != old:
        expected[f"a/{new}"] = SEEDS[new]
    assert values == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize("new", ["velocity", "acceleration", "effort"])
@pytest.mark.parametrize("old", [(), ("a/position",)])
def test_a_joint_that_is_held_starts_with_what_it_does(old, new):
    values, servo_input = seed(mode_of(*old), mode_of(f"a/{new}"))

    assert values == dict.fromkeys(ORDER, 99.0) | {f"a/{new}": SEEDS[new]}
    assert servo_input[0] == [0.1, 0.2]


@pytest.mark.parametrize("old", ["velocity", "acceleration", "effort"])
def test_a_joint_that_is_let_go_comes_to_rest(old):
    values, servo_input = seed(mode_of(f"a/{old}"), mode_of())

    assert servo_input == [[REST[0], 0.2]] + [[0.0, 0.0]] * (NUM_PARTS - 1)
    assert values == dict.fromkeys(ORDER, 99.0)


def test_a_position_that_is_taken_over_goes_on():
    values, servo_input = seed(mode_of("a/position"), mode_of("a/position"))

    assert values == dict.fromkeys(ORDER, 99.0)
    assert servo_input[0] == [0.1, 0.2]


def test_a_joint_that_was_let_go_is_commanded_where_it_is_held():
    # It was driven away from where it was commanded last, and stopped then.
    values, servo_input = seed(mode_of(), mode_of("a/position"))

    assert values == dict.fromkeys(ORDER, 99.0) | {"a/position": 0.1}
    assert servo_input[0] == [0.1, 0.2]


@pytest.mark.parametrize("old", [(), ("a/velocity",), ("a/effort",), ("a/position",)])
def test_a_velocity_that_comes_with_a_position_starts_from_zero(old):
    values, _ = seed(mode_of(*old), mode_of("a/position", "a/velocity"))

    assert values["a/velocity"] == 0.0


def test_a_velocity_that_goes_on_with_a_position_stays():
    guided = mode_of("a/position", "a/velocity")

    values, _ = seed(guided, guided)

    assert values == dict.fromkeys(ORDER, 99.0)


def test_a_velocity_that_came_with_a_position_becomes_the_measured_one():
    values, _ = seed(mode_of("a/position", "a/velocity"), mode_of("a/velocity"))

    assert values == dict.fromkeys(ORDER, 99.0) | {"a/velocity": 0.4}


def test_joints_that_go_on_are_left_alone():
    old = mode_of("a/velocity", "b/effort")

    values, servo_input = seed(old, mode_of("a/position", "b/effort"))

    assert values["b/effort"] == 99.0
    assert servo_input[0] == [pytest.approx(REST[0]), 0.2]


def test_each_joint_starts_with_its_own():
    old = mode_of("a/velocity", "b/velocity")

    values, _ = seed(old, mode_of("a/position", "b/position"))

    found = [values["a/position"], values["b/position"]]
    assert found == pytest.approx(REST, rel=1e-15)
