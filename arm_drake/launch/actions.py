"""Actions of launch files, as data, and the order in which they come to pass.

They have the names and the arguments of `launch.actions`, `launch_ros.actions` and
`launch.event_handlers`. Nothing is started: a `LaunchRun` visits them as `ros2 launch`
does, plays the events that would follow (a spawner ends, a timer rings), and notes the
nodes, processes and inclusions. They are used in the process that reads launch files.
"""

import functools
import heapq
import itertools
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from arm_drake.launch.event_handlers import EventHandler, entities_after
from arm_drake.launch.nodes import PACKAGES, ends
from arm_drake.launch.parameters import Parameter, read_parameters
from arm_drake.launch.shell import write_files
from arm_drake.launch.substitutions import (
    LaunchContext,
    LaunchError,
    perform,
)
from arm_drake.launch.words import split_ros_arguments, split_words

# How long what ends by itself takes [s]: only its place among timers matters.
_TAKES = 0.5

# More than any launch file does; a chain of events may be endless.
_MAX_EVENTS = 10_000
_MAX_DEPTH = 100


class Action:
    """Something that a launch file does."""

    def __init__(self, *args: Any, condition: Any = None, **kwargs: Any) -> None:
        """Take what describes it; what isn't modelled keeps it as it is."""
        self.args, self.kwargs, self.condition = args, kwargs, condition

    def act(self, run: "LaunchRun") -> Iterable[Any] | None:
        """Come to pass; return what comes to pass next."""
        raise NotImplementedError

    def execute(self, context: Any) -> Iterable[Any] | None:
        """Do so, by the name that packages call and that their own actions give it."""
        return self.act(context.run)

    def visit(self, context: Any) -> Iterable[Any] | None:
        """Return what a package's own action consists of."""
        if self.condition is not None and not self.condition.evaluate(context):
            return None
        return self.execute(context)


class LambdaAction(Action):
    """An action that is a function of the run."""

    def __init__(self, function: Callable[["LaunchRun"], None]) -> None:
        super().__init__()
        self.function = function

    def act(self, run: "LaunchRun") -> None:
        self.function(run)


class UnknownAction(Action):
    """An action that isn't modelled; it is noted."""

    def act(self, run: "LaunchRun") -> None:
        run.note("unknown", name=type(self).__name__)


