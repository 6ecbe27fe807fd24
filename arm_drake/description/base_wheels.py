"""Wheels of mobile bases: joints that drive and steer them, axles they lack, rollers.

Descriptions made for RViz may end at the steering joint: the wheel is part of the link
that it turns, and on a ground it is a brake. Or one joint turns two wheels of an axle,
of which in a curve one would have to be faster. In the plant such wheels get a part
that turns about the wheel's axis: freely if it is steered, and through a differential,
one against the other, if it is driven.

Wheels of mecanum and omni bases are plain, and simulators go with friction in one
direction, which Drake's contact doesn't know. So in the plant a wheel gets what it has
in truth: rollers at its rim, each of which turns freely. The description, and so joint
states and frames, stays as it is.
"""

import dataclasses as dc
import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Final

import numpy as np

from arm_drake.arrays import Array
from arm_drake.description.claimed_hardware import (
    STEERING,
    WHEEL_PARAMETERS,
    claims_by,
    humble_wheel_parameters,
    texts_of,
)
from arm_drake.description.controllers import ControllerConfig, ControllerManagerConfig
from arm_drake.description.gazebo_plugins import (
    BaseHolder,
    GazeboRosAckermannDrive,
    GazeboRosDiffDrive,
    MecanumDrive,
    WheelDrive,
)
from arm_drake.description.inertia import (
    in_link_axes,
    link_solid,
    placed_solid,
    take_mass,
)
from arm_drake.description.joints import (
    JointInfo,
    Mimic,
    joints_above,
    last_master,
)
from arm_drake.description.links import (
    Geometry,
    LinkInfo,
    Origin,
    ShapeInfo,
    Transform,
    Vector,
)
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import RobotDescription, total_mass
from arm_drake.importing import dataclass
from arm_drake.interfaces import EFFORT, VELOCITY


@dataclass(frozen=True)
class MobileBase:
    """A base as one controller drives it."""

    # Name of the controller.
    controller: str

    # Joints that it drives, and joints that it steers, as its parameters order them.
    driven: tuple[str, ...]
    steered: tuple[str, ...]

    # Link whose odometry the controller publishes.
    link: str

    # Of driven wheels that have rollers: how far the axis of a roller that touches the
    # ground points to the right, per way forwards; else empty.
    slants: tuple[float, ...] = ()

    # What the controller says of their radius [m].
    wheel_radius: float = 0.0


def find_bases(
    description: RobotDescription, config: ControllerManagerConfig
) -> tuple[MobileBase, ...]:
    """Return the bases that controllers and Gazebo's plugins drive.

    Joints that the description lacks are left out: their controllers don't load.
    """
    bases = []
    joints = {joint.name for joint in description.movable_joints}
    followers = {controller.name for controller in config.controllers}
    for controller in config.controllers:
        tags = [
            tag
            for tag in controller.plugins
            if isinstance(
                tag, WheelDrive | GazeboRosDiffDrive | GazeboRosAckermannDrive
            )
        ]
        for tag in tags:
            driven, steered = (
                tuple(n for n in dict.fromkeys(names) if n in joints)
                for names in (tag.driven_joints, tag.steered_joints)
            )
            link = tag.base_link or description.base
            base = MobileBase(controller.name, driven, steered, link)
            if isinstance(tag, MecanumDrive):
                by_joint = {
                    joint: slant
                    for corner, slant in zip(tag.corners, _CORNERS, strict=True)
                    for joint in corner
                }
                base = dc.replace(
                    base,
                    slants=tuple(by_joint[joint] for joint in driven),
                    wheel_radius=tag.wheel_radius,
                )
            bases.append(base)
        bases += [
            MobileBase(controller.name, (), (), tag.base_link or description.base)
            for tag in controller.plugins
            if isinstance(tag, BaseHolder)
        ]
        if controller.type in WHEEL_PARAMETERS:
            bases.append(
                _base_by_parameters(description, controller, joints, followers)
            )
    known = {joint for base in bases for joint in base.driven}
    for controller in config.controllers:
        if controller.type in WHEEL_PARAMETERS:
            continue
        wheels = _claimed_wheels(description, controller)
        if not known.issuperset(wheels):
            bases.append(MobileBase(controller.name, wheels, (), description.base))
    return tuple(bases)


