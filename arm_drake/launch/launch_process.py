"""Program that reads one launch file, and prints what it would start.

`launch_files.load_launch` runs it in a process of its own: a launch file in Python is a
program. Here it finds ours in the place of the modules that it knows from ROS, none of
which is on PyPI (`launch`, `launch_ros`, `ament_index_python`, `xacro`,
`moveit_configs_utils`, `nav2_common.launch`, `controller_manager.launch_utils`), and
what packages bring themselves, in their source folders. It may take only so much memory
and time, and is refused what would change the machine or leave it: starting programs,
connections, changing files outside a temporary folder. What it writes elsewhere is
kept in that. This keeps honest files from harm; it is
no wall against a program that means it.

It reads one request from standard input as a line of JSON, asks for packages, and ends
with what it noted, or with what is wrong.
"""

import builtins
import contextlib
import functools
import importlib
import importlib.machinery
import io
import json
import os
import resource
import signal
import sys
import tempfile
import types
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO
from xml.dom import minidom

import yaml

from arm_drake.launch import actions, event_handlers, parameters, substitutions
from arm_drake.launch.actions import LaunchRun
from arm_drake.launch.launch_description_sources import (
    GAZEBO_ACTIONS,
    load_as_module,
    read_launch_file,
)
from arm_drake.launch.substitutions import (
    LaunchContext,
    LaunchError,
    PackageNotFoundError,
    current,
    perform,
    read_description,
)
from arm_drake.launch.written_files import WrittenFiles

# Modules that have actions, substitutions and conditions, also those of which there
# are none here: what isn't known is noted when it comes to pass.
_LAUNCH = ("launch", "launch_ros", "launch_xml", "launch_yaml", "launch_testing")


def _public(module: types.ModuleType) -> dict[str, Any]:
    return {
        name: value
        for name, value in vars(module).items()
        if not name.startswith("_")
        and getattr(value, "__module__", "") == module.__name__
    }


def _is_class(value: Any) -> bool:
    return isinstance(value, type)


# Where the names are that `import *` takes from modules called so.
_OF_MODULES = {
    "actions": actions,
    "conditions": substitutions,
    "event_handlers": event_handlers,
    "substitutions": substitutions,
}


class _Launch(types.ModuleType):
    """Module `launch` or one below it: knows all names of all of them."""

    def __getattr__(self, name: str) -> Any:
        last = self.__name__.rpartition(".")[2]
        if name == "__all__" and last in _OF_MODULES:
            return [k for k, v in _public(_OF_MODULES[last]).items() if _is_class(v)]
        if name.startswith("__"):
            raise AttributeError(name)
        aliases = {
            "PushROSNamespace": "PushRosNamespace",
            "ROSTimer": "TimerAction",
            "RosTimer": "TimerAction",
            "SomeSubstitutionsType_types_tuple": "Substitution",
            "SomeSubstitutionsType": "Substitution",
        }
        modules = (substitutions, actions, event_handlers, parameters)
        known = {k: v for each in modules for k, v in _public(each).items()}
        known = {k: v for k, v in known.items() if _is_class(v)}
        if name in aliases or name in known:
            return known[aliases.get(name, name)]
        if name.endswith("LaunchDescriptionSource"):
            return actions.LaunchDescriptionSource
        if name in _FUNCTIONS:
            return _FUNCTIONS[name]
        if f"{self.__name__}.{name}" in sys.modules:
            return sys.modules[f"{self.__name__}.{name}"]
        if name[0].islower():
            return importlib.import_module(f"{self.__name__}.{name}")
        if self.__name__.endswith("substitutions"):
            return type(name, (substitutions.Substitution,), {})
        if self.__name__.endswith("events") or ".events." in self.__name__:
            return type(name, (event_handlers.Event,), {})
        if name.startswith("On"):
            return type(name, (event_handlers.EventHandler,), {})
        return type(name, (actions.UnknownAction,), {})


def _normalize(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else [value]


_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "evaluate_condition_expression": lambda context, expression: substitutions.is_true(
        perform(context, expression)
    ),
    "expose_action": lambda name: lambda kind: kind,
    "expose_substitution": lambda name: lambda kind: kind,
    "load_python_launch_file_as_module": load_as_module,
    "get_launch_description_from_python_launch_file": lambda path: load_as_module(
        path
    ).generate_launch_description(),
    "normalize_to_list_of_substitutions": _normalize,
    "normalize_parameters": _normalize,
    "perform_substitutions": lambda context, value: context.whole(
        perform(context, value)
    ),
    "perform_typed_substitution": lambda context, value, kind: kind(
        context.whole(perform(context, value))
    ),
    "evaluate_parameters": lambda context, values: tuple(
        parameters.read_parameters(context, each) for each in values
    ),
    "is_a": lambda value, kind: isinstance(value, kind),
    "get_logger": lambda *names: _Quiet(),
}


