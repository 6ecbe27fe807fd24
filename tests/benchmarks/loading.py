"""Time and memory of loading a robot, with an empty cache and a full one.

Each robot is loaded in two fresh processes, the first with an empty cache of meshes.
The second one loads it several times more, in turns with a peer that does only what
others' code must: `xacro` expands the file and is told where packages are, and Drake
parses the mended URDF, whose meshes are converted. The last line says what
the robot with the largest converted meshes takes, and the slowest one.

    python -m tests.benchmarks.loading [--robots NAME ...] [--runs 5] [--json FILE]
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest import mock

if TYPE_CHECKING:
    import arm_drake as ad

# What we aim at for the largest robot, its meshes converted before [s].
GOAL = 0.5

Entry = dict[str, Any]


def find_entries() -> list[Entry]:
    """Return how to load each robot: the bundled ones, and those of the index."""
    import pytest
    import yaml

    from arm_drake.description.entry import bundled_robots, models_folder
    from tests.robots import robots_folder

    bundled = bundled_robots()
    entries: list[Entry] = [
        {"name": name, "folder": str(models_folder()), "options": {"source": name}}
        for name in bundled
    ]
    try:
        folder = robots_folder()
    except pytest.skip.Exception as error:
        print(error, file=sys.stderr)
        return entries
    index = yaml.safe_load((folder / "INDEX.yaml").read_text(encoding="utf-8"))
    for robot in index["robots"]:
        files = [str(folder / file) for file in robot["controllers_yaml"]]
        name = robot["name"]
        options = {
            "source": str(folder / robot["entry"]),
            "xacro_args": robot["xacro_args"],
            "controllers": files or None,
            "variables": robot["launch_vars"],
        }
        entries.append(
            {
                "name": f"{name}_published" if name in bundled else name,
                "folder": str(folder / robot["folder"]),
                "options": options,
            }
        )
    return entries


def measure(entry: Entry, runs: int) -> dict[str, Any]:
    """Return what one robot takes: [s], and [MB] of the whole process."""
    with tempfile.TemporaryDirectory() as cache:
        cold = run_child(entry, 0, cache)
        warm = run_child(entry, runs, cache)
        files = [path for path in Path(cache).rglob("*") if path.is_file()]
        size = sum(path.stat().st_size for path in files) / 1e6
    first = {
        f"{label}_{key}": times[key]
        for label, times in (("cold", cold), ("warm", warm))
        for key in ("load", "build", "memory")
    }
    others = {key: warm[key] for key in warm if key not in ("load", "build", "memory")}
    return {"robot": entry["name"], **first, **others, "cache": size}


def run_child(entry: Entry, runs: int, cache: str) -> dict[str, float]:
    """Return what `measure_here` finds in a fresh process."""
    task = json.dumps({"entry": entry, "runs": runs})
    done = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks.loading", "--child", task],
        capture_output=True,
        text=True,
        env={**os.environ, "ARM_DRAKE_CACHE": cache},
    )
    if done.returncode != 0:
        raise RuntimeError(f"{entry['name']}: {done.stderr}")
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def measure_here(entry: Entry, runs: int) -> dict[str, float]:
    """Load a robot for the first time in this process, then ``runs`` times more."""
    start = time.perf_counter()
    import arm_drake as ad

    # Names are imported when they are used first.
    load_robot, build_diagram = ad.load_robot, ad.build_diagram
    found = {"import": time.perf_counter() - start}

    def time_ours() -> tuple[ad.Robot, float, float]:
        start = time.perf_counter()
        robot = load_robot(**entry["options"])
        loaded = time.perf_counter()
        build_diagram(robot, world="void")
        return robot, loaded - start, time.perf_counter() - loaded

    robot, found["load"], found["build"] = time_ours()
    # Linux counts in kilobytes, macOS in bytes.
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    found["memory"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
    if not runs:
        return found
    rows = []
    for _ in range(runs):
        robot, load, build = time_ours()
        rows.append((load, build, time_xacro(robot, entry), time_drake(robot)))
    keys = ("again_load", "again_build", "peer_xacro", "peer_drake")
    columns = zip(*rows, strict=True)
    medians = [statistics.median(column) for column in columns]
    found |= dict(zip(keys, medians, strict=True))
    found["ratio"] = statistics.median(
        (load + build) / (expand + parse) for load, build, expand, parse in rows
    )
    return found


def time_xacro(robot: "ad.Robot", entry: Entry) -> float:
    """Return how long `xacro` alone takes to expand a robot [s]."""
    import xacro

    file = robot.description.file
    packages = Path(entry["folder"]).rglob("package.xml")
    folders = {path.parent.name: str(path.parent) for path in packages}
    lookup = xacro.substitution_args
    with (
        mock.patch.object(lookup, "_eval_find", folders.__getitem__),
        mock.patch.dict(lookup._eval_dict, find=folders.__getitem__),
        mock.patch.dict(xacro.substitution_args_context, arg={}),
    ):
        start = time.perf_counter()
        if "xacro" in file.read_text(encoding="utf-8"):
            arguments = dict(entry["options"].get("xacro_args", {}))
            xacro.process_file(str(file), mappings=arguments).toxml()
        return time.perf_counter() - start


def time_drake(robot: "ad.Robot") -> float:
    """Return how long Drake alone takes from the mended URDF to a diagram [s]."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
    from pydrake.systems.framework import DiagramBuilder

    start = time.perf_counter()
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
    root = ET.fromstring(robot.description.urdf)  # noqa: S314  our own text.
    root.set("name", robot.name)
    text = ET.tostring(root, encoding="unicode")
    Parser(plant).AddModelsFromString(text, "urdf")
    for link in robot.description.roots:
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(link))
    plant.Finalize()
    builder.Build()
    return time.perf_counter() - start


