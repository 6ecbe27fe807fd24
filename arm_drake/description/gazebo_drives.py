"""Gazebo plugins that drive bases, with their fields and defaults.

Sources of both: gz-sim, src/systems/diff_drive/DiffDrive.cc; gazebo_ros_pkgs, branch
ros2, gazebo_plugins/src/gazebo_ros_diff_drive.cpp.
"""

import dataclasses as dc
import math

from arm_drake.description.gazebo_plugins import joint_tags, tags


@dc.dataclass(frozen=True)
class DiffDrive:
    """Drives wheels on two sides by velocity commands."""

    left_joints: tuple[str, ...] = joint_tags("left_joint")
    right_joints: tuple[str, ...] = joint_tags("right_joint")

    # [m].
    wheel_separation: float = 1.0
    wheel_radius: float = 0.2

    # Rate of the odometry [Hz].
    odom_publish_frequency: float = 50.0

    # Empty: "/model/<model>/cmd_vel", "/model/<model>/odometry", "/model/<model>/tf".
    topic: str = ""
    odom_topic: str = ""
    tf_topic: str = ""

    # Limits of forward and of turning speed alike, of its rate and of the rate's.
    min_velocity: float = -math.inf
    max_velocity: float = math.inf
    min_acceleration: float = -math.inf
    max_acceleration: float = math.inf
    min_jerk: float = -math.inf
    max_jerk: float = math.inf

    # The same of one of the two; NaN is the limit of both.
    min_linear_velocity: float = math.nan
    max_linear_velocity: float = math.nan
    min_linear_acceleration: float = math.nan
    max_linear_acceleration: float = math.nan
    min_linear_jerk: float = math.nan
    max_linear_jerk: float = math.nan
    min_angular_velocity: float = math.nan
    max_angular_velocity: float = math.nan
    min_angular_acceleration: float = math.nan
    max_angular_acceleration: float = math.nan
    min_angular_jerk: float = math.nan
    max_angular_jerk: float = math.nan

    # Empty: "<model>/odom" and "<model>/<base link>".
    frame_id: str = ""
    child_frame_id: str = ""

    # The link that the robot hangs from.
    base_link: str = tags(default="")


@dc.dataclass(frozen=True)
class GazeboRosDiffDrive:
    """Drives pairs of wheels by "cmd_vel", in Gazebo Classic.

    The n-th value of a tuple is that of the n-th pair; where it is missing, the
    separation is 0.34 m and the diameter 0.15 m.
    """

    left_joints: tuple[str, ...] = joint_tags("left_joint")
    right_joints: tuple[str, ...] = joint_tags("right_joint")
    num_wheel_pairs: int = 1

    # [m].
    wheel_separation: tuple[float, ...] = ()
    wheel_diameter: tuple[float, ...] = ()

    # Of a wheel's rim [m/s^2]; 0 is unlimited.
    max_wheel_acceleration: float = 0.0

    # [N·m].
    max_wheel_torque: float = 5.0

    # [Hz]; 0 is every step.
    update_rate: float = 100.0

    # 0 is the wheels' encoders, 1 the world.
    odometry_source: int = 1

    odometry_frame: str = "odom"
    robot_base_frame: str = "base_footprint"
    publish_odom: bool = False
    publish_odom_tf: bool = False
    publish_wheel_tf: bool = False
    covariance_x: float = 0.00001
    covariance_y: float = 0.00001
    covariance_yaw: float = 0.001

    namespace: str = tags("ros/namespace", default="")
    remappings: tuple[str, ...] = tags("ros/remapping", "ros/argument")

    # The link that the robot hangs from, and the links that each wheel's joint
    # connects, pair by pair, the right one first.
    base_link: str = tags(default="")
    wheel_links: tuple[tuple[str, str], ...] = tags()

    @property
    def separations(self) -> tuple[float, ...]:
        """Distance of the wheels of each pair [m]."""
        return self._per_pair(self.wheel_separation, 0.34)

    @property
    def radii(self) -> tuple[float, ...]:
        """Radius of the wheels of each pair [m]."""
        return tuple(d / 2.0 for d in self._per_pair(self.wheel_diameter, 0.15))

    def _per_pair(self, given: tuple[float, ...], default: float) -> tuple[float, ...]:
        pairs = max(1, self.num_wheel_pairs)
        return (*given, *(default,) * pairs)[:pairs]