def _base_by_parameters(
    description: RobotDescription,
    controller: ControllerConfig,
    joints: Collection[str],
    followers: Collection[str],
) -> MobileBase:
    """Return the base that the parameters of a controller say that it drives.

    A joint that it commands through a controller of `followers` has that one's name in
    front.
    """
    parameters = WHEEL_PARAMETERS[controller.type]
    if parameters is STEERING:
        older = humble_wheel_parameters(controller)
        parameters = tuple((*a, b) for a, b in zip(STEERING, older, strict=True))
    driven, steered = (
        tuple(
            joint
            for joint in dict.fromkeys(
                _joint_behind(name, followers) for name in texts_of(controller, *names)
            )
            if joint in joints
        )
        for names in parameters
    )
    frame = next(
        (controller.parameters[n] for n in _FRAMES if n in controller.parameters), None
    )
    link = "base_link" if frame is None else str(frame.value)
    if link not in description.links:
        link = description.base
    slants, radius = _rollers_by_parameters(controller, len(driven))
    return MobileBase(controller.name, driven, steered, link, slants, radius)


def _joint_behind(name: str, followers: Collection[str]) -> str:
    """Return the joint of a name such as `pid/wheel`, if `pid` is a controller."""
    follower, _, joint = name.partition("/")
    return joint if follower in followers else name


# Parameters with the frame of the base.
_FRAMES: Final = ("base_frame_id", "base_footprint")

# The part of a wheel's axis that may point up: a cosine.
_LEVEL = 0.1


def _claimed_wheels(
    description: RobotDescription, controller: ControllerConfig
) -> tuple[str, ...]:
    """Return the wheels that a controller of joints turns, at least two, or none.

    A wheel is the last link behind a joint without limits, on the base or on what is
    steered, whose axis is level, and it reaches as low as all that carries it. The
    rollers of a conveyor or in the gripper of an arm don't.
    """
    joints = {joint.name: joint for joint in description.movable_joints}
    parents = {joint.parent for joint in joints.values()}
    wheels = tuple(
        dict.fromkeys(
            name
            for name, interface in claims_by(controller)
            if interface in (VELOCITY, EFFORT)
            and name in joints
            and _is_wheel(description, joints[name], parents)
        )
    )
    return wheels if len(wheels) > 1 else ()


def _is_wheel(
    description: RobotDescription, joint: JointInfo, parents: Collection[str]
) -> bool:
    """Return whether a joint turns a wheel; `parents` are links that carry joints."""
    above = joints_above(description.joints, joint.parent)
    if joint.type != "continuous" or any(each.type == "continuous" for each in above):
        return False
    if not set(parents).isdisjoint(rigid_links(description, joint.child)):
        return False
    X = pose_in_root(description, joint.child)
    if abs(float((X.rotation @ joint.unit_axis)[2])) >= _LEVEL:
        return False
    bottom = _lowest(description, rigid_links(description, joint.child))
    if not math.isfinite(bottom):
        return False  # Without a shape to collide with it can't roll.
    radius = X.position[2] - bottom
    carriers = {
        link for j in (joint, *above) for link in rigid_links(description, j.parent)
    }
    return bool(bottom < _lowest(description, carriers) + _BESIDE_GROUND * radius)


# How far above the lowest point of its robot a wheel may end, per radius: casters and
# skids are rarely as low as wheels, and the height of round shapes is an estimate.
_BESIDE_GROUND = 0.5


def _lowest(description: RobotDescription, links: Iterable[str]) -> float:
    """Return about how low links reach in their root, joints at 0 [m]; inf if nowhere.

    Each shape to collide with counts as a box of the same moments.
    """
    lowest = math.inf
    for name in links:
        X = pose_in_root(description, name)
        up = X.rotation[2]
        for shape in description.link(name).collisions:
            if (solid := placed_solid(shape)) is None:
                continue
            middle = X.position[2] + up @ solid.center
            inertia = solid.inertia
            second = np.trace(inertia) / 2.0 - up @ inertia @ up
            half = math.sqrt(3.0 * max(0.0, float(second)) / solid.mass)
            lowest = min(lowest, float(middle) - half)
    return lowest


def _rollers_by_parameters(
    controller: ControllerConfig, number: int
) -> tuple[tuple[float, ...], float]:
    """Return slants and radius [m] of wheels with rollers; () if there are none."""
    if controller.type not in _RADIUS:
        return (), 0.0
    parameter = controller.parameters.get(_RADIUS[controller.type])
    radius = parameter.value if parameter is not None else 0.0
    if not isinstance(radius, int | float):
        return (), 0.0  # The controller doesn't load, and says why.
    if controller.type != MECANUM:
        return (0.0,) * number, float(radius)
    return (_TO_THE_RIGHT if number == len(_TO_THE_RIGHT) else ()), float(radius)


