"""Foxglove's websocket: channels with schemas, services, parameters, assets.

The protocol is that of foxglove-sdk; messages are CDR, with the definitions of ROS.
"""

import concurrent.futures
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import foxglove
from foxglove import Capability
from foxglove.websocket import (
    ChannelView,
    Client,
    ClientChannel,
    ConnectionGraph,
    MessageSchema,
    Parameter,
    ServerListener,
    Service,
    ServiceRequest,
    ServiceSchema,
    WebSocketServer,
)

from arm_drake.description.robot import Robot, name_portably
from arm_drake.errors import ArmDrakeError, InputError, OutputError
from arm_drake.wire.encodings import from_json, to_json
from arm_drake.wire.graph import Request, Topic
from arm_drake.wire.graph import Service as GraphService
from arm_drake.wire.server import RosServer
from arm_drake.wire.services import from_parameter_value, to_parameter_value
from arm_drake.wire.types import full_name

# How long a caller waits for the simulation at most [s].
_PATIENCE = 65.0

# Largest message that is taken, and largest file that is sent [bytes].
_MAX_SIZE, _MAX_ASSET = 10_000_000, 200_000_000

_CAPABILITIES = [
    Capability.ClientPublish,
    Capability.ConnectionGraph,
    Capability.Parameters,
    Capability.Services,
    Capability.Time,
]

_FILE = re.compile(r"filename=\"([^\"]+)\"")


