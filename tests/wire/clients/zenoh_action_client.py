"""An action as zenoh-ros2-sdk sees it: three services and two topics.

It runs in an environment of its own. What types there are and their hashes it finds in
the graph; the definitions it has, so that it needs no net.
"""

import json
import sys
import time
import uuid

import numpy as np
from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import (
    ROS2ServiceClient,
    ROS2Subscriber,
    ZenohSession,
    get_service_info,
    get_topic_info,
)

ACTION = "/joint_trajectory_controller/follow_joint_trajectory/_action"
JOINTS = [f"joint{index}" for index in range(1, 7)]
TRAJECTORY = "control_msgs/msg/FollowJointTrajectory"
ID = "unique_identifier_msgs/UUID goal_id\n"
MESSAGES = {
    "control_msgs/msg/JointTolerance": (
        "string name\nfloat64 position\nfloat64 velocity\nfloat64 acceleration\n"
    ),
    "control_msgs/msg/JointComponentTolerance": (
        "string joint_name\nuint16 component\nfloat64 position\nfloat64 velocity\n"
        "float64 acceleration\n"
    ),
    f"{TRAJECTORY}_Goal": (
        "trajectory_msgs/JointTrajectory trajectory\n"
        "trajectory_msgs/MultiDOFJointTrajectory multi_dof_trajectory\n"
        "JointTolerance[] path_tolerance\n"
        "JointComponentTolerance[] component_path_tolerance\n"
        "JointTolerance[] goal_tolerance\n"
        "JointComponentTolerance[] component_goal_tolerance\n"
        "builtin_interfaces/Duration goal_time_tolerance\n"
    ),
    f"{TRAJECTORY}_Result": "int32 error_code\nstring error_string\n",
    f"{TRAJECTORY}_Feedback": (
        "std_msgs/Header header\nstring[] joint_names\n"
        "trajectory_msgs/JointTrajectoryPoint desired\n"
        "trajectory_msgs/JointTrajectoryPoint actual\n"
        "trajectory_msgs/JointTrajectoryPoint error\n"
        "string[] multi_dof_joint_names\n"
        "trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_desired\n"
        "trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_actual\n"
        "trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_error\n"
    ),
}


