"""Mutated inputs, each given to the command line in a child process with limits.

Input 123 of a kind is always the same for a seed, so what is found can be had again:
`python -m tests.fuzz --kind urdf --first 123 --count 1 --keep out/fuzz`.
"""

import argparse
import collections
import contextlib
import faulthandler
import itertools
import math
import os
import re
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Mapping
from multiprocessing import Pool
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import NamedTuple
from unittest import mock

import numpy as np

from tests.fuzz import seeds
from tests.fuzz.mutations import (
    mutate_arrays,
    mutate_bytes,
    mutate_xml,
    mutate_yaml,
    value,
    word,
)
from tests.snippets import ROOT

# What one input may take, beyond what a process with the package takes anyway.
MEMORY = 1 << 30  # [bytes]
CPU_TIME = 10  # [s]

# A child that waits for something is ended after so long [s].
_LONGEST = 60

# Words that show what an input becomes, and as little else as possible.
_SIM = ["--headless", "--duration", "0.03"]

# So much is shown of what a child printed [characters].
_KEPT = 3_000

# Inputs of each kind between two looks at the clock.
_ROUNDS = 5

# A message that nobody would read is none [characters].
_LONGEST_MESSAGE = 100_000

CLASSES = ("ok", "clean error", "traceback", "death", "limit")


class Outcome(NamedTuple):
    """What became of an input."""

    kind: str
    number: int

    # One of CLASSES.
    what: str

    # Where it happened: the same for the same fault.
    where: str

    # What it printed, if it was found.
    output: str = ""


# Writes an input into a folder; returns words for the command line.
Maker = Callable[[Random, Path], list[str]]


def _write(folder: Path, name: str, text: str) -> str:
    path = folder / name
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    return str(path)


def _robot(folder: Path) -> str:
    _write(folder, "part.stl", seeds.STL)
    return _write(folder, "robot.urdf", seeds.URDF)


def _command(rng: Random, words: list[str]) -> list[str]:
    """Return the words of a check, or now and then of a simulation."""
    if rng.random() < 0.7:
        return ["check", *words]
    return ["sim", *words, *_SIM]


def _urdf(rng: Random, folder: Path) -> list[str]:
    _write(folder, "part.stl", seeds.STL)
    _write(folder, "controllers.yaml", seeds.CONTROLLERS)
    robot = _write(folder, "robot.urdf", mutate_xml(rng, seeds.URDF))
    return _command(rng, [robot])


def _xacro(rng: Random, folder: Path) -> list[str]:
    return ["check", _write(folder, "r.urdf.xacro", mutate_xml(rng, seeds.XACRO))]


def _controllers(rng: Random, folder: Path) -> list[str]:
    text = mutate_yaml(rng, seeds.CONTROLLERS)
    words = ["--controllers", _write(folder, "c.yaml", text)]
    return _command(rng, [_robot(folder), *words])


def _bridge(rng: Random, folder: Path) -> list[str]:
    text = mutate_yaml(rng, seeds.BRIDGE)
    words = [_robot(folder), "--controllers", _write(folder, "b.yaml", text)]
    return _command(
        rng, [*words, "--controllers", _write(folder, "c.yaml", seeds.CONTROLLERS)]
    )


def _srdf(rng: Random, folder: Path) -> list[str]:
    package = '<package format="3"><name>p</name><version>1.0.0</version></package>'
    _write(folder, "package.xml", package)
    _write(folder, "robot.srdf", mutate_xml(rng, seeds.SRDF))
    picked = rng.choice(["arm: up", "up", word(rng)])
    return (
        ["graph", _robot(folder), "--json"]
        if picked == ""
        else ["check", _robot(folder)]
    )


def _motion(rng: Random, folder: Path) -> list[str]:
    text = mutate_yaml(rng, seeds.MOTION)
    motion = _write(folder, "motion.yaml", text)
    yaml = _write(folder, "c.yaml", seeds.CONTROLLERS)
    words = ["--controllers", yaml, "--inactive", "group", "--inactive", "pid"]
    return ["sim", _robot(folder), *words, "--motion", motion, *_SIM]


def _world(rng: Random, folder: Path) -> list[str]:
    world = _write(folder, "w.sdf", mutate_xml(rng, seeds.WORLD))
    return ["sim", _robot(folder), "--world", world, *_SIM]


