"""``pose_broadcaster/PoseBroadcaster``.

Source: ros2_controllers, `pose_broadcaster` (version 6.9.0).
"""

import dataclasses as dc
import math
from collections.abc import Sequence
from typing import NamedTuple

from arm_drake.controllers.controller_interface import TickingController
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.cycles import Now
from arm_drake.description.validation import check_not_empty
from arm_drake.messages import (
    Header,
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    TFMessage,
    Transform,
    TransformStamped,
    Vector3,
)

# How far the squared norm of an orientation on /tf may be off 1.
_NORM_TOLERANCE = 10e-3


@dc.dataclass(frozen=True)
class PoseTf:
    """What goes to /tf."""

    enable: bool = True

    # Frame that has the pose; "" is pose_name.
    child_frame_id: str = ""


@dc.dataclass(frozen=True)
class PoseBroadcasterParameters:
    """Parameters of a PoseBroadcaster."""

    # Frame of the message's header.
    frame_id: str

    # Sensor to read.
    pose_name: str

    tf: PoseTf = PoseTf()

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "frame_id", "pose_name")


class PoseBroadcasterState(NamedTuple):
    """What a PoseBroadcaster published last."""

    pose: PoseStamped = PoseStamped()
    tf: TFMessage = TFMessage()


class PoseBroadcaster(TickingController[PoseBroadcasterState]):
    """Publishes a pose, also as a transform.

    .. pydrake_system::

        name: PoseBroadcaster
        input_ports:
        - controller_manager
        - state_interfaces
        output_ports:
        - command_interfaces
        - pose
        - tf

    ==================  ====  ====  ==================================================
    port                size  unit  meaning
    ==================  ====  ====  ==================================================
    controller_manager  --    --    Cycle: when to tick
    state_interfaces    m     --    everything that is measured; it reads
                                    ``<pose_name>/position.{x,y,z}`` [m] and
                                    ``<pose_name>/orientation.{x,y,z,w}``
    command_interfaces  --    --    Tick; it commands nothing
    pose                --    --    PoseStamped of the last tick
    tf                  --    --    TFMessage of the last tick with a valid pose; there
                                    only with ``tf.enable``
    ==================  ====  ====  ==================================================

    The state is a PoseBroadcasterState. A pose is valid if all its numbers are finite
    and the squared norm of the orientation is within 0.01 of 1.
    """

    def __init__(
        self,
        parameters: PoseBroadcasterParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The broadcaster's parameters.
            params: Rate and surroundings of the broadcaster.
        """
        name, tf = parameters.pose_name, parameters.tf
        super().__init__(
            params,
            PoseBroadcasterState(),
            state_interfaces=(
                *(f"{name}/position.{axis}" for axis in "xyz"),
                *(f"{name}/orientation.{axis}" for axis in "xyzw"),
            ),
        )
        self._frame_id = parameters.frame_id
        self._child_frame_id = tf.child_frame_id or name
        self._has_tf = tf.enable
        self._declare_topic("pose", lambda state: state.pose)
        if self._has_tf:
            self._declare_topic("tf", lambda state: state.tf)

    def _update(self, now: Now, state: PoseBroadcasterState) -> PoseBroadcasterState:
        values = self._read(now.context).tolist()
        header = Header.from_nanoseconds(now.time_ns, self._frame_id)
        orientation = Quaternion(*values[3:])
        pose = PoseStamped(header, Pose(Point(*values[:3]), orientation))
        if not (self._has_tf and is_valid(values)):
            return state._replace(pose=pose)
        transform = Transform(Vector3(*values[:3]), orientation)
        tf = TransformStamped(header, self._child_frame_id, transform)
        return PoseBroadcasterState(pose, TFMessage((tf,)))


def is_valid(pose: Sequence[float]) -> bool:
    """Return whether a pose may go to /tf.

    Args:
        pose: Position x, y, z and orientation x, y, z, w, shape (7,).
    """
    squares = sum(value * value for value in pose[3:])
    return all(map(math.isfinite, pose)) and abs(squares - 1.0) <= _NORM_TOLERANCE
