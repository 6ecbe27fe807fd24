"""Gazebo plugins that concern joints, as their dataclasses."""

from pathlib import Path

import pytest

from arm_drake.description.gazebo import GazeboPlugin, JointPlugin, read_joint_plugins
from arm_drake.description.gazebo_plugins import (
    AckermannSteering,
    DiffDrive,
    GazeboRosAckermannDrive,
    GazeboRosDiffDrive,
    GazeboRosJointPoseTrajectory,
    GazeboRosJointStatePublisher,
    GazeboRosPlanarMove,
    JointController,
    JointPositionController,
    JointStatePublisher,
    JointTrajectoryController,
    MecanumDrive,
    Ros2ControlPlugin,
    VelocityControl,
)
from arm_drake.description.report import LoadReport

ROS2_CONTROL = "gz_ros2_control-system"
POSITION = "gz-sim-joint-position-controller-system"
VELOCITY = "gz-sim-joint-controller-system"
TRAJECTORY = "gz-sim-joint-trajectory-controller-system"
STATES = "gz-sim-joint-state-publisher-system"
DRIVE = "gz-sim-diff-drive-system"
ACKERMANN = "gz-sim-ackermann-steering-system"
MECANUM = "gz-sim-mecanum-drive-system"
CLASSIC_STATES = "libgazebo_ros_joint_state_publisher.so"
CLASSIC_TRAJECTORY = "libgazebo_ros_joint_pose_trajectory.so"
CLASSIC_DRIVE = "libgazebo_ros_diff_drive.so"


def read(
    filename: str, *fields: tuple[str, str]
) -> tuple[tuple[JointPlugin, ...], list[str]]:
    report = LoadReport()
    plugin = GazeboPlugin("p", filename, fields)
    found = read_joint_plugins([plugin], ["j", "k"], report, Path("arm.urdf"))
    return found, [str(entry) for entry in report]


J = ("joint_name", "j")
SIDES = (("left_joint", "j"), ("right_joint", "k"))
GAINS = (
    *("p_gain", "i_gain", "d_gain"),
    *("i_max", "i_min", "cmd_max", "cmd_min", "cmd_offset"),
)


def test_defaults_of_gazebo_sim_are_those_of_its_sources():
    (position,), (velocity,), (drive,) = (
        read(filename, *fields)[0]
        for filename, fields in (
            (POSITION, [J]),
            (VELOCITY, [J]),
            (DRIVE, SIDES),
        )
    )

    # JointPositionController.hh and JointController.hh, "System Parameters".
    assert [getattr(position, name) for name in GAINS] == [
        *(1.0, 0.1, 0.01),
        *(1.0, -1.0, 1000.0, -1000.0, 0.0),
    ]
    assert [getattr(velocity, name) for name in GAINS] == [
        *(1.0, 0.0, 0.0),
        *(1.0, -1.0, 1000.0, -1000.0, 0.0),
    ]
    assert (position.joint_index, position.initial_position) == (0, 0.0)
    assert not position.use_velocity_commands
    assert not velocity.use_force_commands
    # DiffDrive.cc.
    assert (drive.wheel_separation, drive.wheel_radius) == (1.0, 0.2)


def test_defaults_of_gazebo_classic_are_those_of_its_sources():
    (drive,), (states,), (trajectory,) = (
        read(filename, *fields)[0]
        for filename, fields in (
            (CLASSIC_DRIVE, SIDES),
            (CLASSIC_STATES, [J]),
            (CLASSIC_TRAJECTORY, []),
        )
    )

    # gazebo_ros_diff_drive.cpp.
    assert drive == GazeboRosDiffDrive(
        left_joints=("j",),
        right_joints=("k",),
        num_wheel_pairs=1,
        max_wheel_acceleration=0.0,
        max_wheel_torque=5.0,
        update_rate=100.0,
        odometry_source=1,
        odometry_frame="odom",
        robot_base_frame="base_footprint",
        covariance_x=1e-5,
        covariance_y=1e-5,
        covariance_yaw=1e-3,
    )
    # The other two .cpp files.
    assert (states.update_rate, trajectory.update_rate) == (100.0, 100.0)


