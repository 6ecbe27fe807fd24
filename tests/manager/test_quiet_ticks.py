"""A quiet cycle, in which nothing comes, leaves what any other way would, bit by bit.

Both ways are functions of one Context, so every cycle that is taken quietly is computed
in full, too, and compared. How many were quiet is counted.
"""

from collections import defaultdict
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator

import arm_drake as ad
from arm_drake import interfaces
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.joint_trajectory.controller import JointTrajectoryController
from arm_drake.description.entry import configs_folder
from arm_drake.manager.controller_manager import SWITCH_PORT
from arm_drake.messages import (
    Float64MultiArray,
    GripperCommandGoal,
    JointTrajectory,
    JointTrajectoryPoint,
    SetOdometry,
    SwitchController,
    TwistStamped,
)
from arm_drake.messages.control import GripperCommand
from tests import carts, models
from tests.conformance.jtc_players import NAME, Dict, Player, flatten, load
from tests.conformance.open_loop import OpenLoop, is_started
from tests.conformance.test_oracle_gripper import Client
from tests.conformance.test_oracle_jtc_scenarios import INPUTS, OUTPUTS, REPLAYED
from tests.manager.both_ways import Count, Managed, compare
from tests.oracle import oracle_cases
from tests.robots import skip_or_fail

JOINTS = tuple(f"joint{i}" for i in range(1, 7))
PERIOD = 0.01

# What `make bench` alone runs.
BENCH = [pytest.mark.slow, pytest.mark.long]


@pytest.fixture
def count(monkeypatch: pytest.MonkeyPatch) -> Count:
    """Compare both ways in each cycle."""
    counted = Count()
    compare(counted, monkeypatch)
    return counted


class ManagedPlayer(Player):
    """Replays a scenario with a controller and its manager.

    Times are those of the manager's clock.
    """

    def __init__(self, distro: str, inputs: Dict, output: Dict) -> None:
        super().__init__(distro, inputs, output)
        rate = inputs["update_rate"]
        self.period = 1.0 / rate
        basic = interfaces.interface_names(
            self.joint_types, interfaces.STATE_INTERFACES
        )
        others = [n for n in output["state_interfaces"] if n not in basic]
        params = ControllerInterfaceParams(
            controller_name=NAME,
            update_rate=rate,
            period=self.period,
            joint_types=self.joint_types,
            command_interfaces=frozenset(self.claimed),
            state_interfaces=frozenset(output["state_interfaces"]),
            measured=(*basic, *others),
            distro=distro,
            velocity_limits=self.velocity_limits,
            is_managed=True,
        )
        self.system = JointTrajectoryController(load(self.flat, distro), params)
        status = "active" if self.is_active else "inactive"
        self.managed = Managed(self.system, tuple(self.claimed), status)
        self.fix = self.managed.fix

    def run(self, k: int, time_ns: int, events: list[Dict]) -> None:
        inputs: defaultdict[str, list[Any]] = defaultdict(list)
        for event in events:
            names = (NAME,)
            if event["type"] == "activate":
                inputs["switch"].append(SwitchController(names, ()))
            elif event["type"] == "deactivate":
                inputs["switch"].append(SwitchController((), names))
            elif event["type"] == "set_params":
                self.flat.update(flatten(event["params"]))
                parameters = load(self.flat, self.distro)
                self.fix(self.system, "parameters", AbstractValue.Make(parameters))
            else:
                message = self.message_of(event)
                if message is not None:
                    inputs[message[0]].append(message[1])
        for field, system, port in (
            ("switch", self.managed.manager, SWITCH_PORT),
            ("topics", self.system, "joint_trajectory"),
            ("requests", self.system, "follow_joint_trajectory"),
            ("scaling_factors", self.system, "speed_scaling_input"),
        ):
            if field in inputs:
                self.fix(system, port, AbstractValue.Make(tuple(inputs[field])))
        state, order = self.measured(k), self.system.params.measured
        self.managed.measure([state.get(name, 0.0) for name in order])
        self.managed.simulator.AdvanceTo((k + 0.5) * self.period)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("distro", "part"),
    [
        # Each scenario in one of the distributions; `make bench` has them in both.
        ("jazzy", slice(0, None, 2)),
        ("rolling", slice(1, None, 2)),
        *(
            pytest.param(distro, slice(None), marks=pytest.mark.long)
            for distro in ("jazzy", "rolling")
        ),
    ],
)
def test_scenarios_of_upstream_are_the_same_both_ways(
    count: Count, distro: str, part: slice
) -> None:
    names = [name for d, name in REPLAYED if d == distro][part]
    if not names:
        skip_or_fail("the files of the scenarios aren't there")
    for name in names:
        ManagedPlayer(distro, INPUTS[name], OUTPUTS[distro, name]).play()

    assert count.steady_share > 0.6, count


