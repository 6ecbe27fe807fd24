"""Scene files: robots, the world, things in it, and how to simulate them, as one YAML.

    robots:
    - {robot: doosan_a0912, name: left, pose: [0, 0.5, 0, 0, 0, 0], motion: tutorial}
    - {robot: arm.urdf.xacro, controllers: controllers.yaml, initial: {joint2: 0.5}}
    world: house
    things:
    - {name: cube, box: [0.05, 0.05, 0.05], mass: 0.1, color: red, pose: [0.4, 0, 0.03]}
    options: {time_step: 0.001}

Files are looked for in the folder of the scene. `schemas/scene.schema.json` describes
the file for editors.
"""

import dataclasses as dc
import functools
import heapq
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar

import yaml
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from arm_drake import yaml_files
from arm_drake.description.entry import EXAMPLE, bundled_motions, bundled_robots, is_xml
from arm_drake.description.links import Pose
from arm_drake.description.robot import Robot, list_robots
from arm_drake.errors import InputError, suggest
from arm_drake.importing import dataclass
from arm_drake.loading import load_robot
from arm_drake.messages import SwitchController
from arm_drake.options import SimulationOptions
from arm_drake.output_files import writing
from arm_drake.plant.payloads import Payload, Payloads, check_link, read_payload
from arm_drake.plant.plant import pose_of
from arm_drake.simulation.motion import (
    Motion,
    MotionStep,
    SetPayloads,
    TopicMessage,
)
from arm_drake.simulation.motion_files import find_motion
from arm_drake.simulation.simulation import Simulation
from arm_drake.worlds.things import COLORS, SHAPES, LoadedWorld, Thing, with_things
from arm_drake.worlds.world import WORLDS, World, load_world


@dataclass(frozen=True, repr=False)
class MotionOfSeveral(Motion):
    """Motions of several robots, each in its own time."""

    parts: tuple[Motion, ...] = ()

    @property
    def duration(self) -> float:
        """When the last of them is done, those that repeat after one round [s]."""
        return max((part.duration for part in self.parts), default=0.0)

    def timeline(self) -> Iterator[tuple[float, MotionStep]]:
        """Yield when each step is due [s], and the step."""
        timelines = (part.timeline() for part in self.parts)
        return heapq.merge(*timelines, key=lambda due: due[0])