def test_the_ros2_control_plugin_has_the_defaults_of_its_sources():
    (plugin,), lines = read(ROS2_CONTROL, ("parameters", "a.yaml"))

    assert plugin == Ros2ControlPlugin(
        parameters=("a.yaml",),
        controller_manager_name="controller_manager",
        hold_joints=True,
        position_proportional_gain=0.1,
        robot_param="robot_description",
        robot_param_node="robot_state_publisher",
    )
    assert plugin.manager == "controller_manager"
    assert lines == []


def test_the_ros2_control_plugin_has_all_its_fields():
    (plugin,), lines = read(
        ROS2_CONTROL,
        ("parameters", "a.yaml"),
        ("parameters", "b.yaml"),
        ("controller_manager_name", "boss"),
        ("hold_joints", "false"),
        ("position_proportional_gain", "0.5"),
        ("robot_param", "p"),
        ("robot_param_node", "n"),
        ("ros/namespace", "/r1"),
        ("ros/remapping", "a:=b"),
        ("ros/remapping", "c:=d"),
    )

    assert plugin == Ros2ControlPlugin(
        parameters=("a.yaml", "b.yaml"),
        controller_manager_name="boss",
        hold_joints=False,
        position_proportional_gain=0.5,
        robot_param="p",
        robot_param_node="n",
        namespace="/r1",
        remappings=("a:=b", "c:=d"),
    )
    assert lines == []


def test_the_old_prefix_is_the_start_of_the_managers_name():
    (plugin,), lines = read(
        ROS2_CONTROL, ("controller_manager_prefix_node_name", "left")
    )

    assert isinstance(plugin, Ros2ControlPlugin)
    assert plugin.manager == "left_controller_manager"
    assert lines == []


@pytest.mark.parametrize(
    ("filename", "fields", "expected"),
    [
        (
            POSITION,
            [
                J,
                ("joint_name", "k"),
                ("joint_index", "0"),
                ("p_gain", "30"),
                ("cmd_max", "5"),
                ("use_velocity_commands", "1"),
                ("initial_position", "-0.5"),
                ("topic", "/t"),
                ("actuatorNumber", "3"),
            ],
            JointPositionController(
                joint_names=("j", "k"),
                p_gain=30.0,
                cmd_max=5.0,
                use_velocity_commands=True,
                initial_position=-0.5,
                topic="/t",
                actuator_number=3,
            ),
        ),
        (
            VELOCITY,
            [J, ("initial_velocity", "2"), ("use_force_commands", "True")],
            JointController(("j",), initial_velocity=2.0, use_force_commands=True),
        ),
        (
            TRAJECTORY,
            [
                ("joint_name", "k"),
                J,
                ("initial_position", "1"),
                ("initial_position", "2"),
                ("position_p_gain", "10"),
                ("velocity_cmd_min", "-1"),
            ],
            JointTrajectoryController(
                ("k", "j"),
                initial_positions=(1.0, 2.0),
                position_p_gain=(10.0,),
                velocity_cmd_min=(-1.0,),
            ),
        ),
        (
            TRAJECTORY,
            [
                ("joint_names", "j k"),
                ("initial_positions", "0 1.5"),
                ("position_d_gain", " 1  2 "),
            ],
            JointTrajectoryController(
                ("j", "k"), initial_positions=(0.0, 1.5), position_d_gain=(1.0, 2.0)
            ),
        ),
        (TRAJECTORY, [], JointTrajectoryController()),
        (STATES, [], JointStatePublisher()),
        (
            STATES,
            [("topic", "joint_states"), J],
            JointStatePublisher(("j",), "joint_states"),
        ),
        (
            DRIVE,
            [*SIDES, ("wheel_separation", "0.4"), ("max_velocity", "2")],
            DiffDrive(("j",), ("k",), wheel_separation=0.4, max_velocity=2.0),
        ),
        (
            DRIVE,
            [*SIDES, ("max_linear_velocity", "2"), ("min_angular_jerk", "-3")],
            DiffDrive(("j",), ("k",), max_linear_velocity=2.0, min_angular_jerk=-3.0),
        ),
        (
            CLASSIC_STATES,
            [J, ("update_rate", "20"), ("ros/argument", "joint_states:=s")],
            GazeboRosJointStatePublisher(
                ("j",), update_rate=20.0, remappings=("joint_states:=s",)
            ),
        ),
        (
            CLASSIC_TRAJECTORY,
            [("update_rate", "20"), ("ros/namespace", "/n")],
            GazeboRosJointPoseTrajectory(update_rate=20.0, namespace="/n"),
        ),
        (
            CLASSIC_DRIVE,
            [
                *SIDES,
                ("left_joint", "k"),
                ("right_joint", "j"),
                ("num_wheel_pairs", "2"),
                ("wheel_separation", "0.3"),
                ("wheel_separation", "0.4"),
                ("publish_odom", "true"),
            ],
            GazeboRosDiffDrive(
                left_joints=("j", "k"),
                right_joints=("k", "j"),
                num_wheel_pairs=2,
                wheel_separation=(0.3, 0.4),
                publish_odom=True,
            ),
        ),
    ],
)
def test_a_plugin_has_the_fields_that_are_given(filename, fields, expected):
    assert read(filename, *fields) == ((expected,), [])


