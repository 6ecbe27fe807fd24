"""What an admittance controller tells."""

import dataclasses as dc

from arm_drake.messages.base import JointState, Message
from arm_drake.messages.control import Float64MultiArray
from arm_drake.messages.geometry import (
    Quaternion,
    TransformStamped,
    TwistStamped,
    WrenchStamped,
)


@dc.dataclass(frozen=True)
class Int8MultiArray(Message):
    """Small numbers in an agreed order (`std_msgs`)."""

    data: tuple[int, ...] = ()


@dc.dataclass(frozen=True)
class String(Message):
    """A text (`std_msgs`)."""

    data: str = ""


@dc.dataclass(frozen=True)
class AdmittanceControllerState(Message):
    """How an AdmittanceController gives way (`control_msgs`).

    What is given for six axes is along, then about x, y and z of the control frame.
    """

    # What joints are moved by beside their references; the efforts are accelerations.
    joint_state: JointState = dc.field(default_factory=JointState)

    # [N·s/m] and [N·m·s/rad], [kg] and [kg·m^2], each of six values.
    damping: Float64MultiArray = dc.field(default_factory=Float64MultiArray)
    mass: Float64MultiArray = dc.field(default_factory=Float64MultiArray)

    # 1 where the wrench counts.
    selected_axes: Int8MultiArray = dc.field(default_factory=Int8MultiArray)

    # [N/m] and [N·m/rad], six values.
    stiffness: Float64MultiArray = dc.field(default_factory=Float64MultiArray)

    # Filtered wrench, and how it moves the sensor's frame, in the base of the chain.
    wrench_base: WrenchStamped = dc.field(default_factory=WrenchStamped)
    admittance_acceleration: TwistStamped = dc.field(default_factory=TwistStamped)
    admittance_velocity: TwistStamped = dc.field(default_factory=TwistStamped)
    admittance_position: TransformStamped = dc.field(default_factory=TransformStamped)

    # Orientation of the control frame in the base.
    rot_base_control: Quaternion = dc.field(default_factory=Quaternion)

    # Where the sensor's frame is at the references.
    ref_trans_base_ft: TransformStamped = dc.field(default_factory=TransformStamped)

    ft_sensor_frame: String = dc.field(default_factory=String)