def moved_joints(description: RobotDescription, joint: str) -> list[JointInfo]:
    """Return a joint, and the mimic joints that follow it."""
    movable = {j.name: j for j in description.movable_joints}
    return [j for j in movable.values() if last_master(j, movable)[0] == joint]


def rigid_links(description: RobotDescription, link: str) -> list[str]:
    """Return a link, and those that fixed joints attach to it, directly or not."""
    found = [link]
    for parent in found:
        found += [
            j.child
            for j in description.joints
            if j.type == "fixed" and j.parent == parent
        ]
    return found


def wheel_links(description: RobotDescription, joint: str) -> list[str]:
    """Return the links of the wheels that a joint drives, mimic joints included."""
    return [
        link
        for moved in moved_joints(description, joint)
        for link in rigid_links(description, moved.child)
    ]


def find_load_inertia(
    description: RobotDescription, bases: Iterable[MobileBase]
) -> dict[str, float]:
    """Return what driven joints move on the ground besides their wheels [kg·m^2].

    That is the robot's mass at the rim of the wheels, shared by the joints of a base.
    Wheels that are neither cylinders nor spheres are left out.
    """
    mass = total_mass(description)
    load_inertia: dict[str, float] = {}
    for base in bases:
        for joint in base.driven:
            radius = max(
                (
                    shape.wheel_radius
                    for name in wheel_links(description, joint)
                    for shape in description.link(name).collisions
                ),
                default=0.0,
            )
            if radius > 0.0:
                load_inertia[joint] = mass * radius**2 / len(base.driven)
    return load_inertia


def report_bases(
    description: RobotDescription,
    bases: Iterable[MobileBase],
    report: LoadReport,
) -> None:
    """Record driven wheels that can't touch the ground, or have no friction."""
    file = description.file
    for joint in dict.fromkeys(joint for base in bases for joint in base.driven):
        links = wheel_links(description, joint)
        touching = [name for name in links if description.link(name).collisions]
        if not touching:
            what, where = "a driven wheel without a collision shape", f"joint {joint!r}"
            done = "it doesn't touch the ground; expected <collision> in link "
            done += " or ".join(map(repr, links))
            report.add("error", "invalid", what, done, where=where, file=file)
        for link in touching:
            if description.friction.get(link) == 0.0:
                what = "a driven wheel without friction, <mu1> is 0"
                done = "it spins and drives nothing; expected more than 0, such as 1"
                where = f"link {link!r}"
                report.add("error", "invalid", what, done, where=where, file=file)


def pose_in_root(
    description: RobotDescription, link: str, inside: Transform | None = None
) -> Transform:
    """Return the pose of a link, or of what is inside it, in its root, joints at 0."""
    X = inside or Transform()
    for carrier in joints_above(description.joints, link):
        X = carrier.origin.transform @ X
    return X


def first_collision(
    description: RobotDescription, link: str
) -> tuple[str, ShapeInfo] | None:
    """Return the first shape that a link, or what is fixed to it, collides with."""
    for name in rigid_links(description, link):
        for shape in description.link(name).collisions:
            return name, shape
    return None


# Part of the link's mass that turns; the rest is what holds the axle.
_TURNING = 0.5

# Density of wheels on links without mass [kg/m^3], as of other links.
_DENSITY = 1000.0

# A shape whose axis is closer to the steering joint's is no wheel: a cosine.
_PARALLEL = 0.5

# Axes that differ less have one direction: a cosine.
_SAME_DIRECTION = 0.999


@dataclass(frozen=True, eq=False)
class Axle:
    """Axis of a wheel in the link that it is part of."""

    link: str

    # Centre of the wheel [m], and direction of its axis, in the link. Shapes (3,).
    center: Array
    axis: Array

    # Link of the wheel that turns the other way, if this one has a differential.
    other: str = ""

    @property
    def wheel(self) -> str:
        """Name of the body that turns."""
        return f"{self.link}:wheel"


