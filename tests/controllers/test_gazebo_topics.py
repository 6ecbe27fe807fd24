"""Names of topics, against those of gz-sim's and ROS 2's documentation."""

import pytest

from arm_drake.controllers.gazebo.plugin import (
    GazeboTag,
    drive_topics,
    find_unsupported,
    joint_state_topic,
    position_topic,
    ros_topic,
    trajectory_topic,
    velocity_topic,
)
from arm_drake.description.gazebo_plugins import (
    AckermannSteering,
    DiffDrive,
    GazeboRosDiffDrive,
    GazeboRosJointPoseTrajectory,
    GazeboRosJointStatePublisher,
    JointController,
    JointPositionController,
    JointStatePublisher,
    JointTrajectoryController,
    VelocityControl,
)


@pytest.mark.parametrize(
    ("fields", "topic"),
    [
        ({}, "/model/arm/joint/j/cmd_pos"),
        ({"joint_index": 1}, "/model/arm/joint/j/1/cmd_pos"),
        ({"topic": "go"}, "/go"),
        ({"topic": "/go/there"}, "/go/there"),
        ({"topic": "//go", "sub_topic": "x"}, "/go"),
        ({"sub_topic": "left/go"}, "/model/arm/left/go"),
        ({"topic": " my topic "}, "/my_topic"),
    ],
)
def test_the_topic_of_a_position_controller(
    fields: dict[str, object], topic: str
) -> None:
    tag = JointPositionController(("j", "k"), **fields)  # type: ignore[arg-type]

    assert position_topic(tag, "arm") == topic


def test_topics_of_the_other_plugins() -> None:
    assert velocity_topic(JointController(("j",)), "arm") == (
        "/model/arm/joint/j/cmd_vel"
    )
    assert velocity_topic(JointController(("j",), topic="v"), "arm") == "/v"
    assert trajectory_topic(JointTrajectoryController(), "my arm") == (
        "/model/my_arm/joint_trajectory"
    )
    assert trajectory_topic(JointTrajectoryController(topic="t"), "arm") == "/t"
    assert joint_state_topic(JointStatePublisher(), "arm", "house") == (
        "/world/house/model/arm/joint_state"
    )
    assert joint_state_topic(JointStatePublisher((), "s"), "arm", "house") == "/s"


def test_topics_of_a_drive() -> None:
    assert drive_topics(DiffDrive(("j",), ("k",)), "arm") == (
        *("/model/arm/cmd_vel", "/model/arm/enable"),
        *("/model/arm/odometry", "/model/arm/tf"),
    )
    tag = DiffDrive(("j",), ("k",), topic="go", odom_topic="/o/m", tf_topic="/tf")
    assert drive_topics(tag, "arm") == ("/go", "/model/arm/enable", "/o/m", "/tf")


@pytest.mark.parametrize(
    ("namespace", "remappings", "topic"),
    [
        ("", (), "/joint_states"),
        ("/r1", (), "/r1/joint_states"),
        ("r1/", (), "/r1/joint_states"),
        ("", ("joint_states:=s",), "/s"),
        ("/r1", ("joint_states:=s",), "/r1/s"),
        ("/r1", ("joint_states:=/s",), "/s"),
        ("/r1", ("/r1/joint_states:=s",), "/r1/s"),
        ("/r1", ("/joint_states:=s",), "/r1/joint_states"),
        ("", ("other:=x", "joint_states:=s", "joint_states:=t"), "/s"),
        ("/r1", ("__ns:=/r2",), "/r2/joint_states"),
        ("/r1", ("joint_states:=a/b", "__ns:=/r2"), "/r2/a/b"),
    ],
)
def test_namespaces_and_remappings(
    namespace: str, remappings: tuple[str, ...], topic: str
) -> None:
    assert ros_topic("joint_states", namespace, remappings) == topic


@pytest.mark.parametrize(
    ("tag", "problems"),
    [
        (JointPositionController(("j",)), []),
        (JointController(("j",)), []),
        (JointTrajectoryController(), []),
        (AckermannSteering(steering_only=True), []),
        (
            VelocityControl(link_names=("a", "b")),
            ["link_name: a, b: only the robot's base is moved"],
        ),
        (
            AckermannSteering(use_actuator_msg=True, actuator_number=0),
            [
                "use_actuator_msg: no messages of actuators are taken; its topic takes "
                "the angle as a number"
            ],
        ),
        (
            AckermannSteering(use_actuator_msg=True),
            ["use_actuator_msg: it needs an <actuator_number> from 0 on"],
        ),
        (GazeboRosJointStatePublisher(("j",), remappings=("a:=/b",)), []),
        (
            JointPositionController(("j",), use_actuator_msg=True, joint_index=2),
            [
                "use_actuator_msg: no messages of actuators are taken; the joint's own "
                "topic takes numbers",
            ],
        ),
        (
            JointController(("j",), use_actuator_msg=True),
            [
                "use_actuator_msg: no messages of actuators are taken; the joint's own "
                "topic takes numbers"
            ],
        ),
        (DiffDrive(("j",), ("k",)), []),
        (
            GazeboRosDiffDrive(
                ("j",),
                ("k",),
                wheel_separation=(0.3, 0.4),
                wheel_diameter=(0.1,),
                remappings=("odom=o",),
            ),
            [
                "wheel_separation: 2 values for 1 pairs of wheels",
                "remapping 'odom=o': expected from:=to, with names of topics",
            ],
        ),
        (
            GazeboRosJointPoseTrajectory(
                remappings=("a:=b", "~/a:=b", "a=b", "a:=~/b")
            ),
            [
                "remapping 'a=b': expected from:=to, with names of topics",
                "remapping 'a:=~/b': expected from:=to, with names of topics",
            ],
        ),
    ],
)
def test_what_is_not_done_is_said(tag: GazeboTag, problems: list[str]) -> None:
    assert find_unsupported(tag) == problems
