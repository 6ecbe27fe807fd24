"""The sensors of robots as systems of a diagram: what all kinds have in common."""

import abc
import dataclasses as dc
import importlib
import zlib
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, Final, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.geometry import QueryObject, SceneGraph
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import (
    CacheIndex,
    Context,
    DiagramBuilder,
    LeafSystem,
    State,
    ValueProducer,
)

from arm_drake.controllers.gazebo.plugin import as_topic, ros_topic, with_node
from arm_drake.description.gazebo import GazeboPlugin
from arm_drake.description.perception_sensors import PerceptionSensor
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, suggest
from arm_drake.manager.connections import with_prefix
from arm_drake.messages import Header, Message
from arm_drake.perception.images import compress
from arm_drake.perception.scenery import Scenery
from arm_drake.plant.plant import transform_of
from arm_drake.python_system import PythonSystem

# What a rate may be off by rounding, as a part of it.
_ROUNDED: Final = 1e-9


class Place(NamedTuple):
    """Place of a sensor, and names used by others."""

    # Names of the robot's model in Gazebo, of that in the plant, and of the world.
    robot: str
    model: str
    world: str

    # Seed of its noise.
    seed: int = 0

    # Topics that others publish on, with the first one's name and class of messages.
    taken: Mapping[str, tuple[str, type | None]] = MappingProxyType({})


class SensorParams(NamedTuple):
    """Data of a publisher for its topics."""

    controller_name: str

    # [Hz].
    update_rate: float


class SensorSystem(PythonSystem):
    """A camera or lidar: what it has in common with others.

    It has no state: whenever it is asked, it tells what is there then, and nothing is
    computed that nobody reads. There is an output port for each of its `topics`, called
    as the topic is, or `<topic>:<sensor>` where others publish on it, too; the classes
    of their messages are in `output_types`.

    Drake tells whatever depends on the time or on poses at each step that these have
    changed, and a step of a small robot is little more than that. So nothing here
    depends on the time, and the ports keep no values: what was measured is kept by all
    of them in one place, with its time, until something may have moved.
    """

    # Keys of `topics` whose messages are pictures, which logs compress.
    pictures: ClassVar[tuple[str, ...]] = ()

    def __init__(
        self,
        sensor: PerceptionSensor,
        place: Place,
        scenery: Scenery,
        topics: Mapping[str, str],
        R_SM: RotationMatrix | None = None,
    ) -> None:
        """Create the system; `topics` are its topics by what is on them.

        R_SM is from the sensor's frame, x ahead and z up, to that of its `pose`.
        """
        super().__init__()
        self.scenery, self.topics = scenery, dict(topics)
        self.params = SensorParams(sensor.name, sensor.update_rate)
        default = f"{place.robot}/{sensor.link}/{sensor.group or sensor.name}"
        if sensor.plugin is not None:
            default = sensor.link
        self.frame_id = sensor.frame_id or default
        is_world = sensor.link == "world"
        self.link = "world" if is_world else f"{place.model}::{sensor.link}"
        self._seed = (place.seed, zlib.crc32(f"{place.robot}/{sensor.name}".encode()))
        X_LS, R_SM = transform_of(sensor.pose), R_SM or RotationMatrix()
        self._X_LM = RigidTransform(X_LS.rotation() @ R_SM, X_LS.translation())
        self._query = self.DeclareAbstractInputPort(
            "geometry_query", AbstractValue.Make(QueryObject())
        )
        forget = ValueProducer(lambda: AbstractValue.Make({}), _forget)
        entry = self.DeclareCacheEntry("measured", forget, {self._query.ticket()})
        self._measured = int(entry.cache_index())
        self.output_types: dict[str, type[Message]] = {}
        self._taken = place.taken

    @property
    @abc.abstractmethod
    def _makers(self) -> Mapping[str, tuple[type[Message], Any]]:
        """Functions that make the messages of topics, by their content."""

    def _declare_topics(self) -> None:
        for number, (key, topic) in enumerate(self.topics.items(), start=1):
            kind, make = self._makers[key]
            is_shared = topic in self._taken or topic in self.output_types
            port = f"{topic}:{self.params.controller_name}" if is_shared else topic
            self.output_types[port] = kind
            self._declare(port, make)
            # Of cache entries of a system each has the number after the last one's.
            entry = self.get_cache_entry(CacheIndex(self._measured + number))
            entry.disable_caching_by_default()

    @staticmethod
    def topic_of(port: str) -> str:
        """Return the topic of an output port."""
        return port.partition(":")[0]

    def _declare(self, topic: str, make: Any) -> None:
        def calc(context: Context, output: AbstractValue) -> None:
            output.set_value(self._measure(context, topic, make))

        self.DeclareAbstractOutputPort(
            topic,
            lambda: AbstractValue.Make(()),
            calc,
            prerequisites_of_calc={self._query.ticket()},
        )

    def _measure(
        self, context: Context, what: str, make: Callable[[Context], Any]
    ) -> Any:
        """Return what `make` makes, once for the time and the poses of a context."""
        entry = self.get_cache_entry(CacheIndex(self._measured))
        measured, now = entry.Eval(context), context.get_time()
        if measured.get("time") != now:
            measured.clear()
            measured["time"] = now
        if what not in measured:
            measured[what] = make(context)
        return measured[what]

    def pose(self, context: Context) -> RigidTransform:
        """Return the pose of what it measures in, in the world, by its own context."""
        query = self._query.Eval(context)
        return self.scenery.pose_of(query, self.link) @ self._X_LM

    def _random(self, context: Context, *what: int) -> np.random.Generator:
        """Return where noise comes from; at one time it is always the same."""
        return np.random.default_rng([*self._seed, _nanoseconds(context), *what])

    def _header(self, context: Context, frame: str) -> Header:
        return Header.from_nanoseconds(_nanoseconds(context), frame)