@dataclass(frozen=True, eq=False)
class Scene:
    """Scene that `load_scene` returns, and `build_diagram` takes in place of robots."""

    robots: tuple[Robot, ...]

    # As `build_diagram` takes it, without the things.
    world: World = "empty"

    things: tuple[Thing, ...] = ()
    options: SimulationOptions = dc.field(default_factory=SimulationOptions)

    # By link; where there are several robots by `<robot>/<link>`.
    payloads: Payloads = dc.field(default_factory=dict)

    # By robot, or one that calls all of several robots `<robot>/<name>`, by "".
    motions: Mapping[str, Motion] = dc.field(default_factory=dict)

    file: Path | None = None

    def __post_init__(self) -> None:
        """Raise InputError if names are not each one's own."""
        if not self.robots and not self.things:
            raise InputError("expected robots or things, got neither")
        robots = list_robots(self.robots) if self.robots else []
        names = [robot.name for robot in robots]
        for thing in self.things:
            if thing.name in names:
                text = f"something else is called {thing.name!r}; give it another name"
                raise InputError(text, where="things")
            names.append(thing.name)

    def __repr__(self) -> str:
        """Return what is in it, by names."""
        robots = [robot.name for robot in self.robots]
        things = [thing.name for thing in self.things]
        file = "" if self.file is None else f"{str(self.file)!r}, "
        world = str(self.world) if isinstance(self.world, str | Path) else "of its own"
        return f"<Scene {file}robots {robots}, world {world!r}, things {things}>"

    @property
    def motion(self) -> Motion | None:
        """The motions of all robots as one, for `Simulation.run`; None if none has."""
        if not self.motions:
            return None
        if len(self.robots) == 1 or set(self.motions) == {""}:
            return next(iter(self.motions.values()))
        parts = tuple(
            dc.replace(
                motion,
                file=None,
                steps=tuple(_address(motion, s, f"{name}/") for s in motion.steps),
            )
            for name, motion in self.motions.items()
        )
        steps = sorted((s for part in parts for s in part.steps), key=lambda s: s.at)
        repeats = any(part.repeats for part in parts)
        return MotionOfSeveral(None, tuple(steps), repeats, parts=parts)

    def load_world(self) -> LoadedWorld:
        """Return the world with the things in it."""
        paths = [path for robot in self.robots for path in robot.package_paths]
        return with_things(load_world(self.world, paths), self.things)

    def to_data(self, folder: Path | None = None) -> dict[str, Any]:
        """Return it as plain data of a scene file, with files named from a folder."""
        if not isinstance(self.world, str | Path):
            text = "expected a world by name, or of a file"
            raise InputError(f"a scene can't be written: {text}, got {self.world!r}")
        data: dict[str, Any] = {}
        if self.robots:
            data["robots"] = [self._entry_of(r, folder) for r in self.robots]
        world = str(self.world)
        data["world"] = world if world in WORLDS else _name_file(world, folder)
        if self.things:
            data["things"] = [_thing_to_data(thing) for thing in self.things]
        defaults = SimulationOptions()
        options = {
            name: list(value) if isinstance(value, tuple) else value
            for name in _OPTIONS
            if (value := getattr(self.options, name)) != getattr(defaults, name)
        }
        return data | ({"options": options} if options else {})

    def _entry_of(self, robot: Robot, folder: Path | None) -> dict[str, Any]:
        """Return what a scene file says of a robot."""
        options = dict(robot.load_options)
        source = options.pop("source", robot.bundled or robot.description.file)
        if isinstance(source, str) and is_xml(source):
            text = f"robot {robot.name!r} was loaded from a text; expected a file"
            raise InputError(f"a scene can't be written: {text}")
        is_name = robot.bundled is not None or str(source).startswith(EXAMPLE)
        entry: dict[str, Any] = {
            "robot": str(source) if is_name else _name_file(source, folder),
            "name": robot.name,
        }
        for key in _LOAD_OPTIONS:
            option = "initial_positions" if key == "initial" else key
            value = options.get(option)
            if value is None or key == "name" or value in ({}, (), [], False):
                continue
            if key in _FILES:
                several = [value] if isinstance(value, str | os.PathLike) else value
                value = [_name_file(name, folder) for name in several]
            elif key == "frames":
                value = {
                    k: {"parent": parent, "pose": list(map(float, pose))}
                    for k, (parent, pose) in value.items()
                }
            elif isinstance(value, Mapping):
                value = {
                    k: float(v) if key == "initial" else str(v)
                    for k, v in value.items()
                }
            elif key == "pose":
                value = list(map(float, value))
            entry[key] = value
        prefix = f"{robot.name}/" if len(self.robots) > 1 else ""
        payloads = {
            link.removeprefix(prefix): _payload_to_data(link, payload)
            for link, payload in self.payloads.items()
            if link.startswith(prefix)
        }
        entry |= {"payload": payloads} if payloads else {}
        motion = self.motions.get(robot.name)
        return entry | (_motion_to_data(motion, robot, folder) if motion else {})

    def at(self, simulation: Simulation) -> Self:
        """Return the scene as it is now in a simulation of it.

        Joints, free bases and things are where they are; things of the world, motions
        and payloads are as at the start.
        """
        robots = [_robot_at(robot, simulation) for robot in self.robots]
        things, plant = self.things, simulation.diagram.GetSubsystemByName("plant")
        if isinstance(plant, MultibodyPlant):  # Else nothing moves them.
            context = plant.GetMyContextFromRoot(simulation.context)
            things = tuple(_thing_at(thing, plant, context) for thing in things)
        return dc.replace(self, robots=tuple(robots), things=things)

    def save(self, path: str | Path) -> None:
        """Write it as a scene file.

        Args:
            path: A `.yaml` file; files are named from its folder where they lie in it.

        Raises:
            OutputError: If the file can't be written.
        """
        path = Path(path)
        data = self.to_data(path.absolute().parent)
        with writing(path):
            text = yaml.safe_dump(data, sort_keys=False, default_flow_style=None)
            path.write_text(text, encoding="utf-8")