def find_axles(
    description: RobotDescription, bases: Iterable[MobileBase]
) -> list[Axle]:
    """Return the axles that wheels of a robot with a steered base lack.

    A wheel is a link with a single collision shape, a cylinder or a sphere. One that is
    steered lacks an axle if there is no joint below the steering one. It turns about
    the axis of its cylinder; a sphere turns about what points to the left of the base,
    across the steering joint. Wheels that are driven lack one if a joint and those that
    follow it turn two of them, with axes in one direction.
    """
    steering = [base for base in bases if base.steered]
    if not steering:
        return []
    tree = _Tree(description)
    steered = dict.fromkeys(name for base in steering for name in base.steered)
    driven = dict.fromkeys(name for base in steering for name in base.driven)
    free = [
        axle
        for name in steered
        for joint in moved_joints(description, name)
        for axle in tree.steered_axles(joint)
    ]
    return free + [axle for name in driven for axle in tree.differential(name)]


@dataclass(frozen=True)
class _Tree:
    """Finds the wheels of a robot that lack an axle."""

    description: RobotDescription

    def _rotation(self, link: str) -> Array:
        return pose_in_root(self.description, link).rotation

    def steered_axles(self, joint: JointInfo) -> Iterator[Axle]:
        """Yield the axles that wheels below a steering joint lack."""
        parts = rigid_links(self.description, joint.child)
        below = [j for j in self.description.joints if j.parent in parts]
        if any(j.type != "fixed" for j in below):
            return
        up = self._direction(joint)
        for name in parts:
            shape = self._shape(name)
            if shape is None:
                continue
            center, axis = shape
            if axis is None:
                left = np.array([0.0, 1.0, 0.0])
                axis = left - (left @ up) * up
            if abs(axis @ up) < _PARALLEL < np.linalg.norm(axis):
                yield self._axle(name, center, axis)

    def differential(self, joint: str) -> list[Axle]:
        """Return the axles of two wheels that one joint drives, if it is two."""
        found = []
        for moved in moved_joints(self.description, joint):
            shape = self._shape(moved.child)
            axis = self._direction(moved)
            if shape is not None and (
                shape[1] is None or abs(shape[1] @ axis) > _SAME_DIRECTION
            ):
                found.append((moved.child, shape[0], axis))
        if len(found) != 2 or abs(found[0][2] @ found[1][2]) < _SAME_DIRECTION:
            return []
        first, second = (self._axle(*wheel) for wheel in found)
        return [first, dc.replace(second, other=first.link)]

    def _axle(self, link: str, center: Array, axis: Array) -> Axle:
        """Return the axle of a link about an axis in the root."""
        # A wheel that rolls forwards turns positively.
        length = np.linalg.norm(axis) * (1.0 if axis[1] >= 0.0 else -1.0)
        return Axle(link, center, self._rotation(link).T @ axis / length)

    def _shape(self, name: str) -> tuple[Array, Array | None] | None:
        """Return the centre of a wheel in its link, and its axis in the root.

        The axis is None for a sphere, and all is None for what is no wheel.
        """
        shapes = self.description.link(name).collisions
        if len(shapes) != 1:
            return None
        origin, form = shapes[0].origin, shapes[0].geometry.type
        if form == "cylinder":
            return origin.position, self._rotation(name) @ origin.rotation[:, 2]
        return (origin.position, None) if form == "sphere" else None

    def _direction(self, joint: JointInfo) -> Array:
        """Return the axis of a joint in the root, of length 1."""
        direction: Array = self._rotation(joint.child) @ joint.unit_axis
        return direction


def with_axles(
    description: RobotDescription, axles: Sequence[Axle]
) -> RobotDescription:
    """Return a description with joints for wheels to roll on, after its own.

    It is for the plant: joint states and frames are those of the one before.
    """
    if not axles:
        return description
    links = {link.name: link for link in description.link_infos}
    joints = list(description.joints)
    for axle in axles:
        link = links[axle.link]
        collision, *others = link.collisions
        solid = link_solid(link)
        assert solid is not None
        link, mass = take_mass(link, _TURNING)
        mass = mass or _DENSITY * solid[0].mass
        links[axle.link] = dc.replace(link, collisions=tuple(others))
        collision = dc.replace(collision, origin=Origin(rpy=collision.origin.rpy))
        # In the link's axes, as `link_solid` gives it.
        inertia = solid[0].scaled(mass).inertia
        links[axle.wheel] = LinkInfo(
            axle.wheel, in_link_axes(mass, inertia), collisions=(collision,)
        )
        origin = Origin(_vector(axle.center))
        mimic = Mimic(f"{axle.other}:axle", -1.0, 0.0) if axle.other else None
        joint = _axle(axle.link, axle.wheel, f"{axle.link}:axle", origin, axle.axis)
        joints.append(dc.replace(joint, mimic=mimic))
    infos = tuple(links.values())
    return dc.replace(description, link_infos=infos, joints=tuple(joints))


