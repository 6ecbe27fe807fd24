"""``pose_broadcaster/PoseBroadcaster``.

Source: ros2_controllers, `pose_broadcaster` (version 6.9.0). Parameters only.
"""

import dataclasses as dc

from arm_drake.controllers.validation import check_not_empty


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
