"""The documentation: links lead somewhere, and the site of `make docs` is whole."""

import dataclasses as dc
import importlib.util
import inspect
import re
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from urllib.parse import unquote, urldefrag

import pytest

import arm_drake as ad

ROOT = Path(__file__).parents[1]


def load_make_site() -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "make_site", ROOT / "docs/make_site.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


make_site = load_make_site()
PAGES = sorted(make_site.list_pages())


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


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the site; a warning while it is made is an error."""
    folder = tmp_path_factory.mktemp("site")
    make_site.make_site(folder)
    return folder


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    return {file: Page(file) for file in sorted(site.rglob("*.html"))}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_to_files_and_headings(page: Path) -> None:
    for link in make_site.list_links(make_site.read_markdown(page)):
        if "://" in link:
            continue
        target, anchor = urldefrag(link)
        file = page.parent / target if target else page
        assert file.exists(), link
        if anchor:
            assert anchor in make_site.list_anchors(make_site.read_markdown(file)), link


def test_anchors_are_those_of_github() -> None:
    text = "# Add `a` robot: how?\n\n## Two words_and-more\n\n## Two words_and-more\n"

    assert make_site.list_anchors(text) == {
        "add-a-robot-how",
        "two-words_and-more",
        "two-words_and-more-1",
    }


@pytest.mark.slow
def test_all_links_of_the_site_lead_into_it(pages: dict[Path, Page]) -> None:
    lost = []
    for file, page in pages.items():
        for link in page.links:
            target, anchor = urldefrag(unquote(link))
            to = (file.parent / target).resolve() if target else file
            if "://" in link or link.startswith("data:"):
                continue
            if not to.exists() or (anchor and anchor not in pages[to].ids):
                lost.append(f"{file.name}: {link}")

    assert lost == []
    assert len(pages) > len(PAGES)


@pytest.mark.slow
def test_a_page_fetches_nothing(pages: dict[Path, Page]) -> None:
    for file in pages:
        text = file.read_text(encoding="utf-8")
        assert (
            re.findall(r"""<(?:script|link|img)[^>]*(?:src|href)="?http""", text) == []
        )


@pytest.mark.slow
def test_every_public_name_is_in_the_reference(pages: dict[Path, Page]) -> None:
    (reference,) = (
        page for file, page in pages.items() if file.match("api/arm_drake.html")
    )

    for name in ad.__all__:
        assert name in reference.ids
        public = getattr(ad, name)
        assert inspect.getdoc(public), name
        if inspect.isclass(public):
            for method, value in vars(public).items():
                if inspect.isfunction(value) and not method.startswith("_"):
                    assert f"{name}.{method}" in reference.ids
                    assert inspect.getdoc(getattr(public, method)), f"{name}.{method}"


@pytest.mark.slow
def test_the_reference_says_what_fields_mean(site: Path) -> None:
    text = (site / "api/arm_drake.html").read_text(encoding="utf-8")

    comments = make_site.field_comments(ad.SimulationOptions)
    assert set(comments) == {field.name for field in dc.fields(ad.SimulationOptions)}
    assert "Whether the dry friction of <code>&lt;dynamics friction&gt;</code>" in text


def test_fields_without_a_line_between_them_share_a_comment() -> None:
    @dc.dataclass
    class Point:
        # Where it is [m].
        x: float
        y: float

        size: float  # [m]

        name: str = ""

    assert make_site.field_comments(Point) == {
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


def test_the_architecture_names_modules_that_are_there() -> None:
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    named = re.findall(r"`((?:[a-z_]+/)+[a-z_]+)`", text)

    assert len(named) > 40
    for name in named:
        path = ROOT / "arm_drake" / name
        assert path.is_dir() or path.with_suffix(".py").exists(), name
