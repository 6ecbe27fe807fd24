// What a web page does with roslib, from first to last; it prints what it saw.
import * as ROSLIB from "roslib";
import WebSocket from "ws";

globalThis.WebSocket ??= WebSocket;
const JTC = "/joint_trajectory_controller";
const JOINTS = [1, 2, 3, 4, 5, 6].map((index) => `joint${index}`);
const url = `ws://127.0.0.1:${process.argv[2]}`;
const wait = (seconds) => new Promise((done) => setTimeout(done, 1000 * seconds));

const ros = new ROSLIB.Ros({ url });
await new Promise((done, fail) => {
  ros.on("connection", done);
  ros.on("error", fail);
});

function collect(name, messageType, options = {}) {
  const messages = [];
  const topic = new ROSLIB.Topic({ ros, name, messageType, ...options });
  topic.subscribe((message) => messages.push(message));
  return messages;
}

function call(name, serviceType, request) {
  const service = new ROSLIB.Service({ ros, name, serviceType });
  return new Promise((done, fail) => service.callService(request, done, fail));
}

function follow(seconds, cancelAfter) {
  const action = new ROSLIB.Action({
    ros,
    name: `${JTC}/follow_joint_trajectory`,
    actionType: "control_msgs/FollowJointTrajectory",
  });
  const feedback = [];
  const point = { positions: Array(6).fill(0.2), time_from_start: { sec: seconds, nanosec: 0 } };
  const goal = { trajectory: { joint_names: JOINTS, points: [point] } };
  return new Promise((done) => {
    const finish = (how) => (result) =>
      done({ how, result: String(result?.message ?? JSON.stringify(result)), feedback: feedback.length });
    const id = action.sendGoal(goal, finish("result"), (each) => feedback.push(each), finish("failed"));
    if (cancelAfter) setTimeout(() => action.cancelGoal(id), 1000 * cancelAfter);
  });
}

const states = collect("/joint_states", "sensor_msgs/JointState", { compression: "cbor" });
const description = collect("/robot_description", "std_msgs/String");
const frames = collect("/tf", "tf2_msgs/TFMessage", { throttle_rate: 100 });
const stamp = ({ header }) => header.stamp.sec + 1e-9 * header.stamp.nanosec;
// So much simulated time, whatever else the machine does.
async function pass(seconds) {
  while (!states.length) await wait(0.01);
  const end = stamp(states.at(-1)) + seconds;
  while (stamp(states.at(-1)) < end) await wait(0.01);
}
const began = Date.now();
await pass(1.0);
const counts = {
  states: states.length,
  frames: frames.length,
  simulated: stamp(states.at(-1)) - stamp(states[0]),
  waited: (Date.now() - began) / 1000,
};
const reached = await follow(1, 0);
const cancelled = await follow(8, 0.3);
const topic = new ROSLIB.Topic({
  ros,
  name: `${JTC}/joint_trajectory`,
  messageType: "trajectory_msgs/JointTrajectory",
});
const point = { positions: Array(6).fill(-0.1), time_from_start: { sec: 0, nanosec: 500000000 } };
topic.publish({ joint_names: JOINTS, points: [point] });
await pass(1.0);
const listed = await call(
  "/controller_manager/list_controllers",
  "controller_manager_msgs/ListControllers",
  {},
);
const missing = await call("/no/such", "std_srvs/Empty", {}).catch((error) => String(error));
const topics = await new Promise((done, fail) => ros.getTopics(done, fail));
const report = JSON.stringify({
  counts,
  state: { name: states.at(-1).name, position: Array.from(states.at(-1).position) },
  description: description.map((each) => each.data.length),
  reached,
  cancelled,
  controllers: listed.controller.map((each) => [each.name, each.state]),
  missing,
  topics: topics.topics,
});
ros.close();
process.stdout.write(`${report}\n`, () => process.exit(0));