@pytest.mark.parametrize(
    ("field", "problem"),
    [
        (("p_gain", "big"), "p_gain: expected a number, got 'big'"),
        (("joint_index", "0.5"), "joint_index: expected an integer, got '0.5'"),
        (("joint_index", "one"), "joint_index: expected an integer, got 'one'"),
        (
            ("use_velocity_commands", "yes"),
            "use_velocity_commands: expected true or false, got 'yes'",
        ),
    ],
)
def test_a_malformed_field_keeps_its_default(field, problem):
    found, lines = read(POSITION, J, field)

    assert found == (JointPositionController(("j",)),)
    assert lines == [
        f"warning: arm.urdf: Gazebo plugin 'p': {problem}; taken as not given"
    ]


def test_a_malformed_list_is_not_given():
    found, lines = read(TRAJECTORY, ("position_p_gain", "1 x"))

    assert found == (JointTrajectoryController(),)
    assert lines == [
        "warning: arm.urdf: Gazebo plugin 'p': "
        "position_p_gain: expected a number, got 'x'; taken as not given"
    ]


def test_unknown_tags_are_reported():
    _, lines = read(ROS2_CONTROL, ("robot_sim_type", "x"), ("gain@joint", "j"))

    assert lines == [
        "info: arm.urdf: Gazebo plugin 'p': unknown tags: "
        "gain@joint, robot_sim_type; they have no effect"
    ]


def test_joints_that_the_robot_lacks_are_left_out():
    found, lines = read(STATES, J, ("joint_name", "x"))

    assert found == (JointStatePublisher(("j",)),)
    assert lines == [
        "error: arm.urdf: Gazebo plugin 'p': the robot has no joint 'x'; "
        "known: j, k; the joint is left out"
    ]


