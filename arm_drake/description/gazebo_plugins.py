"""Gazebo plugins that move or report joints, and sensors that feel and measure.

Each is a dataclass with the fields and defaults of the plugin, whose metadata say from
which tags they are read.

Sources of the fields and of their defaults:

- gz-sim, src/systems: joint_position_controller/JointPositionController.{hh,cc},
  joint_controller/JointController.{hh,cc}, apply_joint_force/ApplyJointForce.cc,
  joint_trajectory_controller/JointTrajectoryController.{hh,cc}, joint_state_publisher/
  JointStatePublisher.{hh,cc}, diff_drive/DiffDrive.cc, mecanum_drive/MecanumDrive.cc,
  ackermann_steering/AckermannSteering.cc, velocity_control/VelocityControl.cc,
  odometry_publisher/OdometryPublisher.cc, contact/Contact.cc
- gazebo_ros_pkgs, branch ros2, gazebo_plugins/src:
  gazebo_ros_joint_state_publisher.cpp,
  gazebo_ros_joint_pose_trajectory.cpp, gazebo_ros_diff_drive.cpp,
  gazebo_ros_planar_move.cpp, gazebo_ros_ackermann_drive.cpp, gazebo_ros_bumper.cpp,
  gazebo_ros_imu_sensor.cpp
- gz_ros2_control: gz_ros2_control_plugin.cpp; gazebo_ros2_control:
  gazebo_ros2_control_plugin.cpp
"""

import dataclasses as dc
import math
from collections.abc import Mapping
from typing import Any

from arm_drake.importing import dataclass


def tags(*names: str, default: Any = ()) -> Any:
    """Return a field that is read from these tags instead of the one of its name."""
    return dc.field(default=default, metadata={"tags": names})


def joint_tags(*names: str, default: tuple[str, ...] = ()) -> Any:
    """Return a field of joint names, read from these tags."""
    return dc.field(default=default, metadata={"tags": names, "joints": True})


@dataclass(frozen=True, eq=False, repr=False)
class JointPlugin:
    """A plugin that moves or reports joints.

    Its kinds have many fields: what `dataclass` would compile for each of them, at each
    start, takes a third of the time of their import, and is here once. Nor is there an
    ``__init__`` of what only some of them have in common.
    """

    def __eq__(self, other: object) -> bool:
        """Return whether another plugin is of the same kind and says the same."""
        if type(other) is not type(self):
            return NotImplemented
        return vars(self) == vars(other)

    def __hash__(self) -> int:
        """Return a number that is the same for equal plugins."""
        return hash(tuple(vars(self).values()))

    def __repr__(self) -> str:
        """Return its kind and its fields."""
        fields = ", ".join(f"{name}={value!r}" for name, value in vars(self).items())
        return f"{type(self).__name__}({fields})"

    def needs(self, field: str) -> bool:
        """Return whether it does nothing without joints in a field of joints."""
        del field
        return True


@dataclass(frozen=True, eq=False, repr=False)
class Ros2ControlPlugin(JointPlugin):
    """Runs the controller manager inside Gazebo."""

    # Controllers YAML files.
    parameters: tuple[str, ...] = ()

    controller_manager_name: str = "controller_manager"

    # Older name of controller_manager_name, which it wins over.
    controller_manager_node_name: str = ""

    # Start of the manager's name in Ignition Gazebo, followed by "_".
    controller_manager_prefix_node_name: str = ""

    # Whether joints stand still that no controller commands.
    hold_joints: bool = True

    # Velocity per position error and cycle, in Gazebo Sim.
    position_proportional_gain: float = 0.1

    # Node and parameter that hold the description.
    robot_param: str = "robot_description"
    robot_param_node: str = "robot_state_publisher"

    namespace: str = tags("ros/namespace", default="")
    remappings: tuple[str, ...] = tags("ros/remapping")

    @property
    def manager(self) -> str:
        """Name of the controller manager's node."""
        prefix = self.controller_manager_prefix_node_name
        name = self.controller_manager_node_name or self.controller_manager_name
        return "_".join(filter(None, (prefix, name)))


