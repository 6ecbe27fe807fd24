"""The options `--ros` and `--inputs`: programs outside that talk to a simulation."""

import argparse
import importlib.util
import sys
from collections.abc import Iterable
from pathlib import Path

from arm_drake.commands.output import Speaker, history_of
from arm_drake.errors import InputError
from arm_drake.rollout.rollout import ClientInput, Rollout
from arm_drake.simulation.motion import Motion, default_duration
from arm_drake.simulation.simulation import Simulation
from arm_drake.visualization.page.live_simulation import LiveSimulation
from arm_drake.wire.server import LOOPBACK, RosServer, run

# Longer than anybody waits [s].
_ENDLESS = 1e8


def serve(
    options: argparse.Namespace,
    simulation: Simulation,
    say: Speaker,
    live: LiveSimulation | None = None,
) -> RosServer:
    """Return what lets others in, and say where."""
    inputs, host = _read_inputs(options.inputs), options.ros_host or "127.0.0.1"
    server = RosServer(
        simulation,
        () if options.ros is None else options.ros or default_transports(),
        host=host,
        domain=options.ros_domain or 0,
        origins=options.ros_origin,
        controls=live,
        keep_clock=not options.ros_reset_clock,
        # A page keeps its own history.
        history=None if live is not None else history_of(options),
        inputs=inputs,
    ).start()
    if options.ros is not None and host not in LOOPBACK:
        text = "whoever reaches this machine can move the robot"
        print(f"warning: --ros-host {host}: {text}", file=sys.stderr)
    for line in server.addresses:
        say.page(line)
    for name in server.graph.left_out:
        text = "no message of ROS can tell it; it is left out"
        print(f"warning: topic {name!r}: {text}", file=sys.stderr)
    return server


def default_transports() -> str:
    """Return the transports of a plain `--ros`."""
    has_foxglove = importlib.util.find_spec("foxglove") is not None
    return "rosbridge,foxglove" if has_foxglove else "rosbridge"


def _read_inputs(path: Path | None) -> Iterable[ClientInput]:
    if path is None:
        return ()
    inputs = Rollout.load(path).inputs
    if not inputs:
        text = "no program outside sent anything in this run; expected a log of --ros"
        raise InputError(text, file=path)
    return inputs


def _length(rollout: Rollout, motion: Motion | None) -> float:
    """Return how long a run was [s], with what came in last."""
    ends = [float(rollout.time[-1]), *(each.time for each in rollout.inputs)]
    if motion is not None and not motion.tasks:
        ends.append(default_duration(motion))
    return max(ends)


def run_served(
    options: argparse.Namespace,
    server: RosServer,
    duration: float | None,
    motion: Motion | None,
    say: Speaker,
) -> None:
    """Simulate as the command line says, until Ctrl-C if it says no end."""
    if options.ros is not None:
        rate = 1.0 if options.rate is None else options.rate
    else:
        rate = options.rate or 0.0
    if duration is None:
        say.line("simulating until Ctrl-C")
    elif options.ros is None and options.duration is None:
        # As long as the run was.
        duration = _length(Rollout.load(options.inputs), motion)
        duration += server.simulation.period
    run(
        server,
        _ENDLESS if duration is None else duration,
        motion=motion,
        realtime_rate=rate,
        progress=say.progress,
    )