class ManagedLoop(OpenLoop):
    """Replays a case with a controller and its manager, whose clock it has."""

    is_managed = True

    def start(self) -> None:
        claims = tuple(self.expected["command_interfaces"])
        self.managed = Managed(self.system, claims, "active")
        self.context = self.managed.context

    def play(self) -> None:
        period, name = self.system.params.period, (self.name,)
        rows = self.expected.get("state", [])
        for cycle in range(len(self.expected["t_ns"])):
            self._sent, requests = {}, []
            self.time_ns = round(1e9 * cycle * period)
            for event in self.case_input.get("events", ()):
                if event["cycle"] != cycle:
                    continue
                if event["type"] == "activate":
                    requests.append(SwitchController(name, ()))
                elif event["type"] == "deactivate":
                    requests.append(SwitchController((), name))
                else:
                    self._do(event)
            if requests:
                value = AbstractValue.Make(tuple(requests))
                self.managed.fix(self.managed.manager, SWITCH_PORT, value)
            for port, messages in self._sent.items():
                self.managed.fix(self.system, port, AbstractValue.Make(messages))
            measured = np.zeros(len(self.system.params.measured))
            if rows:
                measured[self._find_measured()] = np.array(rows[cycle], dtype=float)
            self.managed.measure(measured.tolist())
            self.managed.simulator.AdvanceTo((cycle + 0.5) * period)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "distro", "share"),
    [
        ("controller_diff_drive", "rolling", 0.9),
        ("controller_pid_controller", "rolling", 0.95),
        ("controller_forward_command", "rolling", 0.8),
        ("controller_gripper", "rolling", 0.7),
        pytest.param(
            "controller_gripper_action_jazzy_4.42.1", "jazzy", 0.65, marks=BENCH
        ),
    ],
)
def test_cases_of_upstream_are_the_same_both_ways(
    count: Count, kind: str, distro: str, share: float
) -> None:
    for case in oracle_cases(kind):
        inputs, output, client = case["input"], case["output"], Client()
        handlers = {"goal": client.send, "cancel": client.cancel}
        if is_started(output) and not inputs.get("chained"):
            ManagedLoop(inputs, output, distro=distro, handlers=handlers).play()

    assert count.steady_share > share, count


def simulate() -> ad.Simulation:
    robot = ad.load_robot("doosan_a0912")
    options = ad.SimulationOptions(preset="fast", time_step=PERIOD)
    return ad.Simulation(ad.build_diagram(robot, options=options))


def motion(*positions: float) -> JointTrajectory:
    points = [
        JointTrajectoryPoint(6 * [q], 6 * [0.0], time_from_start=0.3 * (1 + k))
        for k, q in enumerate(positions)
    ]
    return JointTrajectory(joint_names=JOINTS, points=points)


@pytest.mark.slow
def test_an_arm_that_holds_and_moves_ticks_quietly_and_is_heard(count: Count) -> None:
    sim = simulate()
    arm = sim.controller("joint_trajectory_controller")
    sim.run(0.2)
    goal = arm.send_goal(motion(0.1, 0.2))
    sim.run(0.35)
    num_full = count.num_full
    # Comes to a tick that would have been quiet.
    arm.send_trajectory(motion(0.3))
    sim.run(0.5)

    assert goal.status.is_terminal
    assert len(goal.feedback) > 5
    assert count.steady_share > 0.85, count
    assert count.num_full == num_full + 1
    assert count.share > 0.9
    np.testing.assert_allclose(sim.joint_states().position[:6], 0.3, atol=1e-3)


@pytest.mark.slow
def test_cycles_of_a_trajectory_are_known_ahead(count: Count) -> None:
    sim = simulate()
    arm = sim.controller("joint_trajectory_controller")
    goal = arm.send_goal(motion(0.1, 0.2, 0.1))
    sim.run(0.9)
    sim.run(0.6)

    assert goal.status.is_terminal
    # Each fifth one tells feedback.
    assert count.num_ahead > 0.6 * count.total, count