def _forget(_: Context, measured: AbstractValue) -> None:
    measured.set_value({})


def _nanoseconds(context: Context) -> int:
    return round(context.get_time() * 1e9)


_Sensor = TypeVar("_Sensor", bound=SensorSystem)


class SensorHandle(Generic[_Sensor]):
    """Present measurement of a sensor."""

    def __init__(self, system: _Sensor, find_context: Callable[[], Context]) -> None:
        """Create it; the function returns the diagram's context, as it is then."""
        self._system = system
        self._find_context = find_context

    def __repr__(self) -> str:
        """Return its kind, and the topics that it publishes on."""
        return f"<{type(self).__name__} on {', '.join(self.topics.values())}>"

    @property
    def topics(self) -> dict[str, str]:
        """Its topics, by what is on them."""
        return dict(self._system.topics)

    @property
    def pose(self) -> RigidTransform:
        """Pose in the world: of a camera's optical frame, else x ahead and z up."""
        return self._system.pose(self._own_context())

    def _own_context(self) -> Context:
        return self._system.GetMyContextFromRoot(self._find_context())

    def _in_world(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points of the sensor's own frame in the world, shape (n, 3)."""
        X_WM = self.pose
        return np.asarray(points @ X_WM.rotation().matrix().T + X_WM.translation())


def find_sensor(
    sensors: Mapping[str, SensorSystem], kind: type[_Sensor], name: str, none: str = ""
) -> _Sensor:
    """Return a sensor of a kind, or raise InputError.

    `none` is what to do where there is none.
    """
    found = {key: each for key, each in sensors.items() if isinstance(each, kind)}
    if not isinstance(name, str):
        known = f"known: {', '.join(found)}" if found else f"the robots have none{none}"
        word = kind.__name__.lower()
        raise InputError(f"expected the name of a {word}, got {name!r}; {known}")
    if name not in found:
        word = kind.__name__.lower()
        problem = f"no {word} {name!r}"
        if name in sensors:
            problem = f"{name!r} is a {type(sensors[name]).__name__.lower()}, no {word}"
        hint = suggest(name, found) if found else f"the robots have no {word}{none}"
        raise InputError(f"{problem}; {hint}")
    return found[name]


def find_classic_topics(
    plugin: GazeboPlugin, names: Mapping[str, str]
) -> dict[str, str]:
    """Return the full names of topics of a plugin of Gazebo Classic."""
    namespace = plugin.text("ros/namespace")
    rules = with_node(plugin.texts("ros/remapping"), namespace, plugin.name)
    return {key: ros_topic(name, namespace, rules) for key, name in names.items()}


class _Sampled(NamedTuple):
    """Messages of a time, and those before: a copy is the thing itself."""

    time: float
    messages: tuple[Message, ...]
    before: "_Sampled | None"

    def __deepcopy__(self, memo: object) -> "_Sampled":
        return self


class SensorLog(PythonSystem):
    """Keeps what a sensor publishes, at its update rate.

    .. pydrake_system::

        name: SensorLog
        input_ports:
        - <topic>

    =======  ====  ================================================================
    port     size  meaning
    =======  ====  ================================================================
    <topic>  --    messages of a topic of the sensor; there is a port for each
    =======  ====  ================================================================

    What was kept is in the context.
    """

    def __init__(
        self, sensor: SensorSystem, prefix: str, image_format: str = "raw"
    ) -> None:
        """Create it for a sensor of a robot, whose names begin with a prefix."""
        super().__init__()
        self.topics = tuple(sensor.output_types)
        self._image_format = image_format
        pictures = {sensor.topics.get(name) for name in sensor.pictures}
        if image_format == "raw":
            pictures = set()
        names = list(map(SensorSystem.topic_of, self.topics))
        self._is_file = tuple(name in pictures for name in names)
        self._names = tuple(
            f"/{prefix}{name.lstrip('/')}{'/compressed' if is_file else ''}"
            for name, is_file in zip(names, self._is_file, strict=True)
        )
        for topic in self.topics:
            self.DeclareAbstractInputPort(topic, AbstractValue.Make(()))
        self._kept = self.DeclareAbstractState(AbstractValue.Make([None]))
        period = 1.0 / sensor.params.update_rate
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, state: State) -> None:
        messages = tuple(
            compress(message, self._image_format) if is_file else message
            for message, is_file in zip(
                [self.GetInputPort(topic).Eval(context) for topic in self.topics],
                self._is_file,
                strict=True,
            )
        )
        before = context.get_abstract_state(self._kept).get_value()[0]
        kept = _Sampled(context.get_time(), messages, before)
        state.get_mutable_abstract_state(self._kept).set_value([kept])

    def read(self, root: Context, since: float) -> dict[str, tuple[Message, ...]]:
        """Return the messages since a time [s] by topic, with the robot's prefix."""
        now, found = root.get_time(), []
        kept = self._newest(root)
        while kept is not None and kept.time >= since:
            if kept.time <= now:
                found.append(kept.messages)
            kept = kept.before
        columns = (
            zip(*reversed(found), strict=True) if found else [()] * len(self._names)
        )
        return dict(zip(self._names, map(tuple, columns), strict=True))

    def forget_before(self, root: Context, time: float) -> None:
        """Forget the messages before a time [s]."""
        kept, later = self._newest(root), []
        while kept is not None and kept.time >= time:
            later.append(kept)
            kept = kept.before
        rest: _Sampled | None = None
        for each in reversed(later):
            rest = each._replace(before=rest)
        context = self.GetMyMutableContextFromRoot(root)
        context.get_mutable_abstract_state(self._kept).set_value([rest])

    def _newest(self, root: Context) -> _Sampled | None:
        context = self.GetMyContextFromRoot(root)
        newest: _Sampled | None = context.get_abstract_state(self._kept).get_value()[0]
        return newest