class _Quiet:
    """A logger that says nothing."""

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *args, **kwargs: None


class _Document(minidom.Document):
    """An XML document of xacro's, whose text is the description's until it changes."""

    def __init__(self, file: Any) -> None:
        super().__init__()
        self.file, self._text, self._as_it_was = os.fspath(file), "", ""

    def expand(self, mappings: Mapping[str, Any] | None) -> None:
        """Become what the file is with arguments, or raise LaunchError."""
        texts = {name: str(value) for name, value in (mappings or {}).items()}
        context = current()
        self._text = context.expanded(context.note_description(self.file, texts))
        self.childNodes[:] = []
        made = minidom.parseString(self._text)  # noqa: S318  expat fetches nothing.
        for node in list(made.childNodes):
            self.appendChild(node)
        self._as_it_was = super().toprettyxml("", "")

    def toprettyxml(self, *args: Any, **kwargs: Any) -> str:  # type: ignore[override]
        text = super().toprettyxml("", "")
        return self._text if text == self._as_it_was else text

    toxml = toprettyxml  # type: ignore[assignment]


def _process_file(input_file_name: Any, *args: Any, **kwargs: Any) -> _Document:
    document = _Document(input_file_name)
    document.expand(kwargs.get("mappings"))
    return document


def _parse_xacro(source: Any, filename: Any = None) -> _Document:
    document = _Document(filename or getattr(source, "name", ""))
    with contextlib.suppress(LaunchError):  # It may need arguments of process_doc.
        document.expand(None)
    return document


def _process_document(document: _Document, *args: Any, **kwargs: Any) -> None:
    document.expand(kwargs.get("mappings"))


class ParameterBuilder:
    """Of `launch_param_builder`: parameters from files of a package."""

    def __init__(self, package_name: str) -> None:
        self._package = Path(substitutions.find_package(package_name))
        self._values: dict[str, Any] = {}

    def yaml(self, file_path: Any, parameter_namespace: str | None = None) -> Any:
        data = parameters.read_parameter_file(str(self._package / file_path))
        self._values |= {parameter_namespace: data} if parameter_namespace else data
        return self

    def parameter(self, name: str, value: Any) -> Any:
        self._values[name] = value
        return self

    def xacro_parameter(
        self, parameter_name: str, file_path: Any, mappings: Any = None
    ) -> Any:
        self._values[parameter_name] = read_description(
            self._package / file_path, mappings
        )
        return self

    def to_dict(self) -> dict[str, Any]:
        return self._values


def _spawner_from_dict(
    controller_info_dict: Mapping[str, Any], extra_spawner_args: Sequence[Any] = ()
) -> actions.LaunchDescription:
    """Return a spawner of controllers with their files of parameters."""
    values = controller_info_dict.values()
    files = [file for value in values for file in _normalize(value) if file]
    return _spawner(list(controller_info_dict), files, extra_spawner_args)


def _load_controller(
    controller_name: str,
    controller_type: Any = None,
    controller_params_file: Any = None,
    extra_spawner_args: Sequence[Any] = (),
) -> actions.LaunchDescription:
    """Return a spawner of one controller; only Humble's takes a type, as its second."""
    if str(controller_type).endswith((".yaml", ".yml")):
        if controller_params_file is not None:
            extra_spawner_args = controller_params_file
        controller_type, controller_params_file = None, controller_type
    kind = ["--controller-type", controller_type] if controller_type else []
    files = [file for file in _normalize(controller_params_file) if file]
    return _spawner([controller_name], files, [*kind, *extra_spawner_args])


