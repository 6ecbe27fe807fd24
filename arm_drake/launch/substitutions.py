"""Substitutions and conditions of launch files: texts that depend on a context.

They have the names and the arguments of `launch.substitutions`,
`launch_ros.substitutions` and `launch.conditions`; what they stand for is told by
their documentation. They are used in the process that reads launch files alone.
"""

import itertools
import os
import re
import shlex
import tempfile
import types
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from arm_drake.errors import suggest
from arm_drake.launch.shell import split_command
from arm_drake.launch.written_files import WrittenFiles

# What is passed on in place of a description's text, by its number: most are never
# looked into, and to expand one takes a process of its own.
KEY = re.compile(r'<robot key="([0-9]{1,9})" by="arm_drake"/>')


class LaunchError(Exception):
    """Error that stops a launch file, in words for its user."""

    line: int | None = None

    def __init__(self, text: str, line: int | None = None) -> None:
        """Take the words, and the line of an XML or YAML file, if it is known."""
        super().__init__(text)
        self.line = line

    def at(self, line: int | None) -> "LaunchError":
        """Return the same, at a line if it had none."""
        self.line = self.line or line
        return self


class SubstitutionFailure(LaunchError):
    """A substitution that stands for nothing; the name is that of `launch`."""


class InvalidConditionExpressionError(LaunchError):
    """A condition that is neither true nor false; the name is that of `launch`."""


class PackageNotFoundError(LookupError, LaunchError):
    """A package that isn't found; the name is that of `ament_index_python`."""


class LaunchContext:
    """Context of substitutions: configurations, environment, files."""

    def __init__(
        self,
        find_package: Callable[[str], str],
        expand: Callable[[str, Mapping[str, str]], str],
        written: WrittenFiles,
    ) -> None:
        """Create it, with what finds a package's share folder, and expands xacro."""
        self._expand = expand
        # What launch files wrote, and where it is kept.
        self.written = written
        self.find_package = find_package
        self.launch_configurations: dict[str, str] = {}
        # Names of configurations that something asked for.
        self.asked: set[str] = set()
        self.locals = types.SimpleNamespace()
        # Launch files that are being read, and xacro descriptions that were asked for.
        self.files: list[str] = []
        self.descriptions: list[dict[str, Any]] = []
        # Texts of those that were asked for by keys, and what can't be read of them.
        self.expansions: dict[str, str] = {}
        self.problems: dict[str, str] = {}
        self.parameters: list[Any] = []
        # What nodes that were started are given by name, by their names.
        self.started: dict[str, dict[str, Any]] = {}
        self.remappings: list[tuple[str, str]] = []

        # Files of parameters that were rewritten: of which one, and whether their lines
        # are its own.
        self.rewritten: dict[str, tuple[str, bool]] = {}

    @property
    def environment(self) -> Any:
        """The environment of what is started."""
        return os.environ

    def expanded(self, key: str) -> str:
        """Return the text of a description, or raise LaunchError."""
        number = int(KEY.findall(key)[0])
        if number >= len(self.descriptions):  # Written by the launch file itself.
            return key
        if key not in self.expansions:
            made = self.descriptions[number]
            self.expansions[key] = self._expand(made["file"], made["arguments"])
        return self.expansions[key]

    def whole(self, value: Any) -> Any:
        """Return a value as launch files' own code gets it: with texts for keys.

        What can't be expanded stays a key: what is wrong with it is told with the robot
        that has it, and with what fails for it before.
        """
        if isinstance(value, str) and KEY.fullmatch(value):
            try:
                return self.expanded(value)
            except LaunchError as error:
                self.problems[value] = str(error)
                return value
        return self.filled(value)

    def filled(self, value: Any) -> Any:
        """Return a value whose texts have descriptions among others, expanded."""
        if isinstance(value, Mapping):
            return {key: self.filled(each) for key, each in value.items()}
        if isinstance(value, list | tuple):
            return [self.filled(each) for each in value]
        if not isinstance(value, str) or KEY.fullmatch(value.strip()):
            return value
        return KEY.sub(lambda match: self.expanded(match[0]), value)

    def key_of(self, text: str) -> str:
        """Return what is passed on for a text: the key of a description."""
        for key, known in self.expansions.items():
            if known == text:
                return key
        return text

    def copy_scope(self) -> tuple[Any, ...]:
        """Return a copy of what actions have from those before them."""
        return (
            dict(self.launch_configurations),
            list(self.parameters),
            list(self.remappings),
        )

    def set_scope(self, scope: tuple[Any, ...]) -> None:
        """Let actions that follow have what `copy_scope` returned."""
        self.launch_configurations, self.parameters, self.remappings = scope

    def perform_substitution(self, substitution: Any) -> str:
        """Return the text that a substitution stands for."""
        text: str = self.whole(perform(self, substitution))
        return text

    def note_description(
        self, file: str, arguments: Mapping[str, str], *, ends_on_words: bool = False
    ) -> str:
        """Return the key of a xacro file with arguments.

        `ends_on_words` is whether the launch ends if xacro says something.
        """
        made = {"file": os.path.abspath(file), "arguments": dict(arguments)}
        made = self.written.real(made)
        self.descriptions.append({**made, "ends_on_words": ends_on_words})
        return f'<robot key="{len(self.descriptions) - 1}" by="arm_drake"/>'


