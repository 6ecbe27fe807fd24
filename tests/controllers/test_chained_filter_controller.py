import dataclasses as dc
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake import interfaces
from arm_drake.controllers.chained_filter_controller import (
    ChainedFilter,
    ChainedFilterParameters,
    InputFilters,
)
from arm_drake.controllers.controller_interface import (
    ControllerInterfaceParams,
    TickingController,
)
from arm_drake.controllers.cycles import UpdateContext
from arm_drake.description.report import LoadReport
from arm_drake.errors import ParameterError
from arm_drake.messages import Float64MultiArray
from tests import models
from tests.controllers.driving import NAME, Driven, make_params
from tests.controllers.parameters import FILTER, load

JOINTS = ("wheel_left", "wheel_right")
INPUTS = ("wheel_left/position", "wheel_right/position")
OUTPUTS = ("wheel_left/filtered_position", "wheel_right/filtered_position")


def mean(n: int) -> dict[str, Any]:
    """Return the parameters of a chain of one mean filter."""
    return {
        "filter1.name": "mean",
        "filter1.type": "filters/MeanFilterDouble",
        "filter1.params.number_of_observations": n,
    }


def drive(
    num_inputs: int = 1,
    filter_chain: dict[str, Any] | None = None,
    own: dict[str, dict[str, Any]] | None = None,
) -> Driven:
    parameters = ChainedFilterParameters(
        INPUTS[:num_inputs],
        OUTPUTS[:num_inputs],
        filter_chain or {},
        {name: InputFilters((own or {}).get(name, {})) for name in INPUTS},
    )
    return Driven(ChainedFilter(parameters, make_params(JOINTS)))


def step(driven: Driven, *positions: float, activation: int | None = 1) -> list[float]:
    """Run a cycle with these positions; return what is exported."""
    driven.measure(positions)
    driven.run(activation=activation)
    exported: list[float] = driven.output(interfaces.EXPORT_PORT).tolist()
    return exported


def test_a_mean_of_two_is_exported() -> None:  # CF1
    driven = drive(1, mean(2))

    outputs = [step(driven, position)[0] for position in (1.1, 2.0, 2.0)]

    assert outputs == [1.1, 1.55, 2.0]


def test_outputs_have_the_name_of_the_controller_in_front() -> None:  # CF2
    system = drive(2).system

    assert system.exported_interfaces == tuple(f"{NAME}/{name}" for name in OUTPUTS)
    assert system.state_interfaces == INPUTS
    assert system.command_interfaces == ()


def test_nothing_is_exported_before_the_first_tick() -> None:
    driven = drive(1, mean(2))

    assert np.isnan(driven.output(interfaces.EXPORT_PORT)).all()


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_an_input_that_is_not_finite_leaves_the_output(bad: float) -> None:  # CF5
    driven = drive(2, mean(2))

    first = step(driven, bad, 1.0)
    second = step(driven, 1.1, 3.0)
    third = step(driven, bad, 5.0)
    fourth = step(driven, 2.0, bad)

    assert first == pytest.approx([math.nan, 1.0], nan_ok=True)
    assert (second, third) == ([1.1, 2.0], [1.1, 4.0])
    # The filter hasn't seen what isn't finite.
    assert fourth == [1.55, 4.0]


def test_one_chain_filters_each_input_for_itself() -> None:
    driven = drive(2, mean(2), {INPUTS[0]: mean(9)})

    outputs = [step(driven, *q) for q in ((1.1, 2.2), (2.0, 3.0), (2.0, 3.0))]

    # Upstream's numbers, which are exact there, too.
    assert outputs == [[1.1, 2.2], [1.55, 2.6], [2.0, 3.0]]


def test_inputs_have_filters_of_their_own() -> None:
    driven = drive(2, own={INPUTS[0]: mean(2), INPUTS[1]: mean(3)})

    positions = ((1.1, 2.2), (2.0, 2.8), (2.0, 2.8), (2.0, 2.8))
    outputs = [step(driven, *q) for q in positions]

    # Upstream's numbers; the last of them to 1e-5 there, too.
    assert outputs[:3] == [[1.1, 2.2], [1.55, 2.5], [2.0, 2.6]]
    assert outputs[3] == pytest.approx([2.0, 2.8], abs=1e-5)


def test_without_filters_inputs_are_passed_on() -> None:
    assert step(drive(2), 0.3, -0.7) == [0.3, -0.7]


def test_an_activation_forgets_outputs_but_not_what_filters_remember() -> None:
    driven = drive(1, mean(2))
    step(driven, 1.0)

    inactive = step(driven, 9.0, activation=None)
    nothing = step(driven, math.nan, activation=2)
    again = step(driven, 2.0, activation=2)

    assert inactive == [1.0]
    assert np.isnan(nothing).all()
    assert again == [1.5]


