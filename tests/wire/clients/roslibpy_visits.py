"""Twenty clients of roslibpy that come and go, some of them without a farewell."""

import json
import os
import sys
import time

import roslibpy

NUM_CLIENTS = 20


def main(port: int) -> None:
    seen: list[list] = [[] for _ in range(NUM_CLIENTS)]
    clients = []
    for messages in seen:
        ros = roslibpy.Ros("127.0.0.1", port)
        ros.run(timeout=20)
        roslibpy.Topic(ros, "/joint_states", "sensor_msgs/JointState").subscribe(
            messages.append
        )
        clients.append(ros)
        # Half of them go while others come.
        if len(clients) % 2 == 0:
            wait(seen[len(clients) - 2])
            clients[-2].close()
    for index, ros in enumerate(clients):
        if index % 2:
            wait(seen[index])
            names = ros.get_topics()
            assert "/joint_states" in names, names
    print(json.dumps([len(messages) for messages in seen]), flush=True)
    # Those that are left are cut off by the end of the process.


def wait(messages: list) -> None:
    """Wait for a message."""
    give_up = time.monotonic() + 30.0
    while not messages and time.monotonic() < give_up:
        time.sleep(0.005)


main(int(sys.argv[1]))
os._exit(0)
