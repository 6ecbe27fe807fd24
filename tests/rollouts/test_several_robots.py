"""Bases and arms in one world: each with its manager, its namespace and its motion."""

import ast
import dataclasses as dc
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.messages import Duration, Twist, Vector3
from arm_drake.simulation.motion_files import load_motion
from tests import models
from tests.robots import load_real_robot

# Controllers of the bases, their frames, and what they are told [m/s], [rad/s].
BASES = {
    "create3": ("diffdrive_controller", "base_link", (0.2, 0.3)),
    "pmb2": ("mobile_base_controller", "base_footprint", (0.3, -0.4)),
}
POSES: dict[str, tuple[float, float, float, float, float, float]] = {
    "create3": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "pmb2": (0.0, 2.0, 0.0, 0.0, 0.0, 1.0),
    "arm": (2.5, 0.0, 0.0, 0.0, 0.0, 0.5),
}
ARM = "joint_trajectory_controller"
GOAL = (0.5, -0.3, 0.8, 0.2, 0.5, 0.1)

# How often commands are sent [s], half a tick of the quickest manager after the ticks
# of all: then no rounding of times decides which tick sees one.
PERIOD = 0.1
AFTER_TICKS = 0.0005

# How long the bases stand until they are on their wheels, and drive [s].
SETTLE, DRIVE = 0.5, 2.0


def load(name: str) -> ad.Robot:
    if name not in BASES:
        return ad.load_robot("doosan_a0912", pose=POSES[name], name=name)
    return load_real_robot(name, pose=POSES[name])


@dc.dataclass(frozen=True)
class Run:
    """A simulation of robots that were all told to move."""

    sim: ad.Simulation

    # Where the links were before the bases drove, by robot.
    before: dict[str, dict[str, RigidTransform]]

    def moved(self, name: str) -> RigidTransform:
        """Return how a base has moved, seen from where it stood."""
        frame = BASES[name][1]
        return self.before[name][frame].inverse() @ self.sim.link_poses(name)[frame]


def run(robots: list[ad.Robot]) -> Run:
    # As small as the quickest manager's period needs it, with whomever it is.
    options = ad.SimulationOptions(time_step=0.001)
    sim = ad.Simulation(ad.build_diagram(robots, options=options))
    prefix = {r.name: f"{r.name}/" if len(robots) > 1 else "" for r in robots}
    if "arm" in prefix:
        names = tuple(f"joint{number}" for number in range(1, 7))
        point = ad.JointTrajectoryPoint(positions=GOAL, time_from_start=Duration(2))
        goal = ad.JointTrajectory(joint_names=names, points=(point,))
        sim.controller(prefix["arm"] + ARM).send_goal(goal)
    sim.run(SETTLE + AFTER_TICKS)
    before = {name: sim.link_poses(name) for name in prefix}
    for _ in range(round(DRIVE / PERIOD)):
        for name in prefix.keys() & BASES.keys():
            controller, _, (v, w) = BASES[name]
            twist = Twist(Vector3(x=v), Vector3(z=w))
            sim.controller(prefix[name] + controller).send_velocity(twist)
        sim.run(PERIOD)
    return Run(sim, before)


@pytest.fixture(scope="module")
def robots() -> dict[str, ad.Robot]:
    return {name: load(name) for name in POSES}


@pytest.fixture(scope="module")
def together(robots: dict[str, ad.Robot]) -> Run:
    return run(list(robots.values()))