def _spawner(
    controller_names: Sequence[str],
    controller_params_files: Sequence[Any] | None = None,
    extra_spawner_args: Sequence[Any] = (),
) -> actions.LaunchDescription:
    """Return what `controller_manager.launch_utils` makes: arguments and a spawner."""
    manager = substitutions.LaunchConfiguration(
        "controller_manager_name", default="controller_manager"
    )
    words: list[Any] = [*controller_names, "--controller-manager", manager]
    for file in controller_params_files or ():
        words += ["--param-file", file]
    words += [*(extra_spawner_args or ())]
    return actions.LaunchDescription(
        [
            actions.DeclareLaunchArgument(
                "controller_manager_name",
                default_value="controller_manager",
                description="Controller manager node name",
            ),
            actions.DeclareLaunchArgument(
                "unload_on_kill",
                default_value="false",
                description="Wait until the node is interrupted, then unload it",
            ),
            actions.Node(
                package="controller_manager", executable="spawner", arguments=words
            ),
        ]
    )


def _load_yaml(path: Any) -> Any:
    with open(path, encoding="utf-8") as file:
        return yaml.safe_load(file)


# Modules of `ament_index_python`, and of `moveit_configs_utils`.
_OF_AMENT = ("constants", "packages", "resources", "search_paths")
_OF_MOVEIT = ("launches", "launch_utils", "substitutions", "moveit_configs_builder")


def _make_index(share: Callable[[str], str]) -> Mapping[str, Any]:
    """Return functions for the index of installed resources: packages are all of it."""

    def has_resource(resource_type: str, resource_name: str) -> Any:
        try:
            return get_resource(resource_type, resource_name)[1]
        except LookupError:
            return False

    def get_resource(resource_type: str, resource_name: str) -> tuple[str, str]:
        if resource_type != "packages":
            text = f"Could not find the resource '{resource_name}' of type "
            raise LookupError(f"{text}'{resource_type}'")
        return "", substitutions.prefix_of(resource_name, share(resource_name))

    return {
        "RESOURCE_INDEX_SUBFOLDER": "share/ament_index/resource_index",
        "InvalidResourceNameError": type("InvalidResourceNameError", (ValueError,), {}),
        "get_resource": get_resource,
        "get_resources": lambda resource_type: {},
        "get_resource_types": set,
        "get_search_paths": list,
        "has_resource": has_resource,
    }


def _list_modules() -> Mapping[str, Mapping[str, Any]]:
    """Return what modules of ROS hold, by their names."""
    from arm_drake.launch import moveit_configs

    moveit = _public(moveit_configs)

    def share(package_name: str, print_warning: bool = True) -> str:
        return substitutions.find_package(package_name)

    ament = {
        "PackageNotFoundError": PackageNotFoundError,
        "get_package_share_directory": share,
        "get_package_share_path": lambda name, print_warning=True: Path(share(name)),
        "get_package_prefix": lambda name: substitutions.prefix_of(name, share(name)),
        "get_packages_with_prefixes": dict,
        **_make_index(share),
    }
    xacro = {
        "process_file": _process_file,
        "parse": _parse_xacro,
        "process_doc": _process_document,
        "process": lambda file, **kwargs: _process_file(file, **kwargs).toxml(),
        "XacroException": type("XacroException", (Exception,), {}),
    }
    controllers = "generate_controllers_spawner_launch_description"
    controller_manager = {
        controllers: _spawner,
        f"{controllers}_from_dict": _spawner_from_dict,
        "generate_load_controller_launch_description": _load_controller,
    }
    nav2 = {each.__name__: each for each in parameters.OF_NAV2}
    builder = {
        "ParameterBuilder": ParameterBuilder,
        "load_yaml": _load_yaml,
        "load_xacro": read_description,
        "get_package_path": lambda name: Path(share(name)),
    }
    return {
        "ament_index_python": ament,
        **{f"ament_index_python.{name}": ament for name in _OF_AMENT},
        "xacro": xacro,
        "controller_manager": {},
        "controller_manager.launch_utils": controller_manager,
        "moveit_configs_utils": moveit,
        **{f"moveit_configs_utils.{name}": moveit for name in _OF_MOVEIT},
        "ros_gz_bridge": {},
        "ros_gz_bridge.actions": GAZEBO_ACTIONS,
        "ros_gz_sim": {},
        "ros_gz_sim.actions": GAZEBO_ACTIONS,
        "nav2_common": {},
        "nav2_common.launch": nav2,
        "launch_param_builder": builder,
        "srdfdom": {},
        "srdfdom.srdf": {"SRDF": moveit_configs.SRDF, "Robot": moveit_configs.SRDF},
    }