def log_name(prefix: str, sensor: str) -> str:
    """Return the name of the log of a sensor."""
    return f"{prefix}log:sensor:{sensor}"


def add_sensors(
    builder: DiagramBuilder,
    scene_graph: SceneGraph,
    robot: Robot,
    place: Place,
    scenery: Scenery,
    prefix: str,
    report: LoadReport,
    time_step: float,
    logged: Sequence[str] = (),
    image_format: str = "raw",
) -> tuple[LeafSystem, ...]:
    """Add the cameras and lidars of a robot, and export their topics.

    They compute nothing that nobody reads; the log of those whose names, with the
    prefix, are in `logged` reads them, and has their pictures in a format, as
    `SimulationOptions.log_image_format`. Nothing is told more often than the
    simulation steps, every `time_step` [s].
    """
    systems: list[LeafSystem] = []
    publishers = dict(place.taken)
    query = scene_graph.GetOutputPort("query")
    for sensor in robot.description.perception_sensors:
        sensor = _restrain(sensor, time_step, report)
        module, _, name = sensor.system.partition(":")
        make: Any = getattr(importlib.import_module(module), name)
        system = make(sensor, place._replace(taken=publishers), scenery)
        builder.AddNamedSystem(f"{prefix}sensor:{sensor.name}", system)
        builder.Connect(query, system.GetInputPort("geometry_query"))
        for port, kind in system.output_types.items():
            builder.ExportOutput(system.GetOutputPort(port), with_prefix(prefix, port))
            topic = system.topic_of(port)
            first, other = publishers.setdefault(topic, (sensor.name, kind))
            if kind is not other:
                names = f"{first!r} and {sensor.name!r}"
                what = f"{names} publish messages of two types on the topic {topic!r}"
                done = f"what {first!r} publishes is there"
                report.add("warning", "unsupported", what, done, where="sensors")
        systems.append(system)
        if f"{prefix}{sensor.name}" in logged:
            name = log_name(prefix, sensor.name)
            log = builder.AddNamedSystem(name, SensorLog(system, prefix, image_format))
            for topic in log.topics:
                builder.Connect(system.GetOutputPort(topic), log.GetInputPort(topic))
    return tuple(systems)


def _restrain(
    sensor: PerceptionSensor, time_step: float, report: LoadReport
) -> PerceptionSensor:
    """Return a sensor as it can be in the diagram, and report what it can't."""
    where, most = f"sensor {sensor.name!r}", 1.0 / time_step
    topic = as_topic(sensor.topic).strip("/")
    if sensor.plugin is None and topic != sensor.topic.strip("/"):
        what = f"topic {sensor.topic!r}: expected one without spaces, @, ~, // and :="
        done = f"it is {topic!r}" if topic else "it is the usual one"
        report.add("warning", "invalid", what, done, where=where)
        sensor = dc.replace(sensor, topic=topic)
    if sensor.update_rate <= most * (1.0 + _ROUNDED):
        return sensor
    what = f"update_rate {sensor.update_rate:g} Hz, more often than anything moves"
    done = f"it is {most:g} Hz, once in each step"
    report.add("warning", "unsupported", what, done, where=where)
    return dc.replace(sensor, update_rate=most)


def check_logged(names: Sequence[str], robots: Mapping[str, Robot]) -> None:
    """Raise InputError if one of the names isn't a camera or lidar of the robots.

    The robots are by the prefix of their names.
    """
    known = [
        f"{prefix}{sensor.name}"
        for prefix, robot in robots.items()
        for sensor in robot.description.perception_sensors
    ]
    for name in names:
        if name not in known:
            hint = suggest(name, known) if known else "the robots have none"
            raise InputError(f"log_images: no camera or lidar {name!r}; {hint}")
