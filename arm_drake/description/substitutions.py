"""What launch files put into parameter files: `$(var NAME)` and its kin.

Vendors have templates of their own, `<NAME>` and `${NAME}`, which their scripts fill.
"""

import os
import re
from collections.abc import Mapping
from pathlib import Path

import yaml

from arm_drake import yaml_files
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.errors import PackageError, ParameterError

_BRACKET = re.compile(r"(\$\(|\))")
_TEMPLATE = re.compile(r"\$\{(\w+)\}|<(\w+)>")
_WITH_DEFAULT = ("var", "arg", "env")
_OF_PACKAGES = ("find", "find-pkg-share")


class Substitutions:
    """Values for the substitutions of parameter files."""

    def __init__(
        self,
        variables: Mapping[str, str],
        packages: PackageFinder | None,
        report: LoadReport,
    ) -> None:
        """Create it.

        Args:
            variables: Values by name, whatever the kind of substitution or template.
            packages: What resolves `$(find-pkg-share PACKAGE)`.
            report: Where templates without a value are recorded.
        """
        self._variables = {name: str(value) for name, value in variables.items()}
        self._packages = packages
        self._report = report
        self._used: set[str] = set()

    @property
    def unused(self) -> list[str]:
        """Names of the variables that nothing asked for."""
        return sorted(self._variables.keys() - self._used)

    def fill_templates(self, text: str) -> str:
        """Return a text with the templates filled whose value is known.

        It is done before the text is parsed: `[${prefix}joint1]` is no YAML.
        """

        def fill(match: re.Match[str]) -> str:
            name = match.group(1) or match.group(2)
            if name not in self._variables:
                return match.group()
            self._used.add(name)
            return self._variables[name]

        return _TEMPLATE.sub(fill, text)

    def apply(
        self, root: yaml.Node, file: Path, loader: type[yaml_files.Loader]
    ) -> yaml.Node:
        """Return the nodes of a file with every `$(...)` replaced.

        Args:
            root: Root of the file's nodes, which may be changed.
            file: The file, for messages.
            loader: What makes nodes of a value that is a list.

        Raises:
            ParameterError: If any has no value; it names all of them.
        """
        task = _Task(self._variables, self._packages, loader)
        result = task.visit(root)
        self._used |= task.used
        if task.aliases:
            self._report.add(
                "info",
                "repair",
                "aliases and merges (`*`, `<<`) are refused by rcl",
                "they are taken",
                file=file,
                line=task.aliases[0],
            )
        for template, line in task.templates.items():
            self._report.add(
                "warning",
                "missing",
                f"the template {template!r} has no value",
                f"it stays as it is; variables={{{_TEMPLATE.sub(_name, template)!r}: "
                "...} fills it",
                file=file,
                line=line,
            )
        for text, (name, line) in task.missing.items():
            self._report.add(
                "error",
                "missing",
                f"package {name!r} not found",
                f"{text} stays as it is; --package-path names the package's folder",
                file=file,
                line=line,
            )
        if task.unresolved:
            raise _unresolved(task.unresolved, file)
        return result


def _name(match: re.Match[str]) -> str:
    return match.group(1) or match.group(2)


# Texts of substitutions: name of the value or package, line.
_Unresolved = dict[str, tuple[str, int]]


class _Task:
    """Replaces the substitutions of one file."""

    def __init__(
        self,
        variables: Mapping[str, str],
        packages: PackageFinder | None,
        loader: type[yaml_files.Loader],
    ) -> None:
        self._variables = variables
        self._packages = packages
        self._loader = loader
        # What has been visited, and what replaces it; an alias is a second visit.
        self._visited: dict[int, tuple[yaml.Node, yaml.Node]] = {}
        self.used: set[str] = set()
        self.unresolved: _Unresolved = {}
        self.missing: _Unresolved = {}
        self.templates: dict[str, int] = {}
        self.aliases: list[int] = []

    def visit(self, node: yaml.Node) -> yaml.Node:
        if id(node) in self._visited:
            self.aliases.append(node.start_mark.line + 1)
            return self._visited[id(node)][1]
        result = node
        if isinstance(node, yaml.ScalarNode):
            result = self._replace(node)
        elif isinstance(node, yaml.SequenceNode):
            node.value = [self.visit(item) for item in node.value]
        else:
            node.value = [(self.visit(key), self.visit(v)) for key, v in node.value]
        self._visited[id(node)] = node, result
        return result

    def _replace(self, node: yaml.ScalarNode) -> yaml.Node:
        line = node.start_mark.line
        for match in _TEMPLATE.finditer(node.value):
            self.templates.setdefault(match.group(), line + 1)
        if "$(" not in node.value:
            return node
        node.value = self._expand(node.value, line + 1)
        if node.style is None and node.value.startswith(("[", "{")):
            # The empty lines give its nodes their lines.
            text = "\n" * line + node.value
            return yaml_files.compose(text, self._loader) or node
        return node

    def _expand(self, text: str, line: int) -> str:
        """Return a text with its substitutions replaced, the innermost ones first."""
        levels: list[list[str]] = [[]]
        for part in _BRACKET.split(text):
            if part == "$(":
                levels.append([])
            elif part == ")" and len(levels) > 1:
                inner = "".join(levels.pop())
                levels[-1].append(self._value(inner, line))
            else:
                levels[-1].append(part)
        if len(levels) > 1:
            raise yaml_files.YamlError(f"'$(' without ')' in {text!r}", line)
        return "".join(levels[0])

    def _value(self, inner: str, line: int) -> str:
        kind, *arguments = inner.split(maxsplit=1) if inner.strip() else [""]
        argument = _unquote(arguments[0]) if arguments else kind
        name, default = argument, None
        if kind in _WITH_DEFAULT:
            first, *rest = argument.split(maxsplit=1) or [""]
            name, default = _unquote(first), _unquote(rest[0]) if rest else None
        if name in self._variables:
            self.used.add(name)
            return self._variables[name]
        if kind == "env" and name in os.environ:
            return os.environ[name]
        if default is not None:
            return default
        text = f"$({inner})"
        if kind not in _OF_PACKAGES:
            self.unresolved.setdefault(text, (name, line))
            return ""
        if self._packages is not None:
            try:
                return str(self._packages.find(name))
            except PackageError:
                pass
        self.missing.setdefault(text, (name, line))
        return text


def _unquote(text: str) -> str:
    text = text.strip()
    if len(text) > 1 and text[0] == text[-1] and text[0] in "'\"":
        return text[1:-1]
    return text


def _unresolved(unresolved: _Unresolved, file: Path) -> ParameterError:
    """Return one error that names all substitutions without a value."""
    first = next(iter(unresolved.values()))[1]
    texts = [
        text if line == first else f"{text} (line {line})"
        for text, (_, line) in unresolved.items()
    ]
    names = dict.fromkeys(name for name, _ in unresolved.values())
    given = ", ".join(f"{name!r}: ..." for name in names)
    options = " ".join(f"--var {name}=VALUE" for name in names)
    noun = "one" if len(names) == 1 else "them"
    verb = "has" if len(texts) == 1 else "have"
    problem = f"{', '.join(texts)} {verb} no value"
    hint = f"give {noun} with variables={{{given}}} ({options})"
    return ParameterError(f"{problem}; {hint}", file=file, line=first)