@pytest.mark.slow
def test_what_is_known_ahead_ends_where_numbers_are_others(count: Count) -> None:
    sim = simulate()
    sim.controller("joint_trajectory_controller").send_trajectory(motion(0.1, 0.2))
    sim.advance_to(0.255)
    assert count.num_ahead > 5
    # Somebody moves the last position: the next velocity is of the step from there.
    manager = sim.diagram.GetSubsystemByName("controller_manager")
    context = manager.GetMyMutableContextFromRoot(sim.simulator.get_mutable_context())
    numbers = context.get_mutable_discrete_state().get_mutable_value(0)
    before = count.num_ahead
    numbers[manager.numbers.servo.start] -= 1e-4
    sim.advance_to(0.265)

    assert count.num_ahead == before
    sim.advance_to(0.405)
    assert count.num_ahead > before


@pytest.mark.slow
def test_feedback_is_the_same_right_after_a_message(count: Count) -> None:
    sim = simulate()
    arm = sim.controller("joint_trajectory_controller")
    sim.run(0.2)
    goal = arm.send_goal(motion(0.1, 0.2))
    sim.run(0.02)
    for _ in range(10):
        # To a tick; the next one, in which feedback may be due, is none in full.
        arm.set_speed_scaling(1.0)
        sim.run(0.02)

    assert len(goal.feedback) == 4
    # The first cycle, that of the goal, and those of the messages.
    assert count.num_full == 2 + 10, count


@pytest.mark.slow
def test_a_context_goes_on_from_the_middle_of_quiet_ticks(count: Count) -> None:
    sim = simulate()
    sim.controller("joint_trajectory_controller").send_goal(motion(0.1, 0.2))
    sim.advance_to(0.253)
    saved, num_full = sim.simulator.get_context().Clone(), count.num_full
    sim.advance_to(0.953)
    expected = read_state(sim.simulator)

    sim.simulator.reset_context(saved.Clone())
    sim.advance_to(0.953)
    assert read_state(sim.simulator) == expected
    # What lies on the ports is a copy.
    assert count.num_full == num_full + 1

    # There the ports are others, with nothing on them.
    rebuilt = Simulator(simulate().diagram)
    rebuilt.get_mutable_context().SetTimeStateAndParametersFrom(saved)
    rebuilt.AdvanceTo(0.953)
    assert read_state(rebuilt) == expected
    assert count.num_full == num_full + 2


@pytest.mark.slow
def test_time_that_is_set_ends_steady_cycles(count: Count) -> None:
    sim = simulate()
    sim.controller("joint_trajectory_controller").send_trajectory(motion(0.1, 0.2))
    simulator = sim.simulator
    simulator.AdvanceTo(0.255)
    num_full = count.num_full

    simulator.get_mutable_context().SetTime(0.45)
    simulator.Initialize()
    simulator.AdvanceTo(0.555)

    # The first cycle after that, whose number isn't the next one.
    assert count.total - count.num_steady == num_full + 1, count
    assert sim.joint_states().position[0] > 0.1


def read_state(simulator: Simulator) -> list[Any]:
    context = simulator.get_context()
    state = context.get_discrete_state()
    vectors = [state.value(i).tobytes() for i in range(state.num_groups())]
    return [context.get_time(), *vectors]


FORWARD = """
controller_manager:
  ros__parameters:
    update_rate: 100
    arm: {type: forward_command_controller/ForwardCommandController}
arm:
  ros__parameters:
    joints: [joint1, joint2, joint3, joint4, joint5, joint6]
    interface_name: position
"""


@pytest.mark.slow
def test_a_forward_controller_ticks_quietly_until_it_fails(
    count: Count, tmp_path: Path
) -> None:
    file = tmp_path / "controllers.yaml"
    file.write_text(FORWARD)
    robot = ad.load_robot("doosan_a0912", controllers=file)
    options = ad.SimulationOptions(preset="fast", time_step=PERIOD)
    sim = ad.Simulation(ad.build_diagram(robot, options=options))
    sim.topic("/arm/commands").publish([0.1] * 6)
    sim.run(1.0)
    assert count.share > 0.95
    num_full = count.num_full

    message = Float64MultiArray(data=(0.1,))
    sim.mailbox.publish("arm.commands", message, PERIOD)
    sim.run(0.2)

    assert len(sim.failures) == 1
    assert count.num_full == num_full + 2
    np.testing.assert_allclose(sim.joint_states().position[:6], 0.1, atol=1e-3)


