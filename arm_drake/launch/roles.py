"""Roles of the nodes and processes of a launch file: robots, controllers, worlds.

Each is one of a robot's (its description, its controller manager, its spawners, its
place), of the world's, of what is drawn, or is not run and told.
"""

import contextlib
import dataclasses as dc
import functools
import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from arm_drake import yaml_files
from arm_drake.description.elements import parse_float
from arm_drake.description.links import Pose
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.description.sdf import is_sdf, moves_by_itself
from arm_drake.errors import DescriptionError, PackageError
from arm_drake.importing import dataclass
from arm_drake.launch.actions import join_names
from arm_drake.launch.commanded import read_goal, read_publication, save_steps
from arm_drake.launch.frames import StaticFrame, read_static_frame
from arm_drake.launch.nodes import find_role, find_what_it_does
from arm_drake.launch.robot import (
    Bridge,
    Description,
    LaunchedModel,
    Manager,
    PlanFolder,
    Remapping,
    RobotParts,
    Spawn,
    Spawner,
    has_controllers,
)
from arm_drake.launch.substitutions import KEY
from arm_drake.launch.words import (
    all_values_of,
    positional,
    split_ros_arguments,
    split_words,
    value_of,
    values_of,
    without_options,
)
from arm_drake.launch.written_files import name_written
from arm_drake.worlds.world import WORLDS

_TOPIC, _MANAGER = "robot_description", "controller_manager"

# Folder, below that of a plan, of packages that are stood for.
STOOD_FOR = "stood_for"


# So much of a command is shown that isn't run.
_MAX_NAME = 200

# States of controllers that load_controller and others are asked for.
_STATES = {"start": "active", "active": "active", "configure": "inactive"}

# Those of hardware that there is a command for.
_HARDWARE_STATES = ("unconfigured", "inactive", "active")

# What does the same here, by package.
_INSTEAD = {
    "joy": "the page's teleop moves a base",
    "plotjuggler": "--plot and `arm-drake compare` draw what was measured",
    "rqt_controller_manager": "the page switches controllers",
    "rqt_joint_trajectory_controller": "the page has a slider for each joint",
    "rqt_plot": "--plot draws what was measured",
    "rqt_robot_steering": "the page's teleop moves a base",
    "teleop_twist_joy": "the page's teleop moves a base",
    "teleop_twist_keyboard": "the page's teleop moves a base",
    "twist_mux": "a base takes whatever command comes last",
}


@dataclass(frozen=True)
class NotStarted:
    """Something of a launch file that isn't run here."""

    # Package and executable of a node, or the words of a command.
    name: str
    kind: str = "node"

    # What it would do, and what is there instead.
    reason: str = ""

    def __str__(self) -> str:
        """Return it as a line."""
        return f"not started: {self.kind} {self.name}" + (
            f"; {self.reason}" if self.reason else ""
        )


