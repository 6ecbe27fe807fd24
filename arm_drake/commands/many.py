"""The command `arm-drake many`: a study of many runs, its table and its picture."""

import argparse
import csv
import json
import math
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from arm_drake import interfaces
from arm_drake.batch.api import run_many
from arm_drake.batch.runs import Outcome, RunResults, RunsInterrupted, describe
from arm_drake.batch.statistics import mean_interval, rate_interval
from arm_drake.batch.study import Study, load_study
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, MissingExtraError
from arm_drake.output_files import check_writable, writing

# So many of the worst runs are named.
_MOST_NAMED = 3

# Exit codes.
_WELL, _FAILED = 0, 1

RESULTS, TABLE, PICTURE = "results.runs", "results.csv", "results.png"


def run_study(options: argparse.Namespace) -> int:
    """Run a study as the command line says; return the exit code."""
    study = load_study(options.study)
    values = list(study.values())
    if options.run is not None:
        return _show_run(study, values, options)
    folder = options.output or Path(f"{options.study.stem}_results")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"it can't be made: {error}", file=folder) from None
    how: dict[str, Any] = {
        "keep": study.measures,
        "to": folder / RESULTS,
        "time_limit": study.time_limit,
        "memory_limit": study.memory_limit,
        "progress": False if options.json else None,
    }
    try:
        results = _execute(study, options, how)
    except RunsInterrupted as interrupt:
        text = f"{interrupt}; the same command goes on from {folder / RESULTS}"
        print(f"arm-drake: {text}", file=sys.stderr)
        return 130
    table = _tabulate(results, values, study.measures.names)
    _write(folder / TABLE, table)
    # Not at the top: the runs must not wait for matplotlib.
    from arm_drake.visualization.analysis_plots import plot_study

    plot_study(folder / PICTURE, table, study.measures.names)
    content = _summarize(study, results, table, options)
    if options.json:
        print(json.dumps(content))
    else:
        units = {n: study.measures.unit(n, study.robot) for n in content["measures"]}
        _print(content, folder, units)
    return _FAILED if content["failed"] else _WELL


def _execute(
    study: Study, options: argparse.Namespace, how: Mapping[str, Any]
) -> RunResults[Any]:
    runs, run = study.runs(), run_many
    make: Any = run
    address = options.cluster or study.cluster
    if address is not None:
        try:
            from distributed import Client
        except ImportError:
            raise MissingExtraError("a cluster", "cluster") from None
        try:
            client = Client(address, timeout="10s")
        except (OSError, ValueError) as error:
            text = f"no scheduler of dask answers: {error}"
            raise InputError(text, where=f"cluster {address}") from None
        with client:
            results: RunResults[Any] = make(runs, on=client, **how)
        return results
    limited = study.time_limit is not None or study.memory_limit is not None
    backend = "processes" if limited else "auto"
    workers = options.workers or study.workers
    results = make(runs, workers=workers, backend=backend, **how)
    return results


def _show_run(
    study: Study, values: Sequence[Mapping[str, Any]], options: argparse.Namespace
) -> int:
    """Run one of a study; tell, draw and log what it does."""
    if not 0 <= options.run < len(values):
        raise InputError(f"--run {options.run}: expected 0 to {len(values) - 1}")
    for path in (options.plot, options.log):
        if path is not None:
            check_writable(path)
    run = study.run_of(values[options.run], options.run % study.draws)
    (result,) = run_many(
        [run], keep=lambda sim: (Outcome.of(sim), study.measures(sim)), progress=False
    )
    outcome, measured = result.value
    for name, value in values[options.run].items():
        print(f"{name}: {_text(value, _unit_of_varied(name, study.robot))}")
    for name, value in measured.items():
        print(f"{name}: {_text(value, study.measures.unit(name, study.robot))}")
    rollout = outcome.rollout
    if options.plot is not None:
        rollout.plot(options.plot)
    if options.log is not None:
        rollout.save(options.log)
    for failure in outcome.failures:
        print(f"arm-drake: {failure}", file=sys.stderr)
    return _FAILED if outcome.failures else _WELL


