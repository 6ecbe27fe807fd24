"""Parameters of a controller that change while it runs.

They are read as the loader reads a YAML. Which ones may change is that of
ros2_controllers' parameter declarations (version 6.9.0, `read_only`).
"""

import dataclasses as dc
import fnmatch
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context

from arm_drake import interfaces
from arm_drake.controllers import find_controller_type
from arm_drake.controllers.controller_interface_part import ControllerInterface
from arm_drake.controllers.joint_trajectory.parameters import (
    JointTrajectoryControllerParameters,
)
from arm_drake.controllers.pid_parameters import PidControllerParameters
from arm_drake.description.controller_manager import ControllerConfig
from arm_drake.description.given import Parameter, Parameters
from arm_drake.description.parameters import load_parameters
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.errors import ParameterError

# Of a type that isn't here the controller itself decides.
_CHANGEABLE: dict[type, tuple[str, ...]] = {
    PidControllerParameters: (
        "enable_feedforward",
        "gains.*",
        "set_current_state_as_first_setpoint",
    ),
    JointTrajectoryControllerParameters: (
        "allow_integration_in_goal_trajectories",
        "allow_nonzero_velocity_at_trajectory_end",
        "allow_partial_joints_goal",
        "allow_trajectory_replacement",
        "cmd_timeout",
        "constraints.*.goal",
        "constraints.*.trajectory",
        "constraints.goal_time",
        "constraints.stopped_velocity_tolerance",
        "gains.*",
        "set_last_command_interface_value_as_state_on_activation",
    ),
}

# What the manager takes from a controller's parameters, once.
_OF_THE_MANAGER = ("update_rate", "use_sim_time")

_FIXED = "can't change while the controller runs"

# Where values come from that no file holds.
_NO_FILE = Path()


def publish_parameters(
    robot: Robot,
    system: ControllerInterface,
    context: Context,
    changes: Mapping[str, Any],
) -> None:
    """Put changed parameters on a controller's port, upon what was changed before.

    Args:
        robot: Whose controller it is.
        system: The controller.
        context: Its Context; it alone knows what was changed before.
        changes: New values by their names, dotted or nested.

    Raises:
        ParameterError: If a parameter is unknown, can't change, or has a bad value.
    """
    name = system.params.controller_name
    config = next(c for c in robot.controllers.controllers if c.name == name)
    port = system.GetInputPort(interfaces.PARAMETERS_PORT)
    present = port.Eval(context) if port.HasValue(context) else None
    parameters = change_parameters(
        config, present, changes, distro=robot.distro, types=robot.controller_types
    )
    port.FixValue(context, AbstractValue.Make(parameters))


def change_parameters(
    config: ControllerConfig,
    present: Any,
    changes: Mapping[str, Any],
    *,
    distro: str,
    types: Mapping[str, Any] | None = None,
) -> Any:
    """Return a controller's parameters with some changed.

    Args:
        config: What the YAML configures.
        present: Its parameters as they are; None is as the YAML configures them.
        changes: New values by their names, dotted or nested.
        distro: Distribution whose parameters and defaults hold.
        types: Types of the robot alone, by name.

    Raises:
        ParameterError: If a parameter is unknown, can't change, or has a bad value.
    """
    if not isinstance(changes, Mapping):
        problem = f"expected parameters by name, got {changes!r}"
        raise ParameterError(problem, where=config.name)
    new = _as_parameters(_flatten(changes, ""))
    for name in _OF_THE_MANAGER:
        if name in new:
            raise ParameterError(_FIXED, where=f"{config.name}.{name}")
    base = {n: p for n, p in config.parameters.items() if n not in _OF_THE_MANAGER}
    row = find_controller_type(config.type, types or {})
    assert row is not None  # It could be loaded.
    schema = row.parameters
    first, _ = _load(schema, config, base, distro)
    present = first if present is None else present
    old = dict(_leaves(first, ""))
    earlier = _as_parameters(
        (name, _plain(value))
        for name, value in _leaves(present, "")
        if name in old and value != old[name]
    )
    changed, report = _load(schema, config, {**base, **earlier, **new}, distro)
    for entry in report:
        name = entry.where.removeprefix(f"{config.name}.")
        if name in new and entry.kind != "repair":
            raise ParameterError(entry.what, where=entry.where)
    _check_changes(config.name, present, changed)
    return changed


def _as_parameters(values: Iterable[tuple[str, Any]]) -> dict[str, Parameter]:
    return {name: Parameter(value, _NO_FILE, 0) for name, value in values}


def _load(
    schema: type, config: ControllerConfig, parameters: Parameters, distro: str
) -> tuple[Any, LoadReport]:
    report = LoadReport()
    try:
        loaded: Any = load_parameters(
            schema, parameters, config.name, config.file, report, distro=distro
        )
    except ParameterError as error:  # What is in the file is as it was.
        raise ParameterError(error.problem, where=error.where) from None
    return loaded, report


def _check_changes(controller: str, before: Any, after: Any) -> None:
    """Raise ParameterError if something changes that mustn't."""
    old, new = dict(_leaves(before, "")), dict(_leaves(after, ""))
    for schema, changeable in _CHANGEABLE.items():
        if not isinstance(after, schema):
            continue
        for name, value in new.items():
            if value != old.get(name) and not any(
                fnmatch.fnmatchcase(name, pattern) for pattern in changeable
            ):
                raise ParameterError(
                    f"{_FIXED}; these can: {', '.join(changeable)}",
                    where=f"{controller}.{name}",
                )


def _flatten(changes: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield the values of nested mappings by their dotted names."""
    for name, value in changes.items():
        if isinstance(value, Mapping):
            yield from _flatten(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", _plain(value)


def _plain(value: Any) -> Any:
    """Return a value as a YAML would give it."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


def _leaves(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield the values of a parameters dataclass by their dotted names."""
    if dc.is_dataclass(value):
        for field in dc.fields(value):
            # The name of a group per element isn't part of its elements' names.
            own = "" if "per_element_of" in field.metadata else f".{field.name}"
            yield from _leaves(getattr(value, field.name), f"{name}{own}")
    elif isinstance(value, dict):
        for key, below in cast("dict[str, Any]", value).items():
            yield from _leaves(below, f"{name}.{key}")
    else:
        yield name.lstrip("."), value
