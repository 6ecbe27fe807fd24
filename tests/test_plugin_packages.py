"""Controller types from packages outside the tree, and as an argument."""

import importlib
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.controllers import CONTROLLER_TYPES
from arm_drake.errors import InputError
from tests import models
from tests.plugin_package import add_package

TYPE = "ramps/Ramp"
JTC = "joint_trajectory_controller/JointTrajectoryController"
JSB = "joint_state_broadcaster/JointStateBroadcaster"
OWN = "load_robot(controller_types=...)"

# What a user writes, with the public names alone.
MODULE = '''
import dataclasses as dc

import numpy as np

import arm_drake as ad


@dc.dataclass(frozen=True)
class RampParameters:
    joint: str
    rate: float = 0.1


class Ramp(ad.TickingController[float]):
    """Moves a joint at a rate; its state is the time [s]."""

    def __init__(self, parameters, params):
        if parameters.rate < 0.0:
            raise ad.ParameterError(f"rate must be at least 0, got {parameters.rate}")
        if parameters.rate > 1.0:
            raise ZeroDivisionError("too fast for me")
        self._rate = parameters.rate
        claims = (f"{parameters.joint}/position",)
        super().__init__(params, 0.0, command_interfaces=claims)
        self._declare_topic("position", lambda state: self._rate * state)

    def _update(self, now, state):
        return now.time_ns * 1e-9

    def _command(self, state):
        return np.array([self._rate * state])


RAMP = ad.ControllerType(RampParameters, Ramp)
NO_SYSTEM = ad.ControllerType(RampParameters, lambda parameters, params: "a ramp")
NO_TYPE = (RampParameters, Ramp)
NO_DATACLASS = ad.ControllerType(dict, Ramp)
'''


def yaml(*, type_: str = TYPE, rate: float = 0.1) -> str:
    return f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    ramp: {{type: {type_}}}
    jsb: {{type: {JSB}}}
ramp:
  ros__parameters: {{joint: swing, rate: {rate}}}
