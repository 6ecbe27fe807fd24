"""Zenoh as rmw_zenoh speaks it: keys, attachments, liveliness tokens, queryables.

Source: ros2/rmw_zenoh, docs/design.md and `liveliness_utils.cpp`, `attachment_helpers`.
"""

import functools
import json
import socket
import struct
import time
import uuid
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar, TypeAlias

import zenoh
import zenoh.ext

from arm_drake.errors import ArmDrakeError, InputError, OutputError
from arm_drake.wire.graph import (
    DEFAULT_QOS,
    LATCHED,
    Action,
    GoalEvent,
    Qos,
    Request,
    Service,
    Topic,
)
from arm_drake.wire.server import RosServer

# Sequence number, time [ns], length of the identifier, and the identifier.
_ATTACHMENT = struct.Struct("<qqB16s")

# Largest message that is taken [bytes].
_MAX_SIZE = 10_000_000

# action_msgs.
_STATUS, _CANCEL = "action_msgs/msg/GoalStatusArray", "action_msgs/srv/CancelGoal"
_REJECTED, _NOT_KNOWN, _NO_ERROR = 1, 2, 0
_EXECUTING, _CANCELING = 2, 3

# Takes the response to a call.
_Reply: TypeAlias = Callable[[dict[str, Any]], None]

# So many goals of an action, and their results, are remembered.
_NUM_GOALS = 100


def dds_type(type_: str) -> str:
    """Return "sensor_msgs::msg::dds_::JointState_" for "sensor_msgs/msg/JointState"."""
    package, kind, name = type_.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def mangle(name: str) -> str:
    """Return a name as it stands in a liveliness token."""
    return name.replace("/", "%")


def qos_key(qos: Qos) -> str:
    """Return a quality of service as it stands in a liveliness token."""
    reliability = "" if qos.is_reliable else "2"
    durability = "1" if qos.is_latched else ""
    return f"{reliability}:{durability}:,{qos.depth}:,:,:,,"


class _Entity:
    """A publisher, subscriber, service or client in the graph of ROS."""

    def __init__(self) -> None:
        self.gid = uuid.uuid4().bytes
        self.sequence = 0

    def attachment(self) -> bytes:
        """Return what goes beside the next message."""
        self.sequence += 1
        return _ATTACHMENT.pack(self.sequence, time.time_ns(), 16, self.gid)


class _Publisher(_Entity):
    """A publisher of a topic."""

    def __init__(
        self, transport: "Zenoh", name: str, type_: str, qos: Qos, node: str
    ) -> None:
        super().__init__()
        self._types, self._type = transport.server.types, type_
        key = transport.key(name, type_)
        self.last: tuple[bytes, bytes] | None = None
        session = transport.session
        self._publisher: Any
        if qos.is_latched:
            cache = zenoh.ext.CacheConfig(max_samples=qos.depth)
            self._publisher = zenoh.ext.declare_advanced_publisher(
                session, key, cache=cache, publisher_detection=True
            )
            # What asks the way that the first versions of rmw_zenoh did.
            transport.keep(session.declare_queryable(key, self._answer_with_last))
        else:
            self._publisher = session.declare_publisher(key)
        transport.keep(self._publisher)
        transport.declare("MP", node, name, type_, qos)

    @property
    def is_heard(self) -> bool:
        """Whether anybody listens."""
        return bool(self._publisher.matching_status.matching)

    def publish(self, fields: Mapping[str, Any]) -> None:
        """Send a message."""
        data, attachment = self._types.encode(self._type, fields), self.attachment()
        self.last = data, attachment
        self._publisher.put(data, attachment=attachment)

    def _answer_with_last(self, query: zenoh.Query) -> None:
        if self.last is not None:
            data, attachment = self.last
            query.reply(query.key_expr, data, attachment=attachment)


