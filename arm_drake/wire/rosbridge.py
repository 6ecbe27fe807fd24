"""rosbridge v2: JSON, or CBOR, over a websocket.

Source: RobotWebTools/rosbridge_suite, ROSBRIDGE_PROTOCOL.md (3.1 to 3.4).
"""

import asyncio
import collections
import functools
import json
import socket
import time
import uuid
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple
from urllib.parse import urlsplit

import tornado.httpserver
import tornado.iostream
import tornado.web
import tornado.websocket

from arm_drake.errors import ArmDrakeError, InputError
from arm_drake.wire.encodings import (
    Encoded,
    Encoder,
    Fragments,
    decode_cbor,
    encode,
    from_json,
    from_png,
    make_frame,
    split,
    to_png,
)
from arm_drake.wire.graph import GoalEvent, Request, Topic
from arm_drake.wire.server import RosServer
from arm_drake.wire.types import full_name

# Largest message that is taken [bytes], and how many a client may send a second.
_MAX_SIZE, _MAX_RATE = 10_000_000, 2000

# State waits when so much is on its way to a client, and a client that lets so much
# wait of what may not be dropped is gone [bytes].
_FULL, _OVERFLOW = 256_000, 16_000_000

_MAX_CLIENTS, _MAX_SUBSCRIPTIONS = 64, 1000

_LEVELS = ("none", "error", "warning", "info")

# Compressions of what is sent.
_COMPRESSIONS = ("none", "png", "cbor", "cbor-raw")


class _Subscription:
    """Subscription of a client to a topic."""

    def __init__(self) -> None:
        # Of each id: shortest time between two messages [s], and queue length.
        self.wishes: dict[str, tuple[float, int]] = {}
        self.compression = "none"
        self.fragment_size = 0
        self.due = 0.0
        self.queue: collections.deque[dict[str, Any]] = collections.deque(maxlen=1)

    def wish(self, key: str, pause: float, length: int) -> None:
        """Take note of a subscription."""
        self.wishes[key] = (pause, length)
        lengths = [length for _, length in self.wishes.values()]
        longest = max(lengths) or 1
        self.queue = collections.deque(self.queue, maxlen=min(max(longest, 1), 1000))

    @property
    def pause(self) -> float:
        """Shortest time between two messages [s]."""
        return min(pause for pause, _ in self.wishes.values())


class _Waiting(NamedTuple):
    """A call that a client is to answer."""

    client: "Client"
    request: dict[str, Any]
    provider: "Client"


class _Served(NamedTuple):
    """A service or an action that a client has."""

    type: str
    client: "Client"


