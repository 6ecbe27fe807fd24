"""IMUs of `<gazebo>` tags measure closed forms, at their rate, with Gazebo's noise."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.messages import (
    Duration,
    JointTrajectory,
    JointTrajectoryPoint,
    Quaternion,
    Twist,
    Vector3,
)
from arm_drake.messages.sensors import Imu
from arm_drake.wire.server import RosServer
from tests import carts, models
from tests.physics.support import EFFORT, effort_controller, one_joint, simulate

G = models.GRAVITY

# Of the IMU in the bob's link [m], [rad].
MOUNT, TILT = (0.3, 0.1, -0.2), (0.4, -0.2, 0.7)
POSE = f"<pose>{' '.join(map(str, (*MOUNT, *TILT)))}</pose>"

TOPIC = "/world/void/model/{}/link/bob/sensor/imu/imu"

# Fields of the plugin of Gazebo Classic.
PLUGIN = """<plugin name="p" filename="libgazebo_ros_imu_sensor.so">
  <ros><namespace>base</namespace><remapping>~/out:=data</remapping></ros>{}</plugin>"""


def imu(inside: str = "", *, reference: str = "bob", name: str = "imu") -> str:
    """Return the tag of an IMU."""
    sensor = f'<sensor name="{name}" type="imu">{inside}</sensor>'
    return f'<gazebo reference="{reference}">{sensor}</gazebo>'


def noise(text: str, *, axis: str = "linear_acceleration/z", kind: str = "gaussian"):
    """Return a tag with the noise of an axis; `text` is its fields."""
    quantity, _, letter = axis.partition("/")
    inside = f'<{letter}><noise type="{kind}">{text}</noise></{letter}>'
    return f"<imu><{quantity}>{inside}</{quantity}></imu>"


def with_tag(urdf: str, tag: str) -> str:
    return urdf.replace("</robot>", f"{tag}</robot>")


def frame(localization: str, more: str = "") -> str:
    """Return a tag with the frame of orientations."""
    text = f"<localization>{localization}</localization>{more}"
    tag = "orientation_reference_frame"
    return f"<imu><{tag}>{text}</{tag}></imu>"


def lift(folder: Path, tag: str, rate: int = 100, **options: object) -> ad.Simulation:
    """Return a simulation of a load that is held, with an IMU."""
    yaml = models.trajectory_controllers({"arm": ["slide"]}, update_rate=rate)
    robot = models.load(folder, with_tag(models.LIFT, tag), yaml)
    assert not robot.report.errors, robot.report
    options = {"world": "void", "options": ad.SimulationOptions(**options)}
    return ad.Simulation(ad.build_diagram(robot, **options))


LIFTED = TOPIC.format("lift").replace("bob", "load")


def samples(
    sim: ad.Simulation, topic: str, count: int, period: float = 0.01
) -> Iterator[Imu]:
    """Yield what is published after each of some ticks, of a period [s]."""
    for _ in range(count):
        sim.run(period)
        yield sim.topic(topic).value()


def stamp(message: Imu) -> float:
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def array(vector: Vector3 | Quaternion) -> np.ndarray:
    names = "xyzw" if isinstance(vector, Quaternion) else "xyz"
    return np.array([getattr(vector, name) for name in names])


def turn(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return the matrix of a rotation about x, then y, then z of a fixed frame."""
    R = np.eye(3)
    for axis, angle in enumerate((roll, pitch, yaw)):
        c, s = math.cos(angle), math.sin(angle)
        one, two = (axis + 1) % 3, (axis + 2) % 3
        step = np.eye(3)
        step[one, one] = step[two, two] = c
        step[one, two], step[two, one] = -s, s
        R = step @ R
    return R


def matrix(q: np.ndarray) -> np.ndarray:
    """Return the matrix of a quaternion x, y, z, w of length 1."""
    (x, y, z), w = q[:3], q[3]
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * w * K + 2.0 * K @ K


def orientation(message: Imu) -> np.ndarray:
    return matrix(array(message.orientation))