# Keys and heads of the table, times first.
COLUMNS = (
    ("cold_load", "load"),
    ("cold_build", "build"),
    ("cold_memory", "MB"),
    ("warm_load", "load"),
    ("warm_build", "build"),
    ("warm_memory", "MB"),
    ("again_load", "load"),
    ("again_build", "build"),
    ("peer_xacro", "xacro"),
    ("peer_drake", "Drake"),
    ("ratio", "ratio"),
)


def format_table(rows: list[dict[str, Any]]) -> str:
    """Return the slowest robot first, by a first load with a full cache."""
    width = max(len(row["robot"]) for row in rows)
    groups = (("empty cache", 3), ("full cache", 3), ("again", 2), ("others' code", 3))
    head = "".join(f"{text:>{7 * count}}" for text, count in groups)
    names = "".join(f"{text:>7}" for _, text in COLUMNS)
    lines = [" " * width + head, " " * width + names]
    for row in sorted(rows, key=warm_time, reverse=True):
        numbers = [
            f"{row[key]:7.0f}" if text == "MB" else f"{row[key]:7.3f}"
            for key, text in COLUMNS
        ]
        lines.append(f"{row['robot']:{width}}" + "".join(numbers))
    return "\n".join(lines)


def warm_time(row: dict[str, Any]) -> float:
    """Return the time of a first load with a full cache [s]."""
    return float(row["warm_load"] + row["warm_build"])


def summarise(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the rows, and what their summary says."""

    def brief(row: dict[str, Any]) -> dict[str, Any]:
        return {"robot": row["robot"], "warm": warm_time(row), "cache": row["cache"]}

    return {
        "goal": GOAL,
        "largest": brief(max(rows, key=lambda row: float(row["cache"]))),
        "slowest": brief(max(rows, key=warm_time)),
        "import": statistics.median(row["import"] for row in rows),
        "robots": rows,
    }


def main() -> None:
    """Print the table, and write it if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--robots", nargs="+", metavar="NAME")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--child", type=json.loads, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child is not None:
        print(json.dumps(measure_here(**options.child)))
        return
    entries = {entry["name"]: entry for entry in find_entries()}
    unknown = sorted(set(options.robots or ()) - set(entries))
    if unknown:
        parser.error(f"no robot {', '.join(unknown)}; there are {', '.join(entries)}")
    rows = [measure(entries[n], options.runs) for n in options.robots or entries]
    print(format_table(rows))
    found = summarise(rows)
    print(f"all in seconds; imports take {found['import']:.2f} once")
    slowest, largest = found["slowest"], found["largest"]
    print(
        f"goal: at most {GOAL} with a full cache; the largest, {largest['robot']} "
        f"({largest['cache']:.0f} MB converted), takes {largest['warm']:.2f}, "
        f"the slowest, {slowest['robot']}, {slowest['warm']:.2f}"
    )
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
