"""The documentation: links lead somewhere, and the site of `make docs` is whole."""

import dataclasses as dc
import importlib.util
import inspect
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from urllib.parse import unquote, urldefrag

import pytest

import arm_drake as ad
from tests.test_structure import PACKAGES

ROOT = Path(__file__).parents[1]
CONFIGURATION = ROOT / "docs/conf.py"


def load_configuration() -> ModuleType:
    spec = importlib.util.spec_from_file_location("conf", CONFIGURATION)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


field_comments = load_configuration().field_comments


class Page(HTMLParser):
    """What a page of the site refers to, and what it can be referred to by."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.ids.add(values.get("id") or "")
        self.links += [values[key] or "" for key in ("href", "src") if key in values]


# One test, for the site is made once: all of what follows is seen on it.
@pytest.mark.slow
def test_the_site_is_whole(tmp_path: Path) -> None:
    words = ["-q", "-W", "--keep-going", "-c", "docs", "-d", str(tmp_path / "trees")]
    site = tmp_path / "site"
    # `make docs` runs the notebooks too, and lists in the contents of the reference's
    # pages what is on them, a fifth of the time.
    words += ["-D", "nb_execution_mode=off", "-D", "toc_object_entries=0"]
    words += [".", str(site)]

    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )

    # Sphinx warns of links and anchors of the pages that lead nowhere.
    assert done.stdout + done.stderr == ""
    assert done.returncode == 0
    pages = {file: Page(file) for file in sorted(site.rglob("*.html"))}
    check_pages(site, pages)
    check_links(pages)
    check_that_nothing_is_fetched(site)
    check_that_it_fits_a_phone(pages)
    check_reference(site / "docs/api")


def check_pages(site: Path, pages: dict[Path, Page]) -> None:
    """Every page is there, and the menu begins with the tutorials."""
    sources = [*ROOT.glob("docs/**/*.md"), *ROOT.glob("notebooks/*.ipynb")]
    for source in sources:
        assert site / source.relative_to(ROOT).with_suffix(".html") in pages
    links = pages[site / "index.html"].links
    menu = [link for link in links if link.startswith(("docs/", "notebooks/"))]
    names = [link.removesuffix(".html") for link in dict.fromkeys(menu)]
    assert names[:2] == ["docs/tutorials", "docs/coming_from_ros"]
    order = ["notebooks/01_quick_start", "docs/add_a_controller", "docs/api/start"]
    places = [names.index(name) for name in order]
    assert places == sorted(places)
    # Headings have the names that they have on GitHub.
    anchors = pages[site / "docs/servo.html"].ids
    assert "the-joint-servo-from-a-command-to-an-effort" in anchors


def check_links(pages: dict[Path, Page]) -> None:
    """All links lead to a page of the site, and to a place that it has."""
    lost = []
    for file, page in pages.items():
        for link in page.links:
            target, anchor = urldefrag(unquote(link))
            to = (file.parent / target.partition("?")[0]).resolve() if target else file
            if "://" in link or link.startswith(("data:", "#")):
                continue
            if not to.exists() or (anchor and anchor not in pages[to].ids):
                lost.append(f"{file.name}: {link}")

    assert lost == []


def check_that_nothing_is_fetched(site: Path) -> None:
    """No page loads a script, a style, a font or a picture from elsewhere."""
    for file in site.rglob("*.html"):
        text = file.read_text(encoding="utf-8")
        found = re.findall(r"""<(?:script|link|img)[^>]*(?:src|href)="?http""", text)
        assert found == [], file
    for file in site.rglob("*.css"):
        text = file.read_text(encoding="utf-8")
        assert re.findall(r"""(?:@import|url\()\s*["']?http""", text) == [], file


def check_that_it_fits_a_phone(pages: dict[Path, Page]) -> None:
    """Pages have the width of the screen, and what is wider scrolls in itself."""
    for file in pages:
        text = file.read_text(encoding="utf-8")
        assert 'name="viewport"' in text
        tables = text.count("<table")
        assert len(re.findall(r'class="table-wrapper[^>]*>\s*<table', text)) == tables


def check_reference(folder: Path) -> None:
    """Every public name has its place, and methods and fields say what they mean."""
    files = sorted(folder.glob("*.html"))
    ids = set().union(*(Page(file).ids for file in files))
    for name in ad.__all__:
        places = {f"arm_drake.{name}", f"module-arm_drake.{name}"} & ids
        assert places, f"{name}: to be added to a page of docs/api"
        public = getattr(ad, name)
        assert inspect.getdoc(public), name
        if inspect.isclass(public):
            for method, value in vars(public).items():
                if inspect.isfunction(value) and not method.startswith("_"):
                    assert f"arm_drake.{name}.{method}" in ids
                    assert inspect.getdoc(getattr(public, method)), f"{name}.{method}"
    text = (folder / "start.html").read_text(encoding="utf-8")
    order = ["load_robot", "build_diagram", "Simulation"]
    found = [text.index(f'id="arm_drake.{name}"') for name in order]
    assert found == sorted(found)
    assert "arm_drake.SimulationOptions.friction_compensation" in ids
    assert "Whether the servo knows the robot’s weight" in text


def test_make_docs_takes_warnings_as_errors_and_runs_the_notebooks() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")

    assert "-m sphinx -q -W --keep-going -c docs . out/docs\n" in makefile
    assert 'nb_execution_mode = "force"' in CONFIGURATION.read_text(encoding="utf-8")


def test_every_option_says_what_it_means() -> None:
    fields = {field.name for field in dc.fields(ad.SimulationOptions)}

    assert set(field_comments(ad.SimulationOptions)) == fields


def test_fields_without_a_line_between_them_share_a_comment() -> None:
    @dc.dataclass
    class Point:
        # Where it is [m].
        x: float
        y: float

        size: float  # [m]

        name: str = ""

    assert field_comments(Point) == {
        "x": "Where it is [m].",
        "y": "Where it is [m].",
        "size": "[m]",
    }


@pytest.mark.slow
def test_the_picture_of_the_architecture_names_systems_of_the_diagram() -> None:
    picture = (ROOT / "docs/architecture.svg").read_text(encoding="utf-8")
    drawn = re.findall(r'<text class="system"[^>]*>([^<]+)<', picture)

    diagram = ad.build_diagram(ad.load_robot("lab5_arm"))

    assert len(drawn) == 4
    assert set(drawn) <= {system.get_name() for system in diagram.GetSystems()}


def test_no_page_waits_for_a_figure() -> None:
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        assert not re.findall(r"@[A-Z]+@|TODO|TBD", page.read_text("utf-8")), page


def test_the_architecture_names_modules_that_are_there() -> None:
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    named = re.findall(r"`((?:[a-z_]+/)+[a-z_]+)`", text)

    assert len(named) > 40
    for name in named:
        path = ROOT / "arm_drake" / name
        assert path.is_dir() or path.with_suffix(".py").exists(), name
    # All packages, in the order in which they may import each other.
    assert re.findall(r"^      ([a-z]+)/ ", text, re.MULTILINE) == PACKAGES
