"""The README tells the truth: its program runs, its tables are the registries."""

import re
import shutil
import subprocess
from collections.abc import Callable

import pytest

from arm_drake.controllers import CONTROLLER_TYPES, find_controller_type
from arm_drake.controllers.registry import load_other_types
from arm_drake.description.entry import bundled_motions, bundled_robots
from arm_drake.description.plugin_control import PLUGIN_TYPES
from arm_drake.launch import actions, event_handlers, parameters, substitutions
from arm_drake.launch.actions import Action
from arm_drake.launch.event_handlers import EventHandler
from arm_drake.launch.launch_description_sources import _MAKERS
from arm_drake.launch.nodes import NODES
from arm_drake.launch.substitutions import _BY_NAME, Condition, Substitution
from arm_drake.worlds.world import WORLDS
from tests.snippets import ROOT, read_blocks
from tests.type_table import render_others, render_types

README = ROOT / "README.md"
PAGES = [README, ROOT / "docs/controllers.md", ROOT / "docs/launch.md"]

# A whole table below its name.
TABLE = re.compile(r"^<!-- table: (\w+) -->\n((?:\|[^\n]*\n)*)", flags=re.MULTILINE)


def render_table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def render_robots() -> str:
    """Return the bundled robots, as their READMEs call them, and their motions."""
    rows = []
    for name, entry in bundled_robots().items():
        readme = entry.parents[1] / "README.md"
        title = readme.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")
        motions = ", ".join(f"`{motion}`" for motion in bundled_motions(name))
        rows.append([f"`{name}`", f"[{title}](models/{name}/README.md)", motions])
    return render_table(["robot", "what it is", "its motions"], rows)


def render_bundled() -> str:
    """Return the names of everything else that comes with arm_drake."""
    own = [name for name, row in CONTROLLER_TYPES.items() if not row.runs_as]
    plugins = [re.split("::|/", name)[-1] for name in PLUGIN_TYPES.values()]
    kinds = {
        "worlds": sorted(WORLDS),
        "Gazebo plugins": sorted(plugins),
    }
    rows = [[kind, ", ".join(f"`{n}`" for n in names)] for kind, names in kinds.items()]
    page = "[docs/controllers.md](docs/controllers.md)"
    rows.insert(1, ["controller types", f"{len(own)}, all in {page}"])
    return render_table(["what", "names"], rows)


def render_run_as() -> str:
    run_as = {}
    for name in (*CONTROLLER_TYPES, *load_other_types().equivalents):
        row = find_controller_type(name, installed={})
        if row is not None and row.runs_as:
            run_as[name] = row.runs_as
    return f"{render_others(run_as)}\n"


def render_nodes() -> str:
    """Return the nodes of launch files that have a meaning, and what each becomes."""
    rows = []
    for role in NODES:
        packages = ", ".join(f"`{package}`" for package in role.packages)
        names = ", ".join(f"`{name}`" for name in role.executables)
        rows.append([packages, names or "all", role.becomes])
    return render_table(["package", "node", "here"], rows)


def render_launch() -> str:
    """Return the names of `launch` and `launch_ros` that launch files may use."""
    kinds: dict[str, list[str]] = {
        "actions": [],
        "event handlers": [],
        "substitutions": [],
        "conditions": [],
        "in XML, YAML and parameter files": [
            *(f"<{tag}>" for tag in sorted(_MAKERS)),
            *(f"$({name})" for name in sorted(_BY_NAME)),
        ],
    }
    bases = {
        Action: "actions",
        EventHandler: "event handlers",
        Substitution: "substitutions",
        Condition: "conditions",
    }
    for module in (actions, event_handlers, substitutions, parameters):
        for name, value in sorted(vars(module).items()):
            is_own = getattr(value, "__module__", "") == module.__name__
            if is_own and isinstance(value, type) and name[0] != "_":
                for base, kind in bases.items():
                    if issubclass(value, base) and value is not base:
                        kinds[kind].append(name)
    for own in ("LambdaAction", "UnknownAction"):
        kinds["actions"].remove(own)
    rows = [[k, ", ".join(f"`{n}`" for n in names)] for k, names in kinds.items()]
    return render_table(["what", "names"], rows)