@dataclass(frozen=True, eq=False, repr=False)
class JointPositionController(JointPlugin):
    """Holds joints at a commanded position, by the force of a PID controller."""

    joint_names: tuple[str, ...] = joint_tags("joint_name")
    joint_index: int = 0

    p_gain: float = 1.0
    i_gain: float = 0.1
    d_gain: float = 0.01
    i_max: float = 1.0
    i_min: float = -1.0
    cmd_max: float = 1000.0
    cmd_min: float = -1000.0
    cmd_offset: float = 0.0

    # Whether joints move to the position at cmd_max [rad/s], without the controller.
    use_velocity_commands: bool = False

    # Position commanded from the start [rad] or [m].
    initial_position: float = 0.0

    # Empty: "/model/<model>/joint/<joint>/<index>/cmd_pos".
    topic: str = ""

    # Empty, or the end of "/model/<model>/<sub_topic>".
    sub_topic: str = ""

    use_actuator_msg: bool = False
    actuator_number: int = tags("actuator_number", "actuatorNumber", default=0)


@dataclass(frozen=True, eq=False, repr=False)
class JointController(JointPlugin):
    """Moves joints at a commanded velocity."""

    joint_names: tuple[str, ...] = joint_tags("joint_name")

    # Velocity commanded from the start [rad/s] or [m/s].
    initial_velocity: float = 0.0

    # Whether a PID controller's force moves the joints; its gains are below.
    use_force_commands: bool = False

    p_gain: float = 1.0
    i_gain: float = 0.0
    d_gain: float = 0.0
    i_max: float = 1.0
    i_min: float = -1.0
    cmd_max: float = 1000.0
    cmd_min: float = -1000.0
    cmd_offset: float = 0.0

    # Whether joints run free that are faster than commanded.
    disable_braking: bool = False

    # Empty: "/model/<model>/joint/<joint>/cmd_vel".
    topic: str = ""

    # Empty, or the end of "/model/<model>/<sub_topic>".
    sub_topic: str = ""

    use_actuator_msg: bool = False
    actuator_number: int = tags("actuator_number", "actuatorNumber", default=0)


@dataclass(frozen=True, eq=False, repr=False)
class ApplyJointForce(JointPlugin):
    """Pushes a joint by the force of "/model/<model>/joint/<joint>/cmd_force"."""

    # The first one is pushed.
    joint_names: tuple[str, ...] = joint_tags("joint_name")


@dataclass(frozen=True, eq=False, repr=False)
class JointTrajectoryController(JointPlugin):
    """Moves joints along trajectories, by the forces of PID controllers.

    The n-th value of a tuple is that of the n-th joint. Where it is missing, gains,
    offsets and positions are 0; the maxima -1 and the minima 0, which means no limit.
    """

    # Empty: all joints.
    joint_names: tuple[str, ...] = joint_tags("joint_name", "joint_names")

    # Positions commanded from the start [rad] or [m].
    initial_positions: tuple[float, ...] = tags("initial_position", "initial_positions")

    position_p_gain: tuple[float, ...] = ()
    position_i_gain: tuple[float, ...] = ()
    position_d_gain: tuple[float, ...] = ()
    position_i_max: tuple[float, ...] = ()
    position_i_min: tuple[float, ...] = ()
    position_cmd_max: tuple[float, ...] = ()
    position_cmd_min: tuple[float, ...] = ()
    position_cmd_offset: tuple[float, ...] = ()

    velocity_p_gain: tuple[float, ...] = ()
    velocity_i_gain: tuple[float, ...] = ()
    velocity_d_gain: tuple[float, ...] = ()
    velocity_i_max: tuple[float, ...] = ()
    velocity_i_min: tuple[float, ...] = ()
    velocity_cmd_max: tuple[float, ...] = ()
    velocity_cmd_min: tuple[float, ...] = ()
    velocity_cmd_offset: tuple[float, ...] = ()

    use_header_start_time: bool = False

    # Empty: "/model/<model>/joint_trajectory".
    topic: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class JointStatePublisher(JointPlugin):
    """Publishes the states of joints in every step."""

    # Empty: all joints.
    joint_names: tuple[str, ...] = joint_tags("joint_name")

    # Empty: "/world/<world>/model/<model>/joint_state".
    topic: str = ""


