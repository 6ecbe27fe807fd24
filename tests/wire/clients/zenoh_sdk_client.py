"""A simulation as zenoh-ros2-sdk sees it, printed.

It runs in an environment of its own, and has the definitions, so that it needs no net.
"""

import json
import sys
import time

from zenoh_ros2_sdk import ROS2Publisher, ROS2ServiceClient, ROS2Subscriber
from zenoh_ros2_sdk.qos import QosDurability, QosProfile


def main(port: int, names: list[str]) -> None:
    where = {"router_ip": "127.0.0.1", "router_port": port, "domain_id": 0}
    texts: list[str] = []
    subscriber = ROS2Subscriber(
        topic="/robot_description",
        msg_type="std_msgs/msg/String",
        msg_definition="string data\n",
        callback=lambda message: texts.append(message.data),
        qos=QosProfile(durability=QosDurability.TRANSIENT_LOCAL, history_depth=1),
        **where,
    )
    client = ROS2ServiceClient(
        service_name="/controller_manager/load_controller",
        srv_type="controller_manager_msgs/srv/LoadController",
        request_definition="string name\n",
        response_definition="bool ok\n",
        timeout=10.0,
        **where,
    )
    answers = []
    for name in names:
        response = client.call(name=name)
        answers.append(None if response is None else bool(response.ok))
    publisher = ROS2Publisher(
        topic="/joint_trajectory_controller/speed_scaling_input",
        msg_type="control_msgs/msg/SpeedScalingFactor",
        msg_definition="float64 factor\n",
        **where,
    )
    time.sleep(0.5)
    publisher.publish(factor=0.5)
    time.sleep(0.5)
    print(json.dumps({"description": texts, "answers": answers}))
    for each in (subscriber, client, publisher):
        each.close()


main(int(sys.argv[1]), sys.argv[2:])
