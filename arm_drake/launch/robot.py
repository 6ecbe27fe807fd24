"""Robots of a launch file: where each is described, what controls it, its place."""

import dataclasses as dc
import re
import shutil
import tempfile
import weakref
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from arm_drake import yaml_files
from arm_drake.description.bridge import TopicAlias
from arm_drake.description.controllers import ControllerConfig, set_hardware_states
from arm_drake.description.elements import parse_xml
from arm_drake.description.entry import TEXT, text_of
from arm_drake.description.joints import WORLD
from arm_drake.description.links import Pose
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport, ReportEntry
from arm_drake.description.robot import Robot
from arm_drake.description.xacro import SAID, expand_xacro
from arm_drake.errors import InputError, PackageError, find_close, suggest
from arm_drake.importing import dataclass
from arm_drake.launch.frames import Placed
from arm_drake.launch.written_files import PREFIX
from arm_drake.loading import as_urdf, load_robot
from arm_drake.manager.loading import load_controllers_of
from arm_drake.options import SimulationOptions

_NO_MANAGER = "there is no ros2_control_node, and nothing puts it into a simulator"

_GROUND = "model://ground_plane"

_VARIABLE = re.compile(r"\$\(var\s+(\w+)\s*\)")

# Where a simulator's plugin names its controllers YAML.
_PARAMETERS_TAG = re.compile(r"<parameters>\s*([^<]+?)\s*</parameters>")


class PlanFolder:
    """A folder of files that a launch file wrote, kept as long as its users."""

    def __init__(self) -> None:
        """Create it."""
        self.path = Path(tempfile.mkdtemp(prefix=PREFIX)).resolve()

        # Files in it that are others rewritten: which, and whether lines are theirs.
        self.rewritten: dict[str, tuple[str, bool]] = {}
        self.remove = weakref.finalize(
            self, shutil.rmtree, self.path, ignore_errors=True
        )
        self._expansions: dict[tuple[Path, frozenset[tuple[str, str]]], str] = {}

    def write_parameters(self, data: Any, source: str) -> Path:
        """Write a parameter file, of which `source` is the origin."""
        number = len(list(self.path.glob("parameters_*.yaml")))
        path = self.path / f"parameters_{number}.yaml"
        path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
        self.rewritten[str(path)] = (source, False)
        return path

    def expand(
        self, file: Path, arguments: Mapping[str, str], packages: PackageFinder
    ) -> str:
        """Return a xacro file's text, once expanded for all that look into it."""
        key = packages.real(file), frozenset(arguments.items())
        if key not in self._expansions:
            self._expansions[key] = expand_xacro(file, arguments, packages)
        return self._expansions[key]


class Remapping(NamedTuple):
    """A topic of a controller by another name."""

    source: str
    target: str

    # The launch file that says so.
    file: Path

    def to_alias(self, namespace: str) -> TopicAlias:
        """Return it as a bridge of the topic has it."""
        source, target = self.source.strip("/"), self.target.strip("/")
        source = source.removeprefix(f"{namespace}/").removeprefix("~/")
        root = "/" if self.target.startswith("/") else ""
        names = f"{root}{target}", f"/{source}"
        return TopicAlias(*names, "BIDIRECTIONAL", self.file, 1)


# What holds the files of robots that are in use.
_folders: "weakref.WeakKeyDictionary[Robot, PlanFolder | None]" = (
    weakref.WeakKeyDictionary()
)


def hold_files(robot: Robot, folder: PlanFolder | None) -> None:
    """Keep the files that a launch file wrote as long as a robot."""
    _folders[robot] = folder