@pytest.mark.slow
@pytest.mark.parametrize("tilt", [(0.0, 0.0, 0.0), TILT])
def test_at_rest_it_measures_what_holds_it_up(tmp_path: Path, tilt) -> None:
    pose = f"<pose>0 0 0 {' '.join(map(str, tilt))}</pose>"
    sim = lift(tmp_path, imu(pose, reference="load"))

    sim.run(1.0)

    message = sim.topic(LIFTED).value()
    up = turn(*tilt).T @ [0.0, 0.0, G]
    np.testing.assert_allclose(array(message.linear_acceleration), up, atol=1e-6)
    np.testing.assert_allclose(array(message.angular_velocity), np.zeros(3), atol=1e-7)
    np.testing.assert_allclose(array(message.orientation), [0, 0, 0, 1], atol=1e-7)
    assert message.angular_velocity_covariance == (0.0,) * 9
    assert message.header.frame_id == "lift/load/imu"


@pytest.mark.slow
def test_on_a_turning_arm_it_measures_the_centripetal_acceleration(
    tmp_path: Path,
) -> None:
    speed, step = 2.0, 1e-3
    urdf = with_tag(one_joint("continuous", "0 0 1"), imu(POSE))
    yaml = effort_controller()
    sim = simulate(tmp_path, urdf, yaml, step=step, speed=[speed])

    R_LS = turn(*TILT)
    for message in samples(sim, TOPIC.format("one_joint"), 30):
        R_WS = turn(0, 0, speed * stamp(message)) @ R_LS
        # Towards the axis, along the sensor's axes, which turn with it.
        inwards = -(speed**2) * np.array([*MOUNT[:2], 0.0]) + [0.0, 0.0, G]
        np.testing.assert_allclose(
            array(message.linear_acceleration), R_LS.T @ inwards, atol=1e-9
        )
        np.testing.assert_allclose(
            array(message.angular_velocity), R_LS.T @ [0.0, 0.0, speed], atol=1e-12
        )
        # Relative to how it was at the start.
        np.testing.assert_allclose(orientation(message), R_LS.T @ R_WS, atol=1e-9)


@pytest.mark.slow
def test_an_effort_is_felt_in_the_step_that_it_moves(tmp_path: Path) -> None:
    urdf = with_tag(one_joint("prismatic", "1 0 0"), imu())
    sim = simulate(tmp_path, urdf, effort_controller(), step=1e-3)
    sim.run(0.1)
    sim.controller(EFFORT).command([3.0])

    (message, *_) = samples(sim, TOPIC.format("one_joint"), 1)

    assert stamp(message) == 0.1
    assert message.linear_acceleration.x == pytest.approx(3.0 / models.MASS, rel=1e-12)


@pytest.mark.slow
def test_a_base_that_turns_measures_how_fast_and_where_it_looks(
    tmp_path: Path,
) -> None:
    tag = imu("<topic>imu</topic><gz_frame_id>base_link</gz_frame_id>")
    tag = tag.replace('"bob"', '"base_link"')
    robot = carts.load(tmp_path, carts.cart(carts.diff_drive(), tag))
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.topic("/model/cart/cmd_vel").publish(Twist(Vector3(), Vector3(z=0.5)))
    sim.run(4.0)

    message = sim.topic("/imu").value()
    told = 2.0 * math.atan2(message.orientation.z, message.orientation.w)
    R_WB = sim.link_poses()["base_link"].rotation().matrix()
    yaw = math.atan2(R_WB[1, 0], R_WB[0, 0])
    assert message.header.frame_id == "base_link"
    # In the tick before it hadn't turned as far.
    before = yaw - 0.5 * (sim.time - stamp(message))
    assert told == pytest.approx(before, abs=1e-4)
    assert message.angular_velocity.z == pytest.approx(0.5, rel=0.02)
    # On the ground it shakes a bit, from step to step; it stays at its height.
    told = samples(sim, "/imu", 100, period=0.001)
    up = [each.linear_acceleration.z for each in told]
    assert np.mean(up) == pytest.approx(G, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("inside", "R_WR"),
    [
        ("", turn(*TILT)),
        (frame("ENU"), np.eye(3)),
        # Of NED x is north, y east, z down; of NWU x is north, y west, z up.
        (frame("NED"), np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])),
        (frame("NWU"), np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])),
        (
            frame(
                "CUSTOM", '<custom_rpy parent_frame="world">0.1 0.2 0.3</custom_rpy>'
            ),
            turn(0.1, 0.2, 0.3),
        ),
        (frame("CUSTOM"), turn(*TILT)),
        (PLUGIN.format(""), np.eye(3)),
        (
            PLUGIN.format(
                "<initial_orientation_as_reference>true"
                "</initial_orientation_as_reference>"
            ),
            turn(*TILT),
        ),
    ],
)
def test_orientations_are_told_in_the_frame_that_is_named(
    tmp_path: Path, inside: str, R_WR: np.ndarray
) -> None:
    sim = lift(tmp_path, imu(inside + POSE, reference="load"))
    sim.run(0.1)

    message = sim.topic("/base/data" if "plugin" in inside else LIFTED).value()

    expected = R_WR.T @ turn(*TILT)
    np.testing.assert_allclose(orientation(message), expected, atol=1e-7)