class Roles:
    """Reads what `launch_process` noted, record by record."""

    def __init__(
        self,
        answer: Mapping[str, Any],
        finder: PackageFinder,
        report: LoadReport,
        folder: PlanFolder,
    ) -> None:
        """Take the answer of the process, what finds packages, where files go."""
        self._answer, self._finder, self._report = answer, finder, report
        self._folder = folder
        folder.rewritten.update(
            (path, (str(finder.real(Path(source))), has_its_lines))
            for path, (source, has_its_lines) in answer["rewritten"].items()
        )
        self._parts = RobotParts()
        self._world: str | Path | None = None
        self._is_paused, self._is_headless = False, True
        self._rviz: Path | str | None = None
        self._fixed_frame: str | None = None
        self._has_sliders = self._has_move_group = False
        self._bridges: list[Bridge] = []
        self._bridge_files: list[Path] = []
        self._frames: list[StaticFrame] = []
        self._steps: list[dict[str, Any]] = []
        self._models: list[LaunchedModel] = []
        self._num_texts = 0
        self._simulator: str | None = None
        self._not_started: list[NotStarted] = []
        self._own_nodes: list[tuple[Mapping[str, Any], NotStarted]] = []

    def find(self) -> dict[str, Any]:
        """Return the fields of a plan."""
        for record in self._answer["records"]:
            getattr(self, f"_read_{record['kind']}")(record)
        self._take_managers()
        robots = self._parts.find_robots(has_world=self._world is not None)
        shared = {"folder": self._folder, "variables": self._answer["values"]}
        self._not_started += [NotStarted(*each) for each in self._parts.left_out]
        return {
            "robots": tuple(dc.replace(robot, **shared) for robot in robots),
            "world": self._world,
            "simulator": self._simulator,
            "models": tuple(self._models),
            "motion": self._save_motion(),
            "is_paused": self._is_paused,
            "is_headless": self._is_headless,
            "rviz": self._rviz,
            "fixed_frame": self._fixed_frame,
            "has_sliders": self._has_sliders,
            "has_move_group": self._has_move_group,
            "bridges": tuple(self._bridges),
            "bridge_files": tuple(self._bridge_files),
            "static_frames": tuple(self._frames),
            "not_started": tuple(self._not_started),
        }

    def _add(self, severity: Any, kind: Any, what: str, done: str, record: Any) -> None:
        file = record.get("file") or None
        self._report.add(severity, kind, what, done, file=file)

    def _read_log(self, record: Mapping[str, Any]) -> None:
        self._add("info", "ignored", record["text"], "so says the launch file", record)

    def _read_shutdown(self, record: Mapping[str, Any]) -> None:
        what, done = "it shuts the launch down", "the simulation goes on"
        self._add("info", "ignored", what, done, record)

    def _read_event(self, record: Mapping[str, Any]) -> None:
        if record["name"] == "Shutdown":
            return self._read_shutdown(record)
        what = f"event {record['name']}"
        self._add("warning", "unsupported", what, "it never comes here", record)

    def _read_writer(self, record: Mapping[str, Any]) -> None:
        """Do nothing: what it wrote is in the report, and there."""

    def _read_unknown(self, record: Mapping[str, Any]) -> None:
        what = f"action {record['name']}"
        self._add("warning", "unsupported", what, "it does nothing here", record)

    def _read_repeated(self, record: Mapping[str, Any]) -> None:
        what = f"{record['name']} is started once more by the same action"
        done = "ros2 launch ends there, 'executed more than once'; it is started once"
        self._add("error", "invalid", what, done, record)

    def _read_assumed_end(self, record: Mapping[str, Any]) -> None:
        what = f"something waits for the end of {record['name']}, which is not run"
        self._add("info", "ignored", what, "it is taken as ended", record)

    def _read_include(self, record: Mapping[str, Any]) -> None:
        """Read a launch file of a package that is stood for."""
        package, *_, name = (
            Path(record["path"]).relative_to(self._folder.path / STOOD_FOR).parts
        )
        values = record["arguments"]
        is_on = functools.partial(_is_true, values)
        match package, name.partition(".")[0]:
            case "gazebo_ros", "gazebo" | "gzserver" as which:
                self._simulator = "gazebo"
                self._set_world(values.get("world", ""), record)
                self._is_paused |= is_on("pause")
                self._is_headless &= which == "gzserver" or not is_on("gui", "true")
            case "gazebo_ros", "gzclient":
                self._is_headless = False
            case "ros_gz_sim", "gz_server":
                self._simulator = "gz"
                self._set_world(values.get("world_sdf_file", ""), record)
            case "ros_gz_sim", "ros_gz_spawn_model" | "gz_spawn_model":
                turns = {"roll": "R", "pitch": "P", "yaw": "Y"}
                renamed = {turns.get(name, name): v for name, v in values.items()}
                record = {**record, "arguments": (), "parameters": [renamed]}
                self._read_spawn(record, "gz")
            case (("ros_gz_sim" | "ros_ign_gazebo" as which), _):
                words = values.get(
                    "gz_args" if which == "ros_gz_sim" else "ign_args",
                    values.get("gz_args", values.get("ign_args", "")),
                )
                world = values.get("world_sdf_file", "")
                self._read_gz(split_words(f"{words} {world}"), record)
            case (("ros_gz_bridge" | "ros_ign_bridge"), _):
                self._add_bridge_file(values.get("config_file", ""), record)
            case _:
                self._leave_out(f"{package}/{name}", "launch file")

    def _read_process(self, record: Mapping[str, Any]) -> None:
        words = record["command"]
        program = os.path.basename(words[0]) if words else ""
        match [program, *words[1:]]:
            case ["ros2", "control", verb, *rest]:
                self._read_control(verb, rest, record)
            case ["gazebo" | "gzserver" as which, *rest]:
                self._read_gazebo(rest, record)
                self._is_headless &= which == "gzserver"
            case ["gzclient", *_]:
                self._is_headless = False
            case ["gz" | "ign", "sim" | "gazebo", *rest] | ["gz-sim", *rest]:
                self._read_gz(rest, record)
            case ["ros2", "topic" | "action", "pub" | "send_goal", *rest]:
                read = read_publication if words[2] == "pub" else read_goal
                step = read(rest, float(record["time"]))
                if step is None:
                    self._leave_out(" ".join(words), "process")
                else:
                    self._steps.append(step)
            case ["rviz2", *rest]:
                self._read_rviz({"arguments": rest})
            case _:
                self._leave_out(" ".join(words), "process")

    def _read_gazebo(self, words: Sequence[str], record: Mapping[str, Any]) -> None:
        """Read the command line of Gazebo Classic."""
        self._simulator = "gazebo"
        with_value = ("-s", "-g", "-e", "--iters", "--physics", "--seed")
        names = positional(words, with_value)
        self._is_paused |= "-u" in words or "--pause" in words
        self._set_world(names[0] if names else "", record)

    def _read_gz(self, words: Sequence[str], record: Mapping[str, Any]) -> None:
        """Read the arguments of `gz sim`."""
        self._simulator = "gz"
        with_value = (
            *("-v", "--verbose", "--gui-config", "--render-engine", "--seed", "-z"),
            *("--iterations", "--record-path", "--playback", "--physics-engine"),
            *("--render-engine-server", "--render-engine-gui", "--network-role"),
        )
        if "-g" in words:
            self._is_headless = False
            return
        self._is_headless &= "-s" in words
        names = positional(words, with_value)
        names = [n for n in names if not n.isdigit() and n != ".sdf"]
        self._is_paused |= "-r" not in words and "--run" not in words
        self._set_world(names[0] if names else "", record)

    def _set_world(self, name: str, record: Mapping[str, Any]) -> None:
        environment = self._answer["environment"]
        folders = [
            Path(folder, below)
            for variable in (
                *("GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH"),
                *("GAZEBO_RESOURCE_PATH", "GAZEBO_MODEL_PATH", "SDF_PATH"),
            )
            for folder in environment.get(variable, "").split(os.pathsep)
            if folder
            for below in ("", "worlds")
        ]
        for folder in [Path(record["file"]).parent, *folders] if name else []:
            if _is_file(folder / name):
                self._world = self._finder.real(folder / name)
                return
        self._world = self._world or "empty"
        if not name or re.fullmatch(r"(worlds/)?empty(_world)?(\.\w+)?", name):
            return
        what = f"world {name!r} is in no folder that the launch file names"
        done = f"the empty world is taken; --world has others: {', '.join(WORLDS)}"
        self._add("warning", "missing", what, done, record)

    def _read_control(
        self, verb: str, words: Sequence[str], record: Mapping[str, Any]
    ) -> None:
        """Read what follows `ros2 control`."""
        manager = value_of(words, "-c", "--controller-manager") or "controller_manager"
        state = _STATES.get(value_of(words, "--set-state") or "", "inactive")
        names = positional(words, ("-c", "--controller-manager", "--set-state"))
        match verb:
            case "load_controller":
                files = tuple(self._finder.real(Path(name)) for name in names[1:])
                self._spawn(names[:1], state, manager, files)
            case "set_controller_state" if len(names) > 1:
                state = _STATES.get(names[1], "inactive")
                self._spawn(names[:1], state, manager, ())
            case "switch_controllers":
                for key, state in (("activate", "active"), ("deactivate", "inactive")):
                    for one in (f"--{key}", f"--{key}-controllers"):
                        self._spawn(values_of(words, one), state, manager, ())
            case "set_hardware_component_state" if len(names) > 1:
                self._set_hardware(names[:1], names[1], manager, record)
            case _:
                self._leave_out(f"ros2 control {verb} {' '.join(words)}", "process")

    def _save_motion(self) -> Path | None:
        return save_steps(self._steps, self._folder.path / "motion.yaml")

    def _spawn(
        self, names: Sequence[str], state: str, manager: str, files: tuple[Path, ...]
    ) -> None:
        self._parts.spawners.append(Spawner(tuple(names), state, manager, files))

    def _set_hardware(
        self,
        names: Sequence[str],
        state: str,
        manager: str,
        record: Mapping[str, Any],
    ) -> None:
        if state not in _HARDWARE_STATES or not names:
            listed = ", ".join(map(repr, names)) or "without names"
            what = f"hardware components {listed} are set {state or 'no state'}"
            expected = f"expected names and one of {', '.join(_HARDWARE_STATES)}"
            done = f"it has no effect; {expected}"
            self._add("warning", "invalid", what, done, record)
            return
        spawner = Spawner(tuple(names), state, manager, kind="hardware component")
        self._parts.spawners.append(spawner)

    def _read_node(self, record: Mapping[str, Any]) -> None:
        package = record["package"]
        executable = os.path.basename(record["executable"])
        role = find_role(package, executable)
        if role is None:
            name = f"{package}/{executable}"
            self._not_started.append(_explain_node(record, self._finder, name))
            self._own_nodes.append((record, self._not_started[-1]))
        elif role.reads:
            getattr(self, f"_read_{role.reads}")(record)

    def _read_sliders(self, record: Mapping[str, Any]) -> None:
        self._has_sliders = True

    def _read_rviz(self, record: Mapping[str, Any]) -> None:
        words = record.get("arguments", ())
        path = value_of(words, "-d", "--display-config")
        self._fixed_frame = value_of(words, "-f", "--fixed-frame")
        self._rviz = "" if path is None else self._finder.real(Path(path))

    def _read_unspawner(self, record: Mapping[str, Any]) -> None:
        words = record["arguments"]
        names = positional(words, ("-c", "--controller-manager"))
        manager = value_of(words, "-c", "--controller-manager") or _MANAGER
        self._spawn(names, "inactive", join_names(record["namespace"], manager), ())

    def _read_hardware_spawner(self, record: Mapping[str, Any]) -> None:
        words = record.get("arguments", ())
        manager = value_of(words, "-c", "--controller-manager") or _MANAGER
        with_value = ("-c", "--controller-manager", "--controller-manager-timeout")
        states = {"--activate": "active", "--configure": "inactive"}
        state = next((states[word] for word in words if word in states), "")
        names = positional(words, with_value)
        manager = join_names(record["namespace"], manager)
        self._set_hardware(names, state, manager, record)

    def _read_server(self, record: Mapping[str, Any]) -> None:
        values = _merge(record)
        name = values.get("world_sdf_file", values.get("world", ""))
        self._set_world(name, record)

    def _read_move_group(self, record: Mapping[str, Any]) -> None:
        """Write SRDF and limits of a planner to files, as a package has them."""
        self._has_move_group = True
        values = _nest(_merge(record))
        text = values.get(f"{_TOPIC}_semantic")
        found = self._find_description(text, record) if isinstance(text, str) else None
        if found is None:
            return
        text = found.source
        if isinstance(text, Path):
            text = self._folder.expand(text, found.arguments, self._finder)
        folder = self._folder.path / f"moveit_{len(self._parts.semantics)}"
        folder.mkdir()
        srdf = folder / "robot.srdf"
        srdf.write_text(text, encoding="utf-8")
        for key, file in (("planning", "joint_limits"), ("kinematics", "kinematics")):
            content = values.get(f"{_TOPIC}_{key}")
            if isinstance(content, Mapping):
                path = folder / f"{file}.yaml"
                path.write_text(yaml.safe_dump(dict(content)), encoding="utf-8")
        self._parts.semantics.append((record["namespace"], srdf))

    def _leave_out(self, name: str, kind: str) -> None:
        name = " ".join(name_written(name).split())
        name = name if len(name) <= _MAX_NAME else f"{name[:_MAX_NAME]} ..."
        self._not_started.append(NotStarted(name, kind))

    def _find_description(
        self, text: str, record: Mapping[str, Any], topic: str = _TOPIC
    ) -> Description | None:
        """Return the description that a text stands for, if it is one."""
        space, prefix = record["namespace"], str(_merge(record).get("frame_prefix", ""))
        match, found = KEY.search(text), self._answer["descriptions"]
        if match is not None and int(match[1]) < len(found):
            made = found[int(match[1])]
            file = self._finder.real(Path(made["file"]))
            ends = made["ends_on_words"]
            return Description(topic, space, file, made["arguments"], prefix, ends)
        if "<robot" not in text:
            return None
        for name in dict.fromkeys(self._answer["opened"]):
            if name.endswith((".urdf", ".xacro", ".xml")) and _has_text(name, text):
                file = self._finder.real(Path(name))
                return Description(topic, space, file, {}, prefix)
        return Description(topic, space, text, {}, prefix)

    def _read_key(self, path: Path) -> str | None:
        """Return the key of the description that a launch file wrote there, if any."""
        if not (path.is_relative_to(self._folder.path) and _is_file(path)):
            return None
        text = _read_text(path).strip()
        known = self._answer["expansions"].items()
        return next((key for key, each in known if each.strip() == text), None)

    def _read_publisher(self, record: Mapping[str, Any]) -> None:
        topic = _remapped(_TOPIC, record, "/~")
        values = _merge(record)
        text = values.get(_TOPIC)
        if not isinstance(text, str):  # A file, in older versions.
            names = [n for n in record.get("arguments", ()) if n.endswith(".urdf")]
            file = Path(names[0]) if names else None
            text = (self._read_key(file) or _read_text(file)) if file else ""
        found = self._find_description(text, record, topic)
        if found is None:
            what = "robot_state_publisher has no robot_description"
            self._add("warning", "missing", what, "it is left out", record)
        else:
            self._parts.descriptions.append(found)

    def _read_manager(self, record: Mapping[str, Any]) -> None:
        text = _merge(record).get(_TOPIC, "")
        name = record.get("name") or _MANAGER
        files = []
        for each in record["parameters"]:  # In this order: the last one counts.
            if isinstance(each, str):
                files.append(self._find_parameters(Path(each), name))
                continue
            ignored = (_TOPIC, "use_sim_time")
            own = {k: v for k, v in each.items() if k not in ignored}
            files += [self._write_parameters(_MANAGER, own, record)] if own else []
        topic, remappings = _TOPIC, []
        for source, target in record.get("remappings", ()):
            if source.strip("~/") == _TOPIC:
                topic = target
            else:
                remappings.append(Remapping(source, target, Path(record["file"])))
        self._parts.managers.append(
            Manager(
                name=join_names(record["namespace"], name),
                namespace=record["namespace"],
                description=self._find_description(str(text), record),
                topic=join_names(record["namespace"], topic),
                files=tuple(files),
                remappings=tuple(remappings),
            )
        )

    def _take_managers(self) -> None:
        """Take what has a manager's controllers or program, and spawners, as that."""
        asked = {spawner.manager.strip("/") for spawner in self._parts.spawners}
        for record, line in self._own_nodes:
            name = join_names(record["namespace"], record.get("name") or _MANAGER)
            known = [manager.name for manager in self._parts.managers]
            if name in known or name not in asked:
                continue
            is_called_so = record.get("executable") == "ros2_control_node"
            if is_called_so or has_controllers(record["parameters"]):
                self._not_started.remove(line)
                what = f"node {line.name} has the controllers of /{name}"
                if is_called_so:
                    what = f"node {line.name} is asked for controllers of /{name}"
                done = "it is taken as a controller manager"
                self._add("info", "unsupported", what, done, record)
                self._read_manager(record)

    def _find_parameters(self, path: Path, manager: str) -> Path:
        """Return a parameter file, its manager's node called as it is here."""
        path = self._finder.real(path)
        if manager == _MANAGER or not path.is_file():
            return path
        data = _parse(path.read_text(encoding="utf-8", errors="replace"))
        if not isinstance(data, Mapping):
            return path
        names = (manager, f"/{manager}")
        if not any(name in data for name in names):
            return path
        renamed = {_MANAGER if k in names else k: v for k, v in data.items()}
        target = self._folder.path / f"{len(self._parts.managers)}_{path.name}"
        target.write_text(yaml.safe_dump(renamed, sort_keys=False), encoding="utf-8")
        source, _ = self._folder.rewritten.get(str(path), (str(path), False))
        self._folder.rewritten[str(target)] = (source, False)
        return target

    def _write_parameters(
        self, node: str, values: Mapping[str, Any], record: Mapping[str, Any]
    ) -> Path:
        data = {node: {"ros__parameters": _nest(values)}}
        return self._folder.write_parameters(data, str(record["file"]))

    def _read_spawner(self, record: Mapping[str, Any]) -> None:
        words = record.get("arguments", ())
        with_value = (
            *("-c", "--controller-manager", "-n", "--namespace", "-t"),
            *("--controller-type", "--controller-manager-timeout"),
            *("--switch-timeout", "--service-call-timeout", "--controller-ros-args"),
        )
        files = tuple(
            self._finder.real(Path(name))
            for key in ("-p", "--param-file")
            for name in all_values_of(words, key)
        )
        words_left = without_options(words, ("-p", "--param-file"))
        # Its own parameter files are the controllers', too.
        files += tuple(Path(p) for p in record["parameters"] if isinstance(p, str))
        names = positional(words_left, with_value)
        kind = value_of(words, "-t", "--controller-type")
        manager = value_of(words, "-c", "--controller-manager") or "controller_manager"
        space = value_of(words, "-n", "--namespace") or record["namespace"]
        manager = join_names(space, manager)
        if kind is not None:
            types = {f"{name}.type": kind for name in names}
            node = manager.rpartition("/")[2]
            files = (*files, self._write_parameters(node, types, record))
        is_idle = any(
            word in words for word in ("--inactive", "--stopped", "--load-only")
        )
        state = "inactive" if is_idle else "active"
        is_group = "--activate-as-group" in words
        files += tuple(self._read_ros_arguments(names, words, record))
        self._parts.spawners.append(
            Spawner(tuple(names), state, manager, files, is_group)
        )

    def _read_ros_arguments(
        self, names: Sequence[str], words: Sequence[str], record: Mapping[str, Any]
    ) -> list[Path]:
        """Take how a spawner's controllers call topics; return their parameters."""
        files = []
        for text in all_values_of(words, "--controller-ros-args"):
            _, ros_arguments = split_ros_arguments(["--ros-args", *split_words(text)])
            for source, target in ros_arguments["remappings"]:
                own = source.removeprefix("~/")
                sources = [source] if own == source else [f"/{n}/{own}" for n in names]
                for each in sources:
                    remapping = Remapping(each, target, Path(record["file"]))
                    self._parts.remappings.append(remapping)
            for parameters in ros_arguments["parameters"]:
                if isinstance(parameters, str):
                    files.append(self._finder.real(Path(parameters)))
                else:
                    files += [
                        self._write_parameters(n, parameters, record) for n in names
                    ]
        return files

    def _read_classic_spawn(self, record: Mapping[str, Any]) -> None:
        self._read_spawn(record, "gazebo")

    def _read_gz_spawn(self, record: Mapping[str, Any]) -> None:
        self._read_spawn(record, "gz")

    def _read_spawn(self, record: Mapping[str, Any], simulator: str) -> None:
        words, values = record.get("arguments", ()), _merge(record)
        self._simulator = simulator

        def option(*names: str) -> str | None:
            found = value_of(words, *(f"-{name}" for name in names))
            found = found or value_of(words, *(f"--{name}" for name in names))
            for name in (*names, *(["entity_name"] if "name" in names else [])):
                if found is None and values.get(name) not in (None, ""):
                    found = str(values[name])
            return found

        topic, file, text = option("topic"), option("file"), option("string")
        description = None
        path = None if file is None else Path(file)
        if path is not None and (key := self._read_key(path)) is not None:
            path, text = None, key
        if path is None and text is not None and is_sdf(text):
            self._num_texts += 1
            path = self._folder.path / f"model_{self._num_texts}.sdf"
            path.write_text(text, encoding="utf-8")
        if path is not None:
            if path.suffix == ".sdf" or (_is_file(path) and _is_sdf(path)):
                if not _is_file(path):
                    what, done = f"no such model: {path}", "it is left out"
                    self._add("error", "missing", what, done, record)
                    return
                path = self._finder.real(path)
                if not _is_robot(path):  # A thing in the world.
                    pose = self._read_pose(option, record)
                    model = LaunchedModel(path, option("entity", "name"), pose)
                    self._models.append(model)
                    return
            description = Description("", record["namespace"], path, {})
        elif text is not None:
            description = self._find_description(text, record)
        elif topic is None:
            name = option("entity", "name") or option("database") or "model"
            self._leave_out(f"{name} in the simulator", "model")
            return
        self._parts.spawns.append(
            Spawn(
                name=option("entity", "name"),
                topic=None if topic is None else join_names(record["namespace"], topic),
                description=description,
                pose=self._read_pose(option, record),
                simulator=simulator,
            )
        )

    def _read_pose(
        self, option: Callable[..., str | None], record: Mapping[str, Any]
    ) -> Pose | None:
        texts = [option(axis) for axis in ("x", "y", "z", "R", "P", "Y")]
        if all(text is None for text in texts):
            return None
        numbers = []
        for axis, text in zip("xyzRPY", texts, strict=True):
            number = parse_float(text or "0")
            if number is None or not np.isfinite(number):
                what = f"-{axis} {text} of a spawned robot is no number"
                self._add("error", "ignored", what, "0 is taken", record)
                number = 0.0
            numbers.append(number)
        x, y, z, roll, pitch, yaw = numbers
        return (x, y, z, roll, pitch, yaw)

    def _read_bridge(self, record: Mapping[str, Any]) -> None:
        for word in record.get("arguments", ()):
            if "@" in word:
                topic = word.partition("@")[0]
                self._bridges.append(Bridge(word, f"/{_remapped(topic, record)}"))
        self._add_bridge_file(_merge(record).get("config_file", ""), record)

    def _read_image_bridge(self, record: Mapping[str, Any]) -> None:
        for topic in positional(record.get("arguments", ()), ()):
            word = f"{topic}@sensor_msgs/msg/Image[gz.msgs.Image"
            self._bridges.append(Bridge(word, f"/{_remapped(topic, record)}"))

    def _add_bridge_file(self, name: Any, record: Mapping[str, Any]) -> None:
        if not isinstance(name, str):
            what = f"config_file: expected a file's name, got {name!r}"
            self._add("error", "invalid", what, "it is left out", record)
        elif name:
            self._bridge_files.append(self._finder.real(Path(name)))

    def _read_static_frame(self, record: Mapping[str, Any]) -> None:
        words, values = record.get("arguments", ()), _merge(record)
        frame, wrong = read_static_frame(words, values)
        if wrong or not (frame.parent and frame.child):
            text = " ".join(words) or ", ".join(f"{k}: {v}" for k, v in values.items())
            lack = f"{', '.join(wrong)} is no number" if wrong else "it names no frames"
            what = f"static_transform_publisher {text[:200]}: {lack}"
            self._add("error", "invalid", what, "it is left out", record)
        else:
            self._frames.append(frame)