def _mesh(rng: Random, folder: Path) -> list[str]:
    suffix, text = rng.choice(
        [("obj", seeds.OBJ), ("stl", seeds.STL), ("dae", seeds.DAE)]
    )
    if suffix == "dae":
        data = mutate_xml(rng, text).encode(errors="replace")
    else:
        data = mutate_bytes(rng, text.encode())
    (folder / f"part.{suffix}").write_bytes(data)
    text = seeds.URDF.replace("part.stl", f"part.{suffix}")
    if rng.random() < 0.5:
        text = text.replace(
            '<box size="0.1 0.2 0.3"/>', f'<mesh filename="part.{suffix}"/>'
        )
    return ["check", _write(folder, "robot.urdf", text)]


def _log(rng: Random, folder: Path) -> list[str]:
    path = _logs()[rng.choice(["npz", "csv", "mcap"])]
    changed = folder / f"changed{path.suffix}"
    if path.suffix == ".npz" and rng.random() < 0.8:
        with np.load(path) as arrays:
            np.savez(changed, **mutate_arrays(rng, dict(arrays)))
    else:
        changed.write_bytes(mutate_bytes(rng, path.read_bytes()))
    if rng.random() < 0.2:
        return ["replay", str(changed), "--plot", str(folder / "plot.png")]
    return ["compare", *rng.sample([str(changed), str(path)], 2)]


def _words(rng: Random, folder: Path) -> list[str]:
    """Return a command line with words changed, never one that waits for a browser."""
    robot, yaml = _robot(folder), _write(folder, "c.yaml", seeds.CONTROLLERS)
    motion = _write(folder, "motion.yaml", seeds.MOTION)
    options = [
        *(("--motion", motion), ("--set", "angle=0.1"), ("--gravity", "off")),
        *(("--initial", "elbow=0.2"), ("--active", "arm"), ("--rate", "0")),
        *(("--pose", "0", "0", "1", "0", "0", "0"), ("--time-step", "0.002")),
        *(("--log", str(folder / "log.npz")), ("--preset", "fast"), ("--json",)),
        *(("--world", "empty"), ("--name", "two"), ("--var", "a=1"), ("--strict",)),
        *(("--inactive", "pid"), ("--package-path", str(folder)), ("--decompose",)),
    ]
    chosen = [list(option) for option in rng.sample(options, rng.randint(1, 8))]
    for option in rng.sample(chosen, min(len(chosen), rng.choice([1, 1, 2]))):
        # Mostly a value: a name that is none ends all at once.
        at = rng.randrange(len(option)) if rng.random() < 0.3 else len(option) - 1
        name, equals, _ = option[at].partition("=")
        text = word(rng)[:100].replace("\0", "")
        option[at] = f"{name}={text}" if equals and rng.random() < 0.7 else text
    words = [text for option in chosen for text in option]
    # These would open a page, or make its server wait.
    words = [text for text in words if not text.startswith(("--ho", "--por", "--pau"))]
    return ["sim", robot, "--controllers", yaml, *words, *_SIM]


def _page(rng: Random, folder: Path) -> list[str]:
    """Return what a browser says to a page, for `_say`."""
    del folder
    said = ["page"]
    for _ in range(rng.randint(1, 20)):
        kinds = (
            "play step reset rate activate deactivate remote show trail fixed_frame "
            "seek replay end"
        )
        kind = rng.choice([*kinds.split(), word(rng)[:20]])
        names = ["arm", "arm:joint:elbow", "visual", "", word(rng)[:20]]
        said.append(repr((f"{kind}:{rng.choice(names)}", value(rng))))
    return said


KINDS: Mapping[str, Maker] = {
    "urdf": _urdf,
    "xacro": _xacro,
    "controllers": _controllers,
    "bridge": _bridge,
    "srdf": _srdf,
    "motion": _motion,
    "world": _world,
    "mesh": _mesh,
    "log": _log,
    "words": _words,
    "page": _page,
}


class _Logs:
    """Logs of a robot to be mutated; made once."""

    folder: TemporaryDirectory[str] | None = None


def _logs() -> dict[str, Path]:
    assert _Logs.folder is not None
    folder = Path(_Logs.folder.name)
    return {suffix: folder / f"log.{suffix}" for suffix in ("npz", "csv", "mcap")}


