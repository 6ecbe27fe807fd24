"""Where links are that no joint with a position holds: free bases, loose links."""

from collections.abc import Iterator

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import VectorLogSink

from arm_drake.arrays import Array
from arm_drake.description.joints import FREE_TYPES
from arm_drake.description.robot import Robot

# Name of the log, after the prefix of its robot.
_LOG = "log:state"


def log_free_poses(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    robot: Robot,
    *,
    prefix: str,
    period: float,
) -> None:
    """Record the state of a robot that has free links; one without needs no log.

    Args:
        builder: Where the plant is.
        plant: The finalized plant.
        model: The robot's model instance.
        robot: The robot.
        prefix: Start of the names of its systems.
        period: Period of the log [s].
    """
    if any(_free_links(plant, robot)):
        state = plant.get_state_output_port(model)
        log = VectorLogSink(state.size(), period)
        builder.AddNamedSystem(f"{prefix}{_LOG}", log)
        builder.Connect(state, log.get_input_port())


def read_free_poses(
    diagram: Diagram,
    context: Context,
    robot: Robot,
    time: Array,
    *,
    prefix: str,
    period: float,
) -> dict[str, Array]:
    """Return the recorded poses of free links, NaN where they weren't recorded.

    Args:
        diagram: The diagram.
        context: Its context.
        robot: The robot.
        time: Times of the rows [s], shape (N,).
        prefix: Start of the names of its systems.
        period: Period of the log [s].

    Returns:
        x, y, z [m], quaternion w, x, y, z in the world by link, shape (N, 7).
    """
    if not diagram.HasSubsystemNamed(f"{prefix}{_LOG}"):
        return {}
    plant = diagram.GetSubsystemByName("plant")
    log = diagram.GetSubsystemByName(f"{prefix}{_LOG}").FindLog(context)
    ticks = np.round(log.sample_times() / period).astype(np.int64)
    # Where a tick was logged twice the latest counts.
    known, at = np.unique(ticks[::-1], return_index=True)
    wanted = np.round(time / period).astype(np.int64)
    model = plant.GetModelInstanceByName(robot.name)
    order = plant.GetPositionsFromArray(model, np.arange(plant.num_positions()))
    poses = {}
    rows = np.minimum(np.searchsorted(known, wanted), max(len(known) - 1, 0))
    for link in _free_links(plant, robot):
        # A quaternion, then the position.
        first = plant.GetBodyByName(link, model).floating_positions_start()
        columns = [int(np.flatnonzero(order == first + k)[0]) for k in range(7)]
        pose = np.full((len(time), 7), np.nan)
        if len(known):
            there = known[rows] == wanted
            columns = columns[4:] + columns[:4]
            logged = log.data()[columns][:, ::-1].T[at]
            pose[there] = logged[rows[there]]
            # Drake's state lets the length drift, and takes the direction alone.
            pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
        poses[link] = pose
    return poses


def _free_links(plant: MultibodyPlant, robot: Robot) -> Iterator[str]:
    """Yield the links of a robot that may be anywhere."""
    description = robot.description
    names = [description.base] if robot.has_free_base else []
    names += [j.child for j in description.joints if j.type in FREE_TYPES]
    model = plant.GetModelInstanceByName(robot.name)
    for name in names:
        # A planar joint has no pose of its own in Drake's state.
        if plant.GetBodyByName(name, model).is_floating_base_body():
            yield name