class LaunchDescription(Action):
    def __init__(
        self, initial_entities: Iterable[Any] | None = None, **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        self.entities = list(initial_entities or [])

    def add_action(self, action: Any) -> None:
        """Add an action at the end."""
        self.entities.append(action)

    add_entity = add_action

    def act(self, run: "LaunchRun") -> list[Any]:
        return self.entities


class DeclareLaunchArgument(Action):
    def __init__(
        self,
        name: str,
        *,
        default_value: Any = None,
        description: Any = "",
        choices: Iterable[str] | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.name, self.default_value = name, default_value
        self.description = description
        # Of one text, as `("left")` is without its comma, all parts are, as in ROS.
        self.is_text = isinstance(choices, str)
        choices = [choices] if isinstance(choices, str) else choices
        self.choices = None if choices is None else [str(each) for each in choices]

    def act(self, run: "LaunchRun") -> None:
        configurations = run.context.launch_configurations
        text = self._default(run)
        run.declare(
            name=self.name,
            default=text,
            description=perform(run.context, self.description or ""),
            choices=self.choices,
        )
        if self.name not in configurations:
            if text is None:
                if run.only_shows_arguments:
                    return
                raise LaunchError(
                    f"argument {self.name!r} has no default; give it as "
                    f"{self.name}:={'|'.join(self.choices or ['VALUE'])}"
                )
            configurations[self.name] = run.context.whole(text)
        value, choices = configurations[self.name], self.choices or []
        if choices and value not in (choices[0] if self.is_text else choices):
            text = f"argument {self.name}:={value}: expected one of "
            raise LaunchError(text + ", ".join(choices))

    def _default(self, run: "LaunchRun") -> str | None:
        """Return the default's text; None if there is none, or none that is needed."""
        default = self.default_value
        try:
            return None if default is None else perform(run.context, default)
        except LaunchError:
            if self.name not in run.context.launch_configurations:
                raise
            return None  # ROS doesn't evaluate it then.


class SetLaunchConfiguration(Action):
    def __init__(self, name: Any, value: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.name, self.value = name, value

    def act(self, run: "LaunchRun") -> None:
        name = perform(run.context, self.name)
        value = run.context.whole(perform(run.context, self.value))
        run.context.launch_configurations[name] = value


class UnsetLaunchConfiguration(Action):
    def act(self, run: "LaunchRun") -> None:
        name = perform(run.context, self.args[0])
        run.context.launch_configurations.pop(name, None)


class SetEnvironmentVariable(Action):
    def __init__(self, name: Any, value: Any = "", **kwargs: Any) -> None:
        condition = kwargs.pop("condition", None)
        super().__init__(condition=condition, **kwargs)
        self.name, self.value = name, value

    def act(self, run: "LaunchRun") -> None:
        name, value = (perform(run.context, each) for each in (self.name, self.value))
        os.environ[name] = self.join(os.environ.get(name, ""), value, run)

    def join(self, old: str, value: str, run: "LaunchRun") -> str:
        return value


class AppendEnvironmentVariable(SetEnvironmentVariable):
    def join(self, old: str, value: str, run: "LaunchRun") -> str:
        separator = perform(run.context, self.kwargs.get("separator", os.pathsep))
        is_first = self.kwargs.get("prepend", False)
        if not isinstance(is_first, bool):
            is_first = perform(run.context, is_first).lower() in ("true", "1")
        pair = (value, old) if is_first else (old, value)
        return separator.join(filter(None, pair))


class UnsetEnvironmentVariable(Action):
    def act(self, run: "LaunchRun") -> None:
        os.environ.pop(perform(run.context, self.args[0]), None)


class GroupAction(Action):
    def __init__(
        self,
        actions: Iterable[Any],
        *,
        scoped: bool = True,
        forwarding: bool = True,
        launch_configurations: Mapping[str, Any] | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.actions, self.scoped, self.forwarding = list(actions), scoped, forwarding
        self.launch_configurations = dict(launch_configurations or {})

    def get_sub_entities(self) -> list[Any]:
        """Return the actions of the group."""
        return self.actions

    def act(self, run: "LaunchRun") -> None:
        context = run.context
        values = {
            perform(context, name): context.whole(perform(context, value))
            for name, value in self.launch_configurations.items()
        }
        scope, environment = context.copy_scope(), dict(os.environ)
        if not self.forwarding:
            context.launch_configurations.clear()
        context.launch_configurations.update(values)
        run.visit(self.actions)
        if self.scoped:
            for variable in set(os.environ) - set(environment):
                del os.environ[variable]
            os.environ.update(environment)
            context.set_scope(scope)


class PushRosNamespace(Action):
    def __init__(self, namespace: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.namespace = namespace

    def act(self, run: "LaunchRun") -> None:
        name = join_names(run.namespace, perform(run.context, self.namespace))
        run.context.launch_configurations["ros_namespace"] = name


class SetParameter(Action):
    def __init__(self, name: Any, value: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.parameter = Parameter(name, value)

    def act(self, run: "LaunchRun") -> None:
        run.context.parameters.append(read_parameters(run.context, self.parameter))


class SetUseSimTime(SetParameter):
    def __init__(self, value: Any, **kwargs: Any) -> None:
        super().__init__("use_sim_time", value, **kwargs)


class SetParametersFromFile(Action):
    def act(self, run: "LaunchRun") -> None:
        file = self.kwargs.get("filename", *self.args[:1])
        run.context.parameters.append(perform(run.context, file))


class SetRemap(Action):
    def __init__(self, src: Any, dst: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.pair = (src, dst)

    def act(self, run: "LaunchRun") -> None:
        source, target = (perform(run.context, each) for each in self.pair)
        run.context.remappings.append((source, target))


class LogInfo(Action):
    def __init__(self, *, msg: Any = "", **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.msg = msg

    def act(self, run: "LaunchRun") -> None:
        run.note("log", text=perform(run.context, self.msg))


class OpaqueFunction(Action):
    def __init__(
        self,
        *,
        function: Callable[..., Any],
        args: Iterable[Any] | None = None,
        kwargs: Mapping[str, Any] | None = None,
        **rest: Any,
    ) -> None:
        super().__init__(**rest)
        self.function, self.positional = function, list(args or [])
        self.named = dict(kwargs or {})

    def act(self, run: "LaunchRun") -> Iterable[Any] | None:
        found: Any = self.function(run.context, *self.positional, **self.named)
        if found is not None and not isinstance(found, list | tuple):
            name = getattr(self.function, "__name__", "function")
            raise LaunchError(
                f"{name}() of an OpaqueFunction: expected a list of actions, got "
                f"{type(found).__name__}"
            )
        return found


class TimerAction(Action):
    def __init__(self, *, period: Any, actions: Iterable[Any], **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.period, self.actions = period, list(actions)

    def act(self, run: "LaunchRun") -> None:
        text = perform(run.context, self.period)
        try:
            period = float(text)
        except ValueError:
            problem = f"period {text!r} of a timer: expected seconds"
            raise LaunchError(problem) from None
        run.later(period, functools.partial(self._fire, run, run.context.copy_scope()))
        run.later(period, functools.partial(run.fire, "complete", self))

    def _fire(self, run: "LaunchRun", scope: tuple[Any, ...]) -> None:
        """Visit the actions in the scope of the timer, as launch 3.4.5 does."""
        outer = run.context.copy_scope()
        run.context.set_scope(scope)
        run.visit(self.actions)
        run.context.set_scope(outer)


class Shutdown(Action):
    def act(self, run: "LaunchRun") -> None:
        run.note("shutdown")


class EmitEvent(Action):
    def act(self, run: "LaunchRun") -> None:
        event = self.kwargs.get("event", *self.args[:1])
        run.note("event", name=type(event).__name__)


class RegisterEventHandler(Action):
    def __init__(self, event_handler: EventHandler, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.event_handler = event_handler

    def act(self, run: "LaunchRun") -> None:
        if self.event_handler.kind in ("", "output", "shutdown"):
            run.note("event", name=type(self.event_handler).__name__)
        run.handlers.append(self.event_handler)


class UnregisterEventHandler(Action):
    def act(self, run: "LaunchRun") -> None:
        handler = self.kwargs.get("event_handler", *self.args[:1])
        if handler in run.handlers:
            run.handlers.remove(handler)


class LaunchDescriptionSource:
    """A launch file that is included."""

    def __init__(
        self, launch_file_path: Any = None, location: Any = None, **kwargs: Any
    ) -> None:
        """Take its path; `location` is what the base class calls it."""
        self.location = location if launch_file_path is None else launch_file_path


class IncludeLaunchDescription(Action):
    def __init__(
        self,
        launch_description_source: Any,
        *,
        launch_arguments: Any = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.source = launch_description_source
        arguments = launch_arguments or []
        self.launch_arguments = list(
            arguments.items() if isinstance(arguments, Mapping) else arguments
        )

    def act(self, run: "LaunchRun") -> None:
        values = {
            perform(run.context, name): run.context.whole(perform(run.context, value))
            for name, value in self.launch_arguments
        }
        if isinstance(self.source, LaunchDescription):
            run.context.launch_configurations.update(values)
            run.visit(self.source)
            return
        location = getattr(self.source, "location", self.source)
        run.include(perform(run.context, location), values)


class Words(list[Any]):
    """Arguments of a program in one text, which is split when it is known."""


class ExecuteLocal(Action):
    def __init__(
        self,
        *,
        cmd: Iterable[Any] = (),
        on_exit: Any = None,
        additional_env: Mapping[Any, Any] | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        self.cmd, self.on_exit = [cmd] if isinstance(cmd, str) else list(cmd), on_exit

    def act(self, run: "LaunchRun") -> None:
        words = [perform(run.context, word) for word in self.cmd]
        text, is_shell = " ".join(words), self.kwargs.get("shell")
        makes_files = ["sh", "-c", text] if is_shell else words
        if len(words) == 1 or is_shell:
            words = split_words(text)
        # A node by its command.
        if words[:2] == ["ros2", "run"] and len(words) >= 4:
            run.start_node(self, words[2], words[3], arguments=words[4:])
            return
        if words[:2] == ["ros2", "launch"] and len(words) > 2:
            run.launch(words[2:])
            return
        is_made = not self.kwargs.get("cwd") and write_files(makes_files, run.expand)
        run.start(self, "writer" if is_made else "process", command=words)


class ExecuteProcess(ExecuteLocal):
    pass


# Arguments of a Node that nothing here depends on, and those that something does.
_OTHER_WORDS = [
    "additional_env",
    "autostart",
    "autostart_transitions",
    "cached_output",
    "cwd",
    "emulate_tty",
    "env",
    "exec_name",
    "extra_arguments",
    "log_cmd",
    "node_executable",
    "node_name",
    "node_namespace",
    "on_exit",
    "output",
    "output_format",
    "prefix",
    "respawn",
    "respawn_delay",
    "respawn_max_retries",
    "shell",
    "sigkill_timeout",
    "sigterm_timeout",
]
_NODE_WORDS = [
    "arguments",
    "condition",
    "executable",
    "name",
    "namespace",
    "package",
    "parameters",
    "remappings",
    "ros_arguments",
]


class Node(ExecuteProcess):
    def __init__(
        self,
        *,
        executable: Any = None,
        package: Any = None,
        name: Any = None,
        namespace: Any = None,
        parameters: Any = None,
        remappings: Any = None,
        arguments: Any = None,
        ros_arguments: Any = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        for word in kwargs:
            if word not in (*_OTHER_WORDS, *_NODE_WORDS):
                hint = get_close_matches(word, [*_NODE_WORDS, *_OTHER_WORDS], 1)
                text = f"; did you mean {hint[0]!r}?" if hint else ""
                raise LaunchError(f"Node has no argument {word!r}{text}")
        self.package = package
        self.executable = executable or kwargs.get("node_executable", "")
        self.name = name or kwargs.get("node_name")
        self.namespace = namespace or kwargs.get("node_namespace")
        self.parameters = parameters or []
        self.remappings = list(remappings or [])
        self.arguments = arguments or []
        if not isinstance(self.arguments, list | tuple):
            # One word, as `launch_ros` takes it, too; of several it is one text.
            self.arguments = Words([self.arguments])
        self.ros_arguments = ros_arguments or []

    def act(self, run: "LaunchRun") -> None:
        context = run.context
        package, executable, name, space = (
            None if value is None else perform(context, value)
            for value in (
                self.package,
                self.executable,
                self.name,
                self.namespace,
            )
        )
        parameters = self.parameters
        if not isinstance(parameters, list | tuple):
            parameters = [parameters]
        run.start_node(
            self,
            package or "",
            executable or "",
            name=name,
            namespace=join_names(run.namespace, space or ""),
            parameters=[
                read_parameters(context, each)
                for each in (*context.parameters, *parameters)
            ],
            remappings=[
                *context.remappings,
                *(
                    (perform(context, a), perform(context, b))
                    for a, b in self.remappings
                ),
            ],
            arguments=self._words(context),
        )

    def _words(self, context: LaunchContext) -> list[str]:
        if isinstance(self.arguments, Words):
            return split_words(perform(context, self.arguments))
        words = [perform(context, each) for each in self.arguments]
        if self.ros_arguments:
            words.append("--ros-args")
            words += [perform(context, each) for each in self.ros_arguments]
        return words


class LifecycleNode(Node):
    pass


class ComposableNode:
    """A node that a container would load."""

    def __init__(self, *, package: Any, plugin: Any, **kwargs: Any) -> None:
        """Take what describes it."""
        self.node = Node(package=package, executable=plugin, **kwargs)


class ComposableNodeContainer(Node):
    def __init__(
        self, *, composable_node_descriptions: Any = None, **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        self.loaded = composable_node_descriptions or []

    def act(self, run: "LaunchRun") -> None:
        run.visit([each.node for each in self.loaded])
        run.begin(self)


class LoadComposableNodes(ComposableNodeContainer):
    pass


def join_names(space: str, name: str) -> str:
    """Return a name in a name space; one that begins with a slash is as it is."""
    if name.startswith("/") or not space.strip("/"):
        return name.strip("/")
    return f"{space.strip('/')}/{name}".strip("/")


class LaunchRun:
    """One launch of a file: what is visited, and what is noted."""

    def __init__(
        self,
        context: LaunchContext,
        load: Callable[[str], Any],
        *,
        only_shows_arguments: bool = False,
    ) -> None:
        """Create it, with what loads an included file."""
        self.context, self._load = context, load
        self.only_shows_arguments = only_shows_arguments
        context.run = self  # type: ignore[attr-defined]
        self.handlers: list[EventHandler] = []
        self.records: list[dict[str, Any]] = []
        self.declared: dict[str, dict[str, Any]] = {}
        self._time = 0.0
        self._waiting: list[tuple[float, int, Callable[[], Any]]] = []
        self._number = itertools.count()
        self._depth = 0

        # Actions that can't start their program once more.
        self._started: set[ExecuteLocal] = set()

        # Whether what comes to pass is another launch's (`ros2 launch`).
        self._is_isolated = False

    @property
    def namespace(self) -> str:
        """The name space in which nodes start."""
        return self.context.launch_configurations.get("ros_namespace", "").strip("/")

    def run(self, file: str, arguments: Mapping[str, str]) -> None:
        """Visit all that a launch file does, now and later."""
        self.include(file, arguments)
        for _ in range(_MAX_EVENTS):
            if not self._waiting:
                return
            self._time, _, act = heapq.heappop(self._waiting)
            act()
        raise LaunchError(f"more than {_MAX_EVENTS} events: it starts itself again")

    def note(self, kind: str, **values: Any) -> None:
        """Note something."""
        file = self.context.files[-1] if self.context.files else ""
        note = {"kind": kind, "file": file, "time": self._time, **values}
        self.records.append(note)
        if len(self.records) > _MAX_EVENTS:
            raise LaunchError(f"it starts more than {_MAX_EVENTS} things")

    def declare(self, **argument: Any) -> None:
        """Note an argument that is declared; the first declaration counts."""
        self.declared.setdefault(argument["name"], argument)

    def later(self, delay: float, act: Callable[[], Any]) -> None:
        """Do something later, in the file that is read now."""
        context, is_isolated = self.context, self._is_isolated
        files, own = list(context.files), context.launch_configurations

        def resume() -> None:
            context.files[:] = files
            if not is_isolated:
                act()
                return
            # Another process has configurations of its own.
            outer, context.launch_configurations = context.launch_configurations, own
            self._is_isolated = True
            act()
            self._is_isolated = False
            context.launch_configurations = outer

        item = (self._time + delay, next(self._number), resume)
        heapq.heappush(self._waiting, item)

    def visit(self, entity: Any) -> None:
        """Let something come to pass."""
        if entity is None:
            return
        if isinstance(entity, list | tuple):
            for each in entity:
                self.visit(each)
            return
        if not hasattr(entity, "visit"):
            raise LaunchError(
                f"expected actions, got {type(entity).__name__} {str(entity)[:80]!r}"
            )
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise LaunchError("files or actions contain each other")
        try:
            # They may add actions to their own description.
            for each in entity.visit(self.context) or ():
                self.visit(each)
        except Exception as error:
            if isinstance(error, LaunchError):
                error.at(getattr(entity, "line", None))
            # Arguments are shown of what can be read, as `ros2 launch` does it.
            if not self.only_shows_arguments or self._depth == 1:
                raise
        finally:
            self._depth -= 1
        if not isinstance(entity, ExecuteLocal | TimerAction):
            self.fire("complete", entity)

    def include(self, file: str, arguments: Mapping[str, str]) -> None:
        """Visit a launch file."""
        file = os.path.abspath(file)
        self.context.launch_configurations.update(arguments)
        description = self._load(file)
        if description is None:  # Of a package that is stood for.
            values = dict(self.context.launch_configurations)
            self.note("include", path=file, arguments=values, namespace=self.namespace)
            return
        self.context.files.append(file)
        self.visit(description)
        self.context.files.pop()

    def expand(self, file: str, arguments: Mapping[str, str]) -> str:
        """Return the text of a xacro file with arguments."""
        text: str = self.context.whole(self.context.note_description(file, arguments))
        return text

    def launch(self, words: Sequence[str]) -> None:
        """Do what `ros2 launch` does, with arguments of its own."""
        names = [word for word in words if ":=" not in word and word[:1] != "-"]
        arguments = dict(w.split(":=", 1) for w in words if ":=" in w)
        if not names:
            said = " ".join(words)
            raise LaunchError(f"ros2 launch {said}: expected a package and a file")
        file = names[0]
        if len(names) > 1:
            folder = Path(self.context.find_package(names[0]))
            stood_for = [folder / "launch" / names[1]] if names[0] in PACKAGES else []
            if not (found := sorted(folder.rglob(names[1])) or stood_for):
                raise LaunchError(f"package {names[0]!r} has no {names[1]!r}")
            file = str(found[0])
        inner = [LambdaAction(lambda run: run.include(file, arguments))]
        isolated, self._is_isolated = self._is_isolated, True
        self.visit(GroupAction(inner, forwarding=False))
        self._is_isolated = isolated

    def start_node(
        self, action: Any, package: str, executable: str, **values: Any
    ) -> None:
        """Note a node."""
        arguments, from_words = split_ros_arguments(values.get("arguments", ()))
        space, name = from_words.pop("namespace"), from_words.pop("name")
        if space is not None:
            values["namespace"] = join_names(self.namespace, space)
        values.setdefault("namespace", self.namespace)
        values["name"] = name or values.get("name")
        values["arguments"] = arguments
        for key, more in from_words.items():
            values[key] = [*values.get(key, ()), *more]
        full = join_names(values["namespace"], values["name"] or executable).lstrip("/")
        given = [p for p in values.get("parameters", ()) if isinstance(p, Mapping)]
        self.context.started[f"/{full}"] = {k: v for p in given for k, v in p.items()}
        self.start(action, "node", package=package, executable=executable, **values)

    def start(self, action: ExecuteLocal, kind: str, **values: Any) -> None:
        """Note a program, and what follows its start and its end."""
        if action in self._started:
            self.note("repeated", **_name_of(action))
            return
        self._started.add(action)
        self.note(kind, **values)
        it_ends = ends(**values)
        self.begin(action)
        if it_ends is not False:
            self.later(_TAKES, lambda: self._end(action, is_known=bool(it_ends)))

    def begin(self, action: ExecuteLocal) -> None:
        """Let come to pass what follows the start of a program."""
        self.later(0.0, lambda: self.fire("start", action))

    def _end(self, action: ExecuteLocal, *, is_known: bool) -> None:
        if not is_known:
            # A program of the user's own, which may go on for ever.
            follows = [h for h in self.handlers if h.kind == "exit" and h.target]
            if any(h.matches(action) for h in follows):
                self.note("assumed_end", **_name_of(action))
        if action.on_exit and is_known:
            self.visit(entities_after(action.on_exit, action, self.context))
        self.fire("exit", action, is_known=is_known)
        self.fire("complete", action, is_known=is_known)

    def fire(self, kind: str, action: Any, *, is_known: bool = True) -> None:
        """Let come to pass what follows an event of an action."""
        for handler in list(self.handlers):
            if handler.kind != kind or not handler.matches(action):
                continue
            if not is_known and handler.target is None:
                continue
            self.visit(entities_after(handler.entities, action, self.context))


def _name_of(action: Any) -> dict[str, Any]:
    package, executable = (getattr(action, k, None) for k in ("package", "executable"))
    words = [str(word) for word in action.cmd if isinstance(word, str)]
    return {"name": f"{package}/{executable}" if executable else " ".join(words)}