@dataclass(frozen=True, eq=False, repr=False, init=False)
class BaseHolder(JointPlugin):
    """A plugin that sets the velocity of the robot's base, whatever it takes."""

    # The link that the robot hangs from.
    base_link: str = dc.field(default="", kw_only=True, metadata={"tags": ()})


@dataclass(frozen=True, eq=False, repr=False)
class VelocityControl(BaseHolder):
    """Sets the velocity of the robot's base in every step."""

    # Velocity from the start, along the base's axes [m/s], [rad/s]; empty is 0.
    initial_linear: tuple[float, ...] = ()
    initial_angular: tuple[float, ...] = ()

    # Empty: "/model/<model>/cmd_vel".
    topic: str = ""

    # Links with topics of their own, which aren't moved here.
    link_names: tuple[str, ...] = tags("link_name")


@dataclass(frozen=True, eq=False, repr=False, init=False, kw_only=True)
class ClassicBase(JointPlugin):
    """Common parameters of Gazebo Classic's plugins that move bases."""

    # [Hz]; 0 is every step.
    update_rate: float = 100.0

    odometry_frame: str = "odom"
    robot_base_frame: str = "base_footprint"
    publish_odom: bool = False
    publish_odom_tf: bool = False
    covariance_x: float = 0.00001
    covariance_y: float = 0.00001
    covariance_yaw: float = 0.001

    namespace: str = tags("ros/namespace", default="")
    remappings: tuple[str, ...] = tags("ros/remapping", "ros/argument")

    # The link that the robot hangs from.
    base_link: str = tags(default="")


@dataclass(frozen=True, eq=False, repr=False)
class GazeboRosPlanarMove(ClassicBase, BaseHolder):
    """Sets the velocity of the robot's base by "cmd_vel", in Gazebo Classic."""

    # How often it is set, and told [Hz]; 0 is every step.
    update_rate: float = 20.0
    publish_rate: float = 20.0

    publish_odom: bool = True
    publish_odom_tf: bool = True


@dataclass(frozen=True, eq=False, repr=False)
class OdometryPublisher(JointPlugin):
    """Publishes where the robot really is."""

    # Rate [Hz]; 0 is every tick.
    odom_publish_frequency: float = 50.0

    # Empty: "/model/<model>/odometry" and "/model/<model>/pose".
    odom_topic: str = ""
    tf_topic: str = ""

    # Of a second message, with covariances, which isn't published here.
    odom_covariance_topic: str = ""

    # Empty: "<model>/odom" and "<model>/base_footprint".
    odom_frame: str = ""
    robot_base_frame: str = ""

    # 2 or 3.
    dimensions: int = 2

    # Pose of the frame in the root link [m], [rad]; empty is none.
    xyz_offset: tuple[float, ...] = ()
    rpy_offset: tuple[float, ...] = ()

    # Standard deviation of the velocities [m/s] and [rad/s].
    gaussian_noise: float = 0.0

    # The link that the robot hangs from.
    base_link: str = tags(default="")


@dataclass(frozen=True, eq=False, repr=False)
class GazeboRosJointStatePublisher(JointPlugin):
    """Publishes the states of joints on "joint_states", in Gazebo Classic."""

    joint_names: tuple[str, ...] = joint_tags("joint_name")

    # [Hz]; 0 is every step.
    update_rate: float = 100.0

    namespace: str = tags("ros/namespace", default="")
    remappings: tuple[str, ...] = tags("ros/remapping", "ros/argument")


@dataclass(frozen=True, eq=False, repr=False)
class GazeboRosJointPoseTrajectory(JointPlugin):
    """Sets joints to the points of "set_joint_trajectory", in Gazebo Classic."""

    # [Hz]; 0 is every step.
    update_rate: float = 100.0

    namespace: str = tags("ros/namespace", default="")
    remappings: tuple[str, ...] = tags("ros/remapping", "ros/argument")


