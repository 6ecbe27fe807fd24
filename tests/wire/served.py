"""A simulation that is served in a process of its own, and clients of other people."""

import contextlib
import json
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import arm_drake as ad
from arm_drake.simulation.simulation import Simulation
from arm_drake.wire.server import RosServer, run
from tests.robots import skip_or_fail

DOOSAN_JOINTS = [f"joint{index}" for index in range(1, 7)]
JTC = "/joint_trajectory_controller"


def simulation(robot: str = "doosan_a0912", **options: Any) -> Simulation:
    return ad.Simulation(ad.build_diagram(ad.load_robot(robot), **options))


def port_of(server: RosServer, transport: str = "rosbridge") -> int:
    [line] = [line for line in server.addresses if line.startswith(f"{transport}: ")]
    return int(line.rpartition(":")[2].split()[0])


@contextlib.contextmanager
def served(
    sim: Simulation, transports: str = "rosbridge:0", *, rate: float = 1.0, **more: Any
) -> Iterator[RosServer]:
    """Serve a simulation that goes on in a thread until the block is left."""
    server = RosServer(sim, transports, **more).start()
    errors: list[BaseException] = []

    def simulate() -> None:
        try:
            run(server, 1e6, realtime_rate=rate)
        except StopServing:
            pass
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=simulate)
    thread.start()
    try:
        yield server
    finally:
        server.stop()
        sim.exchange = _end
        thread.join(timeout=20.0)
        sim.exchange = None
    assert not thread.is_alive()
    assert not errors, errors


class StopServing(Exception):
    """The test is over."""


def _end() -> float:
    raise StopServing


def wait_for(condition: Callable[[], Any], timeout: float = 20.0) -> Any:
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.005)
    pytest.fail("it did not happen in time")


CLIENTS = Path(__file__).with_name("clients")


def run_client(script: str, *arguments: object, timeout: float = 60.0) -> Any:
    """Run a program of a foreign client; return what it prints as JSON."""
    return _run([sys.executable, str(CLIENTS / script)], arguments, timeout)


def run_node(script: str, *arguments: object, timeout: float = 60.0) -> Any:
    """Run a program of a client from npm; return what it prints as JSON."""
    if shutil.which("node") is None:
        skip_or_fail("there is no node")
    if not Path(__file__).with_name("node_modules").is_dir():
        skip_or_fail("npm ci was not run in tests/wire")
    return _run(["node", str(CLIENTS / script)], arguments, timeout)


def run_zenoh_peer(script: str, *arguments: object, timeout: float = 60.0) -> Any:
    """Run a program of zenoh-ros2-sdk, which has an environment of its own."""
    peer = Path(__file__).parents[2] / "out" / "zenoh_peer" / "bin" / "python"
    if not peer.is_file():
        skip_or_fail("there is no environment out/zenoh_peer with zenoh-ros2-sdk")
    return _run([str(peer), str(CLIENTS / script)], arguments, timeout)


def _run(command: list[str], arguments: tuple[object, ...], timeout: float) -> Any:
    # Nothing here may need the net.
    nowhere = {"HTTPS_PROXY": "http://127.0.0.1:9", "HTTP_PROXY": "http://127.0.0.1:9"}
    done = subprocess.run(
        [*command, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
        env={**os.environ, **nowhere},
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])