def perform(context: LaunchContext, value: Any) -> str:
    """Return the text of a text, a substitution, or a list of them.

    Descriptions in it are keys.
    """
    if isinstance(value, str | bytes):
        return context.key_of(value) if isinstance(value, str) else value.decode()
    kind = type(value)
    if isinstance(value, Substitution) and kind.perform is Substitution.perform:
        return value.text_of(context)
    if hasattr(value, "perform"):  # One of a package's own.
        found = value.perform(context)
        return context.key_of(found if isinstance(found, str) else str(found))
    if isinstance(value, Mapping) or not isinstance(value, Iterable):
        return str(value)
    return "".join(perform(context, each) for each in value)


def is_substitution(value: Any) -> bool:
    """Return whether a value, or some of a list, must be evaluated."""
    if isinstance(value, list | tuple):
        return any(is_substitution(each) for each in value)
    return hasattr(value, "perform")


class Substitution:
    """A text that depends on the context."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """Take what describes it."""
        self.args, self.kwargs = args, kwargs

    def perform(self, context: LaunchContext) -> str:
        """Return the text, for launch files' own code."""
        text: str = context.whole(self.text_of(context))
        return text

    def text_of(self, context: LaunchContext) -> str:
        """Return the text; descriptions in it are keys."""
        raise SubstitutionFailure(f"substitution {type(self).__name__} is not known")

    def describe(self) -> str:
        """Return what it is, for messages."""
        return f"{type(self).__name__}{self.args}"

    def __truediv__(self, other: Any) -> "PathJoinSubstitution":
        """Return a path, as in `PathSubstitution(a) / 'b'`."""
        return PathJoinSubstitution([self, other])


class TextSubstitution(Substitution):
    def __init__(self, *, text: str) -> None:
        super().__init__()
        self.text = text

    def text_of(self, context: LaunchContext) -> str:
        return str(self.text)


class LaunchConfiguration(Substitution):
    def __init__(self, variable_name: Any, *, default: Any = None) -> None:
        super().__init__(variable_name)
        self.variable_name, self.default = variable_name, default

    def text_of(self, context: LaunchContext) -> str:
        name = perform(context, self.variable_name)
        context.asked.add(name)
        if name in context.launch_configurations:
            return perform(context, context.launch_configurations[name])
        if self.default is None:
            hint = suggest(name, context.launch_configurations)
            text = f"launch configuration {name!r} does not exist; {hint}"
            raise SubstitutionFailure(text)
        return perform(context, self.default)


