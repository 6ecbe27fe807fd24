"""The cost of programs outside that listen to a simulation.

Run it with `python -m tests.benchmarks.wire`. Two processes listen to `/joint_states`,
`/tf`, `/clock` and the controller's state of a Doosan. A few ticks are simulated for
them, then a few for nobody, and so on: what else the machine does meets both alike.
Times are of the thread that simulates; medians, and what a quarter and a tenth of the
ticks took at most, which is nearer to what they take on a machine that does nothing
else. The last lines are of ticks without a pause and without a network.
"""

import math
import subprocess
import sys
import time
from collections.abc import Callable
from random import Random

import arm_drake as ad
from arm_drake.wire.server import RosServer

_TOPICS = ("/joint_states", "/tf", "/clock")
_STATE = "/joint_trajectory_controller/controller_state"
# Rounds, and ticks in a row with and without clients in each of them.
_ROUNDS, _TICKS = 500, 4

_LISTENER = """
import asyncio, json, sys, tornado.websocket
async def main(port, *topics):
    url = f"ws://127.0.0.1:{port}"
    client = await tornado.websocket.websocket_connect(url)
    for topic in topics:
        await client.write_message(json.dumps({"op": "subscribe", "topic": topic}))
    while await client.read_message() is not None:
        pass
asyncio.run(main(*sys.argv[1:]))
"""


def tick(sim: ad.Simulation) -> float:
    """Simulate a tick; return the time that it took of the thread [us]."""
    began = time.thread_time_ns()
    sim.advance_to((round(sim.time / sim.period) + 1) * sim.period)
    return (time.thread_time_ns() - began) / 1e3


def compare(
    sim: ad.Simulation, exchanges: dict[str, Callable[[], float]], pause: float
) -> dict[str, list[float]]:
    """Return what ticks took with each of several exchanges, in turns."""
    took: dict[str, list[float]] = {name: [] for name in exchanges}
    order = Random(0)  # noqa: S311
    for _ in range(_ROUNDS):
        for name in order.sample(list(exchanges), len(exchanges)):
            sim.exchange = exchanges[name]
            # The first one of them finds the other's traces in all caches.
            tick(sim)
            for _ in range(_TICKS - 1):
                took[name].append(tick(sim))
                time.sleep(pause)
    return took


def report(title: str, took: dict[str, list[float]]) -> None:
    """Print what more it takes than with the first of the exchanges."""
    print(f"{title:36}{'tenth':>10}{'quarter':>10}{'median':>10}   [us]")
    first: list[float] = []
    for name, times in took.items():
        times.sort()
        values = [times[len(times) // part] for part in (10, 4, 2)]
        print(f"  {name:34}" + "".join(f"{value:10.1f}" for value in values))
        if first:
            more = [b - a for a, b in zip(first, values, strict=True)]
            print(f"  {'  more':34}" + "".join(f"{value:+10.1f}" for value in more))
        first = first or values


def main() -> None:
    """Measure, and print."""
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912")))
    server = RosServer(sim, "rosbridge:0").start()
    port = server.addresses[0].rpartition(":")[2]
    exchange = sim.exchange
    assert exchange is not None
    command = [sys.executable, "-c", _LISTENER, port, *_TOPICS, _STATE]
    clients = [subprocess.Popen(command) for _ in range(2)]
    time.sleep(2.0)
    exchanges = {"nothing is exchanged": lambda: math.inf, "two clients": exchange}
    report("every 10 ms", compare(sim, exchanges, 0.01))
    for client in clients:
        client.kill()
        client.wait()
    server.stop()
    alone = RosServer(sim, ())
    watched = [alone.graph.topics[name] for name in (*_TOPICS, _STATE)]

    def read() -> float:
        alone.graph.update(watched, sim.time)
        for topic in watched:
            topic.waiting.clear()
        return math.inf

    exchanges = {"nothing is exchanged": lambda: math.inf, "four topics are read": read}
    report("without a pause", compare(sim, exchanges, 0.0))


if __name__ == "__main__":
    main()