class Client(tornado.websocket.WebSocketHandler):
    """A client's connection."""

    bridge: "Rosbridge"

    def initialize(self, bridge: "Rosbridge") -> None:
        """Begin with nothing."""
        self.bridge = bridge
        self.subscriptions: dict[str, _Subscription] = {}
        self.advertised: set[str] = set()
        self.goals: dict[str, str] = {}
        self.level = "error"
        self.on_its_way = 0
        self.sender = "rosbridge"
        self._window, self._count = 0.0, 0
        self._frames: list[bytes] = []
        self.fragments: Fragments | None = None

    def check_origin(self, origin: str) -> bool:
        """Let pages of this machine in, and those that were named."""
        return is_allowed(origin, self.bridge.server.origins)

    def prepare(self) -> None:
        """Refuse clients beyond the maximum."""
        if len(self.bridge.clients) >= _MAX_CLIENTS:
            raise tornado.web.HTTPError(503, reason="too many clients")

    def get_compression_options(self) -> None:
        """Send it as it is: on one machine that is quicker."""
        return

    def open(self, *args: str, **kwargs: str) -> None:
        """Take note of a client."""
        self.set_nodelay(True)
        stream = self.ws_connection.stream if self.ws_connection else None
        name = stream.socket.getpeername() if stream is not None else ("?", 0)
        self.sender = f"rosbridge {name[0]}:{name[1]}"
        self.bridge.clients.add(self)

    def on_close(self) -> None:
        """Forget a client, and what it had."""
        self.bridge.forget(self)

    async def on_message(self, message: str | bytes) -> None:
        """Do what a client wants."""
        now = time.monotonic()
        if now - self._window > 1.0:
            self._window, self._count = now, 0
        self._count += 1
        if self._count > _MAX_RATE:
            # It has to wait for its turn: nothing is read meanwhile.
            await asyncio.sleep(max(1.0 - (now - self._window), 0.0))
        self.take(message)

    def take(self, message: str | bytes) -> None:
        """Do what a message says; whatever is wrong with it is answered."""
        try:
            content = _read(message)
        except InputError as error:
            self.tell_error(str(error))
            return
        try:
            self.bridge.do(self, content)
        except ArmDrakeError as error:
            self.refuse(content, str(error))
        except RecursionError:
            self.refuse(content, "it is nested too deeply")
        except (TypeError, ValueError, KeyError, AttributeError) as error:
            # A check of ours is missing; the client gets its answer all the same.
            text = f"{type(error).__name__}: {error}"
            self.bridge.server.warn(f"rosbridge: {str(content)[:200]}: {text}")
            self.refuse(content, f"it can't be used ({text})")

    def refuse(self, content: Mapping[str, Any], problem: str) -> None:
        """Send a client the problem, as the operation has it."""
        op, id_ = content.get("op"), content.get("id")
        if op == "call_service":
            self.send(_response(content, problem, is_done=False))
        elif op == "send_action_goal":
            self.send(_no_result(content, problem))
        else:
            self.tell_error(problem, id_)

    def tell_error(self, text: str, id_: Any = None) -> None:
        """Send a client the problem, unless its status level is "none"."""
        if self.level != "none":
            content = {"op": "status", "level": "error", "msg": text}
            self.send(content if id_ is None else {**content, "id": id_})

    def send(
        self,
        content: dict[str, Any] | str | bytes,
        compression: str = "none",
        fragment_size: int = 0,
    ) -> None:
        """Send a message, or end with a client that takes none."""
        data = content
        if isinstance(data, dict):
            data = encode(data, compression)
        if compression == "png" and isinstance(data, str):
            data = json.dumps({"op": "png", "data": to_png(data)})
        if fragment_size and isinstance(data, str) and len(data) > fragment_size:
            for part in split(data, fragment_size):
                self._write(part)
            return
        self._write(data)

    def send_encoded(
        self, encoded: Encoded, compression: str, fragment_size: int
    ) -> None:
        """Send what was made for all clients."""
        if compression == "png" or fragment_size:
            self.send(encoded.data, compression, fragment_size)
        else:
            self._put(encoded.frame)

    def _write(self, data: str | bytes) -> None:
        self._put(make_frame(data))

    def _put(self, frame: bytes) -> None:
        """Have a frame sent, together with what else comes in this round."""
        if self.on_its_way > _OVERFLOW:
            self.close(1008, "the client doesn't read")
            return
        if not self._frames:
            asyncio.get_running_loop().call_soon(self.send_waiting)
        self._frames.append(frame)
        self.on_its_way += len(frame)

    def send_waiting(self) -> None:
        """Send what waits."""
        data, connection = b"".join(self._frames), self.ws_connection
        stream = None if connection is None else connection.stream
        self._frames.clear()

        def done(future: Any) -> None:
            self.on_its_way -= len(data)
            # A client that has gone is told by on_close.
            future.exception()

        if not data or stream is None or stream.closed():
            self.on_its_way -= len(data)
            return
        try:
            future = stream.write(data)
        except tornado.iostream.StreamClosedError:
            self.on_its_way -= len(data)
            return
        future.add_done_callback(done)


def _read(message: str | bytes) -> dict[str, Any]:
    """Return what a message says, or raise InputError."""
    content = from_json(message) if isinstance(message, str) else decode_cbor(message)
    if not isinstance(content, dict):
        raise InputError(f"expected an object with op, got a {type(content).__name__}")
    return content


def _response(call: Mapping[str, Any], values: Any, *, is_done: bool) -> dict[str, Any]:
    answer = {
        "op": "service_response",
        "service": call.get("service"),
        "values": values,
        "result": is_done,
    }
    return answer if call.get("id") is None else {**answer, "id": call["id"]}


def _no_result(content: Mapping[str, Any], problem: str) -> dict[str, Any]:
    return {
        "op": "action_result",
        "action": content.get("action"),
        "id": content.get("id"),
        "values": problem,
        "status": 6,
        "result": False,
    }


def is_allowed(origin: str, allowed: Sequence[str]) -> bool:
    """Return whether a web page of an origin may connect: those of this machine."""
    if origin in allowed or "*" in allowed:
        return True
    try:
        host = urlsplit(origin).hostname or ""
    except ValueError:
        return False
    return host in ("localhost", "127.0.0.1", "::1")


