"""Chooses the reference cases in `oracle/`: every behaviour at least once, below 1 MB.

A case's features are what is said in words of its input and output: names of fields
and parameters, strings, booleans, which interfaces go together, result codes, texts
without their numbers; and of numbers whether they are 0, negative, not finite. The
cheapest cases that have all features of a file are chosen, one after the other, by
features that are new per compressed byte. Unit cases are cheap: of these, more are
chosen for pairs of features, up to a size. Cases stay whole.

    python tests/data/choose_cases.py FOLDER_OF_ALL_CASES

The same input gives the same bytes. Files of before are removed; `sources.json` says of
which files the cases are a choice.
"""

import gzip
import hashlib
import itertools
import json
import lzma
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

Case = dict[str, Any]

OUT = Path(__file__).parent / "oracle"
SOURCES = OUT.with_name("sources.json")

JTC = "jtc_scenarios"
JAZZY = "jtc_scenarios_jazzy_4.42.1"

# Files of cases that stand alone, and up to which size they are filled [bytes].
FILES = {
    "trajectory_sample": 40_000,
    "wraparound_joint": 5_000,
    "state_tolerance_check": 8_000,
    "goal_tolerance_resolution": 7_000,
    "pid": 10_000,
    "pid_jazzy_legacy_antiwindup": 10_000,
    "rate_limiter": 8_000,
    "joint_limits": 8_000,
    "controller_forward_command": 2_000,
    "controller_joint_state_broadcaster": 8_000,
    "controller_pid_controller": 0,
    "controller_manager_rate_schedule": 6_000,
}

# Files with the same long numbers several times, far from each other: xz sees that, and
# takes half of gzip's space.
XZ = {JTC, f"{JAZZY}_differing", "controller_pid_controller"}