@dataclass(frozen=True)
class LaunchedRobot:
    """Robots of a launch file: where each is described, what controls it, its place."""

    # A URDF or xacro file, or the text of a URDF.
    source: Path | str
    xacro_args: Mapping[str, str] = dc.field(default_factory=dict)

    # Its name in the simulator, and the name space of its nodes.
    name: str | None = None
    namespace: str = ""
    frame_prefix: str = ""

    # "gazebo" (Classic), "gz", or None.
    simulator: str | None = None

    # x, y, z [m], roll, pitch, yaw [rad]; None if nothing is said.
    pose: Pose | None = None

    # Whether a controller manager runs, in or beside a simulator.
    has_manager: bool = False

    # Parameter files, and states of controllers in the order of their spawners.
    controllers: tuple[Path, ...] = ()
    spawned: Mapping[str, str] = dc.field(default_factory=dict)

    # Controllers of which all run or none (`--activate-as-group`).
    groups: tuple[tuple[str, ...], ...] = ()

    # States that hardware components are put into after the start.
    hardware: Mapping[str, str] = dc.field(default_factory=dict)

    # Whether `ros2 launch` ends if xacro says something.
    ends_on_words: bool = False

    # SRDF file that a planner is given, with what lies beside it.
    srdf: Path | None = None

    # What its controllers' topics are called besides.
    remappings: tuple[Remapping, ...] = ()

    # Values of `$(var NAME)` in parameter files.
    variables: Mapping[str, str] = dc.field(default_factory=dict)

    # Arguments of `load_robot` that go before what the launch file says.
    loading: Mapping[str, Any] = dc.field(default_factory=dict)

    # What holds the files that were written.
    folder: PlanFolder | None = dc.field(default=None, repr=False, compare=False)

    @property
    def is_controlled(self) -> bool:
        """Whether something controls or simulates it."""
        return self.has_manager or self.simulator is not None

    @property
    def chosen_name(self) -> str | None:
        """Name beside other robots; None if as its description says."""
        name = self.name or self.namespace or None
        return None if name is None else name.strip("/").replace("/", "_")

    def load(
        self,
        name: str | None,
        package_paths: Sequence[Path],
        bridges: Sequence[Path],
        placed: Placed,
        *,
        initial_positions: Mapping[str, float] | None = None,
    ) -> Robot:
        """Load it, with positions of joints at the start [rad] or [m].

        Raises:
            InputError: If it can't be loaded.
        """
        options = dict(self.loading)
        own = options.pop("controllers", None) or self._files(package_paths)
        files = [*map(self._with_hardware, map(Path, own)), *bridges]
        # One that is only shown has no controllers, whatever lies beside it.
        is_shown = not self.is_controlled and not self.spawned
        said: dict[str, Any] = {"name": name, "srdf": self.srdf}
        said["namespace"] = self.namespace or None
        rewritten = self.folder.rewritten if self.folder else {}
        try:
            robot = load_robot(
                self.source,
                xacro_args=self.xacro_args,
                controllers=files or ([] if is_shown else None),
                package_paths=package_paths,
                variables=self._variables_in(files) | options.pop("variables", {}),
                pose=placed.pose if self.pose is None else self.pose,
                initial_positions=initial_positions,
                frames={**placed.frames, **options.pop("frames", {})},
                **(said | options),
            )
        except InputError as error:
            if error.file is None or error.file not in rewritten:
                raise
            file, has_its_lines = rewritten[error.file]
            line = error.line if has_its_lines else None
            raise InputError(
                error.problem, file=file, line=line, where=error.where
            ) from None
        if self.ends_on_words:
            _report_words(robot.report)
        robot = _name_sources(robot, rewritten)
        namespace = self.namespace.strip("/")
        aliases = [each.to_alias(namespace) for each in self.remappings]
        robot = dc.replace(robot, topic_aliases=(*robot.topic_aliases, *aliases))
        if self.is_controlled:
            robot = _without_idle(robot, self.spawned)
        if self.simulator is not None:
            _report_held_base(robot)
        _report_hardware(robot, self.hardware)
        hold_files(robot, self.folder)
        return robot

    def read_carriers(self, package_paths: Sequence[Path]) -> dict[str, str | None]:
        """Return for each link the one that carries it, None for a root."""
        file, text = self._expand(package_paths)
        root = parse_xml(as_urdf(text, file, package_paths, LoadReport()), file)
        carriers = {link.get("name", ""): None for link in root.iterfind("link")}
        found: dict[str, str | None] = dict(carriers)
        for joint in root.iterfind("joint"):
            parent, child = joint.find("parent"), joint.find("child")
            if parent is not None and child is not None:
                found[child.get("link", "")] = parent.get("link", "")
        return found

    def _expand(self, package_paths: Sequence[Path]) -> tuple[Path, str]:
        """Return the description's file, and its text without xacro."""
        if not isinstance(self.source, Path):
            return Path.cwd() / TEXT, self.source
        packages = PackageFinder(self.source, tuple(package_paths))
        expand = expand_xacro if self.folder is None else self.folder.expand
        return self.source, expand(self.source, self.xacro_args, packages)

    def _variables_in(self, files: Sequence[Path]) -> dict[str, str]:
        """Return the values of the `$(var NAME)` in some files."""
        texts = [text_of(file) for file in files]
        named = {name for text in texts for name in _VARIABLE.findall(text)}
        return {k: v for k, v in self.variables.items() if k in named}

    def _with_hardware(self, file: Path) -> Path:
        """Return a parameter file in which hardware starts in its later state."""
        if self.folder is None or not self.hardware:
            return file
        try:
            data = yaml_files.parse(text_of(file))
        except yaml_files.YamlError:
            return file  # It is told where the file is read.
        changed = set_hardware_states(data, self.hardware)
        if changed == data:
            return file
        source, _ = self.folder.rewritten.get(str(file), (str(file), False))
        return self.folder.write_parameters(changed, source)

    def _files(self, package_paths: Sequence[Path]) -> list[Path]:
        """Return the controllers YAML, with those that a simulator's plugin names."""
        if self.simulator is None or not self.controllers:
            return list(self.controllers)
        file, text = self._expand(package_paths)
        packages = PackageFinder(file, tuple(package_paths))
        found = []
        for name in dict.fromkeys(_PARAMETERS_TAG.findall(text)):
            try:
                path = packages.locate(name, file.parent)[0]
            except PackageError:
                continue
            if path.is_file() and name.endswith((".yaml", ".yml")):
                found.append(path.resolve())
        return list(dict.fromkeys([*found, *self.controllers]))

    def states_of(self, robot: Robot, report: LoadReport) -> dict[str, str]:
        """Return which of a robot's controllers run, by name: active or inactive.

        Gazebo's plugins run wherever there is a Gazebo; nothing spawns them.
        """
        controllers = robot.controllers.controllers
        known = [each.name for each in controllers if not each.plugins]
        if not robot.description.hardware or not self.is_controlled:
            return {}
        for name in self.spawned:
            if name not in known:
                what = f"controller {name!r} is spawned but has no parameters"
                done = f"it is left out; {suggest(name, known)}"
                report.add("warning", "missing", what, done)
        states = {name: s for name, s in self.spawned.items() if name in known}
        for group in self.groups:
            self._stop_group(group, states, robot, report)
        if known and not states:
            what = f"no controller of {robot.name!r} is spawned"
            done = f"none runs; --active NAME starts one: {', '.join(known)}"
            report.add("info", "ignored", what, done)
        by_plugins = "inactive" if self.simulator is None else "active"
        states |= {each.name: by_plugins for each in controllers if each.plugins}
        return states | {name: "inactive" for name in known if name not in states}

    def _stop_group(
        self,
        group: Sequence[str],
        states: dict[str, str],
        robot: Robot,
        report: LoadReport,
    ) -> None:
        """Let none of a group's controllers run if one of them can't."""
        active = tuple(name for name, state in states.items() if state == "active")
        inactive = tuple(c.name for c in robot.controllers.controllers)
        options = SimulationOptions(
            active=active, inactive=tuple(n for n in inactive if n not in active)
        )
        loaded, _ = load_controllers_of(robot, options=options)
        running = {each.name for each in loaded if each.state == "active"}
        failed = [name for name in group if name not in running]
        if failed:
            what = f"controllers {', '.join(group)} start as a group"
            done = f"none of them runs, for {', '.join(failed)} can't"
            report.add("warning", "ignored", what, done)
            states.update({name: "inactive" for name in group if name in states})

    def lines(self) -> list[str]:
        """Return it as lines of a plan."""
        source = self.source if isinstance(self.source, Path) else "a text"
        rewritten = self.folder.rewritten if self.folder else {}
        named = {k: rewritten.get(v, (v,))[0] for k, v in self.xacro_args.items()}
        arguments = " ".join(f"{k}:={v}" for k, v in named.items())
        place = "" if self.pose is None else f" at {list(self.pose)}"
        lines = [
            f"robot {self.chosen_name or ''}".rstrip()
            + f": {source} {arguments}".rstrip()
            + place
        ]
        for path in map(str, self.controllers):
            lines.append(f"  parameters: {rewritten.get(path, (path,))[0]}")
        lines += [f"  controller {name}: {s}" for name, s in self.spawned.items()]
        lines += [f"  planning groups: {self.srdf}"] if self.srdf else []
        return lines