@pytest.mark.parametrize("name", BASES)
def test_each_base_is_where_its_odometry_says(together: Run, name: str) -> None:
    controller, frame, (v, w) = BASES[name]

    odometry = together.sim.topic(f"/{name}/{controller}/odom").value()

    truth, pose = together.moved(name), odometry.pose.pose
    off = truth.translation()[:2] - (pose.position.x, pose.position.y)
    # Within 5 % of the way, which is most of what was commanded.
    assert np.linalg.norm(off) < 0.05 * v * DRIVE
    assert np.linalg.norm(truth.translation()[:2]) > 0.6 * v * DRIVE
    heading = RollPitchYaw(truth.rotation()).yaw_angle()
    turned = 2.0 * np.arctan2(pose.orientation.z, pose.orientation.w)
    assert turned == pytest.approx(heading, rel=0.05)
    assert heading / (w * DRIVE) > 0.3
    # Frames have the namespace in front, which is the robot's name.
    assert odometry.header.frame_id == f"{name}/odom"
    assert odometry.child_frame_id == f"{name}/{frame}"
    (transform,) = together.sim.topic(f"/{name}/{controller}/tf").value().transforms
    assert transform.header.frame_id == f"{name}/odom"
    assert transform.child_frame_id == f"{name}/{frame}"
    assert together.sim.topic(f"/{name}/tf").value().transforms == (transform,)


def test_the_arm_moves_bit_by_bit_as_alone(
    together: Run, robots: dict[str, ad.Robot]
) -> None:
    alone = run([robots["arm"]]).sim.rollout()

    rollout = together.sim.rollout("arm")

    # Nothing touches it, so it is none of the contact solver's business.
    for field in ("time", "position", "velocity", "effort"):
        np.testing.assert_array_equal(getattr(rollout, field), getattr(alone, field))
    assert np.abs(rollout.position[-1] - GOAL).max() < 0.01


@pytest.mark.parametrize("name", BASES)
def test_a_base_moves_as_alone(
    together: Run, robots: dict[str, ad.Robot], name: str
) -> None:
    alone = run([robots[name]])

    shared, own = together.moved(name), alone.moved(name)

    # All contacts of the world are one problem of Drake's solver. It ends when the
    # residual is below 1e-6 of the momentum of everything that touches something: so
    # another robot may change a velocity of up to 0.3 m/s by about 3e-7 m/s, and the
    # way of some seconds by less than 1e-6 m. (1e-8 m is seen.)
    np.testing.assert_allclose(shared.translation(), own.translation(), atol=1e-6)
    np.testing.assert_allclose(
        shared.rotation().matrix(), own.rotation().matrix(), atol=1e-5
    )


def test_names_do_not_collide(together: Run) -> None:
    sim = together.sim

    names = [topic.name for topic in sim.list_topics()]
    controllers = [controller.name for controller in sim.list_controllers()]

    assert len(set(names)) == len(names)
    assert all(
        name.startswith(tuple(f"/{robot}/" for robot in POSES)) for name in names
    )
    assert len(set(controllers)) == len(controllers)
    assert {c.state for c in sim.list_controllers()} == {"active"}
    # What one of them alone has needs no name in front; what several have does.
    odom = sim.topic("/mobile_base_controller/odom")
    assert odom.name == "/pmb2/mobile_base_controller/odom"
    with pytest.raises(InputError, match="several robots have a topic '/joint_states'"):
        sim.topic("/joint_states")
    with pytest.raises(InputError, match="'pmb2/mobile_base_controller'"):
        sim.controller("mobile_base_controller")


WHEELS = """
<robot name="cart">
  <link name="base_link"/>{bob_left}{bob_right}{left}{right}{control}
  {plugin}
</robot>"""
DIFF_DRIVE = "diff_drive_controller/DiffDriveController"
YAML = f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    drive: {{type: {DIFF_DRIVE}}}
drive:
  ros__parameters:
    left_wheel_names: [left]
    right_wheel_names: [right]
    wheel_separation: 0.5
    wheel_radius: 0.1
    base_frame_id: base_link
    position_feedback: false
    tf_frame_prefix: "{{prefix}}"
"""
PLUGIN = """
<gazebo>
  <plugin filename="libgazebo_ros2_control.so" name="control">
    <ros><namespace>/fleet/cart7</namespace></ros>
  </plugin>
