"""What a robot offers its controllers."""

import dataclasses as dc
from collections.abc import Callable, Collection, Mapping, Sequence

from arm_drake import interfaces
from arm_drake.control.admittance import ChainKinematics


@dc.dataclass(frozen=True)
class Surroundings:
    """What a robot offers its controllers."""

    # URDF type of every movable joint.
    joint_types: Mapping[str, str]

    # Names of all interfaces, such as "joint1/position", in the order of the file.
    command_interfaces: tuple[str, ...]
    state_interfaces: tuple[str, ...]

    # Initial positions by joint [rad] or [m].
    initial_positions: Mapping[str, float]

    # Initial values of the state interfaces that the physics doesn't know. They stay,
    # or follow the command interface of the same name.
    stored: Mapping[str, float] = dc.field(default_factory=dict)

    # Joints that the physics moves as they are commanded, by one controller at a time.
    driven: frozenset[str] = frozenset()

    # Name of the `<ros2_control>` block that an interface belongs to.
    blocks: Mapping[str, str] = dc.field(default_factory=dict)

    # What `<ros2_control>` blocks name: "joint", "sensor" or "gpio", by name.
    components: Mapping[str, str] = dc.field(default_factory=dict)

    # State interfaces that hold anything but a double, such as a bool.
    other_types: frozenset[str] = frozenset()

    # State interfaces that sensors measure, in the order of their readings.
    sensed: tuple[str, ...] = ()

    # Whether states come from physics, not from commands.
    has_physics: bool = True

    # Why the hardware can't start and stop these command interfaces, "" if it can; None
    # if it always can.
    refuse: Callable[[Collection[str], Collection[str]], str] | None = None

    # URDF velocity limit of joints [rad/s] or [m/s]; others have none.
    velocity_limits: Mapping[str, float] = dc.field(default_factory=dict)

    # URDF effort limit of joints [N·m] or [N]; others have none.
    effort_limits: Mapping[str, float] = dc.field(default_factory=dict)

    # Of each mimic joint: the joint that it follows in the end, and how far it moves
    # per unit of it.
    followed: Mapping[str, tuple[str, float]] = dc.field(default_factory=dict)

    # Where grippers' joints are open and where closed [rad] or [m].
    gripper_ranges: Mapping[str, tuple[float, float]] = dc.field(default_factory=dict)

    # Namespace of the robot's nodes; empty at the root.
    namespace: str = ""

    # Names of the links, of the robot and of the world.
    links: tuple[str, ...] = ()
    robot_name: str = ""
    world_name: str = "empty"

    # Returns the kinematics of joints, seen from a link; None if it isn't known.
    make_kinematics: Callable[[Sequence[str], str], ChainKinematics] | None = None

    @property
    def measured(self) -> tuple[str, ...]:
        """Order of the vector of everything that is measured."""
        joints = interfaces.interface_names(
            self.joint_types, interfaces.STATE_INTERFACES
        )
        return (*joints, *self.sensed, *self.stored)