def _make_modules() -> dict[str, types.ModuleType]:
    """Return the modules that take the place of ROS's, by name."""
    modules = {}
    for name, values in _list_modules().items():
        module = modules[name] = types.ModuleType(name)
        module.__path__ = []
        vars(module).update(values)
        parent, _, last = name.rpartition(".")
        if parent:
            setattr(modules[parent], last, module)
    return modules


class _Finder:
    """Finds ours, and what packages bring themselves, as a finder and loader.

    It has none of `importlib.abc`, whose import would take a tenth of the start.
    """

    def __init__(self, find_sources: Callable[[str], str | None]) -> None:
        self._find_sources = find_sources

    def find_spec(self, name: str, path: Any, target: Any = None) -> Any:
        first = name.partition(".")[0]
        if first in _LAUNCH:
            loader: Any = self
            return importlib.machinery.ModuleSpec(name, loader, is_package=True)
        if path is not None or first in sys.stdlib_module_names:
            return None
        return self._find_own(name)

    def _find_own(self, name: str) -> Any:
        source = self._find_sources(name)
        if source is None:
            return None
        folders = [
            source,
            *(os.path.join(source, f) for f in ("src", "launch", "scripts")),
        ]
        return importlib.machinery.PathFinder.find_spec(name, folders)

    def create_module(self, spec: Any) -> types.ModuleType:
        return _Launch(spec.name)

    def exec_module(self, module: types.ModuleType) -> None:
        pass


def install(context: LaunchContext, find_sources: Callable[[str], str | None]) -> None:
    """Let launch files import what they know, in a context.

    `find_sources` returns the source folder of a package, None if there is none.
    """
    substitutions.enter(context)
    sys.modules.update(_make_modules())
    finder = _Finder(find_sources)
    # Before others for the modules of launch, after them for packages' own.
    sys.meta_path.insert(0, finder)


class _Other:
    """The parent process."""

    def __init__(self, incoming: TextIO, outgoing: TextIO) -> None:
        self._incoming, self._outgoing = incoming, outgoing
        self._found: dict[str, str | None] = {}

    def read(self) -> Any:
        return json.loads(self._incoming.readline())

    def send(self, **values: Any) -> None:
        print(json.dumps(values, default=str), file=self._outgoing, flush=True)

    def find(self, name: str) -> str:
        """Return the share folder of a package."""
        folder = self._ask("find", str(name))
        if folder is None:
            raise PackageNotFoundError(str(name))
        return folder

    def find_sources(self, name: str) -> str | None:
        """Return the source folder of a package, None if it has none."""
        return self._ask("find_sources", name)

    def expand(self, file: str, arguments: Mapping[str, str]) -> str:
        """Return the text of a xacro file, or raise LaunchError."""
        self.send(expand=os.path.abspath(file), arguments=dict(arguments))
        answer = self.read()
        if "problem" in answer:
            raise LaunchError(answer["problem"])
        return str(answer["text"])

    def _ask(self, what: str, name: str) -> str | None:
        key = f"{what} {name}"
        if key not in self._found:
            self.send(**{what: str(name)})
            self._found[key] = self.read()
        return self._found[key]


# Events of Python of what a launch file may not do, by what they are.
_REFUSED = {
    "starts a program": (
        "subprocess.Popen",
        "os.exec",
        "os.fork",
        "os.forkpty",
        "os.posix_spawn",
        "os.spawn",
        "os.startfile",
        "os.system",
        "pty.spawn",
    ),
    "opens a connection": (
        "socket.__new__",
        "socket.bind",
        "socket.connect",
        "socket.getaddrinfo",
        "urllib.Request",
    ),
    "sends a signal": ("os.kill", "os.killpg", "signal.pthread_kill"),
    "calls code that isn't Python's": ("ctypes.dlopen", "ctypes.dlsym"),
    "opens a data base": ("sqlite3.connect",),
}
_REFUSED_EVENTS = {name: what for what, names in _REFUSED.items() for name in names}

# Events that change files: how many of their arguments are paths, and how many of the
# last ones are folders that those are below.
_CHANGES = {
    "os.chmod": (1, 1),
    "os.chown": (1, 1),
    "os.link": (2, 2),
    "os.mkdir": (1, 1),
    "os.remove": (1, 1),
    "os.removexattr": (1, 0),
    "os.rename": (2, 2),
    "os.rmdir": (1, 1),
    "os.setxattr": (1, 0),
    "os.symlink": (2, 1),
    "os.truncate": (1, 0),
    "os.utime": (1, 1),
    "shutil.move": (2, 0),
    "shutil.rmtree": (1, 0),
}