</gazebo>"""


def cart(
    folder: Path,
    name: str = "cart",
    *,
    plugin: str = "",
    prefix: str = "",
    **options: str | None,
) -> ad.Robot:
    """Return a robot of two wheels; commands are mirrored, so it needs no ground."""
    control = models.ros2_control("left", "right", command="velocity")
    free = 'effort="100" velocity="100"'
    urdf = WHEELS.format(
        bob_left=models.bob("left_wheel", "0 0 0"),
        bob_right=models.bob("right_wheel", "0 0 0"),
        left=models.joint(
            "left", "base_link", "left_wheel", type="continuous", limit=free
        ),
        right=models.joint(
            "right", "base_link", "right_wheel", type="continuous", limit=free
        ),
        control=control,
        plugin=plugin,
    )
    folder = folder / name
    folder.mkdir()
    text = YAML.replace("{prefix}", prefix)
    return models.load(folder, urdf, text, name=name, **options)


def frames(*robots: ad.Robot) -> dict[str, tuple[str, str]]:
    """Return the frames of each robot's odometry, after a tick of it."""
    options = ad.SimulationOptions(preset="kinematic")
    sim = ad.Simulation(ad.build_diagram(list(robots), options=options))
    start = {r.name: f"{r.name}/" if len(robots) > 1 else "" for r in robots}
    for name in start.values():
        sim.controller(f"{name}drive").send_velocity(Twist(Vector3(x=0.1)))
    sim.run(0.05)
    found = {}
    for robot in robots:
        odometry = sim.topic(f"/{start[robot.name]}drive/odom").value()
        found[robot.name] = (odometry.header.frame_id, odometry.child_frame_id)
    return found


def test_alone_the_namespace_is_that_of_the_gazebo_plugin(tmp_path: Path) -> None:
    assert frames(cart(tmp_path, "plain")) == {"plain": ("odom", "base_link")}
    assert frames(cart(tmp_path, "named", plugin=PLUGIN)) == {
        "named": ("fleet/cart7/odom", "fleet/cart7/base_link")
    }


@pytest.mark.parametrize(
    ("namespace", "found"),
    [
        (None, "/fleet/cart7"),
        ("", "/fleet/cart7"),
        ("hall/b", "/hall/b"),
        ("/hall//b/", "/hall/b"),
        ("/", ""),
    ],
)
def test_alone_a_namespace_that_is_given_comes_before_that_of_the_plugin(
    tmp_path: Path, namespace: str | None, found: str
) -> None:
    robot = cart(tmp_path, plugin=PLUGIN, namespace=namespace)

    assert robot.namespace == found
    start = f"{found[1:]}/" if found else ""
    assert frames(robot) == {"cart": (f"{start}odom", f"{start}base_link")}


def test_several_of_a_kind_have_frames_of_their_own(tmp_path: Path) -> None:
    robots = [
        cart(tmp_path, "one"),
        cart(tmp_path, "two", plugin=PLUGIN),
        cart(tmp_path, "three", prefix="x/"),
    ]

    # A prefix that is given stands alone, as upstream.
    assert frames(*robots) == {
        "one": ("one/odom", "one/base_link"),
        "two": ("two/odom", "two/base_link"),
        "three": ("x/odom", "x/base_link"),
    }


def test_two_of_a_kind_follow_a_motion_each(tmp_path: Path) -> None:
    robots = [cart(tmp_path, name) for name in ("one", "two")]
    options = ad.SimulationOptions(preset="kinematic")
    sim = ad.Simulation(ad.build_diagram(robots, options=options))
    file = tmp_path / "motion.yaml"
    file.write_text(
        """
- {at: 0.0, every: 0.1, count: 10, controller: one/drive,
   cmd_vel: {linear: {x: 0.2}}}
- {at: 0.0, every: 0.1, count: 10, controller: two/drive,
   cmd_vel: {linear: {x: -0.1}, angular: {z: 0.5}}}
""",
        encoding="utf-8",
    )

    sim.run(1.0, load_motion(file))

    one = sim.topic("/one/drive/odom").value().twist.twist
    two = sim.topic("/two/drive/odom").value().twist.twist
    # Mirrored wheels turn as they are told.
    assert (one.linear.x, one.angular.z) == pytest.approx((0.2, 0.0))
    assert (two.linear.x, two.angular.z) == pytest.approx((-0.1, 0.5))


