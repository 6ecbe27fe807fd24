"""The services of rosapi: what there is, and what it is made of.

Source: RobotWebTools/rosbridge_suite, `rosapi` and `rosapi_msgs`.
"""

import functools
import json
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from arm_drake.errors import InputError, suggest
from arm_drake.rollout.bag import stamp
from arm_drake.wire.server import RosServer
from arm_drake.wire.services import from_parameter_value, to_parameter_value
from arm_drake.wire.types import full_name

Args = Mapping[str, Any]
Reply = Callable[[Any], None]


class Bridge(Protocol):
    """Bridge whose clients call."""

    server: RosServer

    # Types of what clients advertise, by topic; what they serve, by kind and name.
    topics: dict[str, str]
    served: dict[str, dict[str, Any]]

    def ask(
        self, client: Any, content: dict[str, Any], name: str, fields: Any, reply: Reply
    ) -> None:
        """Call a service of the simulation."""


def call_rosapi(
    bridge: Bridge,
    client: Any,
    name: str,
    args: Any,
    reply: Reply,
    content: dict[str, Any],
) -> None:
    """Answer a call, or raise InputError."""
    if not isinstance(args, Mapping):
        raise InputError(f"{name}: expected args by name")
    api, own = RosApi(bridge), name.removeprefix("/rosapi/")
    if own in ("get_param", "set_param", "has_param", "get_param_names"):
        _Params(bridge, client, content, reply).call(own, args)
        return
    answer = _CALLS.get(own)
    if answer is None:
        raise InputError(f"no service {name!r}; {suggest(own, _CALLS)}")
    reply(answer(api, args))


class RosApi:
    """Answers of rosapi on the graph, and on what clients advertise."""

    def __init__(self, bridge: Bridge) -> None:
        """Create it."""
        self.bridge = bridge
        self.graph, self.types = bridge.server.graph, bridge.server.types

    def topics(self) -> dict[str, str]:
        """Return the types of all topics by name."""
        return _types(self.graph.topics) | self.bridge.topics

    def services(self) -> dict[str, str]:
        """Return the types of all services by name."""
        return _types(self.graph.services) | _types(self.bridge.served["service"])

    def actions(self) -> dict[str, str]:
        """Return the types of all actions by name."""
        return _types(self.graph.actions) | _types(self.bridge.served["action"])

    def typedefs(self, type_: str) -> list[dict[str, Any]]:
        """Return what a type is made of, and the types in it."""
        found: dict[str, dict[str, Any]] = {}
        waiting = [type_]
        while waiting:
            name = waiting.pop()
            if name in found or name not in self.types:
                continue
            fields, constants = self.types.fields(name), self.types.constants(name)
            found[name] = {
                "type": name,
                "fieldnames": [field for field, _, _ in fields],
                "fieldtypes": [kind for _, kind, _ in fields],
                "fieldarraylen": [length for _, _, length in fields],
                "examples": [_example(kind, n) for _, kind, n in fields],
                "constnames": [constant for constant, _, _ in constants],
                "constvalues": [str(value) for _, _, value in constants],
            }
            waiting += [kind for _, kind, _ in fields if "/" in kind]
        if not found:
            raise InputError(f"unknown type {type_!r}")
        return list(found.values())


def _types(known: Mapping[str, Any]) -> dict[str, str]:
    return {name: each.type for name, each in known.items()}


def _example(kind: str, length: int) -> str:
    if length != -1:
        return "[]"
    if "/" in kind:
        return "{}"
    return {"string": "", "bool": "false"}.get(kind, "0")


def _of_type(known: Mapping[str, str], type_name: Any, what: str) -> list[str]:
    type_ = full_name(str(type_name), what)
    return [name for name, other in known.items() if other == type_]


def _type(known: Mapping[str, str], args: Args, field: str) -> dict[str, str]:
    return {"type": known.get(f"/{str(args.get(field, '')).strip('/')}", "")}


def _topic_nodes(api: RosApi, args: Args, side: str) -> list[str]:
    topic = api.graph.topics.get(f"/{str(args.get('topic', '')).strip('/')}")
    node = "" if topic is None else getattr(topic, side)
    return [node] if node else []


def _node_details(api: RosApi, args: Args) -> dict[str, list[str]]:
    node, topics = args.get("node"), api.graph.topics.values()
    return {
        "subscribing": [t.name for t in topics if t.subscriber == node],
        "publishing": [t.name for t in topics if t.publisher == node],
        "services": [s.name for s in api.graph.services.values() if s.node == node],
    }


def _details(part: str) -> Callable[[RosApi, Args], dict[str, Any]]:
    def details(api: RosApi, args: Args) -> dict[str, Any]:
        type_ = str(args.get("type", ""))
        what = {"": "msg", "_Request": "srv", "_Response": "srv"}.get(part, "action")
        return {"typedefs": api.typedefs(f"{full_name(type_, what)}{part}")}

    return details


