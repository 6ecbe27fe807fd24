"""The command `arm-drake analyze`: poles, bandwidths and margins of a robot."""

import argparse
import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from arm_drake.batch.linear_model import LinearModel, Margins
from arm_drake.batch.linearization import linearize
from arm_drake.commands.planning import read_target
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError
from arm_drake.options import SimulationOptions
from arm_drake.output_files import check_plot_path, check_writable

# How far responses may be off within the region that is told, of their height.
_TOLERANCE = 0.05

# So many poles are listed.
_MAX_POLES = 20

# What is nearer to a limit lies on it [rad, m].
_AT_LIMIT = 1e-4

# Exit codes.
_STABLE, _UNSTABLE = 0, 1


def run_analyze(options: argparse.Namespace, robot: Robot) -> int:
    """Linearize a robot as the command line says; return the exit code."""
    if options.plot is not None:
        check_plot_path(options.plot)
        check_writable(options.plot)
    at: Any = None
    if options.at is not None:
        at, _ = read_target(options.at)
        if not isinstance(at, str | dict):
            raise InputError(f"--at {options.at}: expected a state or JOINT=VALUE,...")
    model = linearize(
        robot,
        at,
        options=SimulationOptions(
            preset=options.preset or "accurate",
            time_step=options.time_step,
            friction=not options.no_friction,
            state_delay=options.state_delay,
            command_delay=options.command_delay,
        ),
        region_tolerance=_TOLERANCE,
        progress=_show_progress if sys.stderr.isatty() else None,
    )
    if sys.stderr.isatty():
        sys.stderr.write("\r\033[K")
    if options.plot is not None:
        _plot(options.plot, model)
    if options.json:
        print(json.dumps(to_json(robot, model)))
    else:
        print(to_text(robot, model))
        if options.plot is not None:
            print(f"plot: {options.plot}")
    return _STABLE if model.is_stable else _UNSTABLE


def _show_progress(what: str, done: int, total: int) -> None:
    sys.stderr.write(f"\r\033[K{what}: {done} of {total}")
    sys.stderr.flush()


def to_json(robot: Robot, model: LinearModel) -> dict[str, Any]:
    """Return what is known of a model as plain data; what is infinite is null."""
    joints = {}
    for name in model.joints:
        row: dict[str, Any] = dict(model.margins[name]._asdict())
        row["stiffness"] = model.stiffness(name)
        if name in model.commanded:
            row["bandwidth"] = model.bandwidth(name)
            row["resonance"] = model.resonance(name)
            row["region"] = model.region[name]
        joints[name] = {
            key: value if math.isfinite(value) else None for key, value in row.items()
        }
    poles = [
        {
            "real": pole.s.real,
            "imag": pole.s.imag,
            "natural_frequency": pole.natural_frequency,
            "damping": pole.damping,
            "joint": pole.joint,
        }
        for pole in model.poles
    ]
    return {
        "robot": robot.name,
        "period": model.period,
        "positions": dict(model.positions),
        "at_rest": model.at_rest,
        "stable": model.is_stable,
        "joints": joints,
        "poles": poles,
    }


def to_text(robot: Robot, model: LinearModel) -> str:
    """Return what is known of a model for people."""
    lines = []
    if not model.at_rest:
        lines.append("the joints don't come to rest there: take this with care")
    width = max(map(len, model.joints))
    heads = ("bandwidth", "resonance", "gain margin", "phase margin", "holds up to")
    units = ("[Hz]", "", "[dB]", "[°]", "[rad, m]")
    for head in (heads, units):
        lines.append(f"{'':{width}}  " + "  ".join(f"{text:>12}" for text in head))
    for name in model.joints:
        cells = [math.nan, math.nan, *_margins(model.margins[name]), math.nan]
        if name in model.commanded:
            cells[:2] = model.bandwidth(name) / math.tau, model.resonance(name)
            cells[-1] = model.region[name]
        texts = ["-" if math.isnan(cell) else f"{cell:.4g}" for cell in cells]
        lines.append(f"{name:{width}}  " + "  ".join(f"{text:>12}" for text in texts))
    lines += ["", f"{'pole [1/s]':>22}  {'[rad/s]':>9}  {'damping':>8}  joint"]
    poles = [pole for pole in model.poles if pole.s.imag >= 0.0]
    for pole in poles[:_MAX_POLES]:
        value = f"{pole.s.real:.4g}"
        if pole.s.imag > 0.0:
            value += f" ± {pole.s.imag:.4g}i"
        frequency, damping = f"{pole.natural_frequency:.4g}", f"{pole.damping:.3g}"
        lines.append(f"{value:>22}  {frequency:>9}  {damping:>8}  {pole.joint}")
    if len(poles) > _MAX_POLES:
        lines.append(f"and {len(poles) - _MAX_POLES} faster ones")
    lines += [
        f"{name} rests at its limit: its figures are those of the stop"
        for name in _at_limits(robot, model)
    ]
    verdict = "stable" if model.is_stable else "UNSTABLE"
    sampled = f"sampled at {1.0 / model.period:g} Hz"
    return "\n".join([*lines, f"{robot.title}: {verdict}, {sampled}"])


def _at_limits(robot: Robot, model: LinearModel) -> Iterator[str]:
    """Yield the joints that a limit of their range carries."""
    for joint in robot.description.movable_joints:
        if (position := model.positions.get(joint.name)) is not None:
            lower, upper = joint.limits.lower, joint.limits.upper
            if (lower is not None and position < lower + _AT_LIMIT) or (
                upper is not None and position > upper - _AT_LIMIT
            ):
                yield joint.name


def _margins(margins: Margins) -> tuple[float, float]:
    """Return gain [dB] and phase [°] that a loop bears."""
    return 20.0 * math.log10(margins.gain), math.degrees(margins.phase)


def _plot(path: Path, model: LinearModel) -> None:
    # Not at the top: who draws nothing must not wait for matplotlib.
    from arm_drake.visualization.analysis_plots import plot_bode

    at = model.frequencies()
    kinds = {
        "from command to position": ("command", model.commanded),
        "from effort beside to position [rad/(N·m), m/N]": (
            "disturbance",
            model.joints,
        ),
    }
    plot_bode(
        path,
        at,
        {
            title: {name: model.response(at, name, to=to) for name in names}
            for title, (to, names) in kinds.items()
            if names
        },
    )
