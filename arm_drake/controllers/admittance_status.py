"""What an AdmittanceController tells of its ticks."""

from typing import NamedTuple

from pydrake.math import RotationMatrix

from arm_drake.arrays import Array
from arm_drake.control.admittance import AdmittanceFrames, AdmittanceState
from arm_drake.controllers.admittance_setup import AdmittanceSetup
from arm_drake.messages import (
    AdmittanceControllerState,
    Float64MultiArray,
    Header,
    Int8MultiArray,
    JointState,
    Quaternion,
    String,
    Transform,
    TransformStamped,
    Twist,
    TwistStamped,
    Vector3,
    Wrench,
    WrenchStamped,
)


class AdmittanceTick(NamedTuple):
    """What there is to tell of a tick."""

    time_ns: int
    setup: AdmittanceSetup
    frames: AdmittanceFrames
    control: AdmittanceState

    # Pose of the sensor's frame at the references, shape (4, 4).
    X_BR: Array


def make_status(tick: AdmittanceTick) -> AdmittanceControllerState:
    """Return the message of a tick.

    Its stamps are times of the tick, and its position says where the sensor's frame is
    moved; upstream leaves the first at 0 and the second at rest.

    Args:
        tick: The tick.
    """
    setup, control, frames = tick.setup, tick.control, tick.frames
    rule, parameters = setup.rule, setup.parameters
    header = Header.from_nanoseconds(tick.time_ns, parameters.kinematics.base)
    moved = frames.R_BS @ tick.X_BR[:3, :3].T
    return AdmittanceControllerState(
        joint_state=JointState(
            Header.from_nanoseconds(tick.time_ns),
            parameters.joints,
            tuple(control.position.tolist()),
            tuple(control.velocity.tolist()),
            tuple(control.acceleration.tolist()),
        ),
        damping=Float64MultiArray(rule.damping.tolist()),
        mass=Float64MultiArray(rule.mass.tolist()),
        selected_axes=Int8MultiArray(tuple(map(int, rule.selected_axes))),
        stiffness=Float64MultiArray(rule.stiffness.tolist()),
        wrench_base=WrenchStamped(header, Wrench(*_vectors(control.wrench_B))),
        admittance_acceleration=TwistStamped(
            header, Twist(*_vectors(control.twist_rate))
        ),
        admittance_velocity=TwistStamped(header, Twist(*_vectors(control.twist))),
        admittance_position=TransformStamped(
            header,
            "admittance_offset",
            Transform(_vectors(frames.displacement)[0], _quaternion(moved)),
        ),
        rot_base_control=_quaternion(frames.R_BC),
        ref_trans_base_ft=TransformStamped(
            header,
            "ft_reference",
            Transform(
                Vector3(*tick.X_BR[:3, 3].tolist()), _quaternion(tick.X_BR[:3, :3])
            ),
        ),
        ft_sensor_frame=String(setup.sensor),
    )


def _vectors(x: Array) -> tuple[Vector3, Vector3]:
    """Return the halves of a vector of six."""
    values = x.tolist()
    return Vector3(*values[:3]), Vector3(*values[3:])


def _quaternion(R: Array) -> Quaternion:
    q = RotationMatrix(R).ToQuaternion()
    return Quaternion(q.x(), q.y(), q.z(), q.w())
