"""The controller types, by their ros2_control names.

To add one, write its module (parameters dataclass and system) and its test, then add
its row to `CONTROLLER_TYPES`.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.controllers.joint_state_broadcaster import (
    JointStateBroadcaster,
    JointStateBroadcasterParameters,
)
from arm_drake.controllers.joint_trajectory_controller import (
    JointTrajectoryController,
    JointTrajectoryControllerParameters,
)


class ControllerType(NamedTuple):
    """How to parse and build one type of controller."""

    parameters: type
    system: Callable[[Any, ControllerInterfaceParams], ControllerInterface]


CONTROLLER_TYPES: Mapping[str, ControllerType] = {
    "joint_state_broadcaster/JointStateBroadcaster": ControllerType(
        JointStateBroadcasterParameters, JointStateBroadcaster
    ),
    "joint_trajectory_controller/JointTrajectoryController": ControllerType(
        JointTrajectoryControllerParameters, JointTrajectoryController
    ),
}