def _robot_at(robot: Robot, simulation: Simulation) -> Robot:
    """Return a robot that starts as it is now in a simulation."""
    states = simulation.joint_states(robot.name)
    now = dict(zip(states.name, map(float, states.position), strict=True))
    joints = robot.description.independent_joints
    initial = {joint.name: now[joint.name] for joint in joints}
    options = {**robot.load_options, "initial_positions": initial}
    pose = robot.pose
    if robot.has_free_base:
        base = robot.description.base
        pose = options["pose"] = pose_of(simulation.link_poses(robot.name)[base])
    return dc.replace(robot, initial_positions=now, pose=pose, load_options=options)


def _thing_at(thing: Thing, plant: MultibodyPlant, context: Context) -> Thing:
    if thing.fixed:
        return thing
    model = plant.GetModelInstanceByName(thing.name)
    body = plant.GetBodyByName(thing.name, model)
    return dc.replace(thing, pose=pose_of(plant.EvalBodyPoseInWorld(context, body)))


def _address(motion: Motion, step: MotionStep, prefix: str) -> MotionStep:
    """Return a step of a robot's motion as it is called beside other robots."""
    message = step.message
    if isinstance(message, TopicMessage):
        message = message._replace(topic=prefix + message.topic.lstrip("/"))
    elif isinstance(message, SetPayloads):
        named = {f"{prefix}{link}": each for link, each in message.payloads.items()}
        message = SetPayloads(named)
    elif isinstance(message, SwitchController):
        activate, deactivate = (
            tuple(f"{prefix}{name}" for name in names)
            for names in (message.activate_controllers, message.deactivate_controllers)
        )
        message = SwitchController(activate, deactivate, message.strictness)
    controller = None if step.controller is None else f"{prefix}{step.controller}"
    where = motion.place(step)
    return dc.replace(
        step, controller=controller, message=message, where=where, line=None
    )


def _name_file(name: str | os.PathLike[str], folder: Path | None) -> str:
    """Return a file's name as it is called from a folder, if it lies in it."""
    path = Path(os.path.abspath(Path(name).expanduser()))
    if folder is None or not path.is_relative_to(folder):
        return str(path)
    # A name without a slash may be that of something bundled.
    return f"./{path.relative_to(folder)}"


def _payload_to_data(link: str, payload: Payload | float) -> Any:
    payload = read_payload(link, payload)
    if payload.inertia is not None or payload.shape is not None:
        text = "a scene file has its mass and com only, no inertia and no shape"
        raise InputError(f"payload of link {link!r}: {text}")
    com = [float(x) for x in payload.com]
    return {"mass": float(payload.mass), "com": com}


def _motion_to_data(motion: Motion, robot: Robot, folder: Path | None) -> Any:
    """Return the keys of a robot's motion."""
    if motion.file is None:
        text = f"the motion of {robot.name!r} is of no file"
        raise InputError(f"a scene can't be written: {text}")
    known = bundled_motions(robot.bundled) if robot.bundled else {}
    names = [name for name, file in known.items() if file == motion.file]
    data: dict[str, Any] = {
        "motion": names[0] if names else _name_file(motion.file, folder)
    }
    parameters = dict(motion.parameters)
    return data | ({"motion_parameters": parameters} if parameters else {})


def _thing_to_data(thing: Thing) -> dict[str, Any]:
    size = list(thing.size)
    data: dict[str, Any] = {
        "name": thing.name,
        thing.kind: size[0] if thing.kind == "sphere" else size,
    }
    if thing.mass is not None:
        data["mass"] = thing.mass
    if thing.fixed:
        data["fixed"] = True
    return data | {
        "color": list(thing.color),
        "friction": thing.friction,
        "pose": list(thing.pose),
    }


_T = TypeVar("_T")


def load_scene(path: str | Path) -> Scene:
    """Load a scene file, with its robots and their motions.

    Args:
        path: The `.yaml` file.

    Raises:
        InputError: If it can't be used: with the file, the line and the place in it.
    """
    return read_file(path, _read_scene, "robots, things or both")


def read_file(path: str | Path, read: "Callable[[Value], _T]", expected: str) -> _T:
    """Return what a function reads from a YAML file; `expected` is for an empty one."""
    path = Path(path).expanduser()
    try:
        node = yaml_files.compose(yaml_files.read_text(path))
        if node is None:
            raise InputError(f"it is empty; expected {expected}", file=path)
        yaml_files.check_keys(node)
        return read(Value(path, node, ""))
    except yaml_files.YamlError as error:
        raise InputError(error.problem, file=path, line=error.line) from None