def _unit_of_varied(name: str, robot: Robot) -> str:
    """Return the unit of what a study varies, where there is one for all it can be."""
    kind, _, rest = name.partition(".")
    if kind == "initial":
        return interfaces.unit(interfaces.POSITION, robot.description.joint(rest).type)
    return {"payload": "kg"}.get(kind, "")


def _tabulate(
    results: RunResults[Any],
    values: Sequence[Mapping[str, Any]],
    measures: Sequence[str],
) -> list[dict[str, Any]]:
    """Return a row for each run: what was varied, what was measured, what failed."""
    rows = []
    for result, varied in zip(results, values, strict=True):
        found = {} if result.error is not None else result.value
        row = {"run": result.index, **varied}
        row |= {name: found.get(name, math.nan) for name in ("success", *measures)}
        if result.error is not None:
            row["success"] = 0.0
        row["seconds"] = result.wall_time
        row["error"] = "" if result.error is None else describe(result.error)
        rows.append(row)
    return rows


def _write(path: Path, table: Sequence[Mapping[str, Any]]) -> None:
    with writing(path), path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(table[0]))
        writer.writeheader()
        writer.writerows(table)


def _summarize(
    study: Study,
    results: RunResults[Any],
    table: Sequence[Mapping[str, Any]],
    options: argparse.Namespace,
) -> dict[str, Any]:
    """Return what came of a study as plain data; what is unknown is null."""
    succeeded = [row for row in table if row["success"] == 1.0]
    rate = rate_interval(len(succeeded), len(table))
    measures: dict[str, Any] = {}
    for name in study.measures.names:
        found = {row["run"]: row[name] for row in table if math.isfinite(row[name])}
        if not found:
            measures[name] = None
            continue
        mean = mean_interval(list(found.values()))
        worst = sorted(found, key=found.__getitem__, reverse=True)[:_MOST_NAMED]
        measures[name] = {
            "mean": mean.value,
            "interval": [x if math.isfinite(x) else None for x in mean[1:]],
            "least": min(found.values()),
            "largest": max(found.values()),
            "worst_runs": worst,
            "show": f"arm-drake many {shlex.quote(str(options.study))} "
            f"--run {worst[0]} --plot run.png",
        }
    return {
        "robot": study.robot.name,
        "runs": len(table),
        "failed": len(results.failed),
        "errors": [str(row["error"]) for row in table if row["error"]][:_MOST_NAMED],
        "success": {"rate": rate.value, "interval": list(rate[1:])},
        "measures": measures,
        "wall_time": results.wall_time,
        "where": f"{results.backend}: {results.why}",
    }


def _print(content: Mapping[str, Any], folder: Path, units: Mapping[str, str]) -> None:
    seconds = content["wall_time"]
    print(f"{content['runs']} runs in {seconds:.1f} s; {content['where']}")
    low, high = content["success"]["interval"]
    rate = content["success"]["rate"]
    print(f"success: {rate:.4g} (95 %: {low:.4g} to {high:.4g})")
    for name, found in content["measures"].items():
        if found is None:
            print(f"{name}: no run has it")
            continue
        unit = units[name]
        ends = [_text(x) if x is not None else "?" for x in found["interval"]]
        print(
            f"{name}: {_text(found['mean'], unit)} (95 %: {' to '.join(ends)}), "
            f"from {_text(found['least'])} to {_text(found['largest'], unit)}; "
            f"largest in runs {', '.join(map(str, found['worst_runs']))}: "
            f"{found['show']}"
        )
    for error in content["errors"]:
        print(f"arm-drake: {error}", file=sys.stderr)
    print(f"in {folder}: {RESULTS}, {TABLE}, {PICTURE}")


def _text(value: Any, unit: str = "") -> str:
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return f"{text} {unit}" if unit else text