_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


def _below(path: Any, folder: Any = None) -> Any:
    """Return a path that may be one below an open folder."""
    if not isinstance(folder, int) or folder < 0 or isinstance(path, int):
        return path
    return os.path.join(os.readlink(f"/proc/self/fd/{folder}"), os.fsdecode(path))


class _RefusedError(PermissionError):
    """Forbidden operation of a launch file."""


class _Watch:
    """Refuses what changes the machine, and notes which files are read."""

    def __init__(self, folder: str) -> None:
        self._folder = os.path.realpath(folder)
        self.opened: list[str] = []
        self.refused: list[str] = []

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            path, _, flags = arguments
            if not isinstance(path, str | bytes):
                return
            writes = isinstance(flags, int) and bool(flags & _WRITING)
            if not writes:
                self.opened.append(os.fsdecode(path))
            elif os.fsdecode(path) != os.devnull:
                self._check("writes", path)
        elif event in _REFUSED_EVENTS:
            what = arguments[0] if arguments else ""
            # Of Python itself, which numpy asks for.
            of_python = str(arguments[-1:]).startswith("('Py")
            if event == "ctypes.dlopen" and what is None:
                return
            if not (event == "ctypes.dlsym" and of_python):
                self.refuse(_REFUSED_EVENTS[event], what)
        elif event in _CHANGES:
            count, folders = _CHANGES[event]
            below = arguments[len(arguments) - folders :] if folders else ()
            paths = [_below(path, *below[-1:]) for path in arguments[:count]]
            for path in paths[1:] if event == "os.symlink" else paths:
                self._check("changes", path)

    def _check(self, what: str, path: Any) -> None:
        if isinstance(path, int):  # An open file, which may be one that is only read.
            path = f"/proc/self/fd/{path}"
        full = os.path.realpath(os.fsdecode(path))
        if os.path.commonpath([full, self._folder]) != self._folder:
            self.refuse(what, full)

    def refuse(self, what: str, name: Any) -> None:
        name = os.fsdecode(name) if isinstance(name, bytes) else name
        text = f"{what}: {name}" if isinstance(name, str) else what
        self.refused.append(text)
        raise _RefusedError(f"it {text}, which a launch file here may not do")


# What a shell has that ROS is set up in, for launch files that ask for it.
_OF_ROS = {
    "AMENT_PREFIX_PATH": "",
    "LD_LIBRARY_PATH": "",
    "PYTHONPATH": "",
    "ROS_DISTRO": "jazzy",
    "ROS_PYTHON_VERSION": "3",
    "ROS_VERSION": "2",
}


def main() -> None:
    """Read the launch file that standard input names, and print its result."""
    # Nothing that a launch file prints may come between what is told.
    other, said = _Other(sys.stdin, os.fdopen(os.dup(1), "w")), io.StringIO()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    request = other.read()
    _set_limits(request)
    tempfile.tempdir = request["folder"]
    sys.dont_write_bytecode = True
    words = (f"{name}:={value}" for name, value in request["arguments"].items())
    # A package and its file, or as here a path and nothing: arguments begin at 4.
    sys.argv = ["ros2", "launch", request["file"], "", *words]
    for name, value in _OF_ROS.items():
        os.environ.setdefault(name, value)
    # As the module site has it, which isn't loaded.
    vars(builtins).update(exit=sys.exit, quit=sys.exit)
    written = WrittenFiles(request["folder"])
    context = LaunchContext(other.find, other.expand, written)
    install(context, other.find_sources)
    run = LaunchRun(
        context,
        lambda path: _load(Path(path), request["stood_for"]),
        only_shows_arguments=request["only_shows_arguments"],
    )
    written.install()
    watch = _Watch(request["folder"])
    _seal(watch)
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        error = _launch(run, request)
    if error is not None and error.get("ends"):
        last = said.getvalue().strip().rpartition("\n")[2][:500]
        error["text"] += f"; it said: {last}" if last else ""
    other.send(
        error=error,
        arguments=list(run.declared.values()),
        values=written.real(context.launch_configurations),
        asked=sorted(context.asked),
        records=written.real(run.records),
        descriptions=context.descriptions,
        expansions=context.expansions,
        rewritten=context.rewritten,
        kept=written.kept,
        environment=dict(os.environ),
        opened=watch.opened[:10_000],
        refused=watch.refused,
        said=said.getvalue()[:10_000],
    )


