"""The site of `make docs`: Sphinx, with MyST's notebooks and the theme furo.

README, pages, notebooks and the API reference, which is made of docstrings and of the
comments above dataclasses' fields. Nothing is fetched when the site is looked at:
equations are text, for MathJax would be.
"""

import ast
import dataclasses as dc
import gc
import inspect
import itertools
import logging
import os
import textwrap
from typing import Any

from jupyter_client.manager import KernelManager
from sphinx.application import Sphinx

project = "arm_drake"
author = "arm_drake authors"
html_title = project

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
include_patterns = ["index.md", "docs/**.md", "notebooks/*", "models/**README.md"]
exclude_patterns = [".*", "arm_drake", "configs", "out", "tests"]
html_theme = "furo"
pygments_dark_style = "monokai"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sourcelink = html_copy_source = html_show_copyright = False
html_use_index = html_domain_indices = False

# Headings have the anchors that they have on GitHub.
myst_heading_anchors = 4

# Notebooks run when the site is made.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_merge_streams = True

# `name` in a docstring is code, as in Markdown.
default_role = "code"
autoclass_content = "both"
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
add_module_names = False


def setup(app: Sphinx) -> None:
    """Have dataclasses say what their fields mean, and notebooks run without a word."""
    # The reader's browser reaches no page of theirs: a scene stands in the cell.
    os.environ["BINDER_LAUNCH_HOST"] = project
    # Else each kernel warns that others on the machine can listen.
    KernelManager.transport_encryption.default_value = "auto"
    logging.getLogger("traitlets").setLevel(logging.WARNING)
    # To look for garbage among millions of nodes takes a fifth of the time.
    gc.disable()
    app.connect("autodoc-process-docstring", _add_fields)


def _add_fields(
    _app: Sphinx, what: str, _name: str, cls: Any, _options: Any, lines: list[str]
) -> None:
    if what != "class" or not dc.is_dataclass(cls):
        return
    for name, comment in field_comments(cls).items():
        lines += ["", f".. py:attribute:: {name}", "", f"   {comment}", ""]


def field_comments(cls: type) -> dict[str, str]:
    """Return the comments above the fields of a dataclass, by the fields' names.

    Fields that follow each other without an empty line share the comment above them.
    """
    comments: dict[str, str] = {}
    for parent in filter(dc.is_dataclass, reversed(cls.__mro__)):
        lines = textwrap.dedent(inspect.getsource(parent)).splitlines()
        (tree,) = ast.parse("\n".join(lines)).body
        assert isinstance(tree, ast.ClassDef)
        for node in tree.body:
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                above = itertools.takewhile(
                    lambda line: line.strip() and not line.startswith("class "),
                    reversed(lines[: node.lineno - 1]),
                )
                words = [line.strip()[2:] for line in above if "#" in line[:8]]
                behind = lines[(node.end_lineno or node.lineno) - 1].partition("  # ")
                text = " ".join([*reversed(words), behind[2]]).strip()
                if text:
                    comments[node.target.id] = text
    return comments