@pytest.mark.slow
def test_one_that_fails_and_goes_on_as_humble_s_ticks_in_full(
    count: Count, tmp_path: Path
) -> None:
    text = FORWARD.replace(f"[{', '.join(JOINTS)}]", "[swing]")
    robot = models.load(tmp_path, models.pendulum(), text, distro="humble")
    sim = ad.Simulation(ad.build_diagram(robot, world="void"))
    sim.run(0.1)
    num_full = count.num_full

    message = Float64MultiArray(data=(0.1, 0.2))
    sim.mailbox.publish("arm.commands", message, PERIOD)
    sim.run(0.2)
    assert len(sim.failures) == 1
    assert count.num_full == num_full + 20
    sim.topic("/arm/commands").publish([0.1])
    sim.run(0.1)

    assert count.num_full < num_full + 25
    assert sim.joint_states().position[0] > 0.05


@pytest.mark.slow
def test_gazebo_s_controllers_tick_steadily_between_messages(count: Count) -> None:
    robot = ad.load_robot("mycobot_280", xacro_args={"control": "gazebo"})
    sim = ad.Simulation(ad.build_diagram(robot, world="void"))
    joint = "link1_to_link2"
    target = sim.topic(f"/model/mycobot_280/joint/{joint}/cmd_pos")
    target.publish(-0.5)
    sim.run(0.2)
    target.publish(-0.7)
    sim.switch_controllers(deactivate=("JointPositionController",))
    sim.run(0.05)
    sim.switch_controllers(activate=("JointPositionController",))
    target.publish(-0.6)
    sim.run(0.2)

    assert count.steady_share > 0.85
    state = sim.joint_states()
    assert state.position[state.name.index(joint)] < -0.05


PUSHED = """
<robot name="pushed">
  <link name="base"/>{upper}{lower}
  {shoulder}{elbow}
  {plugins}
</robot>"""


@pytest.mark.slow
@pytest.mark.parametrize("may_run_free", [False, True])
def test_gazebo_s_forces_are_the_same_at_their_limits(
    count: Count, tmp_path: Path, may_run_free: bool
) -> None:
    limits = "<i_max>0.3</i_max><i_min>-0.2</i_min><cmd_max>1.5</cmd_max>"
    limits += "<cmd_min>-1</cmd_min><cmd_offset>0.1</cmd_offset>"
    gains = "<p_gain>40</p_gain><i_gain>20</i_gain><d_gain>2</d_gain>"
    free = "<use_force_commands>1</use_force_commands>"
    free += f"<disable_braking>{int(may_run_free)}</disable_braking>"
    plugins = "".join(
        f'<gazebo><plugin filename="gz-sim-{library}-system" '
        f'name="gz::sim::systems::{kind}"><joint_name>{name}</joint_name>{gains}'
        f"{limits}{more}</plugin></gazebo>"
        for library, kind, name, more in (
            ("joint-position-controller", "JointPositionController", "shoulder", ""),
            ("joint-controller", "JointController", "elbow", free),
        )
    )
    text = PUSHED.format(
        upper=models.bob("upper"),
        lower=models.bob("lower"),
        shoulder=models.joint("shoulder", "base", "upper"),
        elbow=models.joint(
            "elbow",
            "upper",
            "lower",
            xyz="0 0 -0.3",
            limit='lower="-3" upper="3" effort="0.8" velocity="10"',
        ),
        plugins=plugins,
    )
    file = tmp_path / "pushed.urdf"
    file.write_text(text, encoding="utf-8")
    sim = ad.Simulation(ad.build_diagram(ad.load_robot(file), world="void"))
    sim.topic("/model/pushed/joint/shoulder/cmd_pos").publish(0.7)
    sim.topic("/model/pushed/joint/elbow/cmd_vel").publish(-0.8)
    sim.run(0.4)

    assert count.share > 0.9
    assert (count.steady_share > 0.9) is not may_run_free
    efforts = sim.rollout().effort
    assert efforts.max(axis=0) == pytest.approx((1.5, 0.8))