class Rosbridge:
    """The transport: a websocket server."""

    name: ClassVar[str] = "rosbridge"

    def __init__(self, server: RosServer, port: int) -> None:
        """Create it."""
        self.server, self.port = server, port
        self.clients: set[Client] = set()

        # What clients advertise that the simulation doesn't know: types by topic, and
        # the last message of those that are latched.
        self.topics: dict[str, str] = {}
        self._latched: dict[str, dict[str, Any]] = {}
        # What they serve, by its kind and name.
        self.served: dict[str, dict[str, _Served]] = {"service": {}, "action": {}}
        self._calls: dict[str, _Waiting] = {}
        self._http: tornado.httpserver.HTTPServer | None = None
        self._pending: set[Client] = set()

    async def start(self) -> list[str]:
        """Listen."""
        application = tornado.web.Application(
            [(r"/.*", Client, {"bridge": self})],
            websocket_max_message_size=_MAX_SIZE,
        )
        host = self.server.host
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        listening = socket.create_server((host, self.port), family=family)
        listening.setblocking(False)
        self._http = tornado.httpserver.HTTPServer(application)
        self._http.add_socket(listening)
        self.port = listening.getsockname()[1]
        return [
            f"rosbridge: ws://{host}:{self.port}",
            f"  roslibpy.Ros({host!r}, {self.port})",
            f"  new ROSLIB.Ros({{url: 'ws://{host}:{self.port}'}})",
        ]

    async def stop(self) -> None:
        """End."""
        for client in list(self.clients):
            client.send_waiting()
            client.close(1001, "the simulation has ended")
        if self._http is not None:
            self._http.stop()
            await self._http.close_all_connections()

    def watched(self) -> Iterable[Topic]:
        """Return the topics that a client listens to."""
        known = self.server.graph.topics
        names = {name for client in self.clients for name in client.subscriptions}
        return [known[name] for name in names if name in known]

    def poll(self, received: Mapping[Topic, Sequence[dict[str, Any]]]) -> None:
        """Send what is new to who wants it."""
        if not received and not self._pending:
            return
        encoder, now = Encoder(self.server), time.monotonic()
        for topic, messages in received.items():
            for client in self.clients:
                subscription = client.subscriptions.get(topic.name)
                if subscription is None:
                    continue
                if subscription.pause or client.on_its_way > _FULL:
                    subscription.queue.extend(messages)
                    self._pending.add(client)
                    continue
                for fields in messages:
                    self._send(client, topic.name, topic.type, fields, encoder)
        self._send_pending(encoder, now)

    def _send_pending(self, encoder: Encoder, now: float) -> None:
        """Send what was held back, and may be sent now."""
        for client in list(self._pending):
            is_waiting = False
            for name, subscription in list(client.subscriptions.items()):
                if not subscription.queue:
                    continue
                if now >= subscription.due and client.on_its_way <= _FULL:
                    fields = subscription.queue.popleft()
                    subscription.due = now + subscription.pause
                    type_ = self._type_of(name)
                    self._send(client, name, type_, fields, encoder)
                is_waiting |= bool(subscription.queue)
            if not is_waiting:
                self._pending.discard(client)

    def _type_of(self, name: str) -> str:
        topic = self.server.graph.topics.get(name)
        return topic.type if topic is not None else self.topics.get(name, "")

    def _send(
        self,
        client: Client,
        name: str,
        type_: str,
        fields: dict[str, Any],
        encoder: Encoder,
    ) -> None:
        subscription = client.subscriptions[name]
        compression = subscription.compression
        encoded = encoder.publish(name, type_, fields, compression)
        client.send_encoded(encoded, compression, subscription.fragment_size)

    def forget(self, client: Client) -> None:
        """Forget a client that has gone."""
        self.clients.discard(client)
        self._pending.discard(client)
        for served in self.served.values():
            for name in [n for n, each in served.items() if each.client is client]:
                del served[name]
        for key, waiting in list(self._calls.items()):
            if waiting.client is client:
                del self._calls[key]
            elif waiting.provider is client:
                del self._calls[key]
                waiting.client.refuse(waiting.request, "the client that has it is gone")
        self.server.watch()

    # Operations of clients.

    def do(self, client: Client, content: dict[str, Any]) -> None:
        """Do what a client wants, or raise InputError."""
        op = content.get("op")
        act = _OPERATIONS.get(op) if isinstance(op, str) else None
        if act is None:
            known = ", ".join(_OPERATIONS)
            raise InputError(f"unknown op {str(op)[:100]!r}; known: {known}")
        act(self, client, content)

    def _do_subscribe(self, client: Client, content: dict[str, Any]) -> None:
        name = _name(content, "topic")
        if name not in client.subscriptions:
            if len(client.subscriptions) >= _MAX_SUBSCRIPTIONS:
                raise InputError(f"more than {_MAX_SUBSCRIPTIONS} subscriptions")
            if not self._type_of(name) and not content.get("type"):
                raise InputError(f"topic {name!r} isn't there yet: give its type")
        self._check_type(name, content.get("type"))
        subscription = client.subscriptions.setdefault(name, _Subscription())
        pause = _number(content, "throttle_rate") / 1000.0
        length = int(_number(content, "queue_length"))
        subscription.wish(str(content.get("id", "")), pause, length)
        compression = content.get("compression") or "none"
        if compression not in _COMPRESSIONS:
            known = ", ".join(_COMPRESSIONS)
            raise InputError(f"no compression {compression!r}; known: {known}")
        subscription.compression = compression
        subscription.fragment_size = int(_number(content, "fragment_size"))
        self.server.watch()
        topic = self.server.graph.topics.get(name)
        last = self._latched.get(name) if topic is None else topic.constant
        if last is not None:
            encoder = Encoder(self.server)
            self._send(client, name, self._type_of(name), last, encoder)

    def _check_type(self, name: str, type_name: Any) -> None:
        """Raise InputError if a topic has another type than the request's, if any."""
        known = self._type_of(name)
        if type_name and known and full_name(str(type_name)) != known:
            raise InputError(f"topic {name!r} is of type {known}, not {type_name}")

    def _do_unsubscribe(self, client: Client, content: dict[str, Any]) -> None:
        name = _name(content, "topic")
        subscription = client.subscriptions.get(name)
        if subscription is None:
            raise InputError(f"topic {name!r} isn't subscribed to")
        if "id" in content:
            subscription.wishes.pop(str(content["id"]), None)
        if "id" not in content or not subscription.wishes:
            del client.subscriptions[name]
        self.server.watch()

    def _do_advertise(self, client: Client, content: dict[str, Any]) -> None:
        name, type_ = _name(content, "topic"), content.get("type")
        if not isinstance(type_, str):
            raise InputError("advertise: expected type, such as std_msgs/msg/String")
        self._check_type(name, type_)
        topic = self.server.graph.topics.get(name)
        if topic is None:
            if full_name(type_) not in self.server.types:
                raise InputError(f"unknown type {type_!r}")
            if len(self.topics) >= _MAX_SUBSCRIPTIONS:
                raise InputError(f"more than {_MAX_SUBSCRIPTIONS} topics of clients")
            self.topics[name] = full_name(type_)
        if content.get("latch"):
            self._latched.setdefault(name, None)  # type: ignore[arg-type]
        client.advertised.add(name)

    def _do_unadvertise(self, client: Client, content: dict[str, Any]) -> None:
        name = _name(content, "topic")
        client.advertised.discard(name)
        if not any(name in other.advertised for other in self.clients):
            self.topics.pop(name, None)
            self._latched.pop(name, None)

    def _do_publish(self, client: Client, content: dict[str, Any]) -> None:
        name, type_ = _name(content, "topic"), content.get("type")
        known = self._type_of(name)
        if not known and isinstance(type_, str):
            self._do_advertise(client, content)
            known = self._type_of(name)
        if not known:
            self.server.graph.topic(name)  # It raises InputError with what there is.
        fields = self.server.types.fill(known, content.get("msg"), f"{name}: msg")
        topic = self.server.graph.topics.get(name)
        if topic is not None:
            if topic.takes is None:
                raise InputError(f"nobody takes messages of topic {name!r}")
            self._submit(client, content, "publish", name, fields)
        elif name in self._latched:
            self._latched[name] = fields
        encoder = Encoder(self.server)
        for other in self.clients:
            if name in other.subscriptions and topic is None:
                other.subscriptions[name].queue.append(fields)
                self._pending.add(other)
        self._send_pending(encoder, time.monotonic())

    def _submit(
        self,
        client: Client,
        content: dict[str, Any],
        kind: str,
        name: str,
        fields: dict[str, Any],
        reply: Callable[[Any], None] = lambda answer: None,
        goal_id: str = "",
    ) -> None:
        def refuse(problem: str) -> None:
            client.refuse(content, problem)

        self.server.submit(
            Request(kind, name, fields, client.sender, goal_id, reply, refuse)
        )

    def _do_call_service(self, client: Client, content: dict[str, Any]) -> None:
        name = _name(content, "service")
        size = int(_number(content, "fragment_size"))
        compression = content.get("compression") or "none"

        def reply(values: Any) -> None:
            client.send(_response(content, values, is_done=True), compression, size)

        if name.startswith("/rosapi/"):
            from arm_drake.wire.rosapi import call_rosapi

            args = content.get("args") or {}
            call_rosapi(self, client, name, args, reply, content)
            return
        if name in (served := self.served["service"]):
            self._call_client(served[name].client, client, name, content)
            return
        service = self.server.graph.service(name)
        args = _arguments(content, f"{service.type}_Request", self)
        self.ask(client, content, name, args, reply)

    def ask(
        self,
        client: Client,
        content: dict[str, Any],
        name: str,
        fields: dict[str, Any],
        reply: Callable[[Any], None],
    ) -> None:
        """Call a service of the simulation for a client."""
        type_ = f"{self.server.graph.service(name).type}_Response"

        def complete(values: dict[str, Any]) -> None:
            reply(self.server.types.complete(type_, values))

        self._submit(client, content, "call", name, fields, complete)

    def _call_client(
        self, provider: Client, caller: Client, name: str, content: dict[str, Any]
    ) -> None:
        """Have another client answer a call."""
        key = f"call_service:{name}:{uuid.uuid4().hex}"
        self._calls[key] = _Waiting(caller, content, provider)
        request = {"op": "call_service", "id": key, "service": name}
        provider.send({**request, "args": content.get("args") or {}})

    def _do_service_response(self, client: Client, content: dict[str, Any]) -> None:
        waiting = self._calls.pop(str(content.get("id")), None)
        if waiting is None:
            raise InputError("nobody waits for this response")
        values, is_done = content.get("values"), bool(content.get("result", True))
        waiting.client.send(_response(waiting.request, values, is_done=is_done))

    def _do_send_goal(self, client: Client, content: dict[str, Any]) -> None:
        name, id_ = _name(content, "action"), content.get("id")
        if not isinstance(id_, str):
            raise InputError("send_action_goal: expected id, a text")
        if name in (served := self.served["action"]):
            provider = served[name].client
            key = f"{id_}:{uuid.uuid4().hex}"
            self._calls[key] = _Waiting(client, content, provider)
            provider.send({**content, "id": key})
            return
        action = self.server.graph.action(name)
        type_name = content.get("action_type")
        if type_name and full_name(str(type_name), "action") != action.type:
            raise InputError(
                f"action {name!r} is of type {action.type}, not {type_name}"
            )
        fields = _arguments(content, f"{action.type}_Goal", self)
        wants_feedback = bool(content.get("feedback", False))
        compression = content.get("compression") or "none"

        def reply(event: GoalEvent) -> None:
            answer = {"action": content.get("action"), "id": id_}
            if event.kind == "feedback":
                if wants_feedback:
                    answer |= {"op": "action_feedback", "values": event.data}
                    client.send(answer, compression)
            elif event.kind == "cancel":
                client.tell_error(event.reason, id_)
            elif event.kind != "accepted":
                client.goals.pop(id_, None)
                is_done = event.status == _SUCCEEDED
                answer |= {"op": "action_result", "values": event.data}
                if event.kind == "rejected":
                    answer["values"] = event.reason or "the goal is rejected"
                answer |= {"status": event.status, "result": is_done}
                client.send(answer, compression)

        self._submit(
            client, content, "goal", name, fields, reply, f"{client.sender} {id_}"
        )
        client.goals[id_] = name

    def _do_cancel_goal(self, client: Client, content: dict[str, Any]) -> None:
        name, id_ = _name(content, "action"), content.get("id")
        for key, waiting in self._calls.items():
            if waiting.client is client and waiting.request.get("id") == id_:
                waiting.provider.send({**content, "id": key})
                return
        if not isinstance(id_, str) or id_ not in client.goals:
            raise InputError(f"no goal {str(id_)[:100]!r} of this client")
        goal = f"{client.sender} {id_}"
        self._submit(client, content, "cancel", name, {}, goal_id=goal)

    def _do_from_server(self, client: Client, content: dict[str, Any]) -> None:
        """Pass on what a client says of a goal of another one."""
        key = str(content.get("id"))
        waiting = self._calls.get(key)
        if waiting is None:
            raise InputError("nobody waits for news of this goal")
        if content.get("op") == "action_result":
            del self._calls[key]
        waiting.client.send({**content, "id": waiting.request.get("id")})

    def _do_set_level(self, client: Client, content: dict[str, Any]) -> None:
        level = content.get("level")
        if level not in _LEVELS:
            raise InputError(f"no level {level!r}; known: {', '.join(_LEVELS)}")
        client.level = level

    def _do_auth(self, client: Client, content: dict[str, Any]) -> None:
        raise InputError("auth: there is no authentication; every client is let in")

    def _do_status(self, client: Client, content: dict[str, Any]) -> None:
        """Take note of what a client says of itself: nothing."""

    def _do_fragment(self, client: Client, content: dict[str, Any]) -> None:
        if client.fragments is None:
            client.fragments = Fragments(_MAX_SIZE)
        whole = client.fragments.add(content)
        if whole is not None:
            inner = _read(whole)
            if inner.get("op") == "fragment":
                raise InputError("a fragment of fragments")
            self.do(client, inner)

    def _do_png(self, client: Client, content: dict[str, Any]) -> None:
        inner = _read(from_png(content.get("data"), _MAX_SIZE))
        if inner.get("op") == "png":
            raise InputError("a png of a png")
        self.do(client, inner)