class Foxglove:
    """The transport: a server of foxglove-sdk."""

    name: ClassVar[str] = "foxglove"

    def __init__(self, server: RosServer, port: int) -> None:
        """Create it."""
        self.server, self._port = server, port
        self._context = foxglove.Context()
        self._channels: dict[Topic, foxglove.Channel] = {}
        self._numbers: dict[int, Topic] = {}
        self._listening: dict[Topic, int] = {}
        self._folders = package_folders(server.simulation.robots.values())
        self._server: WebSocketServer
        self._time_ns = -1

    async def start(self) -> list[str]:
        """Listen."""
        graph, host = self.server.graph, self.server.host
        try:
            self._server = foxglove.start_server(
                name="arm_drake",
                host=host,
                port=self._port,
                capabilities=_CAPABILITIES,
                supported_encodings=["cdr", "json"],
                services=[self._service(each) for each in graph.services.values()],
                asset_handler=self._asset,
                server_listener=_Listener(self),
                context=self._context,
            )
        except RuntimeError as error:
            text = f"--ros foxglove can't listen at {host}:{self._port}: {error}"
            raise OutputError(text) from None
        for topic in graph.topics.values():
            if topic.publisher:
                schema = self._schema(topic.type)
                channel = foxglove.Channel(
                    topic.name,
                    message_encoding="cdr",
                    schema=schema.schema,
                    context=self._context,
                )
                self._channels[topic] = channel
                self._numbers[channel.id()] = topic
        self._server.publish_connection_graph(self._graph())
        port = self._server.port
        return [
            f"foxglove: ws://{host}:{port}",
            "  Foxglove: open a connection to it, layout docs/foxglove_layout.json",
        ]

    async def stop(self) -> None:
        """End."""
        self._server.stop()

    def _schema(self, type_: str) -> MessageSchema:
        text = self.server.types.schema(type_)
        schema = foxglove.Schema(name=type_, encoding="ros2msg", data=text.encode())
        return MessageSchema(encoding="cdr", schema=schema)

    def _graph(self) -> ConnectionGraph:
        graph = ConnectionGraph()
        for topic in self.server.graph.topics.values():
            if topic.publisher:
                graph.set_published_topic(topic.name, [topic.publisher])
            if topic.subscriber:
                graph.set_subscribed_topic(topic.name, [topic.subscriber])
        for service in self.server.graph.services.values():
            graph.set_advertised_service(service.name, [service.node])
        return graph

    # Services and parameters; foxglove-sdk calls them in threads of its own.

    def _service(self, service: GraphService) -> Service:
        types = self.server.types
        request, response = f"{service.type}_Request", f"{service.type}_Response"

        def answer(call: ServiceRequest) -> bytes:
            data = bytes(call.payload)
            if call.encoding == "json":
                fields = types.fill(request, from_json(data))
            else:
                fields = types.decode(request, data)
            found = types.complete(response, self.ask(service.name, fields))
            if call.encoding == "json":
                return to_json(found).encode()
            return types.encode(response, found)

        schema = ServiceSchema(
            service.type, request=self._schema(request), response=self._schema(response)
        )
        return Service(name=service.name, schema=schema, handler=answer)

    def ask(self, name: str, fields: dict[str, Any]) -> dict[str, Any]:
        """Call a service, and wait for its response; InputError if it is refused."""
        answer: concurrent.futures.Future[dict[str, Any]] = concurrent.futures.Future()

        def refuse(problem: str) -> None:
            answer.set_exception(InputError(problem))

        request = Request(
            "call", name, fields, "foxglove", "", answer.set_result, refuse
        )
        self.server.submit(request)
        try:
            return answer.result(timeout=_PATIENCE)
        except concurrent.futures.TimeoutError:
            raise InputError(f"{name}: the simulation doesn't answer") from None

    def parameters(self, names: Sequence[str]) -> list[Parameter]:
        """Return parameters by names such as "/node.name"; all if none is named."""
        nodes = [
            name.removesuffix("/list_parameters")
            for name in self.server.graph.services
            if name.endswith("/list_parameters")
        ]
        found = []
        for node in nodes:
            own_names = [n[len(node) + 1 :] for n in names if n.startswith(f"{node}.")]
            if names and not own_names:
                continue
            if not own_names:
                listed = self.ask(
                    f"{node}/list_parameters", {"prefixes": [], "depth": 0}
                )
                own_names = listed["result"]["names"]
            values = self.ask(f"{node}/get_parameters", {"names": own_names})["values"]
            for name, value in zip(own_names, values, strict=True):
                if value["type"]:
                    found.append(_parameter(f"{node}.{name}", value))
        return found

    def set_parameters(self, parameters: Sequence[Parameter]) -> list[Parameter]:
        """Change parameters; return what they are then."""
        names = []
        for each in parameters:
            node, _, name = each.name.partition(".")
            names.append(each.name)
            try:
                type_ = "rcl_interfaces/srv/SetParameters_Request"
                value = to_parameter_value(self._as_known(each.name, each.get_value()))
                message = {"parameters": [{"name": name, "value": value}]}
                fields = self.server.types.fill(type_, message)
                [result] = self.ask(f"{node}/set_parameters", fields)["results"]
                if not result["successful"]:
                    raise InputError(result["reason"])
            except ArmDrakeError as error:
                level = foxglove.StatusLevel.Error
                self._server.publish_status(f"{each.name}: {error}", level)
        return self.parameters(names)

    def _as_known(self, name: str, value: Any) -> Any:
        """Return a value as a float if the parameter is one: JSON has no integers."""
        if type(value) is int:
            for known in self.parameters([name]):
                if isinstance(known.get_value(), float):
                    return float(value)
        return value

    # Topics.

    def subscribe(self, number: int, change: int) -> None:
        """Take note of a client that listens to a channel, or no longer does."""
        topic = self._numbers.get(number)
        if topic is None:
            return
        self._listening[topic] = self._listening.get(topic, 0) + change
        self.server.watch()
        if change > 0 and topic.constant is not None:
            # The protocol has no messages for late listeners.
            self._log(topic, topic.constant)

    def watched(self) -> Iterable[Topic]:
        """Return the topics that a client listens to."""
        return [topic for topic, count in self._listening.items() if count > 0]

    def poll(self, received: Mapping[Topic, Sequence[dict[str, Any]]]) -> None:
        """Send what is new."""
        for topic, messages in received.items():
            if self._listening.get(topic, 0) > 0:
                for fields in messages:
                    self._log(topic, fields)
        time_ns = self.server.now_ns
        if time_ns // 10_000_000 != self._time_ns // 10_000_000:
            self._time_ns = time_ns
            self._server.broadcast_time(time_ns)

    def _log(self, topic: Topic, fields: dict[str, Any]) -> None:
        data = self.server.types.encode(topic.type, fields)
        self._channels[topic].log(data, log_time=self.server.now_ns)

    def publish(self, channel: ClientChannel, data: bytes) -> None:
        """Send a client's message to who takes it, or raise InputError."""
        topic, types = self.server.graph.topic(channel.topic), self.server.types
        if topic.takes is None:
            raise InputError(f"nobody takes messages of topic {topic.name!r}")
        if channel.schema_name and full_name(channel.schema_name) != topic.type:
            text = f"is of type {topic.type}, not {channel.schema_name}"
            raise InputError(f"topic {topic.name!r} {text}")
        if len(data) > _MAX_SIZE:
            raise InputError(f"more than {_MAX_SIZE} bytes")
        if channel.encoding == "json":
            fields = types.fill(topic.type, from_json(data))
        else:
            fields = types.decode(topic.type, data)
        self.server.submit(
            Request("publish", topic.name, fields, "foxglove", refuse=self.say)
        )

    def say(self, problem: str) -> None:
        """Send clients a problem."""
        self._server.publish_status(problem, foxglove.StatusLevel.Error)

    def _asset(self, uri: str) -> bytes | None:
        path = find_asset(uri, self._folders)
        if path is None or path.stat().st_size > _MAX_ASSET:
            return None
        return path.read_bytes()