@dataclass(frozen=True)
class Value:
    """A value of a scene file or a study file, at its place."""

    file: Path
    node: yaml.Node
    where: str

    def error(self, problem: str) -> InputError:
        """Return an error at this place."""
        mark = self.node.start_mark
        line = None if mark is None else mark.line + 1
        return InputError(problem, file=self.file, line=line, where=self.where or None)

    def plain(self) -> Any:
        """Return it as plain data."""
        return yaml_files.plain(self.node)

    def mapping(self, known: Sequence[str] | None = None) -> "dict[str, Value]":
        """Return the values of a mapping by key, which must be among the known ones."""
        if not isinstance(self.node, yaml.MappingNode):
            names = f" with some of {', '.join(known)}" if known else ""
            raise self.error(f"expected a mapping{names}, got {self.plain()!r}")
        found = {}
        for key, node in yaml_files.items(self.node):
            name = str(key.value)
            where = f"{self.where}.{name}" if self.where else name
            found[name] = Value(self.file, node, where)
            if known is not None and name not in known:
                place = dc.replace(found[name], node=key, where=self.where)
                raise place.error(f"unknown key {name!r}; {suggest(name, known)}")
        return found

    def list(self) -> "list[Value]":
        """Return the values of a list."""
        if not isinstance(self.node, yaml.SequenceNode):
            raise self.error(f"expected a list, got {self.plain()!r}")
        return [
            Value(self.file, node, f"{self.where}[{number}]")
            for number, node in enumerate(self.node.value)
        ]

    def text(self) -> str:
        """Return a text that isn't empty."""
        value = self.plain()
        if not isinstance(value, str) or not value:
            raise self.error(f"expected a text, got {value!r}")
        return value

    def number(self, least: float = -math.inf, *, is_open: bool = False) -> float:
        """Return a number of at least, or above, a bound."""
        value = self.plain()
        is_number = type(value) in (int, float) and abs(value) <= 1e9
        if not is_number or value < least or (is_open and value == least):
            bound = f" {'above' if is_open else 'of at least'} {least:g}"
            what = "a finite number" + (bound if least > -math.inf else "")
            raise self.error(f"expected {what}, got {value!r}")
        return float(value)

    def numbers(
        self, *counts: int, least: float = -math.inf, is_open: bool = False
    ) -> tuple[float, ...]:
        """Return a list of so many numbers, as `number`."""
        values = [each.number(least, is_open=is_open) for each in self.list()]
        if len(values) not in counts:
            expected = " or ".join(map(str, counts))
            raise self.error(f"expected {expected} numbers, got {len(values)}")
        return tuple(values)

    def pose(self) -> Pose:
        """Return x, y, z [m] and roll, pitch, yaw [rad]; angles may be left out."""
        x, y, z, *rpy = self.numbers(3, 6)
        roll, pitch, yaw = rpy or (0.0, 0.0, 0.0)
        return (x, y, z, roll, pitch, yaw)

    def path(self) -> str:
        """Return a name, or the file of it that lies where the scene does."""
        name = self.text()
        beside = self.file.absolute().parent / Path(name).expanduser()
        is_file = os.sep in name or Path(name).suffix or beside.exists()
        return str(beside) if is_file and not name.startswith(EXAMPLE) else name


_THING_KEYS = ("name", *SHAPES, "mass", "color", "friction", "pose", "fixed")
_OPTIONS = tuple(
    field.name for field in dc.fields(SimulationOptions) if field.name != "frame_rate"
)
_WHOLE = [field.name for field in dc.fields(SimulationOptions) if field.type is int]


class SceneRobot(NamedTuple):
    """A robot of a scene file, loaded, with its payloads by link and its motion."""

    robot: Robot
    payloads: Mapping[str, Payload]
    motion: Motion | None


