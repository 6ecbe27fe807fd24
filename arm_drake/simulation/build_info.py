"""How a diagram was built, kept in the diagram, for who asks later."""

from typing import NamedTuple

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantValueSource

from arm_drake.options import SimulationOptions

# Name of the system that keeps it.
_NAME = "build_info"


class BuildInfo(NamedTuple):
    """Options and world of a diagram."""

    options: SimulationOptions

    # Name of the world.
    world: str


def add_build_info(builder: DiagramBuilder, info: BuildInfo) -> None:
    """Keep in a diagram how it is built.

    Args:
        builder: Where to keep it.
        info: What to keep.
    """
    builder.AddNamedSystem(_NAME, ConstantValueSource(AbstractValue.Make(info)))


def find_build_info(diagram: Diagram) -> BuildInfo | None:
    """Return how a diagram was built, or None if it doesn't say."""
    if not diagram.HasSubsystemNamed(_NAME):
        return None
    source = diagram.GetSubsystemByName(_NAME)
    info: BuildInfo = source.get_output_port().Eval(source.CreateDefaultContext())
    return info