def _report_words(report: LoadReport) -> None:
    """Report that `ros2 launch` ends where xacro prints something to standard error."""
    for said in [each for each in report if each.done == SAID][:1]:
        words = said.what.partition(" (when ")[0]
        what = f"xacro prints {words!r}, and on_stderr of its Command is 'fail'"
        done = "ros2 launch ends there, unless with on_stderr='warn'; here it goes on"
        report.add("error", "invalid", what, done, file=said.file)


def _name_sources(robot: Robot, rewritten: Mapping[str, tuple[str, bool]]) -> Robot:
    """Name the files of which others are rewritten, where the user can look."""
    if not rewritten:
        return robot

    def name_entry(entry: ReportEntry) -> ReportEntry:
        if entry.file is None or entry.file not in rewritten:
            return entry
        file, has_its_lines = rewritten[entry.file]
        return dc.replace(entry, file=file, line=entry.line if has_its_lines else None)

    def name(place: Any) -> Any:
        if str(place.file) not in rewritten:
            return place
        file, has_its_lines = rewritten[str(place.file)]
        return dc.replace(place, file=Path(file), line=place.line * has_its_lines)

    controllers = tuple(
        dc.replace(
            name(each), parameters={k: name(p) for k, p in each.parameters.items()}
        )
        for each in robot.controllers.controllers
    )
    return dc.replace(
        robot,
        report=LoadReport(map(name_entry, robot.report)),
        controllers=dc.replace(robot.controllers, controllers=controllers),
    )


