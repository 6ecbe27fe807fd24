"""Gazebo's JointController, all of a robot's at once.

Source: gz-sim, src/systems/joint_controller/JointController.cc.
"""

import numpy as np

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.gazebo.gazebo_topics import velocity_topic
from arm_drake.controllers.gazebo.joint_controllers import GazeboCommandBase
from arm_drake.controllers.gazebo.plugin import GazeboPidState
from arm_drake.description.gazebo_joints import JointController as JointControllerTag


class JointController(GazeboCommandBase):
    """Moves joints at velocities that come on topics.

    .. pydrake_system::

        name: JointController
        input_ports:
        - controller_manager
        - state_interfaces
        - /<topic>
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
                                       velocity [rad/s] or [m/s] from now on
    command_interfaces  --    --       Tick; its command is (k,), in N·m, rad/s, ..
    events              --    --       tuple of the latest (number, TopicRejected), the
                                       newest last
    ==================  ====  =======  =================================================

    The state is a JointCommandState, renewed in every tick. A tag commands its target
    r, which is ``initial_velocity`` until a message comes; with ``use_force_commands``
    it commands a force instead, with the velocity v of its first joint::

        force = pid(v - r)                               GazeboPid.step

    With ``disable_braking`` a joint runs free that is faster than r, in r's direction,
    or whose r is 0: there is no force, and the PID stays as it is.

    All else is as in JointPositionController: several joints of a tag, effort limits,
    mimic joints, activations.
    """

    def __init__(
        self,
        tags: tuple[JointControllerTag, ...],
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            tags: Fields of all plugins of this kind, in the order of the description.
            params: Rate and surroundings of the controller.
        """
        self._may_run_free = np.array([tag.disable_braking for tag in tags], dtype=bool)
        super().__init__(
            tags,
            params,
            topics=[velocity_topic(tag, params.robot_name) for tag in tags],
            targets=[tag.initial_velocity for tag in tags],
            by_force=[tag.use_force_commands for tag in tags],
            read=interfaces.VELOCITY,
        )

    def _step(
        self, pid: GazeboPidState, measured: Array, targets: Array, dt: float
    ) -> tuple[GazeboPidState, Array]:
        if not self._by_force.any():
            return pid, targets
        error = measured - targets
        pushes = None
        if self._may_run_free.any():
            is_fast = (np.sign(targets) * error > 0.0) | (targets == 0.0)
            pushes = ~(self._may_run_free & is_fast)
        pid, force = self._pid.step(pid, error, dt, where=pushes)
        return pid, np.where(self._by_force, force, targets)