PID = """
controller_manager:
  ros__parameters:
    update_rate: 200
    arm: {{type: joint_trajectory_controller/JointTrajectoryController}}
arm:
  ros__parameters:
    joints: [swing]
    command_interfaces: [{command}]
    state_interfaces: [position, velocity]
    gains: {{swing: {{{gains}}}}}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "gains"),
    [
        ("effort", "p: 60.0, i: 90.0, d: 8.0, i_clamp: 2.0"),
        ("effort", "p: 400.0, i: 90.0, d: 40.0, u_clamp_max: 9.0, u_clamp_min: -9.0"),
        ("velocity", "p: 5.0, ff_velocity_scale: 1.0"),
    ],
)
def test_pids_of_a_trajectory_tick_steadily(
    count: Count, tmp_path: Path, command: str, gains: str
) -> None:
    control = models.ros2_control("swing", command=command)
    config = PID.format(command=command, gains=gains)
    robot = models.load(tmp_path, models.pendulum(control=control), config)
    sim = ad.Simulation(ad.build_diagram(robot, world="void"))
    sim.run(0.1)
    point = JointTrajectoryPoint([0.4], [0.0], time_from_start=0.6)
    message = JointTrajectory(joint_names=["swing"], points=[point])
    goal = sim.controller("arm").send_goal(message)
    sim.run(1.0)

    assert goal.status.is_terminal
    assert len(goal.feedback) > 5
    assert count.steady_share > 0.85, count
    assert sim.joint_states().position[0] > 0.1


@pytest.mark.slow
def test_a_robot_whose_rate_another_one_sets_ticks_steadily(
    count: Count, tmp_path: Path
) -> None:
    point = JointTrajectoryPoint([0.4], [0.0], time_from_start=0.1)
    message = JointTrajectory(joint_names=["swing"], points=[point])
    robots = []
    # No step divides both periods.
    for rate in (1000, 997):
        folder = tmp_path / f"at_{rate}"
        folder.mkdir()
        config = PID.format(command="position", gains="p: 1.0")
        config = config.replace("update_rate: 200", f"update_rate: {rate}")
        description = models.pendulum(control=models.ros2_control("swing"))
        robots.append(models.load(folder, description, config, name=folder.name))
    sim = ad.Simulation(ad.build_diagram(robots, world="void"))
    for robot in robots:
        sim.controller(f"{robot.name}/arm").send_trajectory(message)
    sim.run(0.08)

    assert count.num_steady >= 2 * 80 - 4, count


def simulate_base(
    folder: Path, text: str, preset: Literal["accurate", "kinematic"] = "accurate"
) -> ad.Simulation:
    """Return a base whose controller has further parameters."""
    source = configs_folder() / "wheeled_base"
    file = folder / "controllers.yaml"
    config = (source / "diff_drive_controllers.yaml").read_text(encoding="utf-8")
    file.write_text(f"{config}    {text}", encoding="utf-8")
    robot = ad.load_robot(source / "diff_drive.urdf", controllers=file)
    options = ad.SimulationOptions(preset=preset)
    return ad.Simulation(ad.build_diagram(robot, options=options))


def twist(v: float, w: float) -> TwistStamped:
    return TwistStamped(twist={"linear": {"x": v}, "angular": {"z": w}})


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "publish_limited_velocity: true",
        "open_loop: true",
        "position_feedback: false\n    linear.x.max_jerk: 3.0",
        "linear: {x: {max_velocity: 0.3, max_acceleration: 0.5, max_jerk: 3.0}}",
    ],
)
def test_a_base_ticks_steadily_until_its_command_is_too_old(
    count: Count, tmp_path: Path, text: str
) -> None:
    sim = simulate_base(tmp_path, text)
    sim.run(0.2)
    sim.topic("/base/cmd_vel").publish(twist(0.4, 0.3))
    sim.run(0.3)
    sim.mailbox.publish("base.set_odometry", SetOdometry(1.0, 2.0, 0.5), sim.time)
    num_full = count.num_full
    sim.run(0.1)
    assert count.num_full == num_full + 1
    sim.run(1.0)

    # The pose; the velocity that is too old; of the first one nothing had come yet.
    assert count.num_full + count.num_quiet == num_full + 2
    assert count.steady_share > 0.95, count
    assert sim.topic("/base/odom").value().pose.pose.position.x > 1.0


@pytest.mark.slow
def test_a_base_goes_on_from_the_middle_of_steady_ticks(
    count: Count, tmp_path: Path
) -> None:
    text = "linear: {x: {max_acceleration: 0.5}}"
    # Without contacts, whose shapes have other numbers in each diagram.
    sim = simulate_base(tmp_path, text, "kinematic")
    sim.topic("/base/cmd_vel").publish(twist(0.4, 0.3))
    sim.advance_to(0.253)
    saved = sim.simulator.get_context().Clone()
    sim.advance_to(0.953)
    expected = read_state(sim.simulator)

    sim.simulator.reset_context(saved.Clone())
    sim.advance_to(0.953)
    assert read_state(sim.simulator) == expected

    rebuilt = Simulator(simulate_base(tmp_path, text, "kinematic").diagram)
    rebuilt.get_mutable_context().SetTimeStateAndParametersFrom(saved)
    rebuilt.AdvanceTo(0.953)
    assert read_state(rebuilt) == expected
    assert count.steady_share > 0.95, count


@pytest.mark.slow
def test_gazebo_s_base_ticks_steadily_between_its_odometry(
    count: Count, tmp_path: Path
) -> None:
    drive = carts.diff_drive(("max_acceleration", 0.8), ("odom_publish_frequency", 20))
    robot = carts.load(tmp_path, carts.cart(drive))
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.run(0.1)
    sim.topic("/model/cart/cmd_vel").publish(twist(0.4, 0.3).twist)
    sim.run(0.4)

    assert count.steady_share > 0.97, count
    assert sim.topic("/model/cart/odometry").value().pose.pose.position.x > 0.03


CHAIN = """
controller_manager:
  ros__parameters:
    update_rate: 200
    inner: {{type: pid_controller/PidController}}
    outer: {{type: forward_command_controller/ForwardCommandController}}