def test_a_filter_that_can_not_be_made_is_reported() -> None:
    with pytest.raises(ParameterError) as caught:
        drive(2, own={INPUTS[1]: {**mean(2), "filter1.type": "filters/Mean"}})

    assert str(caught.value).startswith(
        "wheel_right/position.filter_chain.filter1.type: no filter of numbers "
        "'filters/Mean'; did you mean 'filters/MeanFilterDouble'? known: "
    )


def filter_parameters(chain: str) -> dict[str, Any]:
    return {f"{chain}.{name}": value for name, value in mean(2).items()}


TWO = {"input_interfaces": list(INPUTS), "output_interfaces": list(OUTPUTS)}
ONE = {"input_interfaces": [INPUTS[1]], "output_interfaces": [OUTPUTS[1]]}
OWN = f"{INPUTS[1]}.filter_chain"


@pytest.mark.parametrize(
    ("parameters", "taken", "lines"),
    [
        ({**TWO, **filter_parameters("filter_chain")}, "filter_chain", []),
        ({**TWO, **filter_parameters(OWN)}, OWN, []),
        ({**ONE, **filter_parameters("filter_chain")}, "filter_chain", []),
        (
            {**TWO, **filter_parameters("filter_chain"), **filter_parameters(OWN)},
            "filter_chain",
            [
                f"{OWN}.filter1.name: filter_chain holds for all inputs; {OWN} has no "
                "effect"
            ],
        ),
        (
            {**TWO, "filter_chain.filter1.type": "x", **filter_parameters(OWN)},
            OWN,
            [
                "filter_chain.filter1.type: without filter1.name it holds for no "
                "input; filter_chain has no effect"
            ],
        ),
        (
            {**ONE, **filter_parameters(OWN)},
            "filter_chain",
            [
                f"{OWN}.filter1.name: a single input has no filters but filter_chain; "
                f"{OWN} has no effect"
            ],
        ),
    ],
)
def test_filters_without_effect_are_reported(
    parameters: dict[str, Any], taken: str, lines: list[str]
) -> None:
    report = LoadReport()

    loaded = load(FILTER, parameters, report=report)

    published = [f"{e.where.removeprefix('c.')}: {e.what}; {e.done}" for e in report]
    assert published == lines
    chain, where = loaded.chain_of(INPUTS[1])
    assert where == taken
    if f"{taken}.filter1.name" in parameters:
        assert chain == mean(2)


def test_what_belongs_to_no_filter_is_reported() -> None:
    report = LoadReport()
    own = {f"{OWN}.filter1.params.number": 4, f"{INPUTS[0]}.filter_chain.filter0": 1}

    load(FILTER, {**TWO, **filter_parameters(OWN), **own}, report=report)

    assert [(e.where, e.what.partition(";")[0], e.done) for e in report] == [
        (
            f"c.{INPUTS[0]}.filter_chain.filter0",
            "belongs to no filter",
            "it has no effect",
        ),
        (
            f"c.{OWN}.filter1.params.number",
            "the filter has no such parameter",
            "it has no effect",
        ),
    ]


@dc.dataclass(frozen=True)
class WatcherParameters:
    """Parameters of a Watcher."""


class Watcher(TickingController[tuple[float, ...]]):
    """Remembers what it has read, tick by tick."""

    def __init__(
        self, parameters: WatcherParameters, params: ControllerInterfaceParams
    ) -> None:
        del parameters
        super().__init__(params, (), state_interfaces=("filter/swing/mean",))
        self._declare_topic("values", lambda values: values)

    def _update(
        self, now: UpdateContext, state: tuple[float, ...]
    ) -> tuple[float, ...]:
        return (*state, *self._read(now.context).tolist())


URDF = models.pendulum(
    control=models.ros2_control("swing").replace(
        "gz_ros2_control/GazeboSimSystem", "mock_components/GenericSystem"
    )
)
YAML = f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    watcher: {{type: test/Watcher}}
    group: {{type: position_controllers/JointGroupPositionController}}
    filter: {{type: {FILTER}}}
group: {{ros__parameters: {{joints: [swing]}}}}
filter:
  ros__parameters:
    input_interfaces: [swing/position]
    output_interfaces: [swing/mean]
    filter_chain:
      filter1:
        name: mean
        type: filters/MeanFilterDouble
        params: {{number_of_observations: 4}}
"""
TYPES = {
    "test/Watcher": ad.ControllerType(WatcherParameters, Watcher),
    FILTER: ad.ControllerType(ChainedFilterParameters, ChainedFilter),
}


def test_another_controller_reads_what_is_filtered(tmp_path: Path) -> None:
    robot = models.load(tmp_path, URDF, YAML, controller_types=TYPES)
    options = ad.SimulationOptions(preset="kinematic")
    simulation = ad.Simulation(ad.build_diagram(robot, options=options))
    simulation.advance_to(0.095)

    simulation.publish("group.commands", Float64MultiArray([1.0]), 0.01)
    simulation.advance_to(0.195)

    values = simulation.eval_output("watcher.values")
    # The joint jumps from 0 to 1, and the mean is of four samples.
    assert list(dict.fromkeys(values)) == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert {c.state for c in simulation.list_controllers()} == {"active"}