def _read_scene(root: Value) -> Scene:
    fields = root.mapping(("robots", "world", "things", "options"))
    lists = {key: fields[key].list() for key in ("robots", "things") if key in fields}
    robots = [read_robot(value) for value in lists.get("robots", ())]
    things = [_read_thing(value) for value in lists.get("things", ())]
    if not robots and not things:
        raise root.error("expected robots, things or both")
    _check_names(fields, robots, things)
    several = len(robots) > 1
    scene = at_place(
        root,
        lambda: Scene(
            robots=tuple(each.robot for each in robots),
            world=read_world(fields["world"]) if "world" in fields else "empty",
            things=tuple(things),
            options=(
                read_options(fields["options"])
                if "options" in fields
                else SimulationOptions()
            ),
            payloads={
                f"{each.robot.name}/{link}" if several else link: payload
                for each in robots
                for link, payload in each.payloads.items()
            },
            motions={each.robot.name: each.motion for each in robots if each.motion},
            file=root.file,
        ),
    )
    at_place(fields.get("world", root), scene.load_world)
    return scene


def _check_names(
    fields: Mapping[str, Value], robots: Sequence["SceneRobot"], things: Sequence[Thing]
) -> None:
    """Raise InputError where something is called as something before it."""
    names = set[str]()
    found = {"robots": [each.robot.name for each in robots]}
    found["things"] = [thing.name for thing in things]
    for key, own in found.items():
        for value, name in zip(fields[key].list() if own else (), own, strict=True):
            if name in names:
                text = f"something else is called {name!r}; give it another name"
                raise value.mapping().get("name", value).error(text)
            names.add(name)


def at_place(value: Value, make: Callable[[], _T]) -> _T:
    """Return what a function makes; its errors without a line get a value's place.

    Such are those of a file that isn't there, for which the value stands.
    """
    try:
        return make()
    except InputError as error:
        if error.line is not None:
            raise
        raise value.error(str(error)) from None


def read_robot(value: Value) -> SceneRobot:
    """Return the robot that a mapping describes, loaded; raises InputError."""
    fields = value.mapping(_ROBOT_KEYS)
    if "robot" not in fields:
        raise value.error("expected robot: a name, a file or a folder")
    name = fields["robot"].text()
    source = name if name in bundled_robots() else fields["robot"].path()
    options = _read_known(fields, _LOAD_OPTIONS)
    if "initial" in options:
        options["initial_positions"] = options.pop("initial")
    robot = at_place(value, lambda: load_robot(source, **options))
    payloads = _read_payloads(fields["payload"], robot) if "payload" in fields else {}
    motion, motion_parameters = None, fields.get("motion_parameters")
    if "motion" in fields:
        name = fields["motion"].path()
        parameters = (
            motion_parameters.plain()
            if motion_parameters and motion_parameters.mapping()
            else {}
        )
        motion = at_place(
            fields["motion"], lambda: find_motion(name, robot, parameters)
        )
    elif motion_parameters:
        raise motion_parameters.error("there is no motion beside them")
    return SceneRobot(robot, payloads, motion)


def _read_known(
    fields: Mapping[str, Value], readers: Mapping[str, Callable[[Value], Any]]
) -> dict[str, Any]:
    """Return what fields hold, of those that there are readers for."""
    return {key: read(fields[key]) for key, read in readers.items() if key in fields}


def _scalar(value: Value) -> str:
    """Return a text as it is written, as xacro takes it."""
    if not isinstance(value.node, yaml.ScalarNode):
        raise value.error(f"expected a text or a number, got {value.plain()!r}")
    return str(value.node.value)


def _texts(value: Value) -> dict[str, str]:
    return {name: _scalar(each) for name, each in value.mapping().items()}


def _numbers(value: Value) -> dict[str, float]:
    return {name: each.number() for name, each in value.mapping().items()}


def _paths(value: Value) -> list[str]:
    """Return a list of files and folders, or the only one."""
    is_list = isinstance(value.node, yaml.SequenceNode)
    return [each.path() for each in (value.list() if is_list else [value])]


def _flag(value: Value) -> bool:
    flag = value.plain()
    if not isinstance(flag, bool):
        raise value.error(f"expected true or false, got {flag!r}")
    return flag


def _count(value: Value) -> int:
    count = value.plain()
    if type(count) is not int or count < 1:
        raise value.error(f"expected an integer of at least 1, got {count!r}")
    return count