class _ActionServer:
    """An action: three services and two topics."""

    def __init__(self, transport: "Zenoh", action: Action) -> None:
        self._action, self._server = action, transport.server
        self._goals: dict[bytes, dict[str, Any]] = {}
        self._results: dict[bytes, dict[str, Any]] = {}
        self._waiting: dict[bytes, list[_Reply]] = {}
        base, node = f"{action.name}/_action", action.node
        self._feedback = _Publisher(
            transport,
            f"{base}/feedback",
            f"{action.type}_FeedbackMessage",
            DEFAULT_QOS,
            node,
        )
        self._status = _Publisher(transport, f"{base}/status", _STATUS, LATCHED, node)
        serve = transport.serve
        serve(f"{base}/send_goal", f"{action.type}_SendGoal", node, self._send)
        serve(f"{base}/get_result", f"{action.type}_GetResult", node, self._result)
        serve(f"{base}/cancel_goal", _CANCEL, node, self._cancel)

    def _send(self, request: dict[str, Any], reply: _Reply) -> None:
        id_ = bytes(request["goal_id"]["uuid"])

        def refuse(problem: str) -> None:
            reply({"accepted": False})

        def take(event: GoalEvent) -> None:
            self._take(id_, event, reply)

        fields = self._server.types.fill(f"{self._action.type}_Goal", request["goal"])
        sender = f"zenoh {id_.hex()[:8]}"
        self._server.submit(
            Request("goal", self._action.name, fields, sender, id_.hex(), take, refuse)
        )

    def _take(self, id_: bytes, event: GoalEvent, reply: _Reply) -> None:
        sec, nanosec = divmod(event.stamp_ns, 10**9)
        stamp = {"sec": sec, "nanosec": nanosec}
        goal = {"goal_id": {"uuid": list(id_)}, "stamp": stamp}
        if event.kind == "rejected":
            reply({"accepted": False, "stamp": stamp})
        elif event.kind == "accepted":
            self._goals[id_] = {"goal_info": goal, "status": _EXECUTING}
            reply({"accepted": True, "stamp": stamp})
            self._publish_status()
        elif event.kind == "feedback":
            self._feedback.publish({"goal_id": goal["goal_id"], "feedback": event.data})
        elif event.kind == "result":
            known = self._goals.setdefault(id_, {"goal_info": goal})
            known["status"] = event.status
            self._publish_status()
            result = {"status": event.status, "result": event.data}
            self._results[id_] = result
            for answer in self._waiting.pop(id_, ()):
                answer(result)
            self._forget()

    def _forget(self) -> None:
        for known in (self._goals, self._results):
            while len(known) > _NUM_GOALS:
                del known[next(iter(known))]

    def _publish_status(self) -> None:
        self._status.publish({"status_list": list(self._goals.values())})

    def _result(self, request: dict[str, Any], reply: _Reply) -> None:
        id_ = bytes(request["goal_id"]["uuid"])
        if id_ in self._results:
            reply(self._results[id_])
        elif id_ in self._goals:
            self._waiting.setdefault(id_, []).append(reply)
        else:
            reply({"status": 0})

    def _cancel(self, request: dict[str, Any], reply: _Reply) -> None:
        goal_id = bytes(request["goal_info"]["goal_id"]["uuid"])
        running = [i for i, g in self._goals.items() if g["status"] == _EXECUTING]
        chosen = running if not any(goal_id) else [i for i in running if i == goal_id]
        for id_ in chosen:
            name = self._action.name
            self._server.submit(Request("cancel", name, {}, "zenoh", id_.hex()))
        code = _NO_ERROR if chosen or not any(goal_id) else _NOT_KNOWN
        infos = [self._goals[id_]["goal_info"] for id_ in chosen]
        reply({"return_code": code, "goals_canceling": infos})


