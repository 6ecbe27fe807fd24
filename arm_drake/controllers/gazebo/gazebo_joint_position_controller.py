"""Gazebo's JointPositionController, all of a robot's at once.

Source: gz-sim, src/systems/joint_position_controller/JointPositionController.cc.
"""

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.gazebo.gazebo_topics import position_topic
from arm_drake.controllers.gazebo.joint_controllers import GazeboCommandBase
from arm_drake.controllers.gazebo.plugin import GazeboPidState
from arm_drake.description.gazebo_joints import (
    JointPositionController as JointPositionControllerTag,
)


class JointPositionController(GazeboCommandBase):
    """Takes joints to positions that come on topics, by force or by velocity.

    .. pydrake_system::

        name: JointPositionController
        input_ports:
        - controller_manager
        - state_interfaces
        - /<topic>
        - gripper_command
        output_ports:
        - command_interfaces
        - events

    With n tags, J joints and k joints that carry forces or have velocities:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  positions and velocities of all joints, or more
    /<topic>            --    --       one for each topic of the tags: Float64, the
                                       position [rad] or [m] from now on
    gripper_command     --    --       Float32: from 0 (open) to 1 (closed); there only
                                       if a tag moves a gripper of which it is known
                                       what that is
    command_interfaces  --    --       Tick; its command is (k,), in N·m, rad/s, ..
    events              --    --       tuple of the latest (number, TopicRejected), the
                                       newest last
    ==================  ====  =======  =================================================

    The state is a JointCommandState, renewed in every tick. Of each tag, with the
    position q of its first joint and the target r, which is ``initial_position`` until
    a message comes::

        error = q - r
        force = pid(error)                               GazeboPid.step
        velocity = clamp(-error / dt, ±cmd_max)          with use_velocity_commands

    All joints of a tag get the same. Gazebo steps the PID once more for each further
    joint, which multiplies its integral and leaves the derivative to the first one. It
    limits no velocity where the tag has no ``cmd_max``; here the default of 1000 does.

    The force at a joint is limited by the joint's effort limit. That at a mimic joint
    acts on its master, see JointForces; a tag for velocities leaves a mimic joint to
    its master. Of two tags with the same joint the last one moves it. An activation
    starts from the tags' initial values; when it ends, efforts and velocities are 0.
    """

    def __init__(
        self,
        tags: tuple[JointPositionControllerTag, ...],
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            tags: Fields of all plugins of this kind, in the order of the description.
            params: Rate and surroundings of the controller.
        """
        self._cmd_max = np.array([tag.cmd_max for tag in tags])
        super().__init__(
            tags,
            params,
            topics=[position_topic(tag, params.robot_name) for tag in tags],
            targets=[tag.initial_position for tag in tags],
            by_force=[not tag.use_velocity_commands for tag in tags],
            read=interfaces.POSITION,
            grips=_find_grips(tags, params),
        )

    def _step(
        self, pid: GazeboPidState, measured: Array, targets: Array, dt: float
    ) -> tuple[GazeboPidState, Array]:
        error = measured - targets
        pid, values = self._pid.step(pid, error, dt)
        if self._moved_by.size:
            velocity = -error / dt
            limited = np.where(error < 0.0, self._cmd_max, -self._cmd_max)
            is_far = np.abs(error) > self._cmd_max * dt
            velocity = np.where(is_far, limited, velocity)
            values = np.where(self._by_force, values, velocity)
        return pid, values


def _find_grips(
    tags: tuple[JointPositionControllerTag, ...], params: ControllerInterfaceParams
) -> dict[int, tuple[float, float]]:
    """Return where a gripper is open and closed, by the tags that move its joints."""
    grips = {}
    for index, tag in enumerate(tags):
        joint = tag.joint_names[0]
        master, multiplier = params.followed.get(joint, (joint, 1.0))
        if master in params.gripper_ranges:
            is_open, is_closed = params.gripper_ranges[master]
            grips[index] = (multiplier * is_open, multiplier * is_closed)
    return grips
