"""Inputs of all controllers: measurements, references of others, and nothing else."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator

from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.controllers.cycles import Cycle
from arm_drake.controllers.pid_controller import (
    DofGains,
    PidController,
    PidControllerGains,
    PidControllerParameters,
)
from arm_drake.errors import InputError

MEASURED = ("j1/position", "j2/position", "j1/velocity", "j2/velocity")


def make_reader(*state_interfaces: str) -> ControllerInterface:
    """Return what reads interfaces of two joints, whose values are 1 to 4."""
    params = ControllerInterfaceParams(
        controller_name="reader",
        update_rate=100,
        period=0.01,
        joint_types=dict.fromkeys(("j1", "j2"), "revolute"),
        command_interfaces=frozenset(),
        state_interfaces=frozenset(),
        measured=MEASURED,
    )
    return ControllerInterface(params, state_interfaces=state_interfaces)


def read(reader: ControllerInterface, exported: tuple[float, ...] = ()) -> list[float]:
    """Return what a reader reads, also of the controller that it was given."""
    context = reader.CreateDefaultContext()
    reader.GetInputPort("state_interfaces").FixValue(context, [1.0, 2.0, 3.0, 4.0])
    if exported:
        port = reader.get_input_port(reader.num_input_ports() - 1)
        port.FixValue(context, exported)
    return list(reader._read(context))


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (MEASURED, [1.0, 2.0, 3.0, 4.0]),
        (("j2/position", "j1/velocity"), [2.0, 3.0]),
        (("j2/velocity", "j1/position"), [4.0, 1.0]),
        ((), []),
    ],
)
def test_state_interfaces_are_read_in_their_order(
    names: tuple[str, ...], expected: list[float]
) -> None:
    assert read(make_reader(*names)) == expected


def test_what_another_controller_exports_is_read_from_it() -> None:
    reader = make_reader("other/b", "j1/velocity", "other/a")
    params = make_reader().params
    reader.add_exporter(
        ControllerInterface(params, exported_interfaces=("other/a", "other/b"))
    )

    assert read(reader, (5.0, 6.0)) == [6.0, 3.0, 5.0]


def test_what_is_missing_is_an_error_once_it_is_read() -> None:
    reader = make_reader("j1/position", "zz/position", "zz/velocity")

    with pytest.raises(InputError) as caught:
        read(reader)

    assert str(caught.value) == (
        "controller 'reader': no state interface 'zz/position', 'zz/velocity'; it has "
        f"{sorted(MEASURED)}"
    )


def test_below_a_manager_what_is_missing_reads_as_unknown() -> None:
    reader = make_reader("j1/position", "zz/position")
    context = reader.CreateDefaultContext()
    reader.GetInputPort("state_interfaces").FixValue(context, [1.0, 2.0, 3.0, 4.0])
    cycle = AbstractValue.Make(Cycle(0, 0, 0, {}))
    reader.GetInputPort("controller_manager").FixValue(context, cycle)

    np.testing.assert_array_equal(reader._read(context), [1.0, np.nan])


def test_what_was_read_stays_when_the_measurements_change() -> None:
    reader = make_reader("j1/position", "j2/position")
    context = reader.CreateDefaultContext()
    port = reader.GetInputPort("state_interfaces")
    value = port.FixValue(context, [1.0, 2.0, 3.0, 4.0])

    values = reader._read(context)
    value.GetMutableData().get_mutable_value().SetFromVector(np.zeros(4))

    assert list(reader._read(context)) == [0.0, 0.0]
    assert list(values) == [1.0, 2.0]


def test_a_controller_that_lacks_a_joint_fails_in_its_first_tick() -> None:
    parameters = PidControllerParameters(
        dof_names=("zz",),
        command_interface="effort",
        reference_and_state_interfaces=("position",),
        gains=PidControllerGains({"zz": DofGains(p=1.0)}),
    )
    simulator = Simulator(PidController(parameters, make_reader().params))
    context = simulator.get_mutable_context()
    simulator.get_system().GetInputPort("state_interfaces").FixValue(context, [0.0] * 4)

    with pytest.raises(InputError) as caught:
        simulator.AdvanceTo(0.01)

    assert str(caught.value) == (
        "controller 'reader': no state interface 'zz/position'; it has "
        f"{sorted(MEASURED)}"
    )


def test_what_no_joint_measures_is_read_by_its_place_not_by_its_name() -> None:
    names = ("joint/position", "joint/velocity", "joint/effort", "valve/position")
    params = ControllerInterfaceParams(
        controller_name="reader",
        update_rate=100,
        period=0.01,
        joint_types={"joint": "revolute"},
        command_interfaces=frozenset(),
        state_interfaces=frozenset(names),
        measured=names,
    )

    reader = ControllerInterface(params, state_interfaces=("valve/position",))

    assert reader.reads_all
    assert reader.GetInputPort("state_interfaces").size() == 4
    context = reader.CreateDefaultContext()
    reader.GetInputPort("state_interfaces").FixValue(context, [1.0, 2.0, 3.0, 4.0])
    assert reader._read(context).tolist() == [4.0]
