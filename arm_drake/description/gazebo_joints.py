"""Gazebo plugins that move joints or report them, with their fields and defaults.

Those that drive bases are in gazebo_drives.

Sources of the fields and of their defaults:

- gz-sim: src/systems/joint_position_controller/JointPositionController.{hh,cc},
  joint_controller/JointController.{hh,cc}, joint_trajectory_controller/
  JointTrajectoryController.{hh,cc}, joint_state_publisher/JointStatePublisher.{hh,cc}
- gazebo_ros_pkgs, branch ros2: gazebo_plugins/src/gazebo_ros_joint_state_publisher.cpp,
  gazebo_ros_joint_pose_trajectory.cpp
- gz_ros2_control: gz_ros2_control_plugin.cpp; gazebo_ros2_control:
  gazebo_ros2_control_plugin.cpp
"""

import dataclasses as dc

from arm_drake.description.gazebo_plugins import joint_tags, tags


@dc.dataclass(frozen=True)
class Ros2ControlPlugin:
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


@dc.dataclass(frozen=True)
class JointPositionController:
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


@dc.dataclass(frozen=True)
class JointController:
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


@dc.dataclass(frozen=True)
class JointTrajectoryController:
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


@dc.dataclass(frozen=True)
class JointStatePublisher:
    """Publishes the states of joints in every step."""

    # Empty: all joints.
    joint_names: tuple[str, ...] = joint_tags("joint_name")

    # Empty: "/world/<world>/model/<model>/joint_state".
    topic: str = ""


@dc.dataclass(frozen=True)
class GazeboRosJointStatePublisher:
    """Publishes the states of joints on "joint_states", in Gazebo Classic."""

    joint_names: tuple[str, ...] = joint_tags("joint_name")

    # [Hz]; 0 is every step.
    update_rate: float = 100.0

    namespace: str = tags("ros/namespace", default="")
    remappings: tuple[str, ...] = tags("ros/remapping", "ros/argument")


@dc.dataclass(frozen=True)
class GazeboRosJointPoseTrajectory:
    """Sets joints to the points of "set_joint_trajectory", in Gazebo Classic."""

    # [Hz]; 0 is every step.
    update_rate: float = 100.0

    namespace: str = tags("ros/namespace", default="")
    remappings: tuple[str, ...] = tags("ros/remapping", "ros/argument")