def test_a_topic_that_is_called_as_the_joints_keeps_its_slash(tmp_path: Path) -> None:
    plugin = """
<gazebo>
  <plugin filename="libgazebo_ros_joint_state_publisher.so" name="publisher">
    <joint_name>fall</joint_name>
  </plugin>
</gazebo></robot>"""
    text = models.FALLING_BALL.replace("</robot>", plugin)
    robots = [models.load(tmp_path, text, name=name) for name in ("one", "two")]

    sim = ad.Simulation(ad.build_diagram(robots))
    sim.run(0.01)

    # Of one robot they are `joint_states` and `/joint_states`.
    assert sim.eval_output("one/joint_states").shape == (3,)
    message = sim.eval_output("/one/joint_states")
    assert message.name == ("fall",)
    assert sim.topic("/one/joint_states").value() == message


def test_two_of_a_name_are_refused(tmp_path: Path) -> None:
    robot = cart(tmp_path, "one")

    with pytest.raises(InputError, match="2 robots are called 'one'"):
        ad.build_diagram([robot, robot])


def test_the_program_of_the_docs_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    docs = Path(__file__).parents[2] / "docs" / "motions.md"
    section = docs.read_text(encoding="utf-8").partition("## Several robots")[2]
    program = section.partition("```python\n")[2].partition("```")[0]
    monkeypatch.chdir(tmp_path)

    exec(compile(program, docs.name, "exec"), {})  # noqa: S102  our own text.

    left, right = map(ast.literal_eval, capsys.readouterr().out.splitlines())
    # Both are there to 5 mrad, each at its own angle.
    np.testing.assert_allclose(left, 0.3, atol=5e-3)
    np.testing.assert_allclose(right, -0.3, atol=5e-3)
    assert (tmp_path / "left.npz").is_file()


def test_two_arms_and_a_base_in_the_house() -> None:
    robots = [
        load("arm"),
        ad.load_robot(
            "mycobot_280",
            xacro_args={"control": "ros2_control"},
            name="small",
            pose=(0.0, -1.0, 0.05, 0.0, 0.0, 0.0),
        ),
        load("create3"),
    ]
    sim = ad.Simulation(ad.build_diagram(robots, world="house"))

    sim.run(SETTLE)
    small = [name for name in sim.joint_states("small").name if name.startswith("link")]
    for robot, controller, goal in (
        ("arm", ARM, GOAL),
        ("small", "arm_controller", (0.3,) * len(small)),
    ):
        names = small if robot == "small" else [f"joint{n}" for n in range(1, 7)]
        point = ad.JointTrajectoryPoint(goal, time_from_start=Duration(1))
        trajectory = ad.JointTrajectory(joint_names=names, points=[point])
        sim.controller(f"{robot}/{controller}").send_trajectory(trajectory)
    for _ in range(15):
        twist = Twist(Vector3(x=0.2), Vector3())
        sim.controller("create3/diffdrive_controller").send_velocity(twist)
        sim.run(PERIOD)

    states = sim.joint_states("small")
    reached = dict(zip(states.name, states.position, strict=True))
    assert [reached[name] for name in small] == pytest.approx([0.3] * 6, abs=1e-3)
    assert sim.joint_states("arm").position == pytest.approx(GOAL, abs=1e-3)
    odom = sim.topic("/create3/diffdrive_controller/odom").value().pose.pose.position
    assert odom.x == pytest.approx(0.2 * 1.5, rel=0.15)