def _set_limits(request: Mapping[str, Any]) -> None:
    for kind, limit in (
        (resource.RLIMIT_AS, request["memory"]),
        (resource.RLIMIT_CPU, request["cpu_time"]),
        (resource.RLIMIT_FSIZE, request["size"]),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(kind)
        least = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        # The hard one, too: it can't be raised again. A second of processor time lets
        # the system say why the process ends.
        last = least + 1 if kind == resource.RLIMIT_CPU else least
        # Not every system has each.
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(kind, (least, last))


def _seal(watch: _Watch) -> None:
    """Refuse from now on what a launch file may not do."""
    import subprocess  # noqa: F401  So that what it starts with is known here.

    with contextlib.suppress(ImportError):
        import _posixsubprocess

        def refuse(*args: Any) -> None:
            watch("subprocess.Popen", ())

        vars(_posixsubprocess)["fork_exec"] = refuse
    open_file = os.open

    def open_below(path: Any, *args: Any, dir_fd: Any = None, **others: Any) -> int:
        return open_file(_below(path, dir_fd), *args, **others)

    # Nothing tells of these, or not of all.
    for module in (os, sys.modules.get("posix", os)):
        vars(module)["open"] = open_below
    for name in ("mkfifo", "mknod"):
        for module in (os, sys.modules.get("posix", os)):
            vars(module)[name] = functools.partial(watch.refuse, "changes")
    for module in (signal, sys.modules.get("_signal", signal)):
        vars(module)["pidfd_send_signal"] = lambda *args: watch("os.kill", ())
    sys.addaudithook(watch)


def _load(path: Path, stood_for: str) -> Any:
    """Return what a launch file describes; None of a package that is stood for."""
    return None if path.is_relative_to(stood_for) else read_launch_file(path)


def _launch(run: LaunchRun, request: Mapping[str, Any]) -> dict[str, Any] | None:
    """Run a launch file; return what is wrong."""
    try:
        run.run(request["file"], request["arguments"])
        run.records[:] = run.context.filled(run.records)
    except PackageNotFoundError as error:
        return {"kind": "package", "name": error.args[0], **_place(error, run)}
    except LaunchError as error:
        return {"kind": "launch", "text": str(error), **_place(error, run)}
    except SyntaxError as error:
        text = f"{type(error).__name__}: {error.msg}"
        return {
            "kind": "python",
            "text": text,
            "file": error.filename,
            "line": error.lineno,
        }
    except ImportError as error:
        # Of a module that is there, a name may lack.
        lacks = isinstance(error, ModuleNotFoundError) or not error.name
        return {
            "kind": "import" if lacks else "launch",
            "name": error.name or str(error),
            "text": f"{error.name} here lacks it: {error.msg.partition(' (')[0]}",
            **_place(error, run),
        }
    except MemoryError:
        return {"kind": "memory"}
    # A launch file is a program, which ends with whatever it likes.
    except BaseException as error:
        files = run.context.files
        if isinstance(error, RecursionError) and files and files[-1][-3:] != ".py":
            text = "substitutions are nested too deeply"
            return {"kind": "launch", "text": text, "file": files[-1], "line": None}
        text = f"{type(error).__name__}: {str(error)[:500]}"
        if isinstance(error, _RefusedError):
            text = str(error)
        for problem in run.context.problems.values():  # They may be why.
            text += f"; a description can't be read: {problem}"
        ends = isinstance(error, SystemExit)
        return {"kind": "python", "text": text, "ends": ends, **_place(error, run)}
    return None


# Where Python and its packages are.
_INSTALLED = tuple({sys.prefix, sys.base_prefix, os.path.dirname(os.__file__)})


def _place(error: BaseException, run: LaunchRun) -> dict[str, Any]:
    """Return the line of a user's file that an error comes from, or the file."""
    line = getattr(error, "line", None)
    ours = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    files = run.context.files
    place = {"file": files[-1] if files else None, "line": line}
    trace = error.__traceback__
    while trace is not None:
        name = trace.tb_frame.f_code.co_filename
        is_code = os.path.isabs(name) and os.path.isfile(name)
        if is_code and not name.startswith((ours, *_INSTALLED)):
            place = {"file": name, "line": trace.tb_lineno}
        trace = trace.tb_next
    return place
