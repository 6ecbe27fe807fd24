"""Study files: what is varied over many runs of a robot, and what is measured.

    robot: mycobot_280
    motion: ping_pong
    duration: 3.0
    vary:
      payload.link6: {uniform: [0.0, 0.25]}
      scale.friction: {normal: [1.0, 0.1]}
      gains.link1_to_link2.p: {values: [5, 10, 20]}
    draws: 20
    seed: 1
    measures: [peak_effort, end_speed]

`values` and `linspace` make a grid; each point of it has as many random draws, the same
ones. `schemas/study.schema.json` describes the file for editors.
"""

import dataclasses as dc
import functools
import importlib.util
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import cloudpickle
import numpy as np
import yaml

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.batch.changes import change_robot
from arm_drake.batch.runs import Run
from arm_drake.description.robot import Robot
from arm_drake.errors import ArmDrakeError, InputError, suggest
from arm_drake.hardware.noise_and_delay import check_noise
from arm_drake.importing import dataclass
from arm_drake.interfaces import unit_of_all
from arm_drake.manager.hardware_interfaces import find_hardware_interfaces
from arm_drake.options import SimulationOptions
from arm_drake.plant.payloads import check_link, read_payload
from arm_drake.rollout.rollout import Rollout
from arm_drake.scene import (
    Value,
    at_place,
    read_file,
    read_options,
    read_robot,
    read_world,
)
from arm_drake.simulation.recording import list_failures, list_unfinished
from arm_drake.simulation.simulation import Simulation
from arm_drake.worlds.world import load_world

_KEYS = (
    "robot",
    "motion",
    "motion_parameters",
    "world",
    "duration",
    "options",
    "vary",
    "draws",
    "seed",
    "measures",
    "where",
    "limits",
)

# Random draws, by the names of numpy's Generator, and how many numbers each takes.
DISTRIBUTIONS = {
    "uniform": 2,
    "normal": 2,
    "lognormal": 2,
    "triangular": 3,
    "exponential": 1,
    "truncated_normal": 4,
    "choice": 0,
}
GRIDS = ("values", "linspace")

# What may be varied, by the start of its name.
VARIED = (
    "payload",
    "initial",
    "motion",
    "options",
    "noise",
    "scale",
    "gains",
    "controller",
)

_MOST_RUNS = 10_000_000


@dataclass(frozen=True, eq=False)
class Study:
    """Study returned by `load_study`: its runs are for `run_many`."""

    robot: Robot
    motion: Any = None
    world: str = "empty"
    duration: float | None = None
    options: SimulationOptions = dc.field(default_factory=SimulationOptions)
    payloads: Mapping[str, Any] = dc.field(default_factory=dict)

    # By name: a kind of DISTRIBUTIONS or GRIDS, and its numbers.
    vary: Mapping[str, tuple[str, tuple[Any, ...]]] = dc.field(default_factory=dict)

    # Random draws at each point of the grid, and what they come from.
    draws: int = 1
    seed: int = 0

    measures: "Measures" = dc.field(default_factory=lambda: Measures(()))

    # Address of dask's scheduler, or None; and how many runs at a time here.
    cluster: str | None = None
    workers: int | None = None

    # Of each run [s], [bytes].
    time_limit: float | None = None
    memory_limit: int | None = None

    file: Path | None = None

    @property
    def num_runs(self) -> int:
        """Number of runs."""
        sizes = [len(_points(*how)) for how in self.vary.values() if how[0] in GRIDS]
        return math.prod(sizes) * self.draws

    def values(self) -> Iterator[dict[str, Any]]:
        """Yield what is varied in each run, by name."""
        grid = {
            name: _points(*how) for name, how in self.vary.items() if how[0] in GRIDS
        }
        for point in itertools.product(*grid.values()):
            for draw in range(self.draws):
                generator = np.random.default_rng([self.seed, draw])
                random = {
                    name: draw_from(generator, *how)
                    for name, how in self.vary.items()
                    if how[0] not in GRIDS
                }
                found = dict(zip(grid, point, strict=True)) | random
                yield {name: found[name] for name in self.vary}

    def runs(self) -> list[Run]:
        """Return all runs, in the order of `values`."""
        return [
            self.run_of(values, index % self.draws)
            for index, values in enumerate(self.values())
        ]

    def run_of(self, values: Mapping[str, Any], draw: int = 0) -> Run:
        """Return the run in which these are varied; its noise is that of its draw."""
        changes, parts = {}, dict[str, dict[str, Any]]()
        for name, value in values.items():
            kind, _, rest = name.partition(".")
            if kind in ("initial", "scale", "gains", "controller"):
                changes[name] = value
            else:
                parts.setdefault(kind, {})[rest] = value
        chosen = parts.get("options", {})
        noise = {**self.options.state_noise, **parts.get("noise", {})}
        if noise and "seed" not in chosen:
            chosen["seed"] = self.options.seed + draw
        options = dc.replace(self.options, **chosen, state_noise=noise)
        varied, motion = parts.get("motion", {}), self.motion
        parameters: dict[str, Any] = {}
        if motion is not None and varied:
            if motion.file is None:
                raise InputError("motion: expected a file, whose parameters vary")
            parameters, motion = {**motion.parameters, **varied}, motion.file
        return Run(
            robot=self.robot,
            motion=motion,
            parameters=parameters,
            duration=self.duration,
            world=self.world,
            options=options,
            payloads={**self.payloads, **parts.get("payload", {})} or None,
            changes=changes,
            name=", ".join(f"{n}={_brief(v)}" for n, v in values.items()),
        )


