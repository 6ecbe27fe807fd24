"""What it costs a simulation that programs outside listen.

Run it with `python -m tests.benchmarks.wire`. Two processes listen to `/joint_states`,
`/tf`, `/clock` and the controller's state of a Doosan. A tick is simulated every 10 ms,
as at real time, with and without them, in turns; times are of that thread.
"""

import statistics
import subprocess
import sys
import time
from collections.abc import Callable

import arm_drake as ad
from arm_drake.wire.server import RosServer

_TOPICS = ("/joint_states", "/tf", "/clock")
_STATE = "/joint_trajectory_controller/controller_state"
_ROUNDS, _TICKS = 5, 200

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


def measure(sim: ad.Simulation) -> list[float]:
    """Return the times that ticks took of the thread [us]."""
    took = []
    for _ in range(_TICKS):
        start, began = time.perf_counter(), time.thread_time()
        sim.advance_to((round(sim.time / sim.period) + 1) * sim.period)
        took.append(1e6 * (time.thread_time() - began))
        time.sleep(max(0.01 - (time.perf_counter() - start), 0.0))
    return took


def main() -> None:
    """Measure, and print medians."""
    sim = ad.Simulation(ad.build_diagram(ad.load_robot("doosan_a0912")))
    server = RosServer(sim, "rosbridge:0").start()
    port = server.addresses[0].rpartition(":")[2]
    exchange = sim.exchange
    assert exchange is not None
    spent: list[float] = []

    def timed(exchange: Callable[[], float] = exchange) -> float:
        began = time.thread_time()
        until = exchange()
        spent.append(1e6 * (time.thread_time() - began))
        return until

    alone, listened, costs = [], [], []
    measure(sim)
    for _ in range(_ROUNDS):
        sim.exchange = None
        alone += measure(sim)
        sim.exchange = timed
        command = [sys.executable, "-c", _LISTENER, port, *_TOPICS, _STATE]
        clients = [subprocess.Popen(command) for _ in range(2)]
        time.sleep(1.0)
        spent.clear()
        listened += measure(sim)
        costs += spent
        for client in clients:
            client.kill()
            client.wait()
        time.sleep(0.2)
    server.stop()
    without, with_two = statistics.median(alone), statistics.median(listened)
    print(f"a tick, nobody listens      {without:8.1f} us")
    print(f"a tick, two clients listen  {with_two:8.1f} us")
    print(f"of it, the exchange         {statistics.median(costs):8.1f} us")


if __name__ == "__main__":
    main()
