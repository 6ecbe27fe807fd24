"""What lies on the topics of a controller, as one value that changes seldom."""

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    Context,
    InputPort,
    LeafSystem,
    OutputPort,
    PortDataType,
)

from arm_drake import interfaces

_NOTHING = object()


def add_inbox(system: LeafSystem) -> OutputPort:
    """Add an output port with all that lies on the topics of a controller.

    Drake computes it anew only when something is put on one of them, so to see that
    nothing has come takes one look instead of one for each port.

    Args:
        system: A controller with all its topics.
    """
    ports = [
        port
        for port in map(system.get_input_port, range(system.num_input_ports()))
        if port.get_data_type() == PortDataType.kAbstractValued and _is_topic(port)
    ]

    def calc(context: Context, output: AbstractValue) -> None:
        output.set_value(
            tuple(
                port.Eval(context) if port.HasValue(context) else _NOTHING
                for port in ports
            )
        )

    return system.DeclareAbstractOutputPort(
        interfaces.INBOX_PORT,
        lambda: AbstractValue.Make(()),
        calc,
        prerequisites_of_calc={
            system.nothing_ticket(),
            *(system.input_port_ticket(port.get_index()) for port in ports),
        },
    )


def _is_topic(port: InputPort) -> bool:
    name = port.get_name()
    return name == interfaces.PARAMETERS_PORT or not interfaces.is_internal(name)