@pytest.mark.slow
def test_an_imu_without_orientation_says_so(tmp_path: Path) -> None:
    inside = "<imu><enable_orientation>false</enable_orientation></imu>"
    sim = lift(tmp_path, imu(inside, reference="load"))
    sim.run(0.1)

    message = sim.topic(LIFTED).value()

    assert array(message.orientation).tolist() == [0.0] * 4
    # What sensor_msgs/Imu asks for.
    assert message.orientation_covariance == (-1.0, *(0.0,) * 8)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "ticks"),
    [
        (0, [*range(9)]),
        (100, [*range(9)]),
        # The first tick of each 1/62 s, of each 1/25 s.
        (62, [0, 2, 4, 5, 7]),
        (25, [0, 4, 8]),
    ],
)
def test_it_measures_at_its_rate(tmp_path: Path, rate: int, ticks: list[int]) -> None:
    tag = imu(f"<update_rate>{rate}</update_rate>", reference="load")
    sim = lift(tmp_path, tag)

    times = [round(100.0 * stamp(m)) for m in samples(sim, LIFTED, 9)]

    assert list(dict.fromkeys(times)) == ticks


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kept", "link"), [("", "base_link"), ("<preserveFixedJoint>", "caster")]
)
def test_names_contain_the_link_that_gazebo_makes_of_several(
    tmp_path: Path, kept: str, link: str
) -> None:
    tag = imu(reference="caster")
    if kept:
        text = f"{kept}true{kept.replace('<', '</')}"
        tag += f'<gazebo reference="caster_joint">{text}</gazebo>'
    urdf = carts.cart(tag).replace('joint name="caster"', 'joint name="caster_joint"')
    sim = ad.Simulation(ad.build_diagram(carts.load(tmp_path, urdf), world="void"))
    sim.run(0.1)

    message = sim.topic(f"/world/void/model/cart/link/{link}/sensor/imu/imu").value()

    assert message.header.frame_id == f"cart/{link}/imu"


@pytest.mark.slow
def test_the_plugin_of_classic_names_topic_and_frame(tmp_path: Path) -> None:
    plugin = PLUGIN.format("<frame_name>base</frame_name>")
    sim = lift(tmp_path, imu(plugin, reference="load"))
    sim.run(0.1)

    assert sim.topic("/base/data").value().header.frame_id == "base"


@pytest.mark.slow
def test_the_plugin_of_classic_publishes_below_its_own_name(tmp_path: Path) -> None:
    plugin = PLUGIN.format("").replace("<remapping>~/out:=data</remapping>", "")
    sim = lift(tmp_path, imu(plugin, reference="load"))
    sim.run(0.1)

    assert sim.topic("/base/p/out").value().header.frame_id == "load"


# What 400 samples tell of noise is off by so many standard errors at most; the seeds
# are fixed.
COUNT, ERRORS = 400, 4.0


def noisy(folder: Path, inside: str, **options: object) -> np.ndarray:
    """Return velocities and accelerations of a load at rest, shape (COUNT, 6)."""
    sim = lift(folder, imu(inside, reference="load"), **options)
    rows = []
    for message in samples(sim, LIFTED, COUNT):
        w, a = message.angular_velocity, message.linear_acceleration
        rows.append([*array(w), *array(a)])
    return np.array(rows) - [0.0, 0.0, 0.0, 0.0, 0.0, G]