def _definitions(api: RosApi) -> list[str]:
    return [
        api.types.schema(type_) if type_ in api.types else ""
        for type_ in api.topics().values()
    ]


def _now(api: RosApi) -> dict[str, int]:
    """Return the clock with the names of ROS 1, too, which roslibpy reads."""
    time = stamp(api.bridge.server.now_ns)
    return {**time, "secs": time["sec"], "nsecs": time["nanosec"]}


_CALLS: Mapping[str, Callable[[RosApi, Args], Any]] = {
    "topics": lambda api, args: {
        "topics": list(api.topics()),
        "types": list(api.topics().values()),
    },
    "topics_and_raw_types": lambda api, args: {
        "topics": list(api.topics()),
        "types": list(api.topics().values()),
        "typedefs_full_text": _definitions(api),
    },
    "topics_for_type": lambda api, args: {
        "topics": _of_type(api.topics(), args.get("type"), "msg")
    },
    "topic_type": lambda api, args: _type(api.topics(), args, "topic"),
    "services": lambda api, args: {"services": list(api.services())},
    "services_for_type": lambda api, args: {
        "services": _of_type(api.services(), args.get("type"), "srv")
    },
    "service_type": lambda api, args: _type(api.services(), args, "service"),
    "service_providers": lambda api, args: {
        "providers": _of_type(api.services(), args.get("service"), "srv")
    },
    "service_node": lambda api, args: {
        "node": next(
            (
                service.node
                for name, service in api.graph.services.items()
                if name == args.get("service")
            ),
            "",
        )
    },
    "action_servers": lambda api, args: {"action_servers": list(api.actions())},
    "action_type": lambda api, args: _type(api.actions(), args, "action"),
    "nodes": lambda api, args: {"nodes": api.graph.nodes()},
    "node_details": _node_details,
    "publishers": lambda api, args: {
        "publishers": _topic_nodes(api, args, "publisher")
    },
    "subscribers": lambda api, args: {
        "subscribers": _topic_nodes(api, args, "subscriber")
    },
    "interfaces": lambda api, args: {"interfaces": sorted(api.types)},
    "message_details": _details(""),
    "service_request_details": _details("_Request"),
    "service_response_details": _details("_Response"),
    "action_goal_details": _details("_Goal"),
    "action_result_details": _details("_Result"),
    "action_feedback_details": _details("_Feedback"),
    "get_time": lambda api, args: {"time": _now(api)},
    "get_ros_version": lambda api, args: {
        "version": 2,
        "distro": api.types.distro,
    },
}


class _Params:
    """Parameters by names such as "/node:name", through the nodes' services."""

    def __init__(
        self, bridge: Bridge, client: Any, content: dict[str, Any], reply: Reply
    ) -> None:
        self._bridge, self._client = bridge, client
        self._content, self._reply = content, reply

    def call(self, name: str, args: Args) -> None:
        """Answer a call of a service of rosapi."""
        if name == "get_param_names":
            self._names()
            return
        node, colon, own = str(args.get("name", "")).partition(":")
        node = f"/{node.strip('/')}"
        if not colon:
            raise InputError("name: expected /NODE:PARAMETER")
        if name == "set_param":
            self._set(node, own, args)
            return
        request = {"names": [own]}
        self._ask(f"{node}/get_parameters", request, lambda v: self._got(name, v, args))

    def _got(self, name: str, values: Any, args: Args) -> None:
        [found] = values["values"]
        if name == "has_param":
            self._reply({"exists": found["type"] != 0})
            return
        value = from_parameter_value(found)
        text = args.get("default_value", "") if value is None else json.dumps(value)
        self._reply({"value": text, "successful": value is not None, "reason": ""})

    def _set(self, node: str, own: str, args: Args) -> None:
        try:
            value = json.loads(str(args.get("value", "")))
        except ValueError:
            value = args.get("value")
        request = {"parameters": [{"name": own, "value": to_parameter_value(value)}]}

        def done(values: Any) -> None:
            [result] = values["results"]
            self._reply(result)

        self._ask(f"{node}/set_parameters", request, done)

    def _names(self) -> None:
        services = self._bridge.server.graph.services
        nodes = [n for n in services if n.endswith("/list_parameters")]
        names: list[str] = []
        left = set(nodes)

        def take(node: str, values: Any) -> None:
            own = node.removesuffix("/list_parameters")
            names.extend(f"{own}:{name}" for name in values["result"]["names"])
            left.discard(node)
            if not left:
                self._reply({"names": names})

        for node in nodes:
            self._ask(node, {}, functools.partial(take, node))

    def _ask(self, name: str, request: Args, reply: Reply) -> None:
        server = self._bridge.server
        type_ = f"{server.graph.service(name).type}_Request"
        fields = server.types.fill(type_, request)
        self._bridge.ask(self._client, self._content, name, fields, reply)
