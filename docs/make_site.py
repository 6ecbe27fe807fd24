"""`make docs`: README, pages, notebooks and the API reference as one static site.

    python -W error docs/make_site.py out/docs

The API reference is pdoc's, of the docstrings and of the comments above dataclasses'
fields. Nothing is fetched, neither when the site is made nor when it is looked at.
"""

import ast
import dataclasses as dc
import html
import importlib
import inspect
import itertools
import json
import re
import shutil
import sys
import textwrap
from pathlib import Path
from urllib.parse import urldefrag

import pdoc
from markdown_it import MarkdownIt
from markdown_it.token import Token
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import get_lexer_by_name

ROOT = Path(__file__).parents[1]

# What the API reference has: the public names, and what the pages name besides.
MODULES = (
    "arm_drake",
    "arm_drake.controllers.topics",
    "arm_drake.description.parameters",
    "arm_drake.description.urdf",
    "arm_drake.messages",
    "arm_drake.simulation.clients",
    "arm_drake.worlds.world",
)

_PICTURES = (".png", ".svg")

_FRAME = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<link rel="stylesheet" href="style.css">
</head>
<body>
<nav>{menu}</nav>
<main>
{body}
</main>
</body>
</html>
"""

_STYLE = """
body { display: flex; margin: 0; font: 16px/1.5 sans-serif; }
nav { flex: 0 0 14em; padding: 1em; background: #f4f4f4; min-height: 100vh; }
nav a { display: block; padding: 0.15em 0; }
main { flex: 1; min-width: 0; max-width: 60em; padding: 0 2em 4em; }
pre { padding: 0.7em; overflow-x: auto; background: #f8f8f8; }
code { font-size: 90%; }
img { max-width: 100%; }
table { display: block; overflow-x: auto; border-collapse: collapse; }
td, th { padding: 0.2em 0.6em; border: 1px solid #ddd; text-align: left; }
a { color: #0056b3; text-decoration: none; }
"""


def list_pages() -> dict[Path, str]:
    """Return the sources of all pages, and the names that they get in the site."""
    sources = [*ROOT.glob("docs/*.md"), *ROOT.glob("notebooks/*.ipynb")]
    pages = {source: f"{source.stem}.html" for source in sorted(sources)}
    return {ROOT / "README.md": "index.html", **pages}


def read_markdown(source: Path) -> str:
    """Return a page as Markdown; of a notebook what stands in its cells."""
    text = source.read_text(encoding="utf-8")
    if source.suffix != ".ipynb":
        return text
    parts = []
    for cell in json.loads(text)["cells"]:
        content = "".join(cell["source"])
        is_code = cell["cell_type"] == "code"
        parts.append(f"~~~~python\n{content}\n~~~~" if is_code else content)
    return "\n\n".join(parts)


def parse(text: str) -> list[Token]:
    """Return the tokens of Markdown, with an id at each heading as on GitHub."""
    tokens = _parser().parse(text)
    seen: dict[str, int] = {}
    for token, inline in itertools.pairwise(tokens):
        if token.type == "heading_open":
            words = "".join(child.content for child in inline.children or ())
            name = re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")
            times = seen[name] = seen.get(name, -1) + 1
            token.attrs["id"] = f"{name}-{times}" if times else name
    return tokens


def list_anchors(text: str) -> set[str]:
    """Return the anchors of a page that is given as Markdown."""
    return {str(t.attrs["id"]) for t in parse(text) if t.type == "heading_open"}


def list_links(text: str) -> list[str]:
    """Return where links and pictures of a page lead that is given as Markdown."""
    inner = [child for token in parse(text) for child in token.children or ()]
    return [
        str(token.attrs.get("href", token.attrs.get("src", "")))
        for token in inner
        if token.type in ("link_open", "image")
    ]


def make_site(folder: Path) -> None:
    """Write the site.

    Args:
        folder: Where to; what was there before is removed.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    pages = list_pages()
    titles = {name: _title(source) for source, name in pages.items()}
    menu = "".join(
        f'<a href="{name}">{html.escape(title)}</a>\n'
        for name, title in {**titles, "api/arm_drake.html": "API reference"}.items()
    )
    for source, name in pages.items():
        tokens = parse(read_markdown(source))
        for token in tokens:
            _lead_into_site(token.children or [], source, pages, folder)
        body = _parser().renderer.render(tokens, _parser().options, {})
        page = _FRAME.format(title=html.escape(titles[name]), menu=menu, body=body)
        (folder / name).write_text(page, encoding="utf-8")
    style = _STYLE + HtmlFormatter().get_style_defs("pre")
    (folder / "style.css").write_text(style, encoding="utf-8")
    _write_reference(folder / "api")


def _parser() -> MarkdownIt:
    return MarkdownIt("commonmark", {"highlight": _highlight}).enable("table")


def _highlight(code: str, language: str, _attributes: str) -> str:
    if not language:
        return ""
    return highlight(code, get_lexer_by_name(language), HtmlFormatter(nowrap=True))


def _title(source: Path) -> str:
    """Return what a page is called in the menu."""
    if source.suffix == ".ipynb":
        return source.stem.replace("_", " ")
    tokens = parse(read_markdown(source))
    at = next(i for i, token in enumerate(tokens) if token.type == "heading_open")
    return tokens[at + 1].content


def _lead_into_site(
    tokens: list[Token], source: Path, pages: dict[Path, str], folder: Path
) -> None:
    """Make links to files of the tree links of the site; others become plain text."""
    is_plain = False
    for token in tokens:
        if token.type == "link_close" and is_plain:
            token.type, token.tag, is_plain = "text", "", False
        name = {"link_open": "href", "image": "src"}.get(token.type)
        if name is None:
            continue
        target, anchor = urldefrag(str(token.attrs[name]))
        file = (source.parent / target).resolve() if target else source
        if "://" in target:
            continue
        if file in pages:
            token.attrs[name] = pages[file] + (f"#{anchor}" if anchor else "")
        elif file.suffix in _PICTURES:
            shutil.copy(file, folder / file.name)
            token.attrs[name] = file.name
        else:
            token.type, token.tag, is_plain = "text", "", True


def _write_reference(folder: Path) -> None:
    # Without sources: they are in the tree.
    pdoc.render.configure(docformat="google", show_source=False)
    for module in map(importlib.import_module, MODULES):
        # pdoc finds only what has been imported, and some names are when they are used.
        for name in getattr(module, "__all__", ()):
            getattr(module, name)
    modules = {name: pdoc.doc.Module.from_name(name) for name in MODULES}
    for module in modules.values():
        for cls in module.classes:
            _document_fields(cls)
    for name, module in modules.items():
        file = folder / f"{name.replace('.', '/')}.html"
        file.parent.mkdir(parents=True, exist_ok=True)
        page = pdoc.render.html_module(module, modules)
        file.write_text(page, encoding="utf-8")
    search = pdoc.render.search_index(modules)
    (folder / "search.js").write_text(search, encoding="utf-8")


def _document_fields(cls: pdoc.doc.Class) -> None:
    """Give a dataclass's fields the comments above them for docstrings."""
    for parent in cls.obj.__mro__:
        if not dc.is_dataclass(parent) or parent.__module__ == "builtins":
            continue
        for name, comment in field_comments(parent).items():
            field = cls.members.get(name)
            if field is not None and not field.docstring:
                field.docstring = comment


def field_comments(cls: type) -> dict[str, str]:
    """Return the comments above the fields of a class, by the fields' names.

    Fields that follow each other without an empty line share the comment above them.
    """
    lines = textwrap.dedent(inspect.getsource(cls)).splitlines()
    (tree,) = ast.parse("\n".join(lines)).body
    assert isinstance(tree, ast.ClassDef)
    comments: dict[str, str] = {}
    for node in tree.body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            above = []
            for line in reversed(lines[: node.lineno - 1]):
                if not line.strip() or line.startswith("class "):
                    break
                above.append(line.strip())
            words = [line.lstrip("# ") for line in above if line.startswith("#")]
            behind = lines[node.end_lineno - 1].partition("  # ")[2]
            text = " ".join([*reversed(words), behind]).strip()
            if text:
                comments[node.target.id] = text
    return comments


if __name__ == "__main__":
    make_site(Path(sys.argv[1]))