def _frames(value: Value) -> dict[str, tuple[str, Pose]]:
    """Return frames fixed to links by name, each its parent and its pose in it."""
    frames = {}
    for name, each in value.mapping().items():
        fields = each.mapping(("parent", "pose"))
        if "parent" not in fields:
            raise each.error("expected parent: a link")
        pose = fields["pose"].pose() if "pose" in fields else (0.0,) * 6
        frames[name] = fields["parent"].text(), pose
    return frames


# What `load_robot` takes besides the robot, by its key.
_FILES: Mapping[str, Callable[[Value], Any]] = {
    "controllers": _paths,
    "package_paths": _paths,
    "srdf": _paths,
}
_LOAD_OPTIONS: Mapping[str, Callable[[Value], Any]] = {
    **_FILES,
    "name": Value.text,
    "namespace": Value.text,
    "pose": Value.pose,
    "initial": _numbers,
    "xacro_args": _texts,
    "variables": _texts,
    "distro": Value.text,
    "decompose": _flag,
    "max_faces": _count,
    "frames": _frames,
}
_ROBOT_KEYS = ("robot", *_LOAD_OPTIONS, "payload", "motion", "motion_parameters")


def _read_payloads(value: Value, robot: Robot) -> dict[str, Payload]:
    """Return masses [kg], or mappings of mass and com, by link."""
    payloads = {}
    for link, each in value.mapping().items():
        place = dc.replace(each, where=value.where)
        at_place(place, functools.partial(check_link, link, robot.description.links))
        fields = {"mass": each}
        if isinstance(each.node, yaml.MappingNode):
            fields = each.mapping(("mass", "com"))
            if "mass" not in fields:
                raise each.error("expected mass [kg]")
        com = fields["com"].numbers(3) if "com" in fields else (0.0, 0.0, 0.0)
        payloads[link] = Payload(fields["mass"].number(0.0), com)
    return payloads


def _read_thing(value: Value) -> Thing:
    fields = value.mapping(_THING_KEYS)
    kinds = [kind for kind in SHAPES if kind in fields]
    if len(kinds) != 1 or "name" not in fields:
        text = f"expected a name and one of {', '.join(SHAPES)}"
        raise value.error(f"{text}, got {', '.join(fields) or 'nothing'}")
    (kind,) = kinds
    if kind == "sphere":
        size: tuple[float, ...] = (fields[kind].number(0.0, is_open=True),)
    else:
        size = fields[kind].numbers(SHAPES[kind][0], least=0.0, is_open=True)
    options = _read_known(fields, _THING_OPTIONS)
    name = fields["name"].text()
    return at_place(value, lambda: Thing(name, kind, size, **options))


def _read_color(value: Value) -> tuple[float, float, float, float]:
    if isinstance(value.node, yaml.SequenceNode):
        red, green, blue, *alpha = value.numbers(3, 4, least=0.0)
        color = (red, green, blue, *(alpha or (1.0,)))
        if max(color) > 1.0:
            raise value.error(f"expected numbers from 0 to 1, got {list(color)}")
        return color
    name = value.text()
    if name not in COLORS:
        raise value.error(f"unknown color {name!r}; {suggest(name, COLORS)}")
    return (*COLORS[name], 1.0)


# What a thing may have besides its name and its shape, by its key.
_THING_OPTIONS: Mapping[str, Callable[[Value], Any]] = {
    "fixed": _flag,
    "mass": functools.partial(Value.number, least=0.0, is_open=True),
    "friction": functools.partial(Value.number, least=0.0),
    "color": _read_color,
    "pose": Value.pose,
}


def read_world(value: Value) -> str:
    """Return the name of a world, or its file."""
    name = value.text()
    return name if name in WORLDS else value.path()


def read_options(value: Value) -> SimulationOptions:
    """Return options of a simulation; raises InputError at the place of a wrong one."""
    fields = value.mapping(_OPTIONS)
    options = {name: each.plain() for name, each in fields.items()}
    for name, option in options.items():
        if isinstance(option, list):
            options[name] = tuple(option)
        elif type(option) is int and name not in _WHOLE:
            options[name] = float(option)
    for name, option in options.items():
        place = dc.replace(fields[name], where="options")
        at_place(place, functools.partial(SimulationOptions, **{name: option}))
    return at_place(value, lambda: SimulationOptions(**options))