def _advertise(
    kind: str, bridge: Rosbridge, client: Client, content: dict[str, Any]
) -> None:
    """Let a client serve what the simulation doesn't serve itself."""
    name, graph = _name(content, kind), bridge.server.graph
    if name in (graph.services if kind == "service" else graph.actions):
        raise InputError(f"{kind} {name!r} is the simulation's own")
    bridge.served[kind][name] = _Served(str(content.get("type", "")), client)


def _unadvertise(
    kind: str, bridge: Rosbridge, client: Client, content: dict[str, Any]
) -> None:
    """Let a client serve something no longer."""
    name, served = _name(content, kind), bridge.served[kind]
    if name not in served or served[name].client is not client:
        raise InputError(f"{kind} {name!r} isn't this client's")
    del served[name]


_SUCCEEDED = 4

_OPERATIONS: Mapping[str, Callable[[Rosbridge, Client, dict[str, Any]], None]] = {
    "subscribe": Rosbridge._do_subscribe,
    "unsubscribe": Rosbridge._do_unsubscribe,
    "advertise": Rosbridge._do_advertise,
    "unadvertise": Rosbridge._do_unadvertise,
    "publish": Rosbridge._do_publish,
    "call_service": Rosbridge._do_call_service,
    "service_response": Rosbridge._do_service_response,
    "advertise_service": functools.partial(_advertise, "service"),
    "unadvertise_service": functools.partial(_unadvertise, "service"),
    "send_action_goal": Rosbridge._do_send_goal,
    "cancel_action_goal": Rosbridge._do_cancel_goal,
    "advertise_action": functools.partial(_advertise, "action"),
    "unadvertise_action": functools.partial(_unadvertise, "action"),
    "action_feedback": Rosbridge._do_from_server,
    "action_result": Rosbridge._do_from_server,
    "set_level": Rosbridge._do_set_level,
    "auth": Rosbridge._do_auth,
    "status": Rosbridge._do_status,
    "fragment": Rosbridge._do_fragment,
    "png": Rosbridge._do_png,
}


def _name(content: Mapping[str, Any], field: str) -> str:
    """Return a name with a slash in front, or raise InputError."""
    name = content.get(field)
    if not isinstance(name, str) or not name.strip("/") or len(name) > 500:
        raise InputError(f"{content.get('op')}: expected {field}, a name")
    return f"/{name.strip('/')}"


def _number(content: Mapping[str, Any], field: str) -> float:
    """Return a number of at least 0, which is 0 if it is missing."""
    value = content.get(field)
    if value is None:
        return 0.0
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not 0.0 <= value < 1e9:
        raise InputError(f"{field}: expected a number of at least 0, got {value!r}")
    return float(value)


def _arguments(
    content: Mapping[str, Any], type_: str, bridge: Rosbridge
) -> dict[str, Any]:
    """Return the arguments of a call or goal; a list has them in order."""
    args = content.get("args")
    if isinstance(args, list):
        names = [name for name, _, _ in bridge.server.types.fields(type_)]
        if len(args) > len(names):
            raise InputError(f"args: {len(names)} expected, got {len(args)}")
        args = dict(zip(names, args, strict=False))
    return bridge.server.types.fill(type_, args, "args")