def _without_idle(robot: Robot, spawned: Collection[str]) -> Robot:
    """Leave out what can't run and nothing spawns; ROS never loads it.

    Why it can't is told, but is no error. What a misspelt spawner may mean stays.
    """

    def has(controller: ControllerConfig, entry: ReportEntry) -> bool:
        return f"{entry.where}.".startswith(f"{controller.name}.")

    report, config = robot.report, robot.controllers
    names = [each.name for each in config.controllers]
    meant = {*spawned}
    meant.update(filter(None, (find_close(n, names) for n in meant.difference(names))))
    lost = [
        each
        for each in config.controllers
        if not (each.plugins or each.name in meant)
        and any(has(each, entry) for entry in report.errors)
    ]
    if not lost:
        return robot
    others = LoadReport(
        dc.replace(e, severity="info") if any(has(each, e) for each in lost) else e
        for e in report
    )
    what = f"no spawner loads {', '.join(each.name for each in lost)}"
    done = "they are left out: they can't run here"
    others.add("info", "ignored", what, done, file=lost[0].file)
    kept = tuple(each for each in config.controllers if each not in lost)
    return dc.replace(
        robot, report=others, controllers=dc.replace(config, controllers=kept)
    )


def _report_held_base(robot: Robot) -> None:
    """Record a base that Gazebo would leave to itself, and that is held here."""
    description = robot.description
    is_held = any(joint.parent == WORLD for joint in description.joints)
    if not robot.has_free_base and not is_held:
        what = f"Gazebo holds {description.base!r} nowhere: there is no link 'world'"
        done = "it is held where it starts; it neither falls nor walks"
        robot.report.add("warning", "repair", what, done, file=description.file)


def _report_hardware(robot: Robot, states: Mapping[str, str]) -> None:
    """Report hardware that is put into a state and isn't there, or stays active."""
    initial = robot.controllers.hardware_components_initial_state
    names = [block.name for block in robot.description.hardware]
    idle = {*initial.unconfigured, *initial.inactive}
    for name, state in states.items():
        what = f"hardware component {name!r} is set {state}"
        if name not in names:
            done = f"it isn't there; {suggest(name, names)}"
            robot.report.add("warning", "missing", what, done)
        elif state != "active" and name in set(initial.active or names) - idle:
            robot.report.add("warning", "unsupported", what, "it stays active")