def _brief(value: Any) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _points(kind: str, numbers: tuple[Any, ...]) -> list[Any]:
    if kind == "values":
        return list(numbers)
    low, high, count = numbers
    return [float(x) for x in np.linspace(low, high, int(count))]


def draw_from(generator: np.random.Generator, kind: str, numbers: Sequence[Any]) -> Any:
    """Return a draw of a distribution of DISTRIBUTIONS."""
    if kind == "choice":
        return numbers[int(generator.integers(len(numbers)))]
    if kind == "truncated_normal":
        from scipy.stats import truncnorm

        mean, width, low, high = numbers
        ends = (low - mean) / width, (high - mean) / width
        return float(truncnorm.rvs(*ends, mean, width, random_state=generator))
    return float(getattr(generator, kind)(*numbers))


def load_study(path: str | Path) -> Study:
    """Load a study file, with its robot and its motion.

    Args:
        path: The `.yaml` file.

    Raises:
        InputError: If it can't be used: with the file, the line and the place in it.
    """
    return read_file(path, _read_study, "a robot")


def _read_study(root: Value) -> Study:
    fields = root.mapping(_KEYS)
    if "robot" not in fields:
        raise root.error("expected robot: a name, a file, or a mapping as in scenes")
    loaded = read_robot(_robot_value(root, fields))
    vary = _read_vary(fields["vary"]) if "vary" in fields else {}
    options: dict[str, Any] = {
        "robot": loaded.robot,
        "motion": loaded.motion,
        "payloads": loaded.payloads,
        "vary": vary,
        "file": root.file,
    }
    for key, read in _READERS.items():
        if key in fields:
            options[key] = read(fields[key])
    if "where" in fields:
        options |= _read_where(fields["where"])
    if "limits" in fields:
        limits = fields["limits"].mapping(("time", "memory"))
        for key, each in limits.items():
            options[f"{key}_limit"] = each.number(0.0, is_open=True)
    study = Study(**options)
    _check(study, fields)
    return study


def _robot_value(root: Value, fields: Mapping[str, Value]) -> Value:
    """Return a robot with its motion, as scenes have it."""
    value = fields["robot"]
    entries = []
    if isinstance(value.node, yaml.MappingNode):
        entries += value.node.value
    else:
        entries.append((_key("robot", value), value.node))
    own = [getattr(key, "value", None) for key, _ in entries]
    for name in ("motion", "motion_parameters"):
        if name in fields:
            if name in own:
                raise fields[name].error("robot has one, too; expected one of them")
            entries.append((_key(name, fields[name]), fields[name].node))
    node = yaml.MappingNode("tag:yaml.org,2002:map", entries)
    node.start_mark, node.end_mark = value.node.start_mark, value.node.end_mark
    return Value(root.file, node, "robot")


def _key(name: str, value: Value) -> Any:
    marks = value.node.start_mark, value.node.end_mark
    return yaml.ScalarNode("tag:yaml.org,2002:str", name, *marks)


def _count(value: Value, least: float = 1.0) -> int:
    number = value.number(least)
    if number != int(number):
        raise value.error(f"expected an integer, got {number:g}")
    return int(number)


