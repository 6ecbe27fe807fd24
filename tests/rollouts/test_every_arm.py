"""Every robot of the index and of models/ holds, moves and carries, at any time step.

Joints that an effort limit, or the range, keeps from it are left out by what the
description says; the load report says the same.
"""

import dataclasses as dc
import math

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.description.entry import bundled_robots
from arm_drake.description.joints import JointInfo, last_master
from arm_drake.hardware.drives import commanded_joints
from tests.robots import load_real_robot, read_index, robot_names
from tests.servo_rig import Motion, Payload, ServoRig

# In front of the names of robots that come with the package; others are of the index.
BUNDLED = "bundled:"

# A step [rad] or [m], and the part of it that is "there".
STEP = {"prismatic": 1e-3}
STEP_OF_OTHERS = 1e-2
SETTLED = 0.02

# How long poses are held [s], and how many random goals are sent then, one a second, by
# step: at small ones the first of the same goals, for they take ten times as long.
FEW = 1.0, {1e-3: 2, 2e-3: 6, 5e-3: 15, 1e-2: 15}
MANY = 10.0, {1e-3: 20, 2e-3: 30, 5e-3: 60, 1e-2: 60}

# Payloads [kg] of arms, and where they are from the last axis [m].
PAYLOADS = {
    f"{BUNDLED}doosan_a0912": 2.0,
    "mycobot_280": 0.1,
    "so100_brukg": 0.1,
    "interbotix_wx250s": 0.1,
    "open_manipulator_x": 0.1,
}

# Some that are far more than the links of the wrist, which need rotors.
HEAVY_PAYLOADS = {"xarm6": 2.0, "kuka_kr6_agilus": 2.0, "dobot_cr5": 2.0}
OFFSET = 0.05

# At 10 rad/s the efforts of these can't stop what they move: it hits its stops, and
# what is light is thrown about. A speed limit holds a drive, not an impact.
FAST = {f"{BUNDLED}centauri"}

# A continuous joint, and one of several turns, is sent within one turn.
TURN = math.pi


@dc.dataclass(frozen=True)
class Arm:
    """A robot, and what it can be asked for."""

    robot: ad.Robot

    # Ranges of the n commanded joints [rad] or [m], and how fast they may be.
    lower: np.ndarray
    upper: np.ndarray
    speed: np.ndarray

    # Whether their effort limits bear their weight in all poses.
    is_strong: bool

    # Whether it can keep to its speed limits.
    can_brake: bool = True

    @property
    def steps(self) -> list[tuple[int, float]]:
        """Return the joints that have room for a step, and its size."""
        found = []
        for index, joint in enumerate(commanded_joints(self.robot.description)):
            size = STEP.get(joint.type, STEP_OF_OTHERS)
            if self.upper[index] - self.lower[index] > 4.0 * size:
                found.append((index, size))
        return found

    def inside(self, positions: np.ndarray, margin: float) -> np.ndarray:
        """Return the positions, a margin away from the ends of the ranges."""
        edge = np.minimum(margin, (self.upper - self.lower) / 2.0)
        return np.clip(positions, self.lower + edge, self.upper - edge)


def all_names() -> list[str]:
    """Return the robots but for those on wheels, each robot once."""
    names = dict.fromkeys(f"{BUNDLED}{name}" for name in bundled_robots())
    if robot_names() == ["none"]:
        return [*names, "none"]
    seen = set()
    for name, row in read_index().items():
        expected = row["expected"]
        types = [c["type"] for c in (expected.get("controllers") or {}).values()]
        has_wheels = any("Drive" in t or "Steering" in t for t in types)
        # Several packages of the index describe the same robot.
        same = (row["kind"], expected["robot_name"], tuple(expected["movable_joints"]))
        if not has_wheels and (row["kind"] != "demo" or same not in seen):
            names[name] = None
        seen.add(same)
    return list(names)


def find_range(robot: ad.Robot, joint: JointInfo) -> tuple[float, float]:
    """Return where a joint can go within its limits, and its mimic joints in theirs."""
    joints = {other.name: other for other in robot.description.movable_joints}
    low, high = limits_of(joint)
    for other in joints.values():
        if other.mimic is not None:
            master, factor, offset = last_master(other, joints)
            if master == joint.name and factor:
                ends = sorted((end - offset) / factor for end in limits_of(other))
                low, high = max(low, ends[0]), min(high, ends[1])
    return low, high


def limits_of(joint: JointInfo) -> tuple[float, float]:
    low, high = joint.limits.lower, joint.limits.upper
    if joint.type == "continuous" or low is None or high is None:
        return -TURN, TURN
    return low, high