class _Listener(ServerListener):
    """Listener to clients; foxglove-sdk calls it in threads of its own."""

    def __init__(self, transport: Foxglove) -> None:
        self._transport = transport
        self._channels: dict[tuple[int, int], ClientChannel] = {}

    def _post(self, act: Callable[[], None], size: int = 0) -> None:
        self._transport.server.post(act, size)

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        number = channel.id
        self._post(lambda: self._transport.subscribe(number, 1))

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        number = channel.id
        self._post(lambda: self._transport.subscribe(number, -1))

    def on_client_advertise(self, client: Client, channel: ClientChannel) -> None:
        if len(self._channels) < 1000:
            self._channels[client.id, channel.id] = channel

    def on_client_unadvertise(self, client: Client, client_channel_id: int) -> None:
        self._channels.pop((client.id, client_channel_id), None)

    def on_message_data(
        self, client: Client, client_channel_id: int, data: bytes
    ) -> None:
        channel = self._channels.get((client.id, client_channel_id))
        content = bytes(data)
        if channel is not None:
            self._post(lambda: self._publish(channel, content), len(content))

    def _publish(self, channel: ClientChannel, data: bytes) -> None:
        try:
            self._transport.publish(channel, data)
        except ArmDrakeError as error:
            self._transport.say(str(error))

    def on_get_parameters(
        self, client: Client, param_names: list[str], request_id: str | None = None
    ) -> list[Parameter]:
        return self._transport.parameters(param_names)

    def on_set_parameters(
        self,
        client: Client,
        parameters: list[Parameter],
        request_id: str | None = None,
    ) -> list[Parameter]:
        return self._transport.set_parameters(parameters)


def _parameter(name: str, value: dict[str, Any]) -> Parameter:
    return Parameter(name, value=from_parameter_value(value))


def package_folders(robots: Iterable[Robot]) -> dict[str, list[Path]]:
    """Return the folders of the packages that robots' files are named from."""
    folders: dict[str, list[Path]] = {}
    for robot in robots:
        for name in _FILE.findall(robot.description.source):
            place = re.sub("^(file:)?/+", "/", name)
            uri = name_portably(place)
            if not uri.startswith("package://"):
                continue
            package, _, rest = uri.removeprefix("package://").partition("/")
            folder = Path(place[: len(place) - len(rest)])
            known = folders.setdefault(package, [])
            if folder not in known:
                known.append(folder)
    return folders


def find_asset(uri: str, folders: Mapping[str, Sequence[Path]]) -> Path | None:
    """Return the file of a package URI, None if it is none of these packages' files."""
    if not uri.startswith("package://"):
        return None
    package, _, rest = uri.removeprefix("package://").partition("/")
    for folder in folders.get(package, ()):
        path = (folder / rest).resolve()
        if path.is_relative_to(folder.resolve()) and path.is_file():
            return path
    return None
