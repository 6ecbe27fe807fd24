"""Read YAML files safely, with numbers as ROS reads them."""

import re
from pathlib import Path
from typing import Any

import yaml

# YAML 1.1 takes 1e-3 for a string; rcl takes it for a number.
_FLOAT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$")


class YamlError(ValueError):
    """A file that can't be read or parsed."""

    def __init__(self, problem: str, line: int | None = None) -> None:
        """Create the error.

        Args:
            problem: What is wrong.
            line: Line of the file, counted from 1.
        """
        super().__init__(problem)
        self.problem = problem
        self.line = line


class Loader(yaml.SafeLoader):
    """Plain values only, as YAML's safe loader."""


Loader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+.0123456789"))


def read_text(path: Path) -> str:
    """Return the text of a file.

    Raises:
        YamlError: If it can't be read.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise YamlError(f"can't be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise YamlError("can't be read: it is not UTF-8 text") from None


def compose(text: str) -> yaml.Node | None:
    """Return the nodes of a YAML text, with their lines.

    Raises:
        YamlError: If the text is malformed.
    """
    try:
        return yaml.compose(text, Loader=Loader)
    except yaml.YAMLError as error:
        raise _explain(error) from None


def load(path: Path) -> Any:
    """Return the plain value of a YAML file.

    Raises:
        YamlError: If it can't be read or is malformed.
    """
    try:
        return yaml.load(read_text(path), Loader=Loader)  # noqa: S506  a safe loader.
    except yaml.YAMLError as error:
        raise _explain(error) from None


def _explain(error: yaml.YAMLError) -> YamlError:
    mark = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or " ".join(str(error).split())
    return YamlError(f"malformed YAML: {problem}", mark.line + 1 if mark else None)


def plain(node: yaml.Node) -> Any:
    """Return the plain value of a scalar or a list."""
    if isinstance(node, yaml.SequenceNode):
        return [plain(item) for item in node.value]
    return yaml.constructor.SafeConstructor().construct_object(node, deep=True)