def _merge(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a node by name."""
    merged: dict[str, Any] = {}
    for each in record.get("parameters", ()):
        if isinstance(each, Mapping):
            merged |= each
    return merged


def _nest(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters as a tree of mappings, by the dots in their names."""
    data: dict[str, Any] = {}
    for key, value in values.items():
        place = data
        *parents, last = key.split(".")
        while parents and isinstance(place.get(parents[0], {}), dict):
            place = place.setdefault(parents.pop(0), {})
        # A parameter and others below its name: the dots stay.
        place[".".join([*parents, last])] = value
    return data


def _remapped(topic: str, record: Mapping[str, Any], around: str = "/") -> str:
    """Return what a topic of a node is called, from the root without a slash.

    `around` is what may stand around the topic in a remapping.
    """
    for source, target in record.get("remappings", ()):
        if source.strip(around) == topic.strip("/"):
            topic = target
            break
    return join_names(record["namespace"], topic)


def _is_true(values: Mapping[str, str], name: str, default: str = "false") -> bool:
    return str(values.get(name, default)).lower() in ("true", "1")


def _parse(text: str) -> Any:
    try:
        return yaml_files.parse(text)
    except yaml_files.YamlError:
        return None


def _has_text(name: str, text: str) -> bool:
    return _read_text(Path(name)) == text


def _read_text(path: Path) -> str:
    """Return the text of a file, "" if it is missing."""
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except (OSError, ValueError):
        return ""


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # Such as a name that is too long.
        return False


def _is_robot(path: Path) -> bool:
    """Return whether an SDF model is a robot, not a thing in the world."""
    try:
        return moves_by_itself(_read_text(path), path)
    except DescriptionError:  # The world's reader says what is wrong.
        return False


def _is_sdf(path: Path) -> bool:
    with path.open(encoding="utf-8", errors="replace") as file:
        return "<sdf" in file.read(2000)


def _explain_node(
    record: Mapping[str, Any], finder: PackageFinder, name: str
) -> NotStarted:
    """Return a node of somebody's, with what it would do as far as its source says."""
    package, executable = record["package"], Path(record["executable"]).name
    reasons = []
    with contextlib.suppress(PackageError):
        folder, remappings = finder.source(package), record.get("remappings", ())
        if does := find_what_it_does(folder, executable, remappings):
            reasons.append(f"it would {does}")
    if package == "topic_tools" and executable == "relay":
        reasons.append(f"it would pass on {' to '.join(record.get('arguments', ()))}")
    if package in _INSTEAD:
        reasons.append(_INSTEAD[package])
    return NotStarted(name, reason="; ".join(reasons))