def test_a_deviation_whose_square_is_no_number_has_an_infinite_covariance(
    tmp_path: Path,
) -> None:
    sim = lift(tmp_path, imu(noise("<stddev>1e300</stddev>"), reference="load"))

    (message,) = samples(sim, LIFTED, 1)
    assert message.linear_acceleration_covariance[8] == math.inf
    assert np.isfinite(array(message.linear_acceleration)).all()


@pytest.mark.slow
def test_noise_has_its_mean_and_deviation_and_is_of_its_axis_alone(
    tmp_path: Path,
) -> None:
    text = "<mean>0.3</mean><stddev>0.2</stddev>"
    rows = noisy(tmp_path, noise(text, axis="angular_velocity/y"))

    told = rows[:, 1]
    assert told.mean() == pytest.approx(0.3, abs=ERRORS * 0.2 / COUNT**0.5)
    assert told.std() == pytest.approx(0.2, abs=ERRORS * 0.2 / (2 * COUNT) ** 0.5)
    # White: what follows has nothing to do with it.
    assert abs(np.corrcoef(told[1:], told[:-1])[0, 1]) < ERRORS / COUNT**0.5
    np.testing.assert_allclose(np.delete(rows, 1, axis=1), 0.0, atol=1e-6)


@pytest.mark.slow
def test_a_bias_stays_on_one_side(tmp_path: Path) -> None:
    text = "<stddev>0</stddev><bias_mean>0.1</bias_mean><bias_stddev>0</bias_stddev>"
    sides = []
    for seed in range(4):
        told = noisy(tmp_path, noise(text), seed=seed)[:, 5]
        np.testing.assert_allclose(told, told[0], atol=1e-6)
        assert abs(told[0]) == pytest.approx(0.1, abs=1e-6)
        sides.append(told[0] > 0.0)

    assert len(set(sides)) == 2


@pytest.mark.slow
def test_a_dynamic_bias_wanders_as_a_gauss_markov_process(tmp_path: Path) -> None:
    sigma, tau, dt = 0.5, 0.2, 0.01
    text = f"""<dynamic_bias_stddev>{sigma}</dynamic_bias_stddev>
      <dynamic_bias_correlation_time>{tau}</dynamic_bias_correlation_time>"""
    told = noisy(tmp_path, noise(text))[:, 5]

    # What is left of the last one, and what comes to it: the exact discrete process.
    phi = math.exp(-dt / tau)
    drive = told[1:] - phi * told[:-1]
    deviation = sigma * math.sqrt(tau / 2.0 * (1.0 - phi**2))
    error = ERRORS / (2 * COUNT) ** 0.5
    assert drive.std() == pytest.approx(deviation, rel=error)
    assert abs(np.corrcoef(drive[1:], drive[:-1])[0, 1]) < ERRORS / COUNT**0.5


@pytest.mark.slow
def test_a_precision_leaves_multiples_of_it(tmp_path: Path) -> None:
    text = "<stddev>0.2</stddev><precision>0.25</precision>"
    told = noisy(tmp_path, noise(text, kind="gaussian_quantized"))[:, 5] + G

    steps = told / 0.25
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-12)
    assert len(set(np.round(steps))) > 2


@pytest.mark.slow
def test_noise_follows_from_the_seed_and_changes_nothing_else(tmp_path: Path) -> None:
    tag = imu(noise("<stddev>0.2</stddev>") + POSE, reference="load")
    exact = imu(POSE, reference="load")
    rows, moved = [], []
    for seed, text in ((1, tag), (1, tag), (2, tag), (1, exact), (1, "")):
        sim = lift(tmp_path, text, seed=seed)
        point = JointTrajectoryPoint((0.2,), time_from_start=Duration(0, 3 * 10**8))
        sim.controller("arm").send_trajectory(
            JointTrajectory(joint_names=("slide",), points=(point,))
        )
        sim.run(0.3)
        rows.append(sim.topic(LIFTED).value().linear_acceleration if text else None)
        moved.append(sim.rollout().position)

    assert rows[0] == rows[1]
    assert rows[0] != rows[2]
    assert rows[0] != rows[3]
    for position in moved[1:]:
        np.testing.assert_array_equal(position, moved[0])