class PathJoinSubstitution(Substitution):
    def __init__(self, substitutions: Iterable[Any]) -> None:
        super().__init__()
        self.substitutions = list(substitutions)

    def text_of(self, context: LaunchContext) -> str:
        return os.path.join(*(perform(context, each) for each in self.substitutions))

    def __truediv__(self, other: Any) -> "PathJoinSubstitution":
        return PathJoinSubstitution([*self.substitutions, other])


class PathSubstitution(PathJoinSubstitution):
    def __init__(self, path: Any) -> None:
        super().__init__([path])


class StringJoinSubstitution(Substitution):
    def __init__(self, substitutions: Iterable[Any], delimiter: Any = "") -> None:
        super().__init__()
        self.substitutions, self.delimiter = list(substitutions), delimiter

    def text_of(self, context: LaunchContext) -> str:
        texts = [perform(context, each) for each in self.substitutions]
        return perform(context, self.delimiter).join(texts)


class FindPackageShare(Substitution):
    def __init__(self, package: Any) -> None:
        super().__init__(package)
        self.package = package

    def find(self, package_name: str) -> str:
        """Return the share folder of a package, without a context."""
        return find_package(package_name)

    def text_of(self, context: LaunchContext) -> str:
        return context.find_package(self._name(context))

    def _name(self, context: LaunchContext) -> str:
        name = perform(context, self.package)
        if name:
            return name
        asked = self.package
        if isinstance(asked, list | tuple) and len(asked) == 1:
            asked = asked[0]
        variable = perform(context, getattr(asked, "variable_name", ""))
        hint = f"; give it as {variable}:=NAME" if variable else ""
        raise SubstitutionFailure(f"the name of a package is empty{hint}")


class FindPackagePrefix(FindPackageShare):
    def find(self, package_name: str) -> str:
        return prefix_of(package_name, find_package(package_name))

    def text_of(self, context: LaunchContext) -> str:
        name = self._name(context)
        return prefix_of(name, context.find_package(name))


# The contexts of launch files that are being read; the last one counts.
_contexts: list[LaunchContext] = []


def enter(context: LaunchContext) -> None:
    """Let what has no context use this one."""
    _contexts.append(context)


def current() -> LaunchContext:
    """Return the context of the launch file that is being read."""
    return _contexts[-1]


def find_package(name: str) -> str:
    """Return the share folder of a package."""
    return current().find_package(name)


def read_description(path: Path, mappings: Mapping[str, Any] | None) -> str:
    """Return a xacro file's text, with these arguments."""
    context = current()
    texts = {name: perform(context, value) for name, value in (mappings or {}).items()}
    text: str = context.whole(context.note_description(str(path), texts))
    return text


def prefix_of(name: str, share: str) -> str:
    """Return a folder that has a package's share folder below `share`."""
    prefix = Path(tempfile.gettempdir(), "prefix", name)
    shown = prefix / "share" / name
    if not shown.exists():
        shown.parent.mkdir(parents=True, exist_ok=True)
        shown.symlink_to(share)
    return str(prefix)


class ExecutableInPackage(Substitution):
    def __init__(self, executable: Any, package: Any) -> None:
        super().__init__(executable, package)

    def text_of(self, context: LaunchContext) -> str:
        executable, package = (perform(context, each) for each in self.args)
        return f"ros2 run {package} {executable}"


class FindExecutable(Substitution):
    def __init__(self, *, name: Any) -> None:
        super().__init__(name)

    def text_of(self, context: LaunchContext) -> str:
        return perform(context, self.args[0])


_ON_STDERR = ("fail", "ignore", "warn", "capture")