# How each table is made.
MAKERS: dict[str, Callable[[], str]] = {
    "robots": render_robots,
    "bundled": render_bundled,
    "types": lambda: f"{render_types(CONTROLLER_TYPES)}\n",
    "others": render_run_as,
    "nodes": render_nodes,
    "launch": render_launch,
}


def renew(text: str) -> str:
    """Return a page with its tables made anew."""
    return TABLE.sub(lambda m: f"<!-- table: {m[1]} -->\n{MAKERS[m[1]]()}", text)


@pytest.mark.slow
def test_the_program_runs_and_succeeds(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    parts = [b.text for b in read_blocks(README) if b.language == "python"]
    program = "\n".join(parts)

    exec(compile(program, "README.md", "exec"), {})  # noqa: S102  our own text.

    printed = capsys.readouterr().out
    assert printed == "nothing to report\n" + 2 * "GoalStatus.SUCCEEDED\n"
    assert len(parts) == 2
    files = {path.name for path in tmp_path.iterdir()}
    assert files == {"arm.html", "run.npz", "run.png"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_tables_are_those_of_the_registries(page):
    text = page.read_text(encoding="utf-8")

    assert text == renew(text), "python -m tests.test_readme renews them"


def test_every_table_has_its_place():
    places = [
        name
        for page in PAGES
        for name, _ in TABLE.findall(page.read_text(encoding="utf-8"))
    ]

    assert sorted(places) == sorted(MAKERS)


def test_the_commands_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = re.findall(r"\bmake ([a-z]+)\b", README.read_text(encoding="utf-8"))
    assert {"bench", "demo", "docs", "test"} <= set(targets)
    for target in targets:
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target


# A Python that makes environments with a pip that says what pip says of two packages.
STAND_IN = """#!/bin/sh
[ "$2" = venv ] || exit 0
mkdir -p .venv/bin
cat > .venv/bin/pip <<'END'
#!/bin/sh
[ -e fails ] && exit 1
case "$*" in *--quiet*) exit 0;; esac
echo 'Collecting drake==1 (from -r requirements.lock (line 1))'
echo '  Downloading drake-1-cp311-manylinux.whl (112.5 MB)'
echo '     ---- 112.5/112.5 MB 12.6 MB/s eta 0:00:00'
echo '  Downloading tiny-1-py3-none-any.whl (1.5 MB)'
echo 'Installing collected packages: tiny, drake'
END
chmod +x .venv/bin/pip
"""

TOOLS = ("cat", "chmod", "date", "mkdir", "rm", "sed", "sh", "touch")


@pytest.mark.parametrize("fails", [False, True])
def test_set_up_says_what_it_does(tmp_path, fails):
    make = shutil.which("make")
    if make is None:
        pytest.skip("there is no make")
    tools = tmp_path / "tools"
    tools.mkdir()
    for name in TOOLS:  # No uv.
        (tools / name).symlink_to(shutil.which(name))
    python = tools / "python"
    python.write_text(STAND_IN, encoding="utf-8")
    python.chmod(0o755)
    for name in ("pyproject.toml", "requirements.lock", *["fails"][: int(fails)]):
        (tmp_path / name).touch()
    words = [make, "-f", str(ROOT / "Makefile"), "setup", f"PYTHON={python}"]

    done = subprocess.run(
        words, cwd=tmp_path, env={"PATH": str(tools)}, capture_output=True, text=True
    )

    said = re.sub(r"(?m)^\d+ s: ", "N s: ", done.stdout).splitlines()
    assert re.fullmatch(r"setting up .*, about \d+ MB to download; .*", said[0])
    steps = ["N s: creating the environment"]
    steps.append("N s: downloading with pip; the largest are")
    if not fails:
        steps.append("  drake-1-cp311-manylinux.whl (112.5 MB)")
        steps += ["  all is there; installing it", "N s: done"]
    assert said[1:] == steps
    assert (done.returncode != 0) == fails
    assert (tmp_path / ".venv/.ready").exists() != fails


if __name__ == "__main__":
    for path in PAGES:
        path.write_text(renew(path.read_text(encoding="utf-8")), encoding="utf-8")