def _read_measures(value: Value) -> "Measures":
    found: list[tuple[str, str | bytes]] = []
    for each in value.list():
        name = each.text()
        file, colon, function = name.rpartition(":")
        if colon:
            found.append((function, _load_measure(each, file, function)))
        elif name in MEASURES:
            found.append((name, name))
        else:
            names = (*MEASURES, "FILE.py:FUNCTION")
            raise each.error(f"unknown measure {name!r}; {suggest(name, names)}")
    return Measures(tuple(found))


def _load_measure(value: Value, file: str, name: str) -> bytes:
    """Return a function of a file as bytes, with its code."""
    path = value.file.absolute().parent / file
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise value.error(f"no Python file {file!r}")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # Whatever a user's file raises.
        kind = type(error).__name__
        raise value.error(f"{file} can't be run: {kind}: {error}") from None
    function = getattr(module, name, None)
    if not callable(function):
        raise value.error(f"{file} has no function {name!r}")
    function.__module__ = "__main__"  # So its code is sent, not its name.
    return bytes(cloudpickle.dumps(function))


_READERS: Mapping[str, Callable[[Value], Any]] = {
    "world": read_world,
    "duration": lambda value: value.number(0.0, is_open=True),
    "options": read_options,
    "draws": _count,
    "seed": functools.partial(_count, least=0.0),
    "measures": _read_measures,
}


def _read_where(value: Value) -> dict[str, Any]:
    fields = value.mapping(("cluster", "workers"))
    if len(fields) != 1:
        raise value.error("expected cluster: an address, or workers: a number")
    if "cluster" in fields:
        return {"cluster": fields["cluster"].text()}
    return {"workers": _count(fields["workers"])}


def _read_vary(value: Value) -> dict[str, tuple[str, tuple[Any, ...]]]:
    found = {}
    for name, each in value.mapping().items():
        if name.partition(".")[0] not in VARIED:
            raise each.error(f"{name!r} can't be varied; {suggest(name, VARIED)}")
        kinds = each.mapping((*DISTRIBUTIONS, *GRIDS))
        if len(kinds) != 1:
            names = ", ".join((*GRIDS, *DISTRIBUTIONS))
            raise each.error(f"expected one of {names}, got {len(kinds)}")
        ((kind, numbers),) = kinds.items()
        found[name] = kind, _read_numbers(kind, numbers)
    return found


def _read_numbers(kind: str, value: Value) -> tuple[Any, ...]:
    if kind in ("values", "choice"):
        items = value.list()
        if not items:
            raise value.error("expected one value at least")
        return tuple(each.plain() for each in items)
    if kind == "linspace":
        numbers = value.numbers(3)
        if numbers[2] < 1 or numbers[2] != int(numbers[2]):
            raise value.error(f"expected [low, high, count], got {list(numbers)}")
        return numbers
    numbers = value.numbers(DISTRIBUTIONS[kind])
    try:
        drawn = draw_from(np.random.default_rng(0), kind, numbers)
    except ValueError as error:
        raise value.error(f"{kind}: {error}") from None
    if not math.isfinite(drawn):
        raise value.error(f"{kind}: expected numbers that draw finite ones")
    return numbers


def _check(study: Study, fields: Mapping[str, Value]) -> None:
    """Raise InputError for what a run can't be changed to.

    Each value is tried alone; of a distribution its first draw, of a row its ends.
    """
    where = fields.get("vary", fields.get("draws", fields["robot"]))
    if study.num_runs > _MOST_RUNS:
        text = f"it has {study.num_runs} runs; expected at most {_MOST_RUNS}"
        raise where.error(text)
    robot, first = study.robot, next(study.values())
    if "world" in fields:
        paths = robot.package_paths
        at_place(fields["world"], lambda: load_world(study.world, paths))
    for name, how in study.vary.items():
        place = fields["vary"].mapping()[name]
        _check_name(study, name, place)
        ((_, numbers),) = place.mapping().items()
        match how[0]:
            case "values" | "choice":
                tried = list(zip(numbers.list(), how[1], strict=True))
            case "linspace":
                points = _points(*how)
                tried = [(place, points[0]), (place, points[-1])]
            case _:
                tried = [(place, first[name])]
        kind, _, rest = name.partition(".")
        for at, value in tried:
            try:
                if kind in ("controller", "gains", "initial", "scale"):
                    change_robot(robot, {name: value})
                elif kind == "payload":
                    read_payload(rest, value)
                else:
                    study.run_of({name: value})
            except (ArmDrakeError, TypeError) as error:
                raise at.error(str(error)) from None