@pytest.mark.parametrize(
    ("filename", "fields", "problem"),
    [
        (POSITION, [], "no joint; expected <joint_name>"),
        (VELOCITY, [], "no joint; expected <joint_name>"),
        (CLASSIC_STATES, [], "no joint; expected <joint_name>"),
        (STATES, [("joint_name", "x")], "the robot has none of its joints: x"),
        (DRIVE, [("left_joint", "j")], "no joint; expected <right_joint>"),
        (
            CLASSIC_DRIVE,
            [*SIDES, ("left_joint", "j")],
            "expected 1 left and 1 right joints, got 2 and 1",
        ),
        (
            CLASSIC_DRIVE,
            [*SIDES, ("num_wheel_pairs", "2")],
            "expected 2 left and 2 right joints, got 1 and 1",
        ),
        (
            DRIVE,
            [*SIDES, ("wheel_radius", "0")],
            "wheel_radius: expected a length above 0 m, got 0",
        ),
        (
            DRIVE,
            [*SIDES, ("wheel_separation", "-1")],
            "wheel_separation: expected a length above 0 m, got -1",
        ),
        (
            CLASSIC_DRIVE,
            [*SIDES, ("wheel_diameter", "-0.1")],
            "wheel_diameter: expected a length above 0 m, got -0.1",
        ),
        (
            CLASSIC_DRIVE,
            [*SIDES, ("max_wheel_torque", "0")],
            "max_wheel_torque: expected more than 0, got 0",
        ),
        (
            CLASSIC_DRIVE,
            [*SIDES, ("max_wheel_acceleration", "-1")],
            "max_wheel_acceleration: expected at least 0, got -1",
        ),
        (
            CLASSIC_DRIVE,
            [*SIDES, ("odometry_source", "2")],
            "odometry_source: expected 0 (encoder) or 1 (world), got 2",
        ),
    ],
)
def test_a_plugin_that_gazebo_refuses_is_left_out(filename, fields, problem):
    found, lines = read(filename, *fields)

    assert found == ()
    assert lines[-1] == (
        f"error: arm.urdf: Gazebo plugin 'p': {problem}; the plugin is left out"
    )


def test_a_plugin_without_a_name_is_called_by_its_library():
    report = LoadReport()

    read_joint_plugins([GazeboPlugin("", POSITION)], ["j"], report, Path("arm.urdf"))

    (entry,) = report
    assert entry.where == f"Gazebo plugin {POSITION!r}"


def test_the_path_of_a_controllers_file_may_hold_a_space():
    (plugin,), _ = read(ROS2_CONTROL, ("parameters", "my robot/a.yaml"))

    assert isinstance(plugin, Ros2ControlPlugin)
    assert plugin.parameters == ("my robot/a.yaml",)


def test_other_plugins_are_passed_over_and_the_rest_keep_their_order():
    plugins = [
        GazeboPlugin("a", "libgazebo_ros_camera.so"),
        GazeboPlugin("b", STATES),
        GazeboPlugin("c", POSITION, (J,)),
    ]

    found = read_joint_plugins(plugins, ["j"], LoadReport(), Path("arm.urdf"))

    assert found == (JointStatePublisher(), JointPositionController(("j",)))


CORNERS = tuple(
    (f"{corner}_joint", joint)
    for corner, joint in (
        *(("front_left", "j"), ("front_right", "k")),
        *(("back_left", "j"), ("back_right", "k")),
    )
)


def test_a_mecanum_drive_has_the_defaults_of_its_source():
    (drive,), lines = read(MECANUM, *CORNERS)

    # MecanumDrive.hh.
    assert drive == MecanumDrive(
        *(("j",), ("k",), ("j",), ("k",)),
        wheel_separation=1.0,
        wheelbase=1.0,
        wheel_radius=0.2,
        odom_publish_frequency=50.0,
    )
    assert lines == []


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        (
            (*CORNERS[:3], ("back_right_joint", "kk")),
            [
                "error: arm.urdf: Gazebo plugin 'p': the robot has no joint 'kk'; "
                "did you mean 'k'? known: j, k; the joint is left out",
                "error: arm.urdf: Gazebo plugin 'p': the robot has none of its joints: "
                "kk; the plugin is left out",
            ],
        ),
        (
            CORNERS[:3],
            [
                "error: arm.urdf: Gazebo plugin 'p': no joint; expected "
                "<back_right_joint>; the plugin is left out"
            ],
        ),
        (
            (*CORNERS, ("wheelbase", "0")),
            [
                "error: arm.urdf: Gazebo plugin 'p': wheelbase: expected a length "
                "above 0 m, got 0; the plugin is left out"
            ],
        ),
        (
            (*CORNERS, ("odom_topic", "/o"), ("tf_topic", "o")),
            [
                "error: arm.urdf: Gazebo plugin 'p': odom_topic and tf_topic are both "
                "'o'; the plugin is left out"
            ],
        ),
    ],
)
def test_a_mecanum_drive_that_can_t_drive_is_left_out(fields, expected):
    assert read(MECANUM, *fields) == ((), expected)