@dataclass(frozen=True, eq=False, repr=False, init=False, kw_only=True)
class WheelDrive(JointPlugin):
    """Common parameters of Gazebo Sim's plugins that drive bases on wheels."""

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

    # Empty: "<model>/odom" and "<model>/<base link>".
    frame_id: str = ""
    child_frame_id: str = ""

    # The link that the robot hangs from.
    base_link: str = tags(default="")

    @property
    def driven_joints(self) -> tuple[str, ...]:
        """Joints of wheels that it turns."""
        return ()

    @property
    def steered_joints(self) -> tuple[str, ...]:
        """Joints by which it steers."""
        return ()


@dataclass(frozen=True, eq=False, repr=False, init=False, kw_only=True)
class LimitedDrive(WheelDrive):
    """One that has limits of linear and of turning speed; NaN is the limit of both."""

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


@dataclass(frozen=True, eq=False, repr=False)
class DiffDrive(LimitedDrive):
    """Drives wheels on two sides by velocity commands."""

    left_joints: tuple[str, ...] = joint_tags("left_joint")
    right_joints: tuple[str, ...] = joint_tags("right_joint")

    @property
    def driven_joints(self) -> tuple[str, ...]:
        """Joints of wheels that it turns."""
        return (*self.left_joints, *self.right_joints)


@dataclass(frozen=True, eq=False, repr=False)
class MecanumDrive(LimitedDrive):
    """Drives mecanum wheels at four corners by velocity commands."""

    front_left_joints: tuple[str, ...] = joint_tags("front_left_joint")
    front_right_joints: tuple[str, ...] = joint_tags("front_right_joint")
    back_left_joints: tuple[str, ...] = joint_tags("back_left_joint")
    back_right_joints: tuple[str, ...] = joint_tags("back_right_joint")

    # Distance of the axles [m].
    wheelbase: float = 1.0

    @property
    def corners(self) -> tuple[tuple[str, ...], ...]:
        """The joints of each corner: front left, front right, back left, back right."""
        front = (self.front_left_joints, self.front_right_joints)
        return (*front, self.back_left_joints, self.back_right_joints)

    @property
    def driven_joints(self) -> tuple[str, ...]:
        """Joints of wheels that it turns."""
        return tuple(joint for corner in self.corners for joint in corner)


@dataclass(frozen=True, eq=False, repr=False)
class AckermannSteering(WheelDrive):
    """Drives wheels by velocity commands, and steers two by their angles."""

    left_joints: tuple[str, ...] = joint_tags("left_joint")
    right_joints: tuple[str, ...] = joint_tags("right_joint")
    left_steering_joints: tuple[str, ...] = joint_tags("left_steering_joint")
    right_steering_joints: tuple[str, ...] = joint_tags("right_steering_joint")

    # Distances of the steering joints from each other, and of the axles [m].
    kingpin_width: float = 0.8
    wheel_base: float = 1.0

    # Largest angle of steering [rad].
    steering_limit: float = 0.5

    # Velocity of a steering joint per error of its angle; the limits of the integral
    # term and of the velocity [rad/s].
    steer_p_gain: float = 1.0
    steer_i_gain: float = 0.0
    steer_d_gain: float = 0.0
    steer_i_max: float = 0.0
    steer_i_min: float = 0.0
    steer_cmd_max: float = 1000.0
    steer_cmd_min: float = -1000.0
    steer_cmd_offset: float = 0.0

    # Whether it steers alone, by the angle of "/model/<model>/steer_angle" [rad].
    steering_only: bool = False

    # With a number of the actuator it steers alone, too; -1 is none.
    use_actuator_msg: bool = False
    actuator_number: int = -1

    # Empty, or the end of "/model/<model>/<sub_topic>".
    sub_topic: str = ""

    @property
    def is_steering_alone(self) -> bool:
        """Whether it leaves the wheels alone."""
        return self.steering_only or (
            self.use_actuator_msg and self.actuator_number >= 0
        )

    @property
    def driven_joints(self) -> tuple[str, ...]:
        """Joints of wheels that it turns."""
        if self.is_steering_alone:
            return ()
        return (*self.left_joints, *self.right_joints)

    @property
    def steered_joints(self) -> tuple[str, ...]:
        """Joints by which it steers."""
        return (*self.left_steering_joints, *self.right_steering_joints)

    def needs(self, field: str) -> bool:
        """Return whether it does nothing without joints in a field of joints."""
        is_of_wheels = field in ("left_joints", "right_joints")
        return not (is_of_wheels and self.is_steering_alone)


