"""Time from import to first step, and memory.

Everything runs in processes of its own. Cold means: without our cache of meshes and
without compiled Python; the files themselves are in the system's memory, as in any
second run of anything.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.benchmarks.peers import robots

# Ends with one line of JSON; `start` is when Python had started.
_OURS = """
import time; start = time.perf_counter()
import arm_drake as ad
imported = time.perf_counter()
robot = ad.load_robot({robot!r})
loaded = time.perf_counter()
sim = ad.Simulation(ad.build_diagram(robot))
built = time.perf_counter()
sim.run(0.001)
done = time.perf_counter()
{memory}
print(json.dumps({{
    "import": 1e3 * (imported - start), "load": 1e3 * (loaded - imported),
    "build": 1e3 * (built - loaded), "step": 1e3 * (done - built),
    "total": 1e3 * (done - start), "memory": memory(),
}}))
"""

_MEMORY = """
import json
def memory():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096 / 1e6
"""

_DIAGRAMS = """
import gc
import arm_drake as ad
{memory}
robot = ad.load_robot({robot!r})
def go():
    sim = ad.Simulation(ad.build_diagram(robot))
    sim.run(0.1)
go()
found = []
for _ in range({number} + 1):
    go()
    gc.collect()
    found.append(memory())
print(json.dumps((found[-1] - found[0]) / {number}))
"""

_PEERS = {
    "MuJoCo": """
import mujoco
model = mujoco.MjModel.from_xml_string(text)
data = mujoco.MjData(model)
mujoco.mj_step(model, data)
""",
    "DART": """
import dartpy as dart
loader = dart.utils.DartLoader()
world = dart.simulation.World()
world.addSkeleton(loader.parseSkeletonString(text, dart.common.Uri()))
world.step()
""",
    "PyBullet": """
import pybullet, tempfile
pybullet.connect(pybullet.DIRECT)
with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
    file.write(text)
    file.flush()
    pybullet.loadURDF(file.name, useFixedBase=True)
pybullet.stepSimulation()
""",
    "Pinocchio loop": """
import numpy, pinocchio
model = pinocchio.buildModelFromXML(text)
zero = numpy.zeros(model.nv)
pinocchio.aba(model, model.createData(), zero, zero, zero)
""",
    "Drake alone": """
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
builder = DiagramBuilder()
plant, _ = AddMultibodyPlantSceneGraph(builder, 0.001)
Parser(plant).AddModelsFromString(text, "urdf")
plant.Finalize()
Simulator(builder.Build()).AdvanceTo(0.001)
""",
}

_PEER = """
import time; start = time.perf_counter()
text = {text!r}
{code}
done = time.perf_counter()
{memory}
print(json.dumps({{"total": 1e3 * (done - start), "memory": memory()}}))
"""


def measure_startup(
    runs: int, *, engines: Sequence[str], num_diagrams: int = 10
) -> dict[str, Any]:
    """Return times [ms] and memory [MB]: medians, and all runs.

    Args:
        runs: How often.
        engines: Which peers to start.
        num_diagrams: How many further diagrams to make.
    """
    text = robots.ur5e_like()
    ours = {
        robot: _OURS.format(robot=robot, memory=_MEMORY)
        for robot in ("doosan_a0912", "lab5_arm")
    }
    peers = {
        name: _PEER.format(text=text, code=code, memory=_MEMORY)
        for name, code in _PEERS.items()
        if name in engines or name == "Drake alone"
    }
    with tempfile.TemporaryDirectory() as folder:
        warm = _environment(Path(folder) / "warm")
        rows: dict[str, list[dict[str, float]]] = {}
        for run in range(runs + 1):
            colds = [_environment(Path(folder) / f"{robot}{run}") for robot in ours]
            for (robot, code), cold in zip(ours.items(), colds, strict=True):
                _note(rows, f"{robot}, cold", run, code, cold)
                _note(rows, f"{robot}, warm", run, code, warm)
            for name, code in peers.items():
                _note(rows, f"{name}, ur5e_like", run, code, warm)
            for kind, environment in (
                ("cold", _environment(Path(folder) / f"sim{run}")),
                ("warm", warm),
            ):
                took = _time_command(environment)
                if run:
                    row = rows.setdefault(f"arm-drake sim lab5_arm, {kind}", [])
                    row.append({"total": took})
        growth = _DIAGRAMS.format(
            robot="doosan_a0912", memory=_MEMORY, number=num_diagrams
        )
        more = [_run(growth, warm) for _ in range(min(runs, 3))]
    medians = {
        name: {key: statistics.median(one[key] for one in found) for key in found[0]}
        for name, found in rows.items()
    }
    return {
        "medians": medians,
        "runs": rows,
        "memory per further diagram": statistics.median(more),
    }


def _note(
    rows: dict[str, list[dict[str, float]]],
    name: str,
    run: int,
    code: str,
    environment: Mapping[str, str],
) -> None:
    """Run a program, and keep what it found; the first run warms up."""
    found = _run(code, environment)
    if run:
        rows.setdefault(name, []).append(found)


def _environment(folder: Path) -> dict[str, str]:
    """Return an environment whose caches are in a folder, and are used."""
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return {
        **kept,
        "ARM_DRAKE_CACHE": str(folder / "meshes"),
        "PYTHONPYCACHEPREFIX": str(folder / "pyc"),
    }


def _run(code: str, environment: Mapping[str, str]) -> Any:
    """Return what a program prints last."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.strip().rpartition("\n")[2])


def _time_command(environment: Mapping[str, str]) -> float:
    """Return what the command line takes for a tenth of a second [ms]."""
    arguments = ["sim", "lab5_arm", "--headless", "--duration", "0.1"]
    command = [sys.executable, "-m", "arm_drake", *arguments]
    start = time.perf_counter()
    subprocess.run(command, env=environment, capture_output=True, check=True)
    return 1e3 * (time.perf_counter() - start)