class LaunchedModel(NamedTuple):
    """An SDF model that a launch file puts into a simulator."""

    file: Path
    name: str | None
    pose: Pose | None


def add_models(
    world: str | Path, models: Sequence[LaunchedModel], folder: PlanFolder
) -> str | Path:
    """Return a world with some models in it, as an SDF file in a folder."""
    if not models:
        return world
    root = ET.Element("sdf", version="1.9")
    if isinstance(world, Path):
        root = parse_xml(world.read_text(encoding="utf-8"), world)
    place = root.find("world")
    if place is None:
        place = ET.SubElement(root, "world", name="empty")
        ET.SubElement(ET.SubElement(place, "include"), "uri").text = _GROUND
    for model in models:
        include = ET.SubElement(place, "include")
        ET.SubElement(include, "uri").text = f"file://{model.file}"
        if model.name is not None:
            ET.SubElement(include, "name").text = model.name
        pose = model.pose or (0.0,) * 6
        ET.SubElement(include, "pose").text = " ".join(map(str, pose))
    target = folder.path / "world.sdf"
    ET.ElementTree(root).write(target, encoding="unicode")
    return target


class Bridge(NamedTuple):
    """An argument of a `parameter_bridge`: a topic of Gazebo, its types and direction.

    Source: ros_gz_bridge, README.md.
    """

    argument: str

    # What the topic is called in ROS, after remappings.
    ros_topic: str

    def __str__(self) -> str:
        """Return the argument."""
        return self.argument


_ARGUMENT = re.compile(r"(?P<topic>[^@]+)@(?P<ros>[^@[\]]+)(?P<way>[@[\]])(?P<gz>.+)")
_WAYS = {"@": "BIDIRECTIONAL", "[": "GZ_TO_ROS", "]": "ROS_TO_GZ"}


def write_bridges(bridges: Sequence[Bridge], folder: PlanFolder) -> list[Path]:
    """Return arguments of bridges as a YAML file of one, if there are any."""
    entries = []
    for argument, ros_topic in bridges:
        match = _ARGUMENT.fullmatch(argument)
        if match is None:
            entries.append({"service_name": argument.partition("@")[0]})
            continue
        entries.append(
            {
                "ros_topic_name": ros_topic,
                "gz_topic_name": match["topic"],
                "ros_type_name": match["ros"],
                "gz_type_name": match["gz"],
                "direction": _WAYS[match["way"]],
            }
        )
    if not any("ros_topic_name" in entry for entry in entries):
        return []
    path = folder.path / "parameter_bridge.yaml"
    path.write_text(yaml.safe_dump(entries, sort_keys=False), encoding="utf-8")
    return [path]


class Description(NamedTuple):
    """A description that something publishes or has."""

    topic: str
    namespace: str
    source: Path | str
    arguments: Mapping[str, str]
    frame_prefix: str = ""
    ends_on_words: bool = False


class Spawn(NamedTuple):
    """A robot that is put into a simulator."""

    name: str | None
    topic: str | None
    description: Description | None
    pose: Pose | None
    simulator: str


class Manager(NamedTuple):
    """A controller manager beside no simulator."""

    name: str
    namespace: str
    description: Description | None
    topic: str
    files: tuple[Path, ...]
    remappings: tuple[Remapping, ...] = ()


def has_controllers(parameters: Sequence[Any]) -> bool:
    """Return whether parameters of a node, or files of them, have controllers' types.

    These are a controller manager's: mappings in its parameters with a `type` of
    pluginlib, such as "joint_trajectory_controller/JointTrajectoryController".
    """
    for each in parameters:
        data: Any = {"ros__parameters": each}
        if isinstance(each, str):
            if not (path := Path(each)).is_file():  # A pipe would be read for ever.
                continue
            try:
                data = yaml_files.load(path)
            except yaml_files.YamlError:
                continue
        if _has_types(data, "ros__parameters"):
            return True
    return False