@dataclass(frozen=True, eq=False, repr=False, init=False, kw_only=True)
class ClassicDrive(ClassicBase):
    """One that turns wheels."""

    publish_wheel_tf: bool = False

    # The links that each wheel's joint connects, in Gazebo's order.
    wheel_links: tuple[tuple[str, str], ...] = tags()


@dataclass(frozen=True, eq=False, repr=False)
class GazeboRosDiffDrive(ClassicDrive):
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

    # 0 is the wheels' encoders, 1 the world.
    odometry_source: int = 1

    @property
    def driven_joints(self) -> tuple[str, ...]:
        """Joints of wheels that it turns."""
        return (*self.left_joints, *self.right_joints)

    @property
    def steered_joints(self) -> tuple[str, ...]:
        """Joints by which it steers: none."""
        return ()

    @property
    def separations(self) -> tuple[float, ...]:
        """Distance of the wheels of each pair [m]."""
        return self._per_pair(self.wheel_separation, 0.34)

    @property
    def radii(self) -> tuple[float, ...]:
        """Radius of the wheels of each pair [m]."""
        return tuple(d / 2.0 for d in self._per_pair(self.wheel_diameter, 0.15))

    def _per_pair(self, values: tuple[float, ...], default: float) -> tuple[float, ...]:
        pairs = max(1, self.num_wheel_pairs)
        return (*values, *(default,) * pairs)[:pairs]


def _named_joint(name: str) -> Any:
    """Return a field of joints, by default the one that is named as the tag."""
    return joint_tags(name, default=(name,))


@dataclass(frozen=True, eq=False, repr=False)
class GazeboRosAckermannDrive(ClassicDrive):
    """Drives rear wheels and steers by the forces of PIDs, in Gazebo Classic."""

    front_right_joints: tuple[str, ...] = _named_joint("front_right_joint")
    front_left_joints: tuple[str, ...] = _named_joint("front_left_joint")
    rear_right_joints: tuple[str, ...] = _named_joint("rear_right_joint")
    rear_left_joints: tuple[str, ...] = _named_joint("rear_left_joint")
    right_steering_joints: tuple[str, ...] = _named_joint("right_steering_joint")
    left_steering_joints: tuple[str, ...] = _named_joint("left_steering_joint")
    steering_wheel_joints: tuple[str, ...] = _named_joint("steering_wheel_joint")

    # Largest speed [m/s], and angles of the front wheels and the steering wheel [rad].
    max_speed: float = 20.0
    max_steer: float = 0.6
    max_steering_angle: float = 7.85

    # Gains p, i and d, and the smallest and the largest integral term; empty is 0.
    right_steering_pid_gain: tuple[float, ...] = ()
    right_steering_i_range: tuple[float, ...] = ()
    left_steering_pid_gain: tuple[float, ...] = ()
    left_steering_i_range: tuple[float, ...] = ()
    linear_velocity_pid_gain: tuple[float, ...] = ()
    linear_velocity_i_range: tuple[float, ...] = ()

    publish_distance: bool = False

    # Of the wheels' shapes to collide with, joints at 0: radius of the right one at
    # the rear, distance of those in front, of the axles [m].
    wheel_radius: float = tags(default=0.0)
    wheel_separation: float = tags(default=0.0)
    wheel_base: float = tags(default=0.0)

    @property
    def driven_joints(self) -> tuple[str, ...]:
        """Joints of wheels that it turns."""
        return (*self.rear_right_joints, *self.rear_left_joints)

    @property
    def steered_joints(self) -> tuple[str, ...]:
        """Joints by which it steers."""
        return (*self.right_steering_joints, *self.left_steering_joints)

    @property
    def all_joints(self) -> tuple[str, ...]:
        """All its joints in Gazebo's order."""
        front = (*self.front_right_joints, *self.front_left_joints)
        moved = (*self.driven_joints, *self.steered_joints)
        return (*front, *moved, *self.steering_wheel_joints)

    def needs(self, field: str) -> bool:
        """Return whether it does nothing without joints in a field of joints."""
        return field != "steering_wheel_joints"