# The best for text of numbers.
FILTERS = [
    {"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "lc": 2, "pb": 0}
]

# Fields of outputs that are time series: of these, only what isn't a number.
SERIES = {"command", "state", "reference", "exported_state", "controller_state", "t_ns"}

# Fields of no importance, or features of a case as a whole.
IGNORED = {"name", "urdf", "stamp", "stamp_ns", "cycle", "log_count"}


def find(folder: Path, name: str) -> Path:
    """Return the file `<name>.json`, `.json.gz` or `.json.xz`."""
    (file,) = folder.glob(f"{name}.json*")
    return file


def read(folder: Path, name: str) -> Any:
    """Return what is in a file."""
    file = find(folder, name)
    unpack = {".gz": gzip.decompress, ".xz": lzma.decompress}.get(file.suffix, bytes)
    return json.loads(unpack(file.read_bytes()))


def digest(folder: Path, name: str) -> str:
    """Return what tells a file from others."""
    return hashlib.sha256(find(folder, name).read_bytes()).hexdigest()


def pack(value: Any, name: str) -> bytes:
    """Return a value as compressed JSON, the same bytes every time."""
    text = json.dumps(value, separators=(",", ":")).encode()
    if name in XZ:
        return lzma.compress(text, filters=FILTERS)
    return gzip.compress(text, 9, mtime=0)


def size_of(value: Any, name: str) -> int:
    """Return about how many bytes a value takes."""
    text = json.dumps(value, separators=(",", ":")).encode()
    return len(lzma.compress(text, preset=1) if name in XZ else gzip.compress(text, 9))


def features(value: Any, path: str = "") -> Iterator[str]:
    """Yield what is said of a value, with its place."""
    if isinstance(value, dict):
        for key, part in value.items():
            if key not in IGNORED:
                # Which joint or goal it is, is no setting.
                name = f"{path}.{without_numbers(key)}"
                yield name
                yield from features(part, name)
    elif isinstance(value, list):
        if not value:
            yield f"{path} is empty"
        elif all(isinstance(part, str) for part in value):
            yield f"{path}={without_numbers(' '.join(value))}"
            yield f"{path} is {'' if value == sorted(value) else 'not '}in order"
            if len(set(value)) < len(value):
                yield f"{path} has one twice"
        for part in value:
            yield from features(part, path)
    elif isinstance(value, bool | None):
        yield f"{path}={value}"
    elif isinstance(value, str):
        yield f"{path}={without_numbers(value)}"
    elif value <= 0:
        yield f"{path} is 0" if value == 0 else f"{path} is below 0"


def without_numbers(text: str) -> str:
    """Return a text with `#` for numbers, so that texts of one kind are equal."""
    return re.sub(r"-?\d+(\.\d+)?(e[+-]?\d+)?", "#", text)


def features_of(case: Case) -> set[str]:
    """Return the features of a case."""
    inputs, output = case["input"], case["output"]
    found = set(features(inputs, "input"))
    for key, value in output.items():
        if key in SERIES:
            words = set(re.findall(r'"(-?[a-z]+)"', json.dumps(value)))
            found.update(f"output.{key}={word}" for word in words)
        else:
            found.update(features({key: value}, "output"))
    params = inputs.get("params", {})
    if "command_interfaces" in params:
        found.add(f"{params['command_interfaces']} {params.get('state_interfaces')}")
    if "name" in inputs:
        found.add(f"group={inputs['name'].split('_')[0]}")
    return found


def differences(case: Case, master: Case) -> set[str]:
    """Return in what a scenario of jazzy differs from master's, and why."""
    ours, theirs = case["output"], master["output"]
    found = {f"differs: {key}" for key in ours if ours[key] != theirs.get(key)}
    columns = theirs.get("controller_state", {})
    found.update(
        f"differs: {column.split('_')[0]}"
        for column, rows in ours.get("controller_state", {}).items()
        if rows != columns.get(column)
    )
    params = master["input"]["params"]
    text = json.dumps(params)
    causes = [name for name in ("upsampling", "allow_trajectory_repl") if name in text]
    if params["command_interfaces"][0] in ("velocity", "effort"):
        causes.append(f"pid of {params['command_interfaces']}")
    return found | set(causes or ["search"])


def cover(
    having: list[set[str]], costs: list[int], known: Iterable[str] = ()
) -> list[int]:
    """Return the indices of cases that have all features, the best ones first.

    Args:
        having: Features of the cases.
        costs: What they take.
        known: Features that needn't be had.
    """
    missing = set().union(*having) - set(known)
    chosen = []
    while missing:
        best = max(
            range(len(having)), key=lambda k: (len(having[k] & missing) / costs[k], -k)
        )
        chosen.append(best)
        missing -= having[best]
    # Later choices may have made earlier ones superfluous.
    needed = set().union(*having) - set(known)
    for k in sorted(chosen, key=lambda k: -costs[k]):
        others = [having[i] for i in chosen if i != k]
        if needed <= set().union(*others):
            chosen.remove(k)
    return chosen


def fill(
    cases: list[Case], chosen: list[int], having: list[set[str]], name: str
) -> list[int]:
    """Return more cases, for pairs of features, as long as there is space."""
    pairs = [set(map(" & ".join, itertools.combinations(sorted(h), 2))) for h in having]
    costs = [size_of(case, name) for case in cases]
    seen = set().union(*(pairs[k] for k in chosen))
    more = [k for k in cover(pairs, costs, seen) if k not in chosen]
    # What has nothing new may still have other numbers.
    rest = [k for k in range(len(cases)) if k not in (*chosen, *more)]
    chosen = list(chosen)
    for k in (*more, *rest):
        if len(pack([cases[i] for i in (*chosen, k)], name)) > FILES[name]:
            break
        chosen.append(k)
    return chosen


def choose(folder: Path) -> dict[str, Any]:
    """Return what goes into each file.

    Args:
        folder: Where all cases are.
    """
    files: dict[str, Any] = {}
    for name in FILES:
        cases = read(folder, name)
        having = [features_of(case) for case in cases]
        chosen = cover(having, [size_of(case, name) for case in cases])
        chosen = fill(cases, chosen, having, name)
        files[name] = [cases[k] for k in sorted(chosen)]
    return files | choose_scenarios(folder)


def choose_scenarios(folder: Path) -> dict[str, Any]:
    """Return the scenarios of JTC: those of jazzy need that of master for the input."""
    masters = read(folder, JTC)
    by_name = {case["input"]["name"]: case for case in masters}
    differing = {
        case["name"]: case
        for case in read(folder, f"{JAZZY}_differing")
        if case["name"] in by_name
    }
    # Who replays a scenario knows what both distros do.
    costs = {
        name: size_of(case, JTC) + size_of(differing.get(name), JTC)
        for name, case in by_name.items()
    }
    in_order = list(differing)
    chosen = cover(
        [differences(differing[name], by_name[name]) for name in in_order],
        [costs[name] for name in in_order],
    )
    names = {in_order[k] for k in chosen}
    known = set().union(*(features_of(by_name[name]) for name in names))
    more = cover([features_of(case) for case in masters], list(costs.values()), known)
    names |= {masters[k]["input"]["name"] for k in more}
    same = read(folder, f"{JAZZY}_identical")["identical_to_master"]
    return {
        JTC: [case for case in masters if case["input"]["name"] in names],
        f"{JAZZY}_differing": [c for n, c in differing.items() if n in names],
        f"{JAZZY}_identical": {
            "identical_to_master": [name for name in same if name in names]
        },
    }


def write(files: dict[str, Any], out: Path) -> None:
    """Write files, and remove others."""
    out.mkdir(exist_ok=True)
    for old in out.iterdir():
        old.unlink()
    for name, value in files.items():
        suffix = "xz" if name in XZ else "gz"
        (out / f"{name}.json.{suffix}").write_bytes(pack(value, name))


def main(folder: Path) -> None:
    """Choose cases, and tell how many and how large they are."""
    files = choose(folder)
    write(files, OUT)
    sources = {name: digest(folder, name) for name in sorted(files)}
    SOURCES.write_text(json.dumps(sources, indent=2) + "\n", encoding="utf-8")
    for path in sorted(OUT.iterdir()):
        count = len(files[path.name.partition(".json")[0]])
        print(f"{path.stat().st_size:8d} bytes, {count:4d} cases  {path.name}")
    print(f"{sum(path.stat().st_size for path in OUT.iterdir()):8d} bytes")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