def _check_name(study: Study, name: str, place: Value) -> None:
    """Raise InputError if the robot has nothing of a name that could vary."""
    kind, _, rest = name.partition(".")
    robot, known = study.robot, study.robot.initial_positions
    if kind == "payload":
        links = robot.description.links
        at_place(place, functools.partial(check_link, rest, links))
    if kind == "initial" and rest not in known:
        raise place.error(f"no joint {rest!r}; {suggest(rest, known)}")
    if kind == "noise":
        offered = find_hardware_interfaces(
            robot.description, known, sensors=robot.sensors
        )
        at_place(place, functools.partial(check_noise, {rest: 0.0}, [offered]))
    if kind == "motion" and study.motion is None:
        raise place.error("there is no motion whose parameters could vary")


def _travel(rollout: Rollout) -> Array:
    """Return how far joints are from where they end, over their way, shape (N, J)."""
    off = np.abs(rollout.position - rollout.position[-1])
    way = np.maximum(off.max(axis=0), 1e-9)
    return np.asarray(np.where(way > 1e-6, off / way, 0.0))


def _settling_time(rollout: Rollout) -> float:
    late = np.flatnonzero((_travel(rollout) > 0.05).any(axis=1))
    return float(rollout.time[late[-1]]) if late.size else 0.0


def _errors(rollout: Rollout) -> Array:
    """Return how far joints are from their references, of all controllers."""
    parts = []
    for reference in rollout.references.values():
        at_ = [rollout.joint_names.index(name) for name in reference.joint_names]
        parts.append(np.abs(reference.position - rollout.position[:, at_]))
    if not parts:
        raise InputError("no controller has a reference")
    return np.nan_to_num(np.hstack(parts))


def _energy(rollout: Rollout) -> float:
    power = np.abs(rollout.effort * rollout.velocity).sum(axis=1)
    return float(np.trapezoid(power, rollout.time))


# Measures of a robot's rollout, by name; SI units.
MEASURES: Mapping[str, Callable[[Rollout], float]] = {
    "end_error": lambda r: float(_errors(r)[-1].max()),
    "tracking_error": lambda r: float(_errors(r).max()),
    "end_speed": lambda r: float(np.abs(r.velocity[-1]).max()),
    "peak_speed": lambda r: float(np.abs(r.velocity).max()),
    "peak_effort": lambda r: float(np.abs(r.effort).max()),
    "settling_time": _settling_time,
    "energy": _energy,
}

# Their units, by the interface that they are of, and those of others.
_INTERFACES = {
    "end_error": interfaces.POSITION,
    "tracking_error": interfaces.POSITION,
    "end_speed": interfaces.VELOCITY,
    "peak_speed": interfaces.VELOCITY,
    "peak_effort": interfaces.EFFORT,
}
_UNITS = {"settling_time": "s", "energy": "J"}


class Measures:
    """Takes the measures of a simulation that has run, and whether all went well."""

    # The simulation may be used for the next run.
    only_reads = True

    def __init__(self, measures: Sequence[tuple[str, str | bytes]]) -> None:
        """Create it with names, and for each a name of MEASURES or a function."""
        self._measures = tuple(measures)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the measures."""
        return tuple(name for name, _ in self._measures)

    def unit(self, name: str, robot: Robot) -> str:
        """Return the unit of a measure of a robot; "" of a function of the user's."""
        if (name, name) not in self._measures:
            return ""
        types = [joint.type for joint in robot.description.movable_joints]
        interface = _INTERFACES.get(name)
        return _UNITS[name] if interface is None else unit_of_all(interface, types)

    def __call__(self, simulation: Simulation) -> dict[str, float]:
        """Return numbers by name; `success` is 1 if all goals ended well, else 0."""
        mailbox = simulation.mailbox
        failed = list_failures(mailbox) + list_unfinished(mailbox)
        found = {"success": float(not failed)}
        for name, how in self._measures:
            try:
                if isinstance(how, bytes):
                    value = cloudpickle.loads(how)(simulation)
                else:
                    value = MEASURES[how](simulation.rollout())
                found[name] = float(value)
            except Exception as error:
                text = f"measure {name!r}: {type(error).__name__}: {error}"
                raise InputError(text) from None
        return found