@pytest.fixture(scope="module")
def arm(request: pytest.FixtureRequest) -> Arm:
    name = request.param
    if name.startswith(BUNDLED):
        robot = ad.load_robot(name.removeprefix(BUNDLED))
    else:
        robot = load_real_robot(name)
    lower, upper, speed = [], [], []
    for joint in commanded_joints(robot.description):
        low, high = find_range(robot, joint)
        middle, half = (low + high) / 2.0, min((high - low) / 2.0, TURN)
        lower.append(middle - half)
        upper.append(middle + half)
        limit = joint.limits.velocity
        speed.append(math.inf if limit is None else limit)
    is_strong = not any("gravity asks for" in entry.what for entry in robot.report)
    return Arm(
        robot,
        np.array(lower),
        np.array(upper),
        np.array(speed),
        is_strong,
        name not in FAST,
    )


def check_limits(arm: Arm, motion: Motion) -> None:
    """Check that a motion keeps within the limits of the description."""
    for values in motion:
        assert np.isfinite(values).all()
    joints = commanded_joints(arm.robot.description)
    for index, joint in enumerate(joints):
        limits = joint.limits
        effort = math.inf if limits.effort is None else limits.effort
        assert (np.abs(motion.effort[:, index]) <= effort).all(), joint.name
        if joint.type == "continuous":
            continue
        position = motion.position[:, index]
        # Drake's limits give way a little under load.
        slack = 1e-3
        assert limits.lower is None or position.min() >= limits.lower - slack
        assert limits.upper is None or position.max() <= limits.upper + slack
    if arm.is_strong and arm.can_brake:
        assert (np.abs(motion.velocity) <= SPEEDING * arm.speed).all()


# Mimic joints are held by compliant constraints, whose masters can speed a little.
SPEEDING = 1.02


# The preset "fast" is for steps as large as the controllers' period. What holds at both
# ends holds in between, which `make bench` shows.
PRESETS = [
    ("accurate", 1e-3),
    pytest.param("accurate", 2e-3, marks=pytest.mark.long),
    pytest.param("accurate", 5e-3, marks=pytest.mark.long),
    ("accurate", 1e-2),
    pytest.param("fast", 2e-3, marks=pytest.mark.long),
    ("fast", 1e-2),
]


def needs_more(arm: Arm, preset: str) -> bool:
    """Return whether the preset refuses a robot: weak, mimic or undriven joints."""
    joints = arm.robot.description.movable_joints
    return preset == "fast" and (
        not arm.is_strong
        or len(joints) != len(arm.lower)
        or any(joint.mimic for joint in joints)
    )


@pytest.mark.parametrize(
    ("hold", "goals"), [FEW, pytest.param(*MANY, marks=pytest.mark.long)]
)
@pytest.mark.parametrize(("preset", "h"), PRESETS)
@pytest.mark.parametrize("arm", all_names(), indirect=True)
def test_it_holds_and_goes_wherever_it_is_sent(
    arm: Arm, preset: str, h: float, hold: float, goals: dict[float, int]
) -> None:
    if not len(arm.lower) or needs_more(arm, preset):
        return  # A suction cup has no joints.
    rig = ServoRig(arm.robot, step=h, preset=preset)
    held = rig.run(hold)
    if arm.is_strong:
        # A creep of 0.1 mrad a second would be seen.
        np.testing.assert_allclose(held.position - rig.start, 0.0, atol=1e-4 * hold)
    random, goal = np.random.default_rng(5), rig.start
    for _ in range(goals[h]):
        goal = random.uniform(arm.lower, arm.upper)
        rig.command(goal)
        check_limits(arm, rig.run(1.0))
    if arm.is_strong:
        final = rig.run(2.0 if arm.can_brake else 4.0).position[-1]
        np.testing.assert_allclose(final - goal, 0.0, atol=1e-3)