def prepare() -> None:
    """Do once what each child would do: imports, and logs."""
    from arm_drake.cli import main

    _Logs.folder = TemporaryDirectory(prefix="arm_drake_fuzz_")
    folder = Path(_Logs.folder.name)
    yaml = _write(folder, "c.yaml", seeds.CONTROLLERS)
    motion = _write(folder, "motion.yaml", seeds.MOTION)
    robot = _robot(folder)
    sources = ["--controllers", yaml, "--inactive", "group", "--inactive", "pid"]
    # With a cache of its own, meshes are converted here, and what that takes imported.
    cache = {"ARM_DRAKE_CACHE": str(folder / "cache")}
    with mock.patch.dict(os.environ, cache), _quiet(folder / "out.txt"):
        for log in _logs().values():
            words = ["sim", robot, *sources, "--motion", motion, "--log", str(log)]
            code = main([*words, *_SIM])
            assert code == 0, (folder / "out.txt").read_text()
        assert main(["compare", *[str(_logs()["npz"])] * 2]) == 0
        main(["replay", str(_logs()["npz"]), "--plot", str(folder / "plot.png")])
        world = _write(folder, "w.sdf", seeds.WORLD)
        main(["sim", robot, "--world", world, *_SIM])
        for suffix, text in (("obj", seeds.OBJ), ("dae", seeds.DAE)):
            _write(folder, f"part.{suffix}", text)
            urdf = seeds.URDF.replace("part.stl", f"part.{suffix}")
            main(["check", _write(folder, "other.urdf", urdf)])
        main(["check", _write(folder, "r.urdf.xacro", seeds.XACRO)])


