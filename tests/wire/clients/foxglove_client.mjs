// What @foxglove/ws-protocol sees of a simulation; it prints that.
import rosmsg from "@foxglove/rosmsg";
import serialization from "@foxglove/rosmsg2-serialization";
import protocol from "@foxglove/ws-protocol";
import WebSocket from "ws";

const { parse } = rosmsg;
const { MessageReader, MessageWriter } = serialization;
const { FoxgloveClient } = protocol;
const [port, mesh] = process.argv.slice(2);
const JTC = "/joint_trajectory_controller";
const wait = (seconds) => new Promise((done) => setTimeout(done, 1000 * seconds));
const socket = new WebSocket(`ws://127.0.0.1:${port}`, ["foxglove.sdk.v1"]);
const client = new FoxgloveClient({ ws: socket });
const seen = { channels: {}, services: {}, messages: {}, status: [] };
const readers = new Map();

client.on("error", (error) => console.error(error));
client.on("serverInfo", (event) => (seen.capabilities = event.capabilities));
client.on("status", (event) => seen.status.push(event.message));
client.on("advertiseServices", (services) => {
  for (const each of services) seen.services[each.name] = each;
});
client.on("advertise", (channels) => {
  for (const channel of channels) {
    seen.channels[channel.topic] = [channel.schemaName, channel.encoding, channel.schemaEncoding];
    const reader = new MessageReader(parse(channel.schema, { ros2: true }));
    readers.set(client.subscribe(channel.id), [channel.topic, reader]);
  }
});
client.on("message", ({ subscriptionId, data }) => {
  const [topic, reader] = readers.get(subscriptionId);
  (seen.messages[topic] ??= []).push(reader.readMessage(data));
});
const last = (topic) => seen.messages[topic].at(-1);
const responses = new Map();
client.on("serviceCallResponse", (event) => responses.set(event.callId, event));
client.on("serviceCallFailure", (event) => responses.set(event.callId, event));
const assets = new Map();
client.on("fetchAssetResponse", (event) => assets.set(event.requestId, event));
const values = {};
client.on("parameterValues", (event) => {
  for (const each of event.parameters) values[each.name] = each.value;
});

async function until(condition) {
  for (let count = 0; count < 1000 && !condition(); ++count) await wait(0.01);
}

function call(name, request, callId) {
  const service = seen.services[name];
  const writer = new MessageWriter(parse(service.request.schema, { ros2: true }));
  const bytes = writer.writeMessage(request);
  const data = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  client.sendServiceCallRequest({ serviceId: service.id, callId, encoding: "cdr", data });
  return until(() => responses.has(callId));
}

function answer(name, callId) {
  const event = responses.get(callId);
  if (!event.data) return { failure: event.message };
  const schema = seen.services[name].response.schema;
  return new MessageReader(parse(schema, { ros2: true })).readMessage(event.data);
}

await new Promise((done) => client.on("open", done));
await until(() => seen.messages["/joint_states"]?.length > 20 && seen.messages["/tf"]?.length > 5);
await call("/controller_manager/list_controllers", {}, 1);
await call("/controller_manager/unload_controller", { name: "joint_trajectory_controller" }, 2);
client.fetchAsset(mesh, 1);
client.fetchAsset(mesh.replace(/\/meshes.*/, "/../../etc/passwd"), 2);
client.fetchAsset("file:///etc/passwd", 3);
await until(() => assets.size === 3);
client.getParameters([`${JTC}.constraints.goal_time`, `${JTC}.joints`], "read");
await until(() => Object.keys(values).length === 2);
const before = { ...values };
client.setParameters([{ name: `${JTC}.constraints.goal_time`, value: 2.5, type: "float64" }], "set");
await until(() => values[`${JTC}.constraints.goal_time`] === 2.5);
const channel = client.advertise({
  topic: `${JTC}/joint_trajectory`,
  encoding: "json",
  schemaName: "trajectory_msgs/msg/JointTrajectory",
});
const point = { positions: Array(6).fill(0.1), time_from_start: { sec: 0, nanosec: 500000000 } };
const trajectory = { joint_names: [1, 2, 3, 4, 5, 6].map((i) => `joint${i}`), points: [point] };
client.sendMessage(channel, new TextEncoder().encode(JSON.stringify(trajectory)));
client.sendMessage(channel, new TextEncoder().encode("{"));
const stamp = () => last("/joint_states").header.stamp;
const seconds = () => stamp().sec + 1e-9 * (stamp().nanosec ?? stamp().nsec);
const end = seconds() + 1.2;
while (seconds() < end) await wait(0.01);
await until(() => seen.status.length > 0);
const asset = (id) => {
  const event = assets.get(id);
  if (event.status !== 0) return null;
  const { buffer, byteOffset, byteLength } = event.data;
  return Buffer.from(buffer, byteOffset, byteLength).toString("base64");
};
const report = JSON.stringify({
  channels: seen.channels,
  services: Object.keys(seen.services),
  capabilities: seen.capabilities,
  state: { name: last("/joint_states").name, position: Array.from(last("/joint_states").position) },
  description: seen.messages["/robot_description"].map((each) => each.data.length),
  counts: Object.fromEntries(Object.entries(seen.messages).map(([k, v]) => [k, v.length])),
  listed: answer("/controller_manager/list_controllers", 1),
  refused: answer("/controller_manager/unload_controller", 2),
  assets: [asset(1), asset(2), asset(3)],
  before,
  after: values,
  status: seen.status,
});
client.close();
process.stdout.write(`${report}\n`, () => process.exit(0));