def test_a_tag_that_a_mecanum_drive_does_not_know_is_named():
    (_,), lines = read(MECANUM, *CORNERS, ("wheel_base", "0.4"))

    assert lines == [
        "info: arm.urdf: Gazebo plugin 'p': unknown tags: wheel_base (did you mean "
        "'wheelbase'?); they have no effect"
    ]


STEERING = (("left_steering_joint", "j"), ("right_steering_joint", "k"))


def test_an_ackermann_steering_has_the_defaults_of_its_source():
    (drive,), lines = read(ACKERMANN, *SIDES, *STEERING)

    # AckermannSteering.cc.
    assert drive == AckermannSteering(
        *(("j",), ("k",), ("j",), ("k",)),
        wheel_separation=1.0,
        kingpin_width=0.8,
        wheel_base=1.0,
        steering_limit=0.5,
        wheel_radius=0.2,
        steer_p_gain=1.0,
        steer_i_gain=0.0,
        steer_d_gain=0.0,
        steer_i_max=0.0,
        steer_i_min=0.0,
        steer_cmd_max=1000.0,
        steer_cmd_min=-1000.0,
        steer_cmd_offset=0.0,
    )
    assert lines == []


@pytest.mark.parametrize(
    "alone",
    [
        [("steering_only", "true")],
        [("use_actuator_msg", "true"), ("actuator_number", "2")],
    ],
)
def test_an_ackermann_steering_that_steers_alone_needs_no_wheels(alone):
    (drive,), lines = read(ACKERMANN, *STEERING, *alone)

    assert (drive.driven_joints, drive.steered_joints) == ((), ("j", "k"))
    assert lines == []


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        (STEERING, "no joint; expected <left_joint>"),
        (
            [*STEERING, ("use_actuator_msg", "true")],
            "no joint; expected <left_joint>",
        ),
        ([*SIDES, STEERING[0]], "no joint; expected <right_steering_joint>"),
        (
            [*SIDES, *STEERING, ("wheel_base", "-1")],
            "wheel_base: expected a length above 0 m, got -1",
        ),
        (
            [*SIDES, *STEERING, ("kingpin_width", "0")],
            "kingpin_width: expected a length above 0 m, got 0",
        ),
        (
            [*SIDES, *STEERING, ("steering_limit", "30")],
            "steering_limit: expected an angle above 0 and below a quarter of a turn, "
            "got 30",
        ),
    ],
)
def test_an_ackermann_steering_that_can_t_drive_is_left_out(fields, problem):
    line = f"error: arm.urdf: Gazebo plugin 'p': {problem}; the plugin is left out"
    assert read(ACKERMANN, *fields) == ((), [line])


def test_plugins_that_set_a_velocity_have_the_defaults_of_their_sources():
    (control,), _ = read("gz-sim-velocity-control-system")
    (planar,), _ = read("libgazebo_ros_planar_move.so")

    # VelocityControl.cc and gazebo_ros_planar_move.cpp.
    assert control == VelocityControl(initial_linear=(), initial_angular=(), topic="")
    assert planar == GazeboRosPlanarMove(
        update_rate=20.0,
        publish_rate=20.0,
        odometry_frame="odom",
        robot_base_frame="base_footprint",
        publish_odom=True,
        publish_odom_tf=True,
        covariance_x=1e-5,
        covariance_y=1e-5,
        covariance_yaw=1e-3,
    )