class Client:
    """The client of an action."""

    def __init__(self, port: int) -> None:
        self._where = {"router_ip": "127.0.0.1", "router_port": port, "domain_id": 0}
        session = ZenohSession.get_instance("127.0.0.1", port)
        session.store.register(get_typestore(Stores.ROS2_JAZZY).fielddefs)
        for name, text in MESSAGES.items():
            session.register_message_type(text, name)
        self._types = session.store.types
        self.statuses: list[list[int]] = []
        self.feedback: list = []
        self._send = self._service(
            "send_goal",
            f"{ID}control_msgs/FollowJointTrajectory_Goal goal\n",
            "bool accepted\nbuiltin_interfaces/Time stamp\n",
        )
        self._result = self._service(
            "get_result",
            ID,
            "int8 status\ncontrol_msgs/FollowJointTrajectory_Result result\n",
        )
        self._cancel = self._service(
            "cancel_goal",
            "action_msgs/GoalInfo goal_info\n",
            "int8 return_code\naction_msgs/GoalInfo[] goals_canceling\n",
        )
        self._kept = [
            self._topic(
                "feedback",
                f"{ID}control_msgs/FollowJointTrajectory_Feedback feedback\n",
                self.feedback.append,
            ),
            self._topic(
                "status",
                "action_msgs/GoalStatus[] status_list\n",
                lambda m: self.statuses.append([each.status for each in m.status_list]),
            ),
        ]

    def _service(self, name: str, request: str, response: str) -> ROS2ServiceClient:
        name = f"{ACTION}/{name}"
        [server] = get_service_info(name, verbose=True, **self._where).servers
        return ROS2ServiceClient(
            service_name=name,
            srv_type=server.service_type,
            type_hash=server.type_hash,
            request_definition=request,
            response_definition=response,
            timeout=20.0,
            **self._where,
        )

    def _topic(self, name: str, text: str, take: object) -> ROS2Subscriber:
        name = f"{ACTION}/{name}"
        [publisher] = get_topic_info(name, verbose=True, **self._where).publishers
        return ROS2Subscriber(
            topic=name,
            msg_type=publisher.topic_type,
            type_hash=publisher.type_hash,
            msg_definition=text,
            callback=take,
            **self._where,
        )

    def make(self, name: str, **fields: object) -> object:
        """Return a message, given those of its fields that aren't empty."""
        values = {
            "multi_dof_trajectory": lambda: self.make(
                "trajectory_msgs/msg/MultiDOFJointTrajectory",
                header=self.header(),
                joint_names=[],
                points=[],
            ),
            "goal_time_tolerance": lambda: self.duration(0),
        }
        cls = self._types[name]
        for each in cls.__dataclass_fields__:
            if each not in fields and not each.startswith("__"):
                fields[each] = values.get(each, list)()
        return cls(**{k: v for k, v in fields.items() if not k.startswith("__")})

    def duration(self, seconds: int) -> object:
        """Return a duration."""
        return self._types["builtin_interfaces/msg/Duration"](sec=seconds, nanosec=0)

    def header(self) -> object:
        """Return an empty header."""
        time_ = self._types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
        return self._types["std_msgs/msg/Header"](stamp=time_, frame_id="")

    def id(self) -> object:
        """Return a new identifier."""
        bytes_ = np.frombuffer(uuid.uuid4().bytes, dtype=np.uint8)
        return self._types["unique_identifier_msgs/msg/UUID"](uuid=bytes_)

    def send(self, names: list[str], target: float, seconds: int) -> tuple:
        """Send a goal; return its identifier and the answer."""
        nothing = np.zeros(0)
        point = self._types["trajectory_msgs/msg/JointTrajectoryPoint"](
            positions=np.full(6, target),
            velocities=nothing,
            accelerations=nothing,
            effort=nothing,
            time_from_start=self.duration(seconds),
        )
        trajectory = self._types["trajectory_msgs/msg/JointTrajectory"](
            header=self.header(), joint_names=names, points=[point]
        )
        id_ = self.id()
        goal = self.make(f"{TRAJECTORY}_Goal", trajectory=trajectory)
        return id_, self._send.call(goal_id=id_, goal=goal)

    def result(self, id_: object) -> object:
        """Wait for the result of a goal."""
        return self._result.call(goal_id=id_)

    def cancel(self, id_: object) -> object:
        """Cancel a goal."""
        stamp = self.header().stamp
        info = self._types["action_msgs/msg/GoalInfo"](goal_id=id_, stamp=stamp)
        return self._cancel.call(goal_info=info)


def main(port: int) -> None:
    client = Client(port)
    first, accepted = client.send(JOINTS, 0.1, 1)
    reached = client.result(first)
    news = [m for m in client.feedback if bytes(m.goal_id.uuid) == bytes(first.uuid)]
    # Another goal takes the place of one that moves.
    replaced, _ = client.send(JOINTS, 0.5, 9)
    second, _ = client.send(JOINTS, -0.5, 9)
    aborted = client.result(replaced)
    answer = client.cancel(second)
    cancelled = client.result(second)
    _, refused = client.send(["nobody"] * 6, 0.1, 1)
    unknown = client.cancel(client.id())
    end = time.monotonic() + 10.0
    while client.statuses[-1] != [4, 6, 5] and time.monotonic() < end:
        time.sleep(0.01)
    seen = {
        "accepted": [bool(accepted.accepted), bool(refused.accepted)],
        "reached": [reached.status, reached.result.error_code],
        "joints": news[0].feedback.joint_names,
        "positions": [float(m.feedback.actual.positions[0]) for m in news],
        "aborted": aborted.status,
        "cancel": [answer.return_code, len(answer.goals_canceling)],
        "cancelled": cancelled.status,
        "unknown": unknown.return_code,
        "statuses": client.statuses[-1],
    }
    print(json.dumps(seen))


try:
    main(int(sys.argv[1]))
finally:
    # A session that is open keeps the process.
    ZenohSession.get_instance().close()