def _axle(
    parent: str, child: str, name: str, origin: Origin, axis: Iterable[float]
) -> JointInfo:
    """Return a continuous joint from one link to another."""
    axis = _vector(axis)
    return JointInfo(name, "continuous", parent, child, origin=origin, axis=axis)


def _vector(numbers: Iterable[float]) -> Vector:
    x, y, z = map(float, numbers)
    return x, y, z


def report_axles(
    description: RobotDescription, axles: Sequence[Axle], report: LoadReport
) -> None:
    """Record wheels that get an axle."""
    others = {axle.other for axle in axles}
    for axle in axles:
        what = "a steered wheel without a joint to roll on"
        done = "in the physics it turns freely about its axis"
        if axle.other or axle.link in others:
            what = "one joint drives two wheels of an axle"
            done = "in the physics they have a differential"
        where, file = f"link {axle.link!r}", description.file
        report.add("info", "repair", what, done, where=where, file=file)


MECANUM: Final = "mecanum_drive_controller/MecanumDriveController"
OMNI: Final = "omni_wheel_drive_controller/OmniWheelDriveController"

# Parameters with the radius of the wheels [m].
_RADIUS: Final = {MECANUM: "kinematics.wheels_radius", OMNI: "wheel_radius"}

# Slants of mecanum wheels. The order is that of the joints' parameters: front left,
# front right, rear right, rear left.
_TO_THE_RIGHT: Final = (1.0, -1.0, 1.0, -1.0)

# The same in the order of Gazebo's MecanumDrive: front left, front right, back left,
# back right.
_CORNERS: Final = (1.0, -1.0, -1.0, 1.0)

# Rollers of a wheel, and their radius at the middle as part of the wheel's. With these
# the rim is round to 0.1 % of the radius, see `Rollers.semi_axis`.
NUM_ROLLERS: Final = 10
_THICKNESS: Final = 0.25

# A wheel with so many joints of its own has its rollers; one may be an encoder's.
_FEWEST_ROLLERS: Final = 3


@dataclass(frozen=True, eq=False)
class Rollers:
    """The rollers of a wheel."""

    # Link of the wheel, and its radius [m].
    link: str
    radius: float

    # Centre of the wheel [m], in the link. Shape (3,).
    center: Array

    # In the link, of length 1, shapes (3,): the axis of the wheel; down, if the robot
    # stands upright with its joints at 0; the axis of the roller that is down there.
    axis: Array
    down: Array
    roller: Array

    @property
    def wheels(self) -> list[str]:
        """Names of the bodies that turn."""
        return [f"{self.link}:roller{number}" for number in range(NUM_ROLLERS)]

    @property
    def thickness(self) -> float:
        """Radius of a roller at its middle [m]."""
        return _THICKNESS * self.radius

    @property
    def semi_axis(self) -> float:
        """Half the length of a roller, an ellipsoid, along its axis [m].

        It is such that the wheel's centre is as high where two rollers touch the ground
        as where one does with its middle.
        """
        R, r = self.radius, self.thickness
        half = math.pi / NUM_ROLLERS
        # Of the roller's axis, upwards, when the wheel has turned by this angle.
        slope = np.linalg.norm(np.cross(self.roller, self.axis)) * math.sin(half)
        reach = R - (R - r) * math.cos(half)
        return math.sqrt(r**2 + (reach**2 - r**2) / slope**2)


def find_rollers(
    description: RobotDescription, bases: Iterable[MobileBase]
) -> list[Rollers]:
    """Return the rollers that the wheels of mecanum and omni bases lack.

    A wheel whose description has three joints of its own has its rollers. The radius is
    that of the wheel's largest cylinder or sphere to collide with, else what the
    controller says.
    """
    return [
        rollers
        for base in bases
        if base.slants
        for joint, slant in zip(base.driven, base.slants, strict=True)
        for rollers in _rollers_of(
            description, base.link, description.joint(joint), slant, base.wheel_radius
        )
    ]


