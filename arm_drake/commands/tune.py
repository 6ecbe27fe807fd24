"""The command `arm-drake tune`: gains of a robot's PIDs, before and after."""

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from arm_drake import interfaces
from arm_drake.batch.changes import Pid
from arm_drake.batch.tuning import Response, Tuning, tune_gains
from arm_drake.description.elements import parse_comma_separated
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError
from arm_drake.options import SimulationOptions
from arm_drake.output_files import check_plot_path, check_writable, writing

# Exit codes.
_KEPT, _NOT_KEPT = 0, 1


def run_tune(options: argparse.Namespace, robot: Robot) -> int:
    """Tune a robot as the command line says; return the exit code."""
    if options.plot is not None:
        check_plot_path(options.plot)
    for path in (options.plot, options.output):
        if path is not None:
            check_writable(path)
    found = tune_gains(
        robot,
        options.controller,
        settle=options.settle,
        overshoot=options.overshoot,
        robust_to=dict(map(_read_range, options.payload)),
        joints=options.joint or None,
        moves=options.moves,
        seed=options.seed,
        options=SimulationOptions(time_step=options.time_step),
        progress=False if options.json else None,
    )
    if options.output is not None:
        with writing(options.output):
            options.output.write_text(found.to_text(), encoding="utf-8")
    if options.plot is not None:
        _plot(options.plot, found)
    if options.json:
        print(json.dumps(_to_json(found)))
    else:
        _print(found, options.output)
    return _KEPT if found.keeps_promise else _NOT_KEPT


def _read_range(pair: tuple[str, str]) -> tuple[str, tuple[float, float]]:
    """Return the masses of `--payload LINK=LEAST,LARGEST` [kg]."""
    name, text = pair
    values = parse_comma_separated(text)
    if len(values) not in (1, 2):
        expected = "expected a largest mass [kg], or a least one and a largest: 0,0.25"
        raise InputError(f"--payload {name}={text}: {expected}")
    return name, (values[0] if len(values) == 2 else 0.0, values[-1])


def _to_json(found: Tuning) -> dict[str, Any]:
    def plain(response: Response) -> dict[str, float | None]:
        return {
            name: value if math.isfinite(value) else None
            for name, value in response._asdict().items()
        }

    return {
        "robot": found.robot.name,
        "gains": {
            joint: {n: v for n, v in gains._asdict().items() if math.isfinite(v)}
            for joint, gains in found.gains.items()
        },
        "before": plain(found.before),
        "after": plain(found.after),
        "keeps_promise": found.keeps_promise,
        "rollouts": found.num_rollouts,
    }


def _print(found: Tuning, output: Path | None) -> None:
    width = max(len(pid.joint) for pid in found.pids)
    print(f"{'':{width}}  {'p':>10}  {'i':>10}  {'d':>10}   before: p, i, d")
    for pid in found.pids:
        type_ = found.robot.description.joint(pid.joint).type
        new = "  ".join(f"{x:>10.4g}" for x in found.gains[pid.joint][:3])
        old = ", ".join(f"{x:.4g}" for x in pid.gains[:3])
        print(f"{pid.joint:{width}}  {new}   {old}   [{_units(pid, type_)}]")
    print("the worst of moves in poses and with payloads that were not tuned for:")
    print(f"before: {found.before.describe(found.error_unit)}")
    print(f"after:  {found.after.describe(found.error_unit)}")
    if not found.keeps_promise:
        print(f"not {found.settle:g} s and {100 * found.overshoot:g} % as asked")
    if output is not None:
        print(f"written: {output}")
    else:
        print(found.to_text(), end="")


def _units(pid: Pid, joint_type: str) -> str:
    """Return the units of p, i and d, which make efforts of what is controlled."""
    effort = interfaces.unit(interfaces.EFFORT, joint_type)
    base = interfaces.unit(interfaces.POSITION, joint_type)
    if pid.quantity == interfaces.POSITION:
        return f"{effort}/{base}, {effort}/({base}·s), {effort}·s/{base}"
    return f"{effort}·s/{base}, {effort}/{base}, {effort}·s²/{base}"


def _plot(path: Path, found: Tuning) -> None:
    """Draw a move before and after, a panel for each joint."""
    # Not at the top: without a picture nobody waits for matplotlib.
    from arm_drake.visualization.plot_panels import make_picture

    names = [pid.joint for pid in found.pids]
    picture = make_picture(9.0, 1.2 + 1.2 * len(names))
    panels = picture.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for k, (panel, name) in enumerate(zip(panels, names, strict=True)):
        for trace, label in (
            (found.trace_before, "before"),
            (found.trace_after, "after"),
        ):
            part = trace.moved[:, k] / trace.steps[k]
            panel.plot(trace.time, np.clip(part, -1.0, 3.0), label=label)
        panel.axhline(1.0, color="gray", lw=0.8)
        panel.axvline(found.settle, color="gray", lw=0.8, ls=":")
        panel.set_ylabel(name, fontsize="x-small")
    panels[-1].set_xlabel("time [s]")
    panels[0].legend(fontsize="small")
    panels[0].set_title("moves, of their step", fontsize="medium")
    with writing(path):
        picture.savefig(path)
