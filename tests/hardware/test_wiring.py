"""Expressions as wired systems: the right values, in as few systems as possible."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from arm_drake.hardware.wiring import Source, Wiring

X, Y = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0])


@pytest.mark.parametrize(
    ("matrix", "num_systems"),
    [
        (np.eye(5)[[4, 0, 0]], 1),  # Picked from both ports at once.
        (np.eye(5), 1),
        (np.hstack([np.eye(2), np.zeros((2, 1)), -np.eye(2)]), 2),  # Joined, times.
        (2.0 * np.eye(5), 2),
        (np.zeros((2, 5)), 2),
        (np.zeros((0, 5)), 1),
    ],
)
def test_a_matrix_times_two_ports_is_one_vector(matrix, num_systems):
    wiring = Wiring(DiagramBuilder())
    x = wiring.add("x", ConstantVectorSource(X))
    y = wiring.add("y", ConstantVectorSource(Y))

    found = wiring.times("found", matrix, x, y)

    wiring.builder.ExportOutput(found, "found")
    diagram = wiring.builder.Build()
    context = diagram.CreateDefaultContext()
    value = diagram.GetOutputPort("found").Eval(context)
    assert value.tolist() == (matrix @ [*X, *Y]).tolist()
    assert len(diagram.GetSystems()) == 2 + num_systems


def test_nothing_is_added_for_what_is_a_port_already():
    wiring = Wiring(DiagramBuilder())
    x = wiring.add("x", ConstantVectorSource(X))

    assert wiring.times("same", np.eye(3), x) is x
    assert wiring.join("same", [x]) is x


def test_systems_share_an_input_of_the_diagram():
    wiring = Wiring(DiagramBuilder())
    u = Source("u", 3)

    for name, matrix in (("first", np.eye(3)[:1]), ("twice", 2.0 * np.eye(3))):
        wiring.builder.ExportOutput(wiring.times(name, matrix, u), name)

    diagram = wiring.builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("u").FixValue(context, X)
    assert diagram.GetOutputPort("first").Eval(context).tolist() == [1.0]
    assert diagram.GetOutputPort("twice").Eval(context).tolist() == [2.0, 4.0, 6.0]
    assert len(diagram.GetSystems()) == 2