"""


def load(folder: Path, text: str, **options: object) -> ad.Robot:
    return models.load(folder, models.pendulum(), text, **options)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of packages on Python's path, with the module `ramps` in it."""
    folder = tmp_path / "site"
    folder.mkdir()
    (folder / "ramps.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.syspath_prepend(folder)
    yield folder
    for name in ("ramps", "broken"):
        sys.modules.pop(name, None)


@pytest.fixture
def ramps(site: Path) -> ModuleType:
    return importlib.import_module("ramps")


def lines(robot: ad.Robot) -> list[str]:
    """Return the lines of the report, without folders."""
    return [str(entry).replace(f"{entry.file}", "file") for entry in robot.report]


def states(robot: ad.Robot) -> dict[str, str]:
    controllers = ad.Simulation(ad.build_diagram(robot)).list_controllers()
    return {controller.name: controller.state for controller in controllers}


def check_ramp(robot: ad.Robot, rate: float) -> None:
    """Check what the controller commands, and that the joint goes there."""
    simulation = ad.Simulation(ad.build_diagram(robot))

    simulation.advance_to(2.0)

    # The tick at 2 s is that of the next step.
    assert simulation.eval_output("ramp.position") == pytest.approx(1.99 * rate)
    rollout = simulation.rollout()
    # As in hardware that obeys, the joint is in each tick where the last one sent it.
    expected = rate * rollout.time[99:-1]
    np.testing.assert_allclose(rollout.position[100:, 0], expected, atol=1e-4 * rate)


@pytest.mark.slow
def test_an_installed_package_brings_a_type(site: Path, tmp_path: Path) -> None:
    add_package(site, "ramps", {TYPE: "ramps:RAMP"})

    robot = load(tmp_path, yaml(rate=0.3))

    assert lines(robot) == []
    check_ramp(robot, 0.3)


@pytest.mark.slow
def test_so_does_an_argument_for_one_robot(tmp_path: Path, ramps: ModuleType) -> None:
    robot = load(tmp_path, yaml(rate=0.3), controller_types={TYPE: ramps.RAMP})

    assert lines(robot) == []
    assert robot.controller_types == {TYPE: ramps.RAMP}
    check_ramp(robot, 0.3)


def test_an_argument_is_for_one_robot_alone(tmp_path: Path, ramps: ModuleType) -> None:
    before = dict(CONTROLLER_TYPES)
    load(tmp_path, yaml(), controller_types={TYPE: ramps.RAMP})

    other = load(tmp_path, yaml())

    assert lines(other) == [
        f"error: file:5: ramp: unknown controller type '{TYPE}'; the controller does "
        "not run"
    ]
    assert before == CONTROLLER_TYPES


@pytest.mark.slow
def test_two_robots_each_have_their_own_type(tmp_path: Path, ramps: ModuleType) -> None:
    class Slow(ramps.Ramp):  # type: ignore[misc, name-defined]
        def _command(self, state: float) -> np.ndarray:
            return np.array([0.0])

    slow = ad.ControllerType(ramps.RampParameters, Slow)
    robots = [
        load(tmp_path, yaml(), name=name, controller_types={TYPE: row})
        for name, row in (("ramp", ramps.RAMP), ("slow", slow))
    ]

    simulation = ad.Simulation(ad.build_diagram(robots))
    simulation.advance_to(1.0)

    at = [simulation.joint_states(name).position[0] for name in ("ramp", "slow")]
    assert at == pytest.approx([0.1, 0.0], abs=2e-3)


@pytest.mark.parametrize("layout", ["archive", "egg"])
def test_packages_of_other_layouts_are_found_too(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, layout: str
) -> None:
    add_package(tmp_path / "files", "ramps", {TYPE: "ramps:RAMP"})
    if layout == "archive":
        folder = shutil.make_archive(str(tmp_path / "ramps"), "zip", tmp_path / "files")
    else:
        folder = str(tmp_path / "ramps-1.0.egg")
        shutil.copytree(
            tmp_path / "files" / "ramps-1.0.dist-info", f"{folder}/EGG-INFO"
        )
    monkeypatch.syspath_prepend(folder)

    assert lines(load(tmp_path, yaml())) == []


def test_a_package_is_not_imported_for_other_types(site: Path, tmp_path: Path) -> None:
    (site / "broken.py").write_text("raise SystemError", encoding="utf-8")
    add_package(site, "broken", {"broken/Other": "broken:OTHER"})
    add_package(site, "ramps", {TYPE: "ramps:RAMP"})

    robot = load(tmp_path, yaml())

    assert lines(robot) == []
    assert "broken" not in sys.modules


@pytest.mark.slow
@pytest.mark.parametrize(
    ("value", "what"),
    [
        (
            "missing:RAMP",
            "'missing:RAMP' of package 'ramps' can't be imported: "
            "ModuleNotFoundError: No module named 'missing'",
        ),
        (
            "ramps:MISSING",
            "'ramps:MISSING' of package 'ramps' can't be imported: AttributeError: "
            "module 'ramps' has no attribute 'MISSING'",
        ),
        (
            "broken:RAMP",
            "'broken:RAMP' of package 'ramps' can't be imported: RuntimeError: no "
            "licence",
        ),
        (
            "ramps:NO_DATACLASS",
            "package 'ramps': parameters: expected a dataclass, got <class 'dict'>",
        ),
        (
            "ramps:MODULE_NAME",
            "package 'ramps': expected an arm_drake.ControllerType, got 'a text'",
        ),
    ],
)
def test_a_broken_package_is_one_line(
    site: Path, tmp_path: Path, value: str, what: str
) -> None:
    with (site / "ramps.py").open("a", encoding="utf-8") as module:
        module.write("MODULE_NAME = 'a text'\n")
    (site / "broken.py").write_text("raise RuntimeError('no licence')")
    add_package(site, "ramps", {TYPE: value})

    robot = load(tmp_path, yaml())

    assert lines(robot) == [
        f"error: file:5: ramp: controller type '{TYPE}': {what}; the controller does "
        "not run"
    ]
    assert states(robot) == {"ramp": "unconfigured", "jsb": "active"}


@pytest.mark.slow
@pytest.mark.parametrize("is_installed", [True, False])
@pytest.mark.parametrize(
    ("attribute", "rate", "what"),
    [
        ("RAMP", -1.0, "rate must be at least 0, got -1.0"),
        (
            "RAMP",
            2.0,
            f"controller type '{TYPE}' of ORIGIN can't be made: ZeroDivisionError: too "
            "fast for me",
        ),
        (
            "NO_SYSTEM",
            0.1,
            f"controller type '{TYPE}' of ORIGIN can't be made: TypeError: expected a "
            "ControllerInterface, got a str",
        ),
    ],
)
def test_a_type_that_fails_when_it_is_made_is_one_line(
    site: Path,
    tmp_path: Path,
    is_installed: bool,
    attribute: str,
    rate: float,
    what: str,
) -> None:
    types = {}
    if is_installed:
        add_package(site, "ramps", {TYPE: f"ramps:{attribute}"})
    else:
        types[TYPE] = getattr(importlib.import_module("ramps"), attribute)

    robot = load(tmp_path, yaml(rate=rate), controller_types=types)

    what = what.replace("ORIGIN", "package 'ramps'" if is_installed else OWN)
    assert lines(robot) == [f"error: file:5: ramp: {what}; the controller does not run"]
    assert states(robot) == {"ramp": "unconfigured", "jsb": "active"}


def test_an_argument_that_is_no_type_is_refused_at_once(
    tmp_path: Path, ramps: ModuleType
) -> None:
    with pytest.raises(InputError) as caught:
        load(tmp_path, yaml(), controller_types={TYPE: ramps.NO_TYPE})

    assert str(caught.value) == (
        f"controller_types['{TYPE}']: expected an arm_drake.ControllerType, got "
        f"{ramps.NO_TYPE!r}"
    )


@pytest.mark.slow
@pytest.mark.parametrize("is_installed", [True, False])
@pytest.mark.parametrize(
    "type_", [JTC, "ur_controllers/ScaledJointTrajectoryController"]
)
def test_one_that_takes_the_name_of_ours_wins_and_is_reported(
    site: Path, tmp_path: Path, is_installed: bool, type_: str
) -> None:
    types = {}
    if is_installed:
        add_package(site, "ramps", {type_: "ramps:RAMP"})
    else:
        types[type_] = importlib.import_module("ramps").RAMP

    robot = load(tmp_path, yaml(type_=type_, rate=0.2), controller_types=types)

    origin = "package 'ramps'" if is_installed else OWN
    assert lines(robot) == [
        f"info: file:5: ramp: controller type '{type_}' comes from arm_drake too; that "
        f"of {origin} is used"
    ]
    check_ramp(robot, 0.2)


@pytest.mark.slow
def test_of_two_packages_the_first_on_the_path_counts(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_package(tmp_path / "second", "zweite", {TYPE: "missing:RAMP"})
    add_package(site, "ramps", {TYPE: "ramps:RAMP"})
    monkeypatch.syspath_prepend(tmp_path / "second")
    monkeypatch.syspath_prepend(site)

    robot = load(tmp_path, yaml())

    assert lines(robot) == [
        f"info: file:5: ramp: controller type '{TYPE}' comes from package 'zweite' "
        "too; that of package 'ramps' is used"
    ]
    check_ramp(robot, 0.1)


@pytest.mark.slow
def test_an_argument_comes_before_a_package(site: Path, tmp_path: Path) -> None:
    add_package(site, "ramps", {TYPE: "missing:RAMP"})
    ramp = importlib.import_module("ramps").RAMP

    robot = load(tmp_path, yaml(), controller_types={TYPE: ramp})

    assert lines(robot) == []
    check_ramp(robot, 0.1)


def test_a_mistyped_name_is_told_from_those_that_exist(
    site: Path, tmp_path: Path
) -> None:
    add_package(site, "ramps", {TYPE: "ramps:RAMP"})

    (line,) = lines(load(tmp_path, yaml(type_="ramps/Ramb")))

    assert f"unknown controller type 'ramps/Ramb'; did you mean '{TYPE}'?" in line
