"""Controller types of other packages, of which ours know something."""

import dataclasses as dc
import difflib
import functools
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal, NamedTuple

from arm_drake import yaml_files

_FILE = Path(__file__).with_name("other_types.yaml")


class Equivalent(NamedTuple):
    """Which type of the registry another package's type is."""

    runs_as: str

    # What a trajectory controller commands by default, as those of ROS 1 say by their
    # names; empty if that type's parameters are this one's.
    commands: Literal["", "position", "velocity", "effort"] = ""


class Other(NamedTuple):
    """What is known of a type that isn't simulated."""

    # What it does, that ours don't.
    does: str

    # The type that stands closest, and how to use it.
    closest: str = ""


class OtherTypes(NamedTuple):
    """The tables of `other_types.yaml`, where each is explained."""

    equivalents: Mapping[str, Equivalent]
    hardware_only: Mapping[str, str]

    # By type, or by package with a "/" at its end.
    others: Mapping[str, Other]


@functools.cache
def load_other_types() -> OtherTypes:
    """Read the tables; done when a type isn't ours, which is rare."""
    tables = yaml_files.load(_FILE)
    return OtherTypes(
        {name: Equivalent(**row) for name, row in tables["equivalents"].items()},
        tables["hardware_only"],
        {name: Other(**row) for name, row in tables["others"].items()},
    )


@functools.cache
def parameters_of(equivalent: Equivalent) -> type | None:
    """Return the dataclass of a type's parameters, None if that of what it runs as."""
    if not equivalent.commands:
        return None
    # Not at the top: few robots have one.
    from arm_drake.controllers.joint_trajectory.parameters import (
        CommandInterface,
        JointTrajectoryControllerParameters,
        StateInterface,
    )

    # They always read the same.
    states: tuple[StateInterface, ...] = ("position", "velocity")
    return dc.make_dataclass(
        "JointTrajectoryControllerParametersOfRos1",
        [
            (
                "command_interfaces",
                tuple[CommandInterface, ...],
                (equivalent.commands,),
            ),
            ("state_interfaces", tuple[StateInterface, ...], states),
        ],
        bases=(JointTrajectoryControllerParameters,),
        frozen=True,
    )


def describe_unknown(
    name: str, known: Iterable[str]
) -> tuple[Literal["info", "error"], str, str]:
    """Return what the report says of a type: severity, what it is, what is done.

    It is neither in the registry, of which `known` are the types, nor equivalent to
    one.
    """
    _, hardware_only, others = load_other_types()
    what, done = f"controller type {name!r}", "the controller does not run"
    if name in hardware_only:
        done = "left out; a simulation lacks nothing"
        return "info", f"{what} {hardware_only[name]}", done
    other = others.get(name) or others.get(f"{name.partition('/')[0]}/")
    if other is not None:
        closest = f"; the closest type is {other.closest}" if other.closest else ""
        return "error", f"{what} is not simulated: {other.does}{closest}", done
    types = list(known)
    close = difflib.get_close_matches(name, types, n=1, cutoff=0.8)
    close += [type_ for type_ in types if type_.rpartition("/")[2] == name]
    hint = f"; did you mean {close[0]!r}?" if close else ""
    return "error", f"unknown {what}{hint}", done