inner:
  ros__parameters:
    dof_names: [swing]
    command_interface: effort
    reference_and_state_interfaces: [{names}]
    gains: {{swing: {{p: 60.0, i: 90.0, d: 8.0, {more}}}}}
outer: {{ros__parameters: {{joints: [inner/swing], interface_name: position}}}}
"""


@pytest.mark.slow
@pytest.mark.parametrize("names", ["position", "position, velocity"])
@pytest.mark.parametrize(
    "more",
    [
        "feedforward_gain: 2.0, angle_wraparound: true",
        "u_clamp_max: 3.0, u_clamp_min: -3.0, antiwindup_strategy: back_calculation",
    ],
)
def test_a_pid_ticks_steadily_where_nobody_commands_its_references(
    count: Count, tmp_path: Path, names: str, more: str
) -> None:
    control = models.ros2_control("swing", command="effort")
    config = CHAIN.format(names=names, more=more)
    robot = models.load(tmp_path, models.pendulum(control=control), config)
    sim = ad.Simulation(ad.build_diagram(robot, world="void"))
    sim.controller("outer").command([0.3])
    sim.run(0.2)
    assert count.num_full == count.total

    sim.switch_controllers(deactivate=("outer",))
    sim.run(0.2)
    sim.controller("inner").command([0.6])
    sim.run(0.2)
    num_full = count.num_full

    # The switch and the message.
    assert count.total - num_full == 80 - 2
    assert count.num_steady > 70
    sim.switch_controllers(activate=("outer",))
    sim.run(0.1)
    assert count.num_full == num_full + 20
    assert sim.joint_states().position[0] > 0.02


BROADCAST = """
controller_manager:
  ros__parameters:
    update_rate: 100
    states: {type: joint_state_broadcaster/JointStateBroadcaster}
"""


@pytest.mark.slow
def test_a_robot_whose_states_are_broadcast_alone_ticks_steadily(
    count: Count, tmp_path: Path
) -> None:
    robot = models.load(tmp_path, models.GRIPPER, BROADCAST)
    sim = ad.Simulation(ad.build_diagram(robot, world="void"))
    sim.run(0.5)

    assert count.num_steady == count.total - 1


HAND = """
controller_manager:
  ros__parameters:
    update_rate: 100
    hand: {type: position_controllers/GripperActionController}
hand: {ros__parameters: {joint: finger}}
"""


@pytest.mark.slow
def test_a_gripper_ticks_quietly(count: Count, tmp_path: Path) -> None:
    robot = models.load(tmp_path, models.GRIPPER, HAND)
    sim = ad.Simulation(ad.build_diagram(robot, world="void"))
    sim.run(0.1)
    goal = sim.controller("hand").send_goal(GripperCommandGoal(GripperCommand(0.2)))
    sim.run(1.0)

    assert goal.status.is_terminal
    assert goal.result is not None
    assert count.share > 0.9
    num_steady = count.num_steady
    sim.run(0.2)
    assert count.num_steady == num_steady + 20