class _quiet:
    """Sends what is printed, by Drake too, to a file."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> None:
        self._streams = sys.stdout, sys.stderr
        for stream in self._streams:
            stream.flush()
        self._kept = [os.dup(1), os.dup(2)]
        file = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        for number in (1, 2):
            os.dup2(file, number)
        os.close(file)
        # pytest's own don't write where the numbers lead.
        sys.stdout = open(1, "w", closefd=False)
        sys.stderr = open(2, "w", closefd=False)

    def __exit__(self, *error: object) -> None:
        sys.stdout.flush()
        sys.stderr.flush()
        sys.stdout, sys.stderr = self._streams
        for number, kept in zip((1, 2), self._kept, strict=True):
            os.dup2(kept, number)
            os.close(kept)


def run_input(seed: int, kind: str, number: int, keep: Path | None = None) -> Outcome:
    """Make an input, have it read in a child, and return what became of it."""
    with TemporaryDirectory(prefix="arm_drake_fuzz_") as name:
        folder = Path(name) if keep is None else keep / f"{kind}-{seed}-{number}"
        folder.mkdir(parents=True, exist_ok=True)
        rng = Random(f"{seed}/{kind}/{number}")  # noqa: S311  It is to be predicted.
        words = KINDS[kind](rng, folder)
        if keep is not None:
            (folder / "words.txt").write_text("\n".join(words), errors="replace")
        output = folder / "output.txt"
        child = os.fork()
        if child == 0:
            _be_child(words, folder, output)
        _, status = os.waitpid(child, 0)
        text = output.read_text(errors="replace") if output.exists() else ""
        what, where = _judge(status, text)
        kept = "" if what in CLASSES[:2] else text[:_KEPT]
        return Outcome(kind, number, what, where, kept)


def _be_child(words: list[str], folder: Path, output: Path) -> None:
    """Read an input, and end this process with what became of it."""
    code = 70
    try:
        os.chdir(folder)
        # Else a mesh that was read once would not be read again.
        os.environ["ARM_DRAKE_CACHE"] = str(folder / "cache")
        with _quiet(output):
            data = re.search(r"VmData:\s+(\d+)", Path("/proc/self/status").read_text())
            memory = int(data[1]) * 1024 + MEMORY if data else -1
            resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
            resource.setrlimit(resource.RLIMIT_CPU, (CPU_TIME, CPU_TIME + 1))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            faulthandler.disable()  # It would write to pytest's terminal.
            signal.alarm(_LONGEST)
            try:
                code = _say(words[1:]) if words[0] == "page" else _main(words)
            except BaseException:
                traceback.print_exc()
    finally:
        os._exit(code)


def _main(words: list[str]) -> int:
    from arm_drake.cli import main

    try:
        return main(words)
    except SystemExit as stop:  # argparse
        return int(stop.code or 0)


def _say(said: list[str]) -> int:
    """Have a page do what browsers say to it."""
    import arm_drake as ad
    from arm_drake.visualization.page import Page, WidgetEvent
    from arm_drake.visualization.page.live_simulation import LiveSimulation

    folder = Path.cwd()
    yaml = _write(folder, "c.yaml", seeds.CONTROLLERS)
    robot = ad.load_robot(_robot(folder), controllers=[yaml])
    nan, inf = float("nan"), float("inf")
    with Page() as page:
        options = ad.SimulationOptions()
        diagram = ad.build_diagram(robot, options=options, meshcat=page.meshcat)
        live = LiveSimulation(page, ad.Simulation(diagram), is_paused=True)
        for text in said:
            name, what = eval(text, {"nan": nan, "inf": inf})  # noqa: S307
            live.handle([WidgetEvent(name, what)])
        # By the wall clock a rate of 1e-320 takes its time.
        live.pause()
        live.step()
    return 0


def _judge(status: int, text: str) -> tuple[str, str]:
    """Return the class of an end, and where it happened."""
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        name = signal.Signals(number).name
        limits = (signal.SIGXCPU, signal.SIGALRM, signal.SIGKILL)
        return ("limit" if number in limits else "death"), name
    code = os.WEXITSTATUS(status)
    # The folder of a clone may have the package's name, too.
    package = re.escape(str(ROOT))
    frames = re.findall(rf'File "{package}/(arm_drake/[^"]+)", line (\d+)', text)
    is_clean = code == 2 and re.search(r"^arm-drake: ", text, re.MULTILINE)
    if ("MemoryError" in text or "std::bad_alloc" in text) and not is_clean:
        return "limit", f"memory, {':'.join(frames[-1]) if frames else ''}"
    if "Traceback (most recent call last)" in text:
        last = text.strip().splitlines()[-1]
        return "traceback", f"{':'.join(frames[-1]) if frames else ''} {last[:100]}"
    if "Warning: " in text and ".py:" in text:
        line = next(line for line in text.splitlines() if "Warning: " in line)
        return "traceback", line[-140:]
    if code not in (0, 1, 2):
        return "traceback", f"exit code {code}"
    if len(text) > _LONGEST_MESSAGE:
        return "traceback", f"{len(text) // 1000} thousand characters of output"
    if code == 2 and not (is_clean or re.search("^usage: ", text, re.MULTILINE)):
        return "traceback", "exit code 2 without a message"
    return ("ok" if code < 2 else "clean error"), ""


def _run_one(job: tuple[int, str, int, Path | None]) -> Outcome:
    return run_input(*job)


def main() -> int:
    """Run a campaign and print its table; return 1 if something was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, help="how long")
    parser.add_argument("--count", type=int, help="how many inputs of each kind")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", action="append", choices=list(KINDS))
    parser.add_argument("--keep", type=Path, help="folder for all inputs and outputs")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    options = parser.parse_args()
    if options.count is None and options.seconds is None:
        options.seconds = 60.0
    found: list[Outcome] = []
    counts: dict[str, collections.Counter[str]] = collections.defaultdict(
        collections.Counter
    )
    # Also in the background, where a shell has it ignored, its end has a table.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    kinds = options.kind or list(KINDS)
    deadline = math.inf if options.seconds is None else options.seconds
    prepare()
    start = shown = time.monotonic()
    rounds = itertools.count(options.first)
    with Pool(options.workers) as pool, contextlib.suppress(KeyboardInterrupt):
        while time.monotonic() < start + deadline:
            numbers = list(itertools.islice(rounds, _ROUNDS))
            if options.count is not None:
                numbers = [n for n in numbers if n < options.first + options.count]
            if not numbers:
                break
            jobs = itertools.product([options.seed], kinds, numbers, [options.keep])
            for outcome in pool.imap_unordered(_run_one, jobs):
                counts[outcome.kind][outcome.what] += 1
                if outcome.what not in CLASSES[:2]:
                    found.append(outcome)
                    text = f"{outcome.what}: {outcome.kind} {outcome.number}"
                    print(text, outcome.where, file=sys.stderr)
            if time.monotonic() > shown + 10.0:
                shown = time.monotonic()
                total = sum(sum(row.values()) for row in counts.values())
                text = f"{shown - start:.0f} s: {total} inputs, {len(found)} found"
                print(text, file=sys.stderr)
    print(table(counts))
    groups: dict[tuple[str, str], list[Outcome]] = collections.defaultdict(list)
    for outcome in found:
        groups[outcome.what, outcome.where].append(outcome)
    for (what, where), group in sorted(groups.items(), key=lambda item: -len(item[1])):
        one = min(group, key=lambda outcome: outcome.number)
        print(f"\n{what}: {where}: {len(group)} times, such as {one.kind} {one.number}")
        print(one.output)
    return 1 if found else 0


def table(counts: Mapping[str, Mapping[str, int]]) -> str:
    """Return how many inputs of each kind ended how, as Markdown."""
    lines = [f"| kind | {' | '.join(CLASSES)} |", "| --- " * 6 + "|"]
    total: collections.Counter[str] = collections.Counter()
    for kind, row in counts.items():
        total.update(row)
        cells = " | ".join(f"{row.get(what, 0):,}" for what in CLASSES)
        lines.append(f"| {kind} | {cells} |")
    cells = " | ".join(f"{total[what]:,}" for what in CLASSES)
    return "\n".join([*lines, f"| all | {cells} |"])