def test_an_initial_velocity_has_three_numbers():
    velocity = "gz-sim-velocity-control-system"
    (control,), lines = read(velocity, ("initial_linear", "1 2 3"))
    refused = read(velocity, ("initial_angular", "1"))

    assert (control.initial_linear, lines) == ((1.0, 2.0, 3.0), [])
    assert refused == (
        (),
        [
            "error: arm.urdf: Gazebo plugin 'p': initial_angular: expected three "
            "numbers, got 1; the plugin is left out"
        ],
    )


@pytest.mark.parametrize("name", ["velocity", "linear_acceleration", "angular_jerk"])
def test_a_minimum_above_its_maximum_is_reported(name):
    limits = ((f"min_{name}", "2"), (f"max_{name}", "1"))
    found, lines = read(
        "gz-sim-diff-drive-system", ("left_joint", "j"), ("right_joint", "k"), *limits
    )

    assert len(found) == 1
    assert lines == [
        f"warning: arm.urdf: Gazebo plugin 'p': min_{name}: expected at most "
        f"max_{name}, 1, got 2; the minimum holds"
    ]


def test_an_initial_velocity_is_finite():
    found, lines = read("gz-sim-velocity-control-system", ("initial_linear", "0 inf 0"))

    assert (found, lines) == (
        (),
        [
            "error: arm.urdf: Gazebo plugin 'p': initial_linear: expected finite "
            "numbers, got inf; the plugin is left out"
        ],
    )


CLASSIC_ACKERMANN = "libgazebo_ros_ackermann_drive.so"
PARTS = (
    *("front_right_joint", "front_left_joint", "rear_right_joint", "rear_left_joint"),
    *("right_steering_joint", "left_steering_joint"),
)
NAMED = tuple((part, "jk"[k % 2]) for k, part in enumerate(PARTS))


def test_classic_s_ackermann_drive_has_the_defaults_of_its_source():
    (drive,), lines = read(CLASSIC_ACKERMANN, *NAMED)

    # gazebo_ros_ackermann_drive.cpp; the robot has no joint steering_wheel_joint.
    assert drive == GazeboRosAckermannDrive(
        *((name,) for name in "jkjkjk"),
        steering_wheel_joints=(),
        max_speed=20.0,
        max_steer=0.6,
        max_steering_angle=7.85,
        update_rate=100.0,
        odometry_frame="odom",
        robot_base_frame="base_footprint",
        publish_odom=False,
        publish_odom_tf=False,
        publish_wheel_tf=False,
        publish_distance=False,
        covariance_x=1e-5,
        covariance_y=1e-5,
        covariance_yaw=1e-3,
    )
    assert lines == []


def test_joints_of_classic_s_ackermann_drive_are_called_as_their_tags():
    plugin = GazeboPlugin("p", CLASSIC_ACKERMANN)
    names = [*PARTS, "steering_wheel_joint"]

    (drive,) = read_joint_plugins([plugin], names, LoadReport(), Path("arm.urdf"))

    assert drive.all_joints == tuple(names)


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        (NAMED[:-1], "no joint; expected <left_steering_joint>"),
        (
            (*NAMED, ("left_steering_pid_gain", "1 2")),
            "left_steering_pid_gain: expected three numbers, got 2",
        ),
        (
            (*NAMED, ("linear_velocity_i_range", "1")),
            "linear_velocity_i_range: expected two numbers, got 1",
        ),
        (
            (*NAMED, ("max_steering_angle", "0")),
            "max_steering_angle: expected a number above 0, got 0",
        ),
    ],
)
def test_classic_s_ackermann_drive_that_can_t_drive_is_left_out(fields, problem):
    line = f"error: arm.urdf: Gazebo plugin 'p': {problem}; the plugin is left out"
    assert read(CLASSIC_ACKERMANN, *fields) == ((), [line])


def test_a_steering_wheel_that_is_named_and_missing_is_said():
    (_,), lines = read(CLASSIC_ACKERMANN, *NAMED, ("steering_wheel_joint", "jj"))

    assert lines == [
        "error: arm.urdf: Gazebo plugin 'p': the robot has no joint 'jj'; did you mean "
        "'j'? known: j, k; the joint is left out",
    ]