def _rollers_of(
    description: RobotDescription,
    base: str,
    mover: JointInfo,
    sideways: float,
    radius: float,
) -> Iterator[Rollers]:
    """Yield the rollers of the wheel on a joint, if it lacks them."""
    link = mover.child
    parts = rigid_links(description, link)
    below = [j for j in description.joints if j.parent in parts]
    if sum(j.type != "fixed" for j in below) >= _FEWEST_ROLLERS:
        return
    rim = _find_rim(description, parts, radius)
    if rim is None:
        return
    name, center, radius = rim
    stand = pose_in_root(description, base).inverse()
    # Of the wheel, in the base.
    R_BW = (stand @ pose_in_root(description, name)).rotation
    R_BL = (stand @ pose_in_root(description, link)).rotation
    axis = R_BL @ mover.unit_axis
    left = axis * (-1.0 if axis[1] < 0.0 else 1.0)
    up = np.array([0.0, 0.0, 1.0])
    forward = np.cross(left, up)
    if radius <= 0.0 or np.linalg.norm(forward) < 0.5:
        return
    roller = forward / np.linalg.norm(forward) - sideways * left
    roller /= np.linalg.norm(roller)
    yield Rollers(name, radius, center, R_BW.T @ axis, R_BW.T @ -up, R_BW.T @ roller)


def _find_rim(
    description: RobotDescription, parts: Sequence[str], radius: float
) -> tuple[str, Array, float] | None:
    """Return link, centre [m] and radius [m] of a wheel's largest shape.

    That is a cylinder or sphere; else, with the radius that is given, the middle of
    what its link collides with.
    """
    found: tuple[str, Array, float] | None = None
    for name in parts:
        for shape in description.link(name).collisions:
            own = shape.wheel_radius
            if own > 0.0 and (found is None or own > found[2]):
                found = (name, shape.origin.position, own)
    if found is not None:
        return found
    for name in parts:
        link = description.link(name)
        solid = link_solid(link)
        if link.collisions and solid is not None:
            return name, solid[0].center, radius
    return None


# Part of the wheel's mass that its rollers have.
_PART: Final = 0.25

# Mass of the rollers of a wheel without mass [kg].
_SMALL: Final = 1e-2


def with_rollers(
    description: RobotDescription, rollers: Sequence[Rollers]
) -> RobotDescription:
    """Return a description with the rollers of wheels, after its own links and joints.

    It is for the plant, as that of `with_axles`. The wheels' own shapes to collide with
    are left out.
    """
    if not rollers:
        return description
    links = {link.name: link for link in description.link_infos}
    joints = list(description.joints)
    for wheel in rollers:
        for name in rigid_links(description, wheel.link):
            links[name] = dc.replace(links[name], collisions=())
        links[wheel.link], mass = take_mass(links[wheel.link], _PART)
        mass = (mass or _SMALL) / NUM_ROLLERS
        for number, body in enumerate(wheel.wheels):
            angle = 2.0 * math.pi * number / NUM_ROLLERS
            links[body], joint = _make_roller(wheel, body, angle, mass)
            joints.append(joint)
    infos = tuple(links.values())
    return dc.replace(description, link_infos=infos, joints=tuple(joints))


def _make_roller(
    wheel: Rollers, name: str, angle: float, mass: float
) -> tuple[LinkInfo, JointInfo]:
    """Return a roller where it is when the wheel has turned by an angle."""
    turn = _rotation(wheel.axis, angle)
    axis, out = turn @ wheel.roller, turn @ wheel.down
    place = wheel.center + (wheel.radius - wheel.thickness) * out
    long, thick = wheel.semi_axis, wheel.thickness
    # The ellipsoid's long axis is x. URDF has no ellipsoid; Drake has one.
    shape = ShapeInfo(Geometry("ellipsoid", (long, thick, thick)))
    along, across = 0.4 * mass * thick**2, 0.2 * mass * (thick**2 + long**2)
    yaw, pitch = math.atan2(axis[1], axis[0]), math.asin(-max(-1.0, min(1.0, axis[2])))
    inertial = in_link_axes(mass, np.diag([along, across, across]))
    link = LinkInfo(name, inertial, collisions=(shape,))
    origin = Origin(_vector(place), (0.0, pitch, yaw))
    return link, _axle(wheel.link, name, f"{name}:axle", origin, (1.0, 0.0, 0.0))


def report_rollers(
    description: RobotDescription, rollers: Sequence[Rollers], report: LoadReport
) -> None:
    """Record wheels that get rollers."""
    what = "a wheel of a base that goes sideways, without rollers"
    done = f"in the physics it has {NUM_ROLLERS} that turn freely"
    for wheel in rollers:
        where, file = f"link {wheel.link!r}", description.file
        report.add("info", "repair", what, done, where=where, file=file)


def _rotation(axis: Array, angle: float) -> Array:
    """Return the matrix of a turn about an axis of length 1."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: Array = np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K
    return turn