class Command(Substitution):
    """Output of a program: xacro's is expanded later, most others are refused."""

    def __init__(self, command: Any, *, on_stderr: Any = "fail") -> None:
        super().__init__()
        self.command, self.on_stderr = command, on_stderr

    def text_of(self, context: LaunchContext) -> str:
        text = perform(context, self.command)
        on_stderr = perform(context, self.on_stderr)
        if on_stderr not in _ON_STDERR:
            expected = f"expected one of {', '.join(_ON_STDERR)}"
            raise SubstitutionFailure(f"on_stderr {on_stderr!r}: {expected}")
        try:
            program, *words = split_command(text)
        except ValueError:
            raise SubstitutionFailure(f"command {text!r}: no program's name") from None
        if program == "ros2" and words[:2] == ["param", "get"]:
            return _parameter(context, text, words[2:])
        if program == "ros2" and words[:2] in (["run", "xacro"],):
            program, words = "xacro", words[3:]
        files = [w for w in words if ":=" not in w and not w.startswith("-")]
        if os.path.basename(program) in ("xacro", "xacro.py", "cat") and files:
            pairs = (word.partition(":=") for word in words if ":=" in word)
            return context.note_description(
                files[0],
                {name: v for name, _, v in pairs},
                ends_on_words=on_stderr == "fail",
            )
        raise SubstitutionFailure(
            f"command {text!r} is not run; expected xacro FILE [NAME:=VALUE ...]"
        )


def _parameter(context: LaunchContext, text: str, words: list[str]) -> str:
    """Return what `ros2 param get` prints of a node that was started before."""
    names = [word for word in words if not word.startswith("-")]
    if len(names) != 2 or "--hide-type" not in words:
        problem = f"command {text!r}: expected ros2 param get --hide-type NODE NAME, "
        problem += "which prints the value alone"
        raise SubstitutionFailure(problem)
    node, name = f"/{names[0].lstrip('/')}", names[1]
    if node not in context.started:
        there = ", ".join(sorted(context.started)) or "none"
        problem = f"command {text!r}: {node} isn't started by then; nodes: {there}"
        raise SubstitutionFailure(problem)
    if name not in (given := context.started[node]):
        there = ", ".join(sorted(given)) or "none"
        problem = f"command {text!r}: {node} is given no {name!r}; it has: {there}"
        raise SubstitutionFailure(problem)
    return str(given[name])


class EnvironmentVariable(Substitution):
    def __init__(self, name: Any, *, default_value: Any = None) -> None:
        super().__init__(name)
        self.default_value = default_value

    def text_of(self, context: LaunchContext) -> str:
        name = perform(context, self.args[0])
        if name in context.environment:
            return str(context.environment[name])
        if self.default_value is None:
            raise SubstitutionFailure(f"environment variable {name!r} does not exist")
        return perform(context, self.default_value)


class PythonExpression(Substitution):
    def __init__(self, expression: Any, python_modules: Any = ("math",)) -> None:
        super().__init__(expression)
        self.python_modules = python_modules

    def text_of(self, context: LaunchContext) -> str:
        text = perform(context, self.args[0])
        names: dict[str, Any] = {}
        for module in self.python_modules:
            name = perform(context, module)
            names[name] = __import__(name)
            names |= {k: v for k, v in vars(names[name]).items() if k[0] != "_"}
        try:
            return str(eval(context.whole(text), {}, names))  # noqa: S307  As launch files say.
        except Exception as error:
            raise SubstitutionFailure(
                f"expression {text!r}: {type(error).__name__}: {error}"
            ) from None


class ThisLaunchFile(Substitution):
    def text_of(self, context: LaunchContext) -> str:
        return context.files[-1]


class ThisLaunchFileDir(Substitution):
    def text_of(self, context: LaunchContext) -> str:
        return os.path.dirname(context.files[-1])


class LocalSubstitution(Substitution):
    def text_of(self, context: LaunchContext) -> str:
        value: Any = context.locals
        for name in perform(context, self.args[0]).split("."):
            value = getattr(value, name)
        return str(value)