@pytest.mark.slow
def test_covariances_are_those_of_the_noise(tmp_path: Path) -> None:
    sim = lift(tmp_path, imu(noise("<stddev>0.2</stddev>"), reference="load"))
    sim.run(0.1)

    message = sim.topic(LIFTED).value()

    assert message.linear_acceleration_covariance == pytest.approx([*[0] * 8, 0.04])
    assert message.angular_velocity_covariance == (0.0,) * 9


@pytest.mark.slow
def test_an_imu_goes_on_where_it_was_saved(tmp_path: Path) -> None:
    text = """<stddev>0.1</stddev><dynamic_bias_stddev>0.5</dynamic_bias_stddev>
      <dynamic_bias_correlation_time>0.2</dynamic_bias_correlation_time>"""
    sim = lift(tmp_path, imu(noise(text) + POSE, reference="load"))
    sim.run(0.2)
    saved = sim.context.Clone()
    sim.run(0.2)
    expected = sim.topic(LIFTED).value()

    again = lift(tmp_path, imu(noise(text) + POSE, reference="load"))
    again.simulator.get_mutable_context().SetTimeStateAndParametersFrom(saved)
    again.simulator.Initialize()
    again.run(0.2)

    assert again.topic(LIFTED).value() == expected


@pytest.mark.slow
def test_one_that_is_not_active_tells_nothing(tmp_path: Path) -> None:
    sim = lift(tmp_path, imu(reference="load"), inactive=("imu",))

    sim.run(0.1)

    assert sim.topic(LIFTED).value() == Imu()


@pytest.mark.slow
@pytest.mark.parametrize("inside", ["", frame("ENU")])
def test_without_physics_it_is_silent_and_the_report_says_so(
    tmp_path: Path, inside: str
) -> None:
    yaml = models.trajectory_controllers({"arm": ["slide"]})
    urdf = with_tag(models.LIFT, imu(inside, reference="load"))
    robot = models.load(tmp_path, urdf, yaml)
    options = ad.SimulationOptions(preset="kinematic")
    sim = ad.Simulation(ad.build_diagram(robot, world="void", options=options))

    sim.run(0.1)

    assert sim.topic(LIFTED).value() == Imu()
    assert "IMU 'imu' measures nothing without physics" in str(sim.report)


@pytest.mark.slow
def test_a_bridge_gives_it_a_name_in_ros(tmp_path: Path) -> None:
    bridge = tmp_path / "bridge.yaml"
    bridge.write_text(
        "- {ros_topic_name: imu/data, gz_topic_name: /gz/imu, direction: GZ_TO_ROS,\n"
        "   ros_type_name: sensor_msgs/msg/Imu, gz_type_name: gz.msgs.IMU}\n"
    )
    urdf = with_tag(models.LIFT, imu("<topic>gz/imu</topic>", reference="load"))
    (tmp_path / "robot.urdf").write_text(urdf)
    robot = ad.load_robot(tmp_path / "robot.urdf", controllers=bridge)
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.run(0.1)

    assert sim.topic("/imu/data").value() == sim.topic("/gz/imu").value() != Imu()
    topic = RosServer(sim, ()).graph.topics["/imu/data"]
    assert topic.type == "sensor_msgs/msg/Imu"