class Zenoh:
    """The transport: a session of Zenoh that is its own router, or asks one."""

    name: ClassVar[str] = "zenoh"

    def __init__(self, server: RosServer, port: int) -> None:
        """Create it."""
        self.server, self._port = server, port
        self.session: zenoh.Session
        self._kept: list[Any] = []
        self._publishers: dict[Topic, _Publisher] = {}
        self._nodes: dict[str, int] = {}
        self._num_entities = 0
        self._heard: list[Topic] = []
        self._look_at = 0.0

    async def start(self) -> list[str]:
        """Open a session, and declare all entities."""
        self.session, says = self._open()
        graph = self.server.graph
        for node in graph.nodes():
            self._nodes[node] = len(self._nodes)
            self._token("NN", node, self._nodes[node])
        for topic in graph.topics.values():
            if topic.publisher:
                publisher = _Publisher(
                    self, topic.name, topic.type, topic.qos, topic.publisher
                )
                self._publishers[topic] = publisher
                if topic.constant is not None:
                    publisher.publish(topic.constant)
            if topic.takes is not None:
                self._subscribe(topic)
        for service in graph.services.values():
            call = functools.partial(self._call, service)
            self.serve(service.name, service.type, service.node, call)
        for action in graph.actions.values():
            _ActionServer(self, action)
        return says

    def _open(self) -> tuple[zenoh.Session, list[str]]:
        """Return a session, and what is to be said of it."""
        host = self.server.host
        self._port = self._port or _free_port(host)
        endpoint = f"tcp/{host}:{self._port}"
        config = zenoh.Config()
        config.insert_json5("mode", '"router"')
        config.insert_json5("listen/endpoints", json.dumps([endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        says = [
            f"zenoh: {endpoint}",
            "  RMW_IMPLEMENTATION=rmw_zenoh_cpp "
            f"ROS_DOMAIN_ID={self.server.domain} ros2 topic list",
        ]
        try:
            return zenoh.open(config), says
        except zenoh.ZError as error:
            first = error
        # A router is there already: that of rmw_zenoh, most likely.
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("connect/timeout_ms", "2000")
        # What is latched needs it, and a router has it by itself.
        config.insert_json5("timestamping/enabled", "true")
        config.insert_json5("scouting/multicast/enabled", "false")
        try:
            session = zenoh.open(config)
        except zenoh.ZError:
            text = f"--ros zenoh can't listen at {endpoint}: {first}"
            raise OutputError(text) from None
        return session, [f"{says[0]} (a router that is there)", says[1]]

    async def stop(self) -> None:
        """Close the session."""
        self._kept.clear()
        self.session.close()  # type: ignore[no-untyped-call]

    def key(self, name: str, type_: str) -> str:
        """Return the key of a topic or a service."""
        hash_ = self.server.types.hash(type_)
        return f"{self.server.domain}{name}/{dds_type(type_)}/{hash_}"

    def keep(self, thing: Any) -> None:
        """Keep what ends when nobody refers to it."""
        self._kept.append(thing)

    def _token(self, kind: str, node: str, entity: int, *more: str) -> None:
        namespace, _, name = node.rpartition("/")
        number = self._nodes[node]
        zid = self.session.zid()
        parts = [
            "@ros2_lv",
            str(self.server.domain),
            str(zid),
            str(number),
            str(entity),
            kind,
            "%",
            mangle(namespace or "/"),
            name,
            *more,
        ]
        self.keep(self.session.liveliness().declare_token("/".join(parts)))

    def declare(self, kind: str, node: str, name: str, type_: str, qos: Qos) -> None:
        """Declare an entity in the graph of ROS."""
        if node not in self._nodes:
            self._nodes[node] = len(self._nodes)
            self._token("NN", node, self._nodes[node])
        self._num_entities += 1
        entity = len(self._nodes) + 1000 + self._num_entities
        hash_ = self.server.types.hash(type_)
        self._token(
            kind, node, entity, mangle(name), dds_type(type_), hash_, qos_key(qos)
        )

    def _subscribe(self, topic: Topic) -> None:
        """Take messages of a topic."""

        def take(sample: zenoh.Sample) -> None:
            data = bytes(sample.payload)
            self.server.post(lambda: self._publish(topic, data), len(data))

        key = self.key(topic.name, topic.type)
        self.keep(self.session.declare_subscriber(key, take))
        self.declare("MS", topic.subscriber, topic.name, topic.type, topic.qos)

    def _publish(self, topic: Topic, data: bytes) -> None:
        try:
            if len(data) > _MAX_SIZE:
                raise InputError(f"more than {_MAX_SIZE} bytes")
            fields = self.server.types.decode(topic.type, data)
            self.server.submit(
                Request("publish", topic.name, fields, "zenoh", refuse=self._warn)
            )
        except ArmDrakeError as error:
            self._warn(f"{topic.name}: {error}")

    def _warn(self, problem: str) -> None:
        """Report unusable messages; they have no sender to be answered."""
        self.server.warn(f"zenoh: {problem}")

    def serve(
        self,
        name: str,
        type_: str,
        node: str,
        call: Callable[[dict[str, Any], _Reply], None],
    ) -> None:
        """Answer calls of a service by `call`, which takes request and reply."""
        types = self.server.types

        def act(query: zenoh.Query, data: bytes) -> None:
            def reply(values: dict[str, Any]) -> None:
                response = types.complete(f"{type_}_Response", values)
                encoded = types.encode(f"{type_}_Response", response)
                attachment = query.attachment
                query.reply(
                    query.key_expr,
                    encoded,
                    attachment=_answer_to(
                        b"" if attachment is None else bytes(attachment)
                    ),
                )
                query.drop()  # type: ignore[no-untyped-call]

            try:
                call(types.decode(f"{type_}_Request", data), reply)
            except ArmDrakeError as error:
                self._warn(f"{name}: {error}")
                query.reply_err(str(error))
                query.drop()  # type: ignore[no-untyped-call]

        def take(query: zenoh.Query) -> None:
            payload = query.payload
            data = b"" if payload is None else bytes(payload)
            if not self.server.post(lambda: act(query, data), len(data)):
                query.reply_err("too much comes in at once")
                query.drop()  # type: ignore[no-untyped-call]

        key = self.key(name, type_)
        self.keep(self.session.declare_queryable(key, take, complete=True))
        self.declare("SS", node, name, type_, DEFAULT_QOS)

    def _call(
        self,
        service: Service,
        request: dict[str, Any],
        reply: _Reply,
    ) -> None:
        def refuse(problem: str) -> None:
            # A response of ROS has no room for an error, but for what it has itself.
            self._warn(f"{service.name}: {problem}")
            known = {n for n, _, _ in self.server.types.fields(response)}
            text = {"message": problem, "status_message": problem}
            reply({name: value for name, value in text.items() if name in known})

        response = f"{service.type}_Response"
        self.server.submit(
            Request("call", service.name, request, "zenoh", "", reply, refuse)
        )

    def watched(self) -> Iterable[Topic]:
        """Return the topics that somebody listens to."""
        return self._heard

    def poll(self, received: Mapping[Topic, Sequence[dict[str, Any]]]) -> None:
        """Send what is new, and look now and then who listens."""
        for topic, messages in received.items():
            publisher = self._publishers.get(topic)
            is_heard = topic.qos.is_latched or topic in self._heard
            if publisher is not None and is_heard:
                for fields in messages:
                    publisher.publish(fields)
        now = time.monotonic()
        if now >= self._look_at:
            self._look_at = now + 0.1
            heard = [
                topic
                for topic, publisher in self._publishers.items()
                if not topic.qos.is_latched and publisher.is_heard
            ]
            if heard != self._heard:
                self._heard = heard
                self.server.watch()


def _free_port(host: str) -> int:
    """Return a port that nobody listens at."""
    with socket.create_server((host, 0)) as listening:
        return int(listening.getsockname()[1])


def _answer_to(attachment: bytes) -> bytes:
    """Return what goes beside a response: whose request it answers, and when."""
    if len(attachment) != _ATTACHMENT.size:
        return _ATTACHMENT.pack(0, time.time_ns(), 16, bytes(16))
    sequence, _, size, gid = _ATTACHMENT.unpack(attachment)
    return _ATTACHMENT.pack(sequence, time.time_ns(), size, gid)