@pytest.mark.parametrize(
    ("preset", "h", "friction"),
    [
        ("accurate", 1e-3, True),
        ("accurate", 1e-2, True),
        ("accurate", 1e-2, False),
        ("fast", 1e-2, True),
        ("fast", 1e-2, False),
        *(
            pytest.param(preset, h, friction, marks=pytest.mark.long)
            for preset, h, friction in (
                ("accurate", 1e-3, False),
                ("accurate", 2e-3, True),
                ("accurate", 2e-3, False),
                ("accurate", 5e-3, True),
                ("accurate", 5e-3, False),
                ("fast", 2e-3, True),
                ("fast", 2e-3, False),
            )
        ),
    ],
)
@pytest.mark.parametrize("arm", all_names(), indirect=True)
def test_a_small_step_settles_and_moves_no_other_joint(
    arm: Arm, preset: str, h: float, friction: bool
) -> None:
    if not arm.steps or needs_more(arm, preset):
        return  # A suction cup has no joints.
    if not arm.is_strong:
        return  # Said in the report; its efforts are saturated.
    if not friction and not any(
        joint.friction for joint in arm.robot.description.movable_joints
    ):
        return  # The same as with it.
    names = [joint.name for joint in commanded_joints(arm.robot.description)]
    initial = np.array([arm.robot.initial_positions[name] for name in names])
    start = arm.inside(initial, 2.0 * STEP_OF_OTHERS)
    rig = ServoRig(
        arm.robot,
        step=h,
        preset=preset,
        friction=friction,
        initial=dict(zip(names, start, strict=True)),
    )
    for index, size in arm.steps:
        rig.reset()
        goal = start.copy()
        goal[index] += size
        rig.command(goal)

        motion = rig.run(0.6)

        error = (goal - motion.position) / size
        is_outside = np.abs(error[:, index]) > SETTLED
        settled = motion.time[is_outside][-1] + h
        assert settled < 0.2, names[index]
        # Grippers' mimic joints are compliant; the arms are not.
        assert error[:, index].min() > (-1e-2 if len(start) == 1 else -1e-3)
        others = np.delete(error, index, axis=1)
        assert np.abs(others).max(initial=0.0) < 1e-2, names[index]
        late = error[motion.time - motion.time[0] > 0.45, index]
        assert np.ptp(late) < 1e-3
        assert abs(late[-1]) * size < 1e-6


def last_link(arm: Arm) -> str:
    """Return the link behind the last joint of the arm, not of its gripper."""
    mimicked = {
        joint.mimic.joint
        for joint in arm.robot.description.movable_joints
        if joint.mimic is not None
    }
    joints = [
        joint
        for joint in commanded_joints(arm.robot.description)
        if joint.type != "prismatic"
        and joint.name not in mimicked
        and "gripper" not in joint.name.lower()
    ]
    return joints[-1].child


def of_robots(payloads: dict[str, float]) -> list[tuple[str, float]]:
    return [(name, mass) for name, mass in payloads.items() if name in all_names()]


# How many goals a payload is carried to, by step.
CARRIED = [
    (1e-3, 2),
    (1e-2, 5),
    *(pytest.param(h, 5, marks=pytest.mark.long) for h in (1e-3, 2e-3, 5e-3)),
]
CARRIED_BY_WRISTS = [
    (1e-3, 2),
    (5e-3, 5),
    *(pytest.param(h, 5, marks=pytest.mark.long) for h in (1e-3, 2e-3)),
]


@pytest.mark.parametrize(("h", "goals"), CARRIED)
@pytest.mark.parametrize(("arm", "mass"), of_robots(PAYLOADS), indirect=["arm"])
def test_an_unknown_payload_is_carried(
    arm: Arm, mass: float, h: float, goals: int
) -> None:
    carry(arm, mass, h, goals)


@pytest.mark.parametrize(("h", "goals"), CARRIED_BY_WRISTS)
@pytest.mark.parametrize(("arm", "mass"), of_robots(HEAVY_PAYLOADS), indirect=["arm"])
def test_light_wrists_carry_heavy_payloads_with_rotors(
    arm: Arm, mass: float, h: float, goals: int
) -> None:
    carry(arm, mass, h, goals, reflected_inertia=True)


def carry(arm: Arm, mass: float, h: float, goals: int, **options: object) -> None:
    """Check that a payload that the servo knows nothing of is held and moved."""
    payload = Payload(last_link(arm), mass, (OFFSET, 0.0, OFFSET))
    rig = ServoRig(arm.robot, step=h, payload=payload, **options)
    # It falls into the servo, and is at rest where it should be soon after.
    motion = rig.run(2.0)
    np.testing.assert_allclose(motion.position[-1] - rig.start, 0.0, atol=2e-3)
    random, middle = np.random.default_rng(3), (arm.lower + arm.upper) / 2.0
    for _ in range(goals):
        goal = middle + (random.uniform(arm.lower, arm.upper) - middle) / 2.0
        rig.command(goal)
        final = rig.run(2.0).position[-1]
        np.testing.assert_allclose(final - goal, 0.0, atol=2e-3)