@pytest.mark.slow
def test_ros_is_told_each_sample_once(tmp_path: Path) -> None:
    tag = imu("<topic>imu</topic><update_rate>20</update_rate>", reference="load")
    sim = lift(tmp_path, tag)
    graph = RosServer(sim, ()).graph
    topic, told = graph.topics["/imu"], []
    for _ in range(20):
        sim.run(0.01)
        graph.update([topic], sim.time)
        while topic.waiting:
            told.append(stamp(topic.waiting.popleft()))

    assert told == pytest.approx([0.0, 0.05, 0.1, 0.15])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tag", "severity", "message"),
    [
        (
            imu(reference="lod"),
            "error",
            "IMU 'imu': its reference is no link, 'lod'; did you mean 'load'?",
        ),
        (
            imu("<update_rate>-5</update_rate>", reference="load"),
            "warning",
            "IMU 'imu': update_rate: expected at least 0, got '-5'",
        ),
        (
            imu("<update_rate>500</update_rate>", reference="load"),
            "warning",
            "IMU 'imu': update_rate 500 Hz, above the controller manager's; it "
            "measures at 100 Hz, in each of its cycles",
        ),
        (
            imu(noise("<stddev>1</stddev>", kind="gausian"), reference="load"),
            "warning",
            "IMU 'imu', linear_acceleration/z: noise type: expected gaussian, "
            "gaussian_quantized or none, got 'gausian'",
        ),
        (
            imu(noise("<stddev>-1</stddev>"), reference="load"),
            "warning",
            "IMU 'imu', linear_acceleration/z: stddev: expected at least 0, got '-1'",
        ),
        (
            imu(noise("<sdev>1</sdev>"), reference="load"),
            "info",
            "IMU 'imu': <imu/linear_acceleration/z/noise/sdev>; it has no effect",
        ),
        (
            imu("<imu><noise><type>gaussian</type></noise></imu>", reference="load"),
            "info",
            "IMU 'imu': <imu/noise>; Gazebo doesn't read it in a URDF either; expected "
            "<noise> in <x>, <y> and <z> of <angular_velocity> and "
            "<linear_acceleration>",
        ),
        (
            imu(frame("EMU"), reference="load"),
            "warning",
            "IMU 'imu': unknown localization 'EMU'; did you mean 'ENU'? "
            "known: CUSTOM, ENU, NED, NWU; its orientations are relative to that at "
            "the start",
        ),
        (
            imu(frame("GRAV_UP"), reference="load"),
            "warning",
            "IMU 'imu': localization GRAV_UP, which Gazebo Sim doesn't know either; "
            "its orientations are relative to that at the start",
        ),
        (
            imu(frame("CUSTOM", "<custom_rpy>1 0 0</custom_rpy>"), reference="load"),
            "warning",
            "IMU 'imu': custom_rpy: expected parent_frame 'world', the only one that "
            "Gazebo Sim knows, got ''",
        ),
        (
            imu(
                frame("CUSTOM", '<custom_rpy parent_frame="world">1 0</custom_rpy>'),
                reference="load",
            ),
            "warning",
            "IMU 'imu': custom_rpy: expected roll, pitch, yaw, got '1 0'",
        ),
        (
            imu("<gz_frame_id>lod</gz_frame_id>", reference="load"),
            "warning",
            "IMU 'imu': its frame 'lod' is no link; did you mean 'load'? known: "
            "base, load; its messages name it all the same",
        ),
        (
            imu("<topic>my imu</topic>", reference="load"),
            "warning",
            "IMU 'imu': topic 'my imu': expected one without spaces, @, ~, // and :=",
        ),
        (
            imu(PLUGIN.format("<frameName>load</frameName>"), reference="load"),
            "info",
            "IMU 'imu': unknown tags of its plugin: frameName; they have no effect",
        ),
        (
            imu(
                PLUGIN.format("")
                .replace("imu_s", "create_imu|")
                .replace("create_imu|ensor", "create_imu"),
                reference="load",
            ),
            "info",
            "IMU 'imu': plugin 'libgazebo_ros_create_imu.so'; run as "
            "libgazebo_ros_imu_sensor.so, whose accelerations are less that of free "
            "fall: 9.81 upwards at rest",
        ),
    ],
)
def test_what_cannot_be_as_it_is_written_is_reported(
    tmp_path: Path, tag: str, severity: str, message: str
) -> None:
    yaml = models.trajectory_controllers({"arm": ["slide"]})

    robot = models.load(tmp_path, with_tag(models.LIFT, tag), yaml)

    lines = [str(e) for e in robot.report if e.severity == severity]
    assert any(message in line for line in lines), str(robot.report)


@pytest.mark.slow
def test_what_has_an_effect_is_not_reported_as_ignored(tmp_path: Path) -> None:
    system = '<gazebo><plugin filename="gz-sim-imu-system" name="i"/></gazebo>'
    tag = imu(f"{PLUGIN.format('')}<always_on>1</always_on>", reference="load")
    yaml = models.trajectory_controllers({"arm": ["slide"]})
    robot = models.load(tmp_path, with_tag(models.LIFT, tag + system), yaml)

    assert "imu" not in str(robot.report)