class AnonName(Substitution):
    def text_of(self, context: LaunchContext) -> str:
        return (
            f"{perform(context, self.args[0] if self.args else self.kwargs['name'])}_1"
        )


class FileContent(Substitution):
    def text_of(self, context: LaunchContext) -> str:
        return Path(perform(context, self.args[0])).read_text(encoding="utf-8")


def is_true(text: str) -> bool:
    """Return whether a text means true, as conditions read it."""
    known = {"true": True, "1": True, "false": False, "0": False}
    known |= {"on": True, "off": False, "yes": True, "no": False}
    if text.strip().lower() not in known:
        raise InvalidConditionExpressionError(
            f"condition {text!r}: expected true, 1, false or 0"
        )
    return known[text.strip().lower()]


class _Logic(Substitution):
    """Substitution that is true or false."""

    def text_of(self, context: LaunchContext) -> str:
        texts = [perform(context, each) for each in (*self.args, *self.kwargs.values())]
        return str(self.decide(texts)).lower()

    def decide(self, texts: list[str]) -> bool:
        raise NotImplementedError


class NotSubstitution(_Logic):
    def decide(self, texts: list[str]) -> bool:
        return not is_true(texts[0])


class AndSubstitution(_Logic):
    def decide(self, texts: list[str]) -> bool:
        return all(map(is_true, texts))


class OrSubstitution(_Logic):
    def decide(self, texts: list[str]) -> bool:
        return any(map(is_true, texts))


class EqualsSubstitution(_Logic):
    def decide(self, texts: list[str]) -> bool:
        left, right = texts
        try:
            return left.lower() == right.lower() or float(left) == float(right)
        except ValueError:
            return False


class NotEqualsSubstitution(EqualsSubstitution):
    def decide(self, texts: list[str]) -> bool:
        return not super().decide(texts)


class IfElseSubstitution(Substitution):
    def __init__(
        self, condition: Any, if_value: Any = "", else_value: Any = ""
    ) -> None:
        super().__init__(condition)
        self.if_value, self.else_value = if_value, else_value

    def text_of(self, context: LaunchContext) -> str:
        is_so = is_true(perform(context, self.args[0]))
        return perform(context, self.if_value if is_so else self.else_value)


class Condition:
    """Condition for the execution of an action."""

    def __init__(
        self, predicate: Callable[[LaunchContext], bool] | None = None
    ) -> None:
        """Take what decides."""
        self._predicate = predicate

    def evaluate(self, context: LaunchContext) -> bool:
        """Return what it decides."""
        return True if self._predicate is None else bool(self._predicate(context))


class IfCondition(Condition):
    def __init__(self, predicate_expression: Any) -> None:
        super().__init__()
        self.expression = predicate_expression

    def evaluate(self, context: LaunchContext) -> bool:
        return is_true(perform(context, self.expression))


class UnlessCondition(IfCondition):
    def evaluate(self, context: LaunchContext) -> bool:
        return not super().evaluate(context)


class LaunchConfigurationEquals(Condition):
    def __init__(self, launch_configuration_name: Any, expected_value: Any) -> None:
        super().__init__()
        self.name, self.expected = launch_configuration_name, expected_value

    def evaluate(self, context: LaunchContext) -> bool:
        expected = None if self.expected is None else perform(context, self.expected)
        return context.launch_configurations.get(self.name) == expected


class LaunchConfigurationNotEquals(LaunchConfigurationEquals):
    def evaluate(self, context: LaunchContext) -> bool:
        return not super().evaluate(context)