def _has_types(data: Any, key: str) -> bool:
    """Return whether a mapping, or one in it, has controllers below a key."""
    if not isinstance(data, Mapping):
        return False
    found = data.get(key)
    sections = found.values() if isinstance(found, Mapping) else ()
    types = [each.get("type") for each in sections if isinstance(each, Mapping)]
    if any(isinstance(kind, str) and "/" in kind for kind in types):
        return True
    return any(_has_types(value, key) for value in data.values())


class Spawner(NamedTuple):
    """Controllers that are started at once, or hardware components."""

    names: tuple[str, ...]
    state: str
    manager: str
    files: tuple[Path, ...] = ()

    # Whether all of them run or none.
    is_group: bool = False
    kind: str = "controller"


@dc.dataclass
class RobotParts:
    """Parts of robots in a launch file, in its order, to be put together."""

    descriptions: list[Description] = dc.field(default_factory=list)
    spawns: list[Spawn] = dc.field(default_factory=list)
    managers: list[Manager] = dc.field(default_factory=list)
    spawners: list[Spawner] = dc.field(default_factory=list)

    # What spawners' controllers call their topics.
    remappings: list[Remapping] = dc.field(default_factory=list)

    # SRDF files of planners, with their name spaces.
    semantics: list[tuple[str, Path]] = dc.field(default_factory=list)

    # Controllers and hardware of robots that aren't there: the name, which of the two,
    # and why.
    left_out: list[tuple[str, str, str]] = dc.field(default_factory=list)

    def find_robots(self, *, has_world: bool) -> list[LaunchedRobot]:
        """Return the robots of all descriptions, with what belongs to each.

        Where nothing has a world, spawners need a controller manager.
        """
        descriptions: list[Description] = []
        for published in self.descriptions:
            # Publishers of one description say the same of one robot.
            if published not in descriptions:
                descriptions.append(published)
        for each in self.spawns:
            if each.description and not _is_among(each.description, descriptions):
                descriptions = self._add_spawn(each.description, descriptions)
        for manager in self.managers:
            own = manager.description
            if own is None or _is_among(own, descriptions, in_namespace=True):
                continue
            others = [d for d in descriptions if d.namespace == own.namespace]
            others = others or self._published_apart(own, descriptions)
            if len(others) == 1 and others[0].source == own.source:
                # What is published, but for arguments that concern its control.
                index = descriptions.index(others[0])
                descriptions[index] = own._replace(topic=others[0].topic)
            else:
                descriptions.append(own)
        robots = []
        for description in descriptions:
            spawns = self._spawns_of(description, len(descriptions))
            managers = [
                m for m in self.managers if self._has(m, description, descriptions)
            ]
            spaces = [description.namespace]
            if len(descriptions) == 1:
                # Its controllers are where their manager is.
                spaces += [m.namespace for m in managers]
            robot = LaunchedRobot(
                source=description.source,
                xacro_args=description.arguments,
                namespace=next(filter(None, spaces), ""),
                frame_prefix=description.frame_prefix,
                ends_on_words=description.ends_on_words,
                has_manager=bool(managers),
                controllers=tuple(f for m in managers for f in m.files),
                srdf=self._semantics_of(description, len(descriptions)),
                remappings=(
                    *(each for m in managers for each in m.remappings),
                    *self.remappings,
                ),
            )
            robots += [
                dc.replace(
                    robot,
                    name=spawn.name,
                    simulator=spawn.simulator,
                    pose=spawn.pose,
                )
                for spawn in spawns
            ] or [robot]
        return self._add_spawned(robots, has_world=has_world)

    def _published_apart(
        self, own: Description, descriptions: Sequence[Description]
    ) -> list[Description]:
        """Return what is published elsewhere of the one robot that a manager has."""
        is_same = len(self.managers) == 1 and _is_among(own, descriptions)
        return list(descriptions) if is_same and len(descriptions) == 1 else []

    def _add_spawn(
        self, own: Description, descriptions: list[Description]
    ) -> list[Description]:
        """Add what a spawner has by itself; it stands for what is published there.

        A description of its name space that nothing else puts into the simulator, or
        controls, says only how RViz and TF see the robot, as of one in an SDF file.
        """
        topics = [spawn.topic for spawn in self.spawns if spawn.topic is not None]
        topics += [each.topic for each in self.managers if each.description is None]
        owned = [m.description for m in self.managers if m.description is not None]
        seen = [
            each
            for each in descriptions
            if each in self.descriptions
            and each.namespace == own.namespace
            and each.topic not in topics
            and not _is_among(each, owned)
        ]
        if seen:
            own = own._replace(frame_prefix=seen[0].frame_prefix)
        return [each for each in descriptions if each not in seen] + [own]

    def _semantics_of(self, description: Description, count: int) -> Path | None:
        for namespace, path in self.semantics:
            if count == 1 or namespace == description.namespace:
                return path
        return None

    def _spawns_of(self, description: Description, count: int) -> list[Spawn]:
        """Return where a description is put into a simulator, which may be often."""
        found = [
            spawn
            for spawn in self.spawns
            if (spawn.topic == description.topic and spawn.topic is not None)
            or (spawn.description and _is_among(spawn.description, [description]))
        ]
        return found or (self.spawns if count == 1 and len(self.spawns) == 1 else [])

    def _has(
        self,
        manager: Manager,
        description: Description,
        descriptions: Sequence[Description],
    ) -> bool:
        """Return whether a controller manager is that of a description."""
        if len(descriptions) == 1:
            return True
        if manager.description is not None:
            is_same = description.namespace == manager.namespace
            same = _is_among(manager.description, [description])
            spaces = [d.namespace for d in descriptions]
            return same and (is_same or manager.namespace not in spaces)
        return manager.topic == description.topic

    def _add_spawned(
        self, robots: list[LaunchedRobot], *, has_world: bool
    ) -> list[LaunchedRobot]:
        """Return robots with what their spawners start."""
        for spawner in self.spawners:
            index = self._index_of(spawner, robots, has_world=has_world)
            if index is None:
                reason = "its robot isn't started"
                if robots:
                    known = [f"/{each.name}" for each in self.managers]
                    reason = f"/{spawner.manager.strip('/')} isn't started; "
                    reason += f"there is {', '.join(known)}" if known else _NO_MANAGER
                self.left_out += [(n, spawner.kind, reason) for n in spawner.names]
                continue
            robot = robots[index]
            if spawner.kind != "controller":
                states = dict.fromkeys(spawner.names, spawner.state)
                robots[index] = dc.replace(robot, hardware={**robot.hardware, **states})
                continue
            spawned = dict(robot.spawned)
            for name in spawner.names:
                spawned[name] = spawner.state
            files = dict.fromkeys((*robot.controllers, *spawner.files))
            groups = robot.groups
            if spawner.is_group and spawner.state == "active":
                groups = (*groups, spawner.names)
            robots[index] = dc.replace(
                robot, spawned=spawned, controllers=tuple(files), groups=groups
            )
        return robots

    def _index_of(
        self, spawner: Spawner, robots: Sequence[LaunchedRobot], *, has_world: bool
    ) -> int | None:
        """Return which robot a spawner's controller manager is that of."""
        is_simulated = any(robot.simulator is not None for robot in robots)
        if not is_simulated and (self.managers or not has_world):
            # All managers are known, so that a spawner would wait for any other.
            names = [manager.name for manager in self.managers]
            if spawner.manager.strip("/") not in names:
                return None
        candidates = [i for i, robot in enumerate(robots) if robot.is_controlled]
        candidates = candidates or list(range(len(robots)))
        if len(candidates) <= 1:
            return candidates[0] if candidates else None
        space = spawner.manager.rpartition("/")[0].strip("/")
        for index in candidates:
            if robots[index].namespace == space:
                return index
        for index in candidates:
            if space in (robots[index].name, robots[index].chosen_name):
                return index
        return candidates[0]


def _is_among(
    one: Description, others: Sequence[Description], *, in_namespace: bool = False
) -> bool:
    return any(
        (one.source, dict(one.arguments)) == (other.source, dict(other.arguments))
        and (not in_namespace or one.namespace == other.namespace)
        for other in others
    )