# Those that the simulator stands in for, by what they are for.
KINDS: Mapping[str, type[JointPlugin]] = {
    "ros2_control": Ros2ControlPlugin,
    "joint_position_controller": JointPositionController,
    "joint_controller": JointController,
    "apply_joint_force": ApplyJointForce,
    "joint_trajectory_controller": JointTrajectoryController,
    "joint_state_publisher": JointStatePublisher,
    "diff_drive": DiffDrive,
    "mecanum_drive": MecanumDrive,
    "ackermann_steering": AckermannSteering,
    "velocity_control": VelocityControl,
    "odometry_publisher": OdometryPublisher,
    "gazebo_ros_joint_state_publisher": GazeboRosJointStatePublisher,
    "gazebo_ros_joint_pose_trajectory": GazeboRosJointPoseTrajectory,
    "gazebo_ros_diff_drive": GazeboRosDiffDrive,
    "gazebo_ros_planar_move": GazeboRosPlanarMove,
    "gazebo_ros_ackermann_drive": GazeboRosAckermannDrive,
}


@dataclass(frozen=True)
class ContactSensorTag:
    """A contact sensor."""

    name: str

    link: str

    # The shapes that it feels with, "<link>::<shape>".
    shapes: tuple[str, ...]

    # Topic that its tag names; empty is Gazebo's default.
    topic: str = ""

    # Whether Gazebo Classic's plugin publishes what it feels.
    is_classic: bool = False

    # Link in whose frame that is told; empty is the world's.
    frame: str = ""

    namespace: str = ""
    remappings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Noise:
    """Gaussian noise of a sensor, in its unit; a camera's is of colours from 0 to 1."""

    mean: float = 0.0
    stddev: float = 0.0

    # Of an error that a sensor has all the time, to either side; a camera has none.
    bias_mean: float = 0.0
    bias_stddev: float = 0.0

    # The sensor tells multiples of it; 0 is any.
    precision: float = 0.0

    # Of an IMU's error that wanders about 0: how fast, in its unit per square root of
    # a second, and how long it lasts [s]; 0 is none.
    dynamic_bias_stddev: float = 0.0
    dynamic_bias_correlation_time: float = 0.0


@dataclass(frozen=True)
class ImuSensorTag:
    """An inertial measurement unit."""

    name: str

    # Link that carries it, and its pose there: x, y, z [m], roll, pitch, yaw [rad].
    link: str
    pose: tuple[float, float, float, float, float, float] = (0.0,) * 6

    # Link of which that one is part in Gazebo, if it is; Gazebo's names contain it.
    merged: str = ""

    # [Hz]; 0 is every tick.
    update_rate: float = 0.0

    # Topic that its tag names; empty is Gazebo's default.
    topic: str = ""

    # Frame that its messages name; empty is Gazebo's default.
    frame_id: str = ""

    # Of the angular velocity [rad/s] along x, y and z, and of the linear acceleration
    # [m/s^2].
    noise: tuple[Noise, ...] = (Noise(),) * 6

    has_orientation: bool = True

    # Frame in which it tells orientations: roll, pitch, yaw in the world [rad]; None is
    # its own as it is at the start.
    reference: tuple[float, float, float] | None = None

    # Whether Gazebo Classic's plugin publishes it, and the name of that.
    is_classic: bool = False
    node: str = ""

    namespace: str = ""
    remappings: tuple[str, ...] = ()


def shape_name(link: str, number: int) -> str:
    """Return what the n-th collision shape of a link is called, from 0 on."""
    return f"{link}_collision" + (f"_{number}" if number else "")