# What `$(NAME ...)` in XML, YAML and parameter files stands for.
_BY_NAME: Mapping[str, Callable[..., Any]] = {
    "and": AndSubstitution,
    "anon": AnonName,
    "any": OrSubstitution,
    "all": AndSubstitution,
    "command": lambda text, on_stderr="fail": Command(text, on_stderr=on_stderr),
    "dirname": ThisLaunchFileDir,
    "env": lambda name, default=None: EnvironmentVariable(name, default_value=default),
    "equals": EqualsSubstitution,
    "eval": lambda *words: PythonExpression(_with_spaces(words)),
    "exec-in-pkg": ExecutableInPackage,
    "file-content": FileContent,
    "filename": ThisLaunchFile,
    "find-exec": lambda name: FindExecutable(name=name),
    "find-pkg-prefix": FindPackagePrefix,
    "find-pkg-share": FindPackageShare,
    "if": IfElseSubstitution,
    "local": LocalSubstitution,
    "not": NotSubstitution,
    "not-equals": NotEqualsSubstitution,
    "optenv": lambda name, default="": EnvironmentVariable(name, default_value=default),
    "or": OrSubstitution,
    "path-join": lambda *parts: PathJoinSubstitution(parts),
    "var": lambda name, default=None: LaunchConfiguration(name, default=default),
}

_PIECE = re.compile(r"\$\(|\)|\s+|'|\"|\\.|[^$\s()'\"\\]+|.", re.DOTALL)


def _with_spaces(words: Iterable[Any]) -> list[Any]:
    return [part for word in words for part in (word, " ")][:-1]


def parse_substitution(text: str) -> list[Any]:
    """Return the parts of a text with `$(NAME ...)` in it, as XML and YAML have it."""
    pieces = _PIECE.findall(str(text))
    pieces.reverse()
    parts: list[Any] = []
    while pieces:
        piece = pieces.pop()
        parts.append(_parse_call(pieces) if piece == "$(" else _unescape(piece))
    return parts


def _unescape(piece: str) -> str:
    """Return a character without the backslash in front; a line's end keeps it."""
    is_escaped = len(piece) == 2 and piece[0] == "\\" and piece[1] != "\n"
    return piece[1] if is_escaped else piece


def parse_command(text: str) -> list[Any]:
    """Return the words of a command in XML and YAML, each of parts.

    As upstream: quotes are looked for between substitutions, and end at those.
    """
    words: list[list[Any]] = [[]]
    for is_text, run in itertools.groupby(
        parse_substitution(text), key=lambda part: isinstance(part, str)
    ):
        if not is_text:
            words[-1] += run
            continue
        joined = "".join(run)
        if joined[0].isspace():
            words.append([])
        try:
            split = shlex.split(joined)
        except ValueError:
            problem = "a quote isn't closed; expected it before the next $( or the end"
            raise SubstitutionFailure(f"cmd {text!r}: {problem}") from None
        for index, word in enumerate(split):
            words += [[]] if index else []
            words[-1].append(word)
        if joined[-1].isspace():
            words.append([])
    return [word for word in words if word]


def _parse_call(pieces: list[str]) -> Substitution:
    """Return a substitution whose `$(` was taken."""
    words: list[list[Any]] = [[]]
    quote = ""
    while pieces:
        piece = pieces.pop()
        if piece == "$(":
            words[-1].append(_parse_call(pieces))
        elif quote and piece == quote:
            quote = ""
        elif quote:
            words[-1].append(_unescape(piece))
        elif piece in ("'", '"'):
            quote = piece
            words[-1].append("")
        elif piece == ")":
            name, *rest = [word for word in words if word]
            made = "".join(map(str, name))
            if made not in _BY_NAME:
                known = ", ".join(sorted(_BY_NAME))
                raise SubstitutionFailure(f"unknown $({made} ...); known: {known}")
            try:
                substitution: Substitution = _BY_NAME[made](*rest)
            except TypeError:
                problem = f"$({made}) has {len(rest)} words, which is not what it takes"
                raise SubstitutionFailure(problem) from None
            return substitution
        elif piece.isspace():
            words.append([])
        else:
            words[-1].append(_unescape(piece))
    raise SubstitutionFailure("a $( is never closed")
