"""``forward_command_controller`` and the groups of `position_controllers` and others.

Source: ros2_controllers, `forward_command_controller`, `position_controllers`,
`velocity_controllers`, `effort_controllers` (version 6.9.0 and jazzy).
"""

import dataclasses as dc
from typing import Literal

from arm_drake import interfaces
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.controllers.forward_controllers_base import ForwardControllersBase
from arm_drake.description.validation import check_not_empty, check_unique


@dc.dataclass(frozen=True)
class JointGroupControllerParameters:
    """Parameters of a JointGroup{Position,Velocity,Effort}Controller."""

    # Joints to command, in the order of the values; at least one, unique.
    joints: tuple[str, ...]

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "joints")
        check_unique(self, "joints")


@dc.dataclass(frozen=True)
class ForwardCommandControllerParameters:
    """Parameters of a ForwardCommandController."""

    # Joints to command, in the order of the values; at least one, unique.
    joints: tuple[str, ...]

    # Interface to claim on each joint.
    interface_name: str

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "joints", "interface_name")
        check_unique(self, "joints")


@dc.dataclass(frozen=True)
class MultiInterfaceForwardCommandControllerParameters:
    """Parameters of a MultiInterfaceForwardCommandController."""

    # Joint to command.
    joint: str

    # Interfaces to claim on it, in the order of the values; at least one, unique.
    interface_names: tuple[str, ...]

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, "joint", "interface_names")
        check_unique(self, "interface_names")


class ForwardCommandController(ForwardControllersBase):
    """Writes the values of a topic to one command interface of several joints.

    .. pydrake_system::

        name: ForwardCommandController
        input_ports:
        - controller_manager
        - state_interfaces
        - commands
        output_ports:
        - command_interfaces
        - events

    With k = len(joints), vectors in the order of ``joints``:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  not read
    commands            --    --       Float64MultiArray of k values
    command_interfaces  --    --       Tick; its command is (k,), in rad, rad/s or N·m
    events              --    --       tuple of the latest (number, TopicRejected), the
                                       newest last
    ==================  ====  =======  =================================================

    The state is a ForwardCommandState. The last message holds for ever, or until the
    controller is deactivated; an empty one takes it back and leaves the commands as
    they are. With one of another size every tick fails and nothing is written.

    A message with a value that isn't finite is dropped. Humble writes all of it; here
    its finite values are written, and the other commands stay as they are, for no
    hardware can follow them.
    """

    def __init__(
        self,
        parameters: ForwardCommandControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The controller's parameters.
            params: Rate and surroundings of the controller.
        """
        names = (parameters.interface_name,)
        super().__init__(interfaces.interface_names(parameters.joints, names), params)


class MultiInterfaceForwardCommandController(ForwardControllersBase):
    """Writes the values of a topic to several command interfaces of one joint.

    .. pydrake_system::

        name: MultiInterfaceForwardCommandController
        input_ports:
        - controller_manager
        - state_interfaces
        - commands
        output_ports:
        - command_interfaces
        - events

    Vectors are in the order of ``interface_names``, k of them:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  not read
    commands            --    --       Float64MultiArray of k values
    command_interfaces  --    --       Tick; its command is (k,), in rad, rad/s or N·m
    events              --    --       tuple of the latest (number, TopicRejected)
    ==================  ====  =======  =================================================

    All else is as in ForwardCommandController.
    """

    def __init__(
        self,
        parameters: MultiInterfaceForwardCommandControllerParameters,
        params: ControllerInterfaceParams,
    ) -> None:
        """Create the system.

        Args:
            parameters: The controller's parameters.
            params: Rate and surroundings of the controller.
        """
        joints, names = (parameters.joint,), parameters.interface_names
        super().__init__(interfaces.interface_names(joints, names), params)


class JointGroupController(ForwardControllersBase):
    """Writes the values of a topic to the joints' positions, velocities or efforts.

    It is `position_controllers/JointGroupPositionController` and those of velocities
    and efforts; these two write 0 when they are deactivated.

    .. pydrake_system::

        name: JointGroupController
        input_ports:
        - controller_manager
        - state_interfaces
        - commands
        output_ports:
        - command_interfaces
        - events

    With k = len(joints), vectors in the order of ``joints``:

    ==================  ====  =======  =================================================
    port                size  unit     meaning
    ==================  ====  =======  =================================================
    controller_manager  --    --       Cycle: when to tick
    state_interfaces    2J    rad, ..  not read
    commands            --    --       Float64MultiArray of k values
    command_interfaces  --    --       Tick; its command is (k,), in rad, rad/s or N·m
    events              --    --       tuple of the latest (number, TopicRejected)
    ==================  ====  =======  =================================================

    All else is as in ForwardCommandController.
    """

    def __init__(
        self,
        parameters: JointGroupControllerParameters,
        params: ControllerInterfaceParams,
        *,
        interface: Literal["position", "velocity", "effort"],
    ) -> None:
        """Create the system.

        Args:
            parameters: The controller's parameters.
            params: Rate and surroundings of the controller.
            interface: What it commands of each joint.
        """
        claims = interfaces.interface_names(parameters.joints, (interface,))
        super().__init__(claims, params, stops=interface != interfaces.POSITION)
