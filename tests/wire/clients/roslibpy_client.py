"""A user's session with roslibpy, from first to last, printed."""

import json
import sys
import time

import roslibpy

JTC = "/joint_trajectory_controller"
JOINTS = [f"joint{index}" for index in range(1, 7)]


def goal(target: float, seconds: int) -> roslibpy.Goal:
    point = {"positions": [target] * 6, "time_from_start": {"sec": seconds}}
    return roslibpy.Goal({"trajectory": {"joint_names": JOINTS, "points": [point]}})


def call(ros: roslibpy.Ros, name: str, type_: str, **request: object) -> dict:
    service = roslibpy.Service(ros, name, type_)
    return dict(service.call(roslibpy.ServiceRequest(request), timeout=10))


def collect(ros: roslibpy.Ros, name: str, type_: str, **options: object) -> list:
    messages: list = []
    roslibpy.Topic(ros, name, type_, **options).subscribe(messages.append)
    return messages


def stamp(message: dict) -> float:
    return (
        message["header"]["stamp"]["sec"] + 1e-9 * message["header"]["stamp"]["nanosec"]
    )


def wait(states: list, seconds: float) -> None:
    """Wait for so much simulated time, whatever else the machine does."""
    give_up = time.monotonic() + 60.0
    while not states and time.monotonic() < give_up:
        time.sleep(0.01)
    end = stamp(states[-1]) + seconds
    while stamp(states[-1]) < end and time.monotonic() < give_up:
        time.sleep(0.01)


def follow(ros: roslibpy.Ros, seconds: int, *, cancel: bool) -> dict:
    name, type_ = f"{JTC}/follow_joint_trajectory", "control_msgs/FollowJointTrajectory"
    client = roslibpy.ActionClient(ros, name, type_)
    results: list = []
    feedback: list = []
    id_ = client.send_goal(
        goal(0.2, seconds), results.append, feedback.append, results.append
    )
    if cancel:
        time.sleep(0.3)
        client.cancel_goal(id_)
    client.wait_goal(id_, 20)
    result = dict(results[0])
    return {
        "status": int(result["status"].value),
        "values": result["values"],
        "feedback": [dict(each) for each in feedback],
    }


def main(port: int) -> None:
    ros = roslibpy.Ros("127.0.0.1", port)
    ros.run(timeout=10)
    states = collect(ros, "/joint_states", "sensor_msgs/JointState")
    slow = collect(ros, "/clock", "rosgraph_msgs/Clock", throttle_rate=200)
    description = collect(ros, "/robot_description", "std_msgs/String")
    frames = collect(ros, "/tf", "tf2_msgs/TFMessage")
    fixed = collect(ros, "/tf_static", "tf2_msgs/TFMessage")
    state = collect(
        ros, f"{JTC}/controller_state", "control_msgs/JointTrajectoryControllerState"
    )
    began = time.monotonic()
    wait(states, 1.0)
    counts = {"joint_states": len(states), "clock": len(slow), "tf": len(frames)}
    spans = {
        "joint_states": stamp(states[counts["joint_states"] - 1]) - stamp(states[0]),
        "tf": stamp(frames[counts["tf"] - 1]["transforms"][0])
        - stamp(frames[0]["transforms"][0]),
        "clock": time.monotonic() - began,
    }
    errors: list = []
    roslibpy.Service(ros, "/no/such", "std_srvs/Empty").call(
        roslibpy.ServiceRequest({}), callback=errors.append, errback=errors.append
    )
    reached = follow(ros, 1, cancel=False)
    cancelled = follow(ros, 8, cancel=True)
    topic = roslibpy.Topic(
        ros, f"{JTC}/joint_trajectory", "trajectory_msgs/JointTrajectory"
    )
    topic.publish(roslibpy.Message(goal(-0.1, 1)["trajectory"]))
    wait(states, 1.5)
    listed = call(
        ros,
        "/controller_manager/list_controllers",
        "controller_manager_msgs/ListControllers",
    )
    names = {"names": ["constraints.goal_time", "joints", "no_such"]}
    values = call(ros, f"{JTC}/get_parameters", "rcl_interfaces/GetParameters", **names)
    switched = call(
        ros,
        "/controller_manager/switch_controller",
        "controller_manager_msgs/SwitchController",
        deactivate_controllers=["joint_trajectory_controller"],
        strictness=2,
    )
    # Of one instant, whatever is on its way.
    at = {stamp(each): each for each in states}
    frame = next(f for f in reversed(frames) if stamp(f["transforms"][0]) in at)
    seen = {
        "counts": counts,
        "spans": spans,
        "states": [states[0], at[stamp(frame["transforms"][0])]],
        "description": description,
        "frames": frame,
        "fixed": fixed,
        "state": state[-1],
        "errors": [str(error) for error in errors],
        "reached": reached,
        "cancelled": cancelled,
        "controllers": listed["controller"],
        "parameters": values["values"],
        "switched": switched,
        "topics": ros.get_topics(),
        "topic_type": ros.get_topic_type("/joint_states"),
        "services": ros.get_services(),
        "nodes": ros.get_nodes(),
        "time": dict(ros.get_time()),
        "param": ros.get_param(f"{JTC}:constraints.goal_time"),
    }
    print(json.dumps(seen))
    ros.terminate()


main(int(sys.argv[1]))
