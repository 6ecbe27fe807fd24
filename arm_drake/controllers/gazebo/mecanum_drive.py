"""Gazebo's plugin for bases on mecanum wheels, which isn't ros2_control's.

Sources: gz-sim, src/systems/mecanum_drive/MecanumDrive.cc; gz-math,
src/MecanumDriveOdometry.cc.
"""

import numpy as np

from arm_drake.arrays import Array
from arm_drake.control.odometry import (
    MecanumKinematics,
    MecanumWheels,
    WheelOdometryState,
    integrate_planar,
)
from arm_drake.controllers.bases.base import Velocity
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.gazebo.drive import GazeboDrive
from arm_drake.description.gazebo_plugins import MecanumDrive as MecanumDriveTag


class MecanumDrive(GazeboDrive):
    """Drives the mecanum wheels of four corners by the base's velocity command.

    With J joints and k wheels:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  positions and velocities of all joints, or more
    /<topic>            --    --       Twist: velocity forwards, to the left, of turning
    command_interfaces  --    rad/s    UpdateResult; command (k,): front left, front
                                       right, back left, back right wheels
    /<odom_topic>       --    --       Odometry: where the base is by its wheels
    /<tf_topic>         --    --       TFMessage with the same
    events              --    --       tuple of the latest (number, TopicRejected), the
                                       newest last
    ==================  ====  =======  =================================================

    The state is a GazeboDriveState, renewed in every tick. The last command holds for
    ever; there is no timeout. With vx, vy and w within the limits (`SpeedLimits`), of
    which both linear velocities have the same, a wheel turns with::

        (vx -+ vy -+ w (wheel_separation + wheelbase) / 2) / wheel_radius

    see `MecanumKinematics`. The odometry counts the first wheel of each corner from the
    angle 0 on, whatever it is at the start; its velocities are means of ten ticks. It
    is published at times 1 / ``odom_publish_frequency`` apart, from then on; with a
    frequency of 0 in every tick. Its covariances are 0. Gazebo before Garden doesn't
    publish it.

    A message with a number that isn't finite is dropped, which Gazebo takes.
    """

    moves_sideways = True

    def __init__(self, tag: MecanumDriveTag, params: ControllerInterfaceParams) -> None:
        """Create the system."""
        reach = 0.5 * (tag.wheel_separation + tag.wheelbase)
        self._kinematics = MecanumKinematics(tag.wheel_radius, reach)
        super().__init__(tag, params, tag.corners)

    def _find_command(self, velocity: Velocity, measured: Array, dt: float) -> Array:
        front_left, front_right, back_right, back_left = self._kinematics.to_wheels(
            velocity
        )
        wheels = np.array([front_left, front_right, back_left, back_right])
        return wheels[self._group]

    def _count(
        self, odometry: WheelOdometryState, measured: Array, dt: float
    ) -> WheelOdometryState:
        turned = (measured - odometry.positions) / dt
        front_left, front_right, back_left, back_right = turned.tolist()
        wheels = MecanumWheels(front_left, front_right, back_right, back_left)
        velocity = self._kinematics.to_base(wheels)
        mean = odometry.mean.add(*velocity)
        return WheelOdometryState(
            mean,
            integrate_planar(odometry.pose, velocity, dt),
            mean.means(3),
            tuple(measured.tolist()),
        )
