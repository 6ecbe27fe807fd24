"""Joints of a robot: whether they make a robot with its links, and which follow others.

Newer ros2_control takes the URDF's `<mimic>`, unless the joint in the block has
`mimic="false"`. Up to Humble, a block's joint had the parameters `mimic` and
`multiplier` instead. Either way a joint that follows takes no commands.
"""

import dataclasses as dc
import itertools
import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from arm_drake.arrays import Array
from arm_drake.description.elements import (
    ElementReader,
    parse_number,
    quote_attribute,
)
from arm_drake.description.links import (
    Origin,
    Vector,
    read_numbers,
    read_origin,
    read_vector,
    write_origin,
    write_vector,
)
from arm_drake.description.report import LoadReport
from arm_drake.description.ros2_control import ComponentInfo, HardwareInfo
from arm_drake.errors import DescriptionError, suggest
from arm_drake.importing import dataclass

MOVABLE_TYPES = ("revolute", "continuous", "prismatic")
# They have several degrees of freedom: no interface of ros2_control is for them.
FREE_TYPES = ("floating", "planar")

JOINT_TYPES = (*MOVABLE_TYPES, "fixed", *FREE_TYPES)

WORLD = "world"

# No revolute joint has such limits in radians; in degrees they are whole numbers. So
# are speeds, but that 100 often stands for "any".
_MOST_TURNS = 4.0 * math.pi  # [rad]
_MOST_DEGREES = 720.0
_LEAST_SPEED = 45.0
_ANY_SPEED = 100.0

# Drake takes no shorter axis: the root of the least difference of numbers from 1.
_SHORTEST_AXIS = math.sqrt(math.ulp(1.0))

# So far beside a limit is where it was rounded [rad] or [m].
_BESIDE = 1e-3


@dataclass(frozen=True)
class JointLimits:
    """`<limit>` of a joint; None where there is none.

    An end that a `<limit>` lacks is 0, as for urdfdom; an effort or speed of 0 is none.
    """

    # [rad] or [m].
    lower: float | None = None
    upper: float | None = None

    # [N·m] or [N].
    effort: float | None = None

    # [rad/s] or [m/s].
    velocity: float | None = None

    @property
    def range(self) -> tuple[float, float]:
        """Both ends, infinite without a limit."""
        low, high = self.lower, self.upper
        return -math.inf if low is None else low, math.inf if high is None else high


@dataclass(frozen=True)
class Mimic:
    """`<mimic>`: position = multiplier * position of ``joint`` + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class SafetyController:
    """`<safety_controller>` of a joint; the lower and upper limit as urdfdom has them.

    Limits that are both 0 are none.
    """

    # [rad] or [m].
    soft_lower_limit: float = 0.0
    soft_upper_limit: float = 0.0

    # Speed per distance from a limit [1/s].
    k_position: float = 0.0

    # Effort per speed [N·m·s/rad] or [N·s/m]; None where it is not given.
    k_velocity: float | None = None


@dataclass(frozen=True)
class JointInfo:
    """A joint of a robot."""

    name: str

    # One of JOINT_TYPES.
    type: str

    parent: str
    child: str
    limits: JointLimits = JointLimits()

    # Viscous damping [N·m·s/rad] or [N·s/m].
    damping: float = 0.0

    # Dry friction [N·m] or [N].
    friction: float = 0.0

    mimic: Mimic | None = None

    safety_controller: SafetyController | None = None

    # Of the child link in the parent link, with the joint at 0.
    origin: Origin = dc.field(default_factory=Origin)

    # In the child link, of any length.
    axis: Vector = (1.0, 0.0, 0.0)

    @property
    def is_movable(self) -> bool:
        """Whether the joint has one degree of freedom."""
        return self.type in MOVABLE_TYPES

    @property
    def unit_axis(self) -> Array:
        """The axis in the child link, of length 1, shape (3,)."""
        direction = np.array(self.axis)
        return np.asarray(direction / np.linalg.norm(direction))


def check_structure(
    links: tuple[str, ...], joints: tuple[JointInfo, ...], file: Path
) -> None:
    """Raise DescriptionError if links and joints make no trees."""
    for kind, names in (("link", links), ("joint", [j.name for j in joints])):
        repeated = sorted(name for name, n in Counter(names).items() if n > 1)
        if repeated:
            problem = f"two {kind}s are called {repeated[0]!r}; names must be unique"
            raise DescriptionError(problem, file=file)
    known = {*links, WORLD}
    for joint in joints:
        where = f"joint {joint.name!r}"
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in known:
                problem = f"{role} link {link!r} doesn't exist; {suggest(link, links)}"
                raise DescriptionError(problem, file=file, where=where)
        if joint.child == WORLD:
            problem = f"the child is {WORLD!r}, which nothing moves"
            problem += "; it can only be a parent"
            raise DescriptionError(problem, file=file, where=where)
    _check_tree(joints, file)


def _check_tree(joints: tuple[JointInfo, ...], file: Path) -> None:
    holders: dict[str, JointInfo] = {}
    for joint in joints:
        other = holders.setdefault(joint.child, joint)
        if other is not joint:
            where, link = f"joint {joint.name!r}", joint.child
            problem = f"joint {other.name!r} holds link {link!r} already"
            problem += "; a link is the child of one joint"
            raise DescriptionError(problem, file=file, where=where)
    is_tree: set[str] = set()
    for joint in joints:
        path, link = {joint.child}, joint.parent
        while link in holders and link not in is_tree:
            if link in path:
                where = f"joint {holders[link].name!r}"
                problem = f"link {link!r} hangs on itself; links and joints form a tree"
                raise DescriptionError(problem, file=file, where=where)
            path.add(link)
            link = holders[link].parent
        is_tree |= path


def beyond_limits(
    joints: Iterable[JointInfo], positions: Mapping[str, float]
) -> Iterator[tuple[str, str]]:
    """Yield joints whose positions aren't within their limits, and a line about each.

    Positions are all of one point [rad] or [m]: where they are whole numbers and would
    be within the limits as degrees, the line says so.
    """
    is_whole = all(position == round(position) for position in positions.values())
    for joint in joints:
        lower, upper = joint.limits.lower, joint.limits.upper
        position = positions.get(joint.name)
        if position is None or lower is None or upper is None:
            continue
        if lower - _BESIDE <= position <= upper + _BESIDE:
            continue
        problem = f"{joint.name} {position:g} is outside [{lower:g}, {upper:g}]"
        is_turning = joint.type == "revolute" and abs(position) > math.tau
        if is_whole and is_turning and lower <= math.radians(position) <= upper:
            problem += "; in degrees?"
        yield joint.name, problem


def _in_degrees(lower: float, upper: float) -> bool:
    """Return whether limits are whole numbers, and one of them is beyond two turns."""
    largest = max(abs(lower), abs(upper))
    is_whole = lower == round(lower) and upper == round(upper)
    return is_whole and _MOST_TURNS < largest <= _MOST_DEGREES


def report_degrees(joints: Sequence[JointInfo], file: Path, report: LoadReport) -> None:
    """Record limits of revolute joints that are nearly certainly in degrees."""
    for joint in joints:
        if joint.type != "revolute":
            continue
        lower, upper = joint.limits.lower, joint.limits.upper
        speed, found = joint.limits.velocity, []
        if lower is not None and upper is not None and _in_degrees(lower, upper):
            turns = max(abs(lower), abs(upper)) / math.tau
            radians = f"{math.radians(lower):.5g} to {math.radians(upper):.5g}"
            what = f"limits {lower:g} to {upper:g} rad are {turns:.0f} turns"
            what += " each way" if lower == -upper else ""
            what += f"; in degrees? URDF has radians: {radians}"
            found.append(what)
        if (
            speed is not None
            and speed == round(speed)
            and _LEAST_SPEED <= speed <= _MOST_DEGREES
            and speed != _ANY_SPEED
        ):
            what = f"velocity limit {speed:g} rad/s is {speed / math.tau:.0f} turns a "
            what += f"second; in degrees? URDF has radians: {math.radians(speed):.5g}"
            found.append(what)
        where, done = f"joint {joint.name!r}", "taken as written"
        for what in found:
            report.add("warning", "invalid", what, done, where=where, file=file)


def drop_bad_mimics(
    joints: tuple[JointInfo, ...], file: Path, report: LoadReport
) -> tuple[JointInfo, ...]:
    """Return the joints without `<mimic>` tags that nothing can follow."""
    by_name = {joint.name: joint for joint in joints}
    for name, joint in by_name.items():
        if joint.mimic is None:
            continue
        problem = _mimic_problem(joint, joint.mimic.joint, by_name)
        if problem:
            by_name[name] = dc.replace(joint, mimic=None)
            is_fixed = joint.type == "fixed"
            done = "it is fixed" if is_fixed else "the joint moves on its own"
            where = f"joint {name!r}"
            report.add("warning", "invalid", problem, done, where=where, file=file)
    return tuple(by_name.values())


def _mimic_problem(
    joint: JointInfo, name: str, joints: Mapping[str, JointInfo]
) -> str | None:
    """Return why a joint can't follow the one of a name, None if it can."""
    if not joint.is_movable:
        return f"mimics {name!r}, but is {joint.type}"
    if name not in joints:
        return f"mimics {name!r}, which doesn't exist; {suggest(name, joints)}"
    if not joints[name].is_movable:
        kind, expected = joints[name].type, ", ".join(MOVABLE_TYPES)
        return f"mimics {name!r}, which is {kind}; expected one of {expected}"
    # What is wrong with the masters of its master is their problem.
    mimic: Mimic | None = Mimic(name)
    seen: set[str] = set()
    while mimic is not None and mimic.joint in joints and mimic.joint not in seen:
        if mimic.joint == joint.name:
            return f"mimics itself, through {name!r}"
        seen.add(mimic.joint)
        mimic = joints[mimic.joint].mimic
    return None


def links_on(joints: Sequence[JointInfo], link: str) -> set[str]:
    """Return a link, and all that hang on it through joints."""
    found, waiting, below = set(), [link], joints_on_links(joints)
    while waiting:
        found.add(waiting[-1])
        waiting += [joint.child for joint in below.get(waiting.pop(), ())]
    return found


def joints_on_links(joints: Iterable[JointInfo]) -> dict[str, list[JointInfo]]:
    """Return the joints that each link carries, of those that carry any."""
    found: dict[str, list[JointInfo]] = {}
    for joint in joints:
        found.setdefault(joint.parent, []).append(joint)
    return found


def joints_above(joints: Sequence[JointInfo], link: str) -> list[JointInfo]:
    """Return the joints that carry a link, the nearest first."""
    return _above({joint.child: joint for joint in joints}, link)


def _above(carriers: Mapping[str, JointInfo], link: str) -> list[JointInfo]:
    found = []
    while link in carriers:
        found.append(carriers[link])
        link = carriers[link].parent
    return found


def extent(joints: Sequence[JointInfo]) -> float:
    """Return how far from a root the farthest link is, joints between stretched [m]."""
    steps = {j.child: (j.parent, math.hypot(*j.origin.xyz)) for j in joints}
    distances: dict[str, float] = {}
    for link in steps:
        chain = [link]
        while chain[-1] in steps and chain[-1] not in distances:
            chain.append(steps[chain[-1]][0])
        for nearer, farther in itertools.pairwise(reversed(chain)):
            distances[farther] = distances.get(nearer, 0.0) + steps[farther][1]
    return max(distances.values(), default=0.0)


def from_the_root(joints: Sequence[JointInfo]) -> list[JointInfo]:
    """Return the joints so that each comes after those that carry it."""
    carriers = {joint.child: joint for joint in joints}
    return sorted(joints, key=lambda joint: len(_above(carriers, joint.parent)))


def last_master(
    joint: JointInfo, joints: Mapping[str, JointInfo]
) -> tuple[str, float, float]:
    """Return the joint that moves a mimic joint in the end, a factor and an offset.

    position = factor * master's + offset; a joint that follows none is its own master.
    """
    factor, offset = 1.0, 0.0
    while joint.mimic is not None:
        offset += factor * joint.mimic.offset
        factor *= joint.mimic.multiplier
        joint = joints[joint.mimic.joint]
    return joint.name, factor, offset


def find_mimics(
    joints: Sequence[JointInfo],
    hardware: Sequence[HardwareInfo],
    report: LoadReport,
    file: Path,
) -> tuple[JointInfo, ...]:
    """Return the joints with the mimic that holds."""
    found = {joint.name: joint for joint in joints}
    components = [
        (component, block)
        for block in hardware
        for component in block.joints
        if component.name in found
    ]
    for component, _ in components:
        if component.is_mimic is False:
            found[component.name] = dc.replace(found[component.name], mimic=None)
    for component, block in components:
        finder = _Finder(f"ros2_control {block.name!r}", report, file)
        joint = found[component.name]
        mimic = finder.find(joint, component, block, found)
        found[component.name] = dc.replace(joint, mimic=mimic)
    return tuple(found.values())


def read_joint(element: ET.Element, file: Path, report: LoadReport) -> JointInfo:
    """Return what a `<joint>` says; what can't be taken as it stands is recorded."""
    name = element.get("name")
    if not name:
        problem = 'a joint has no name; expected <joint name="...">'
        raise DescriptionError(problem, file=file)
    where = f"joint {name!r}"
    joint_type = element.get("type", "")
    if joint_type not in JOINT_TYPES:
        problem = f"type {joint_type!r}; expected one of {', '.join(JOINT_TYPES)}"
        raise DescriptionError(problem, file=file, where=where)
    reader = ElementReader(where, report, file)
    if joint_type in FREE_TYPES:
        what = f"the joint is {joint_type}"
        done = "it moves freely, no controller moves it"
        reader.note("info", "unsupported", what, done)
    mimic = element.find("mimic")
    return JointInfo(
        name=name,
        type=joint_type,
        parent=_link_of(element, "parent", reader),
        child=_link_of(element, "child", reader),
        limits=_limits(element.find("limit"), joint_type, reader),
        mimic=None
        if mimic is None
        else Mimic(
            joint=mimic.get("joint", ""),
            multiplier=read_numbers(mimic, "multiplier", (1.0,), file, where)[0],
            offset=read_numbers(mimic, "offset", (0.0,), file, where)[0],
        ),
        safety_controller=_safety_controller(element, reader),
        origin=read_origin(element, file, where),
        axis=_axis(element, joint_type, file, where),
        **_dynamics(element.find("dynamics"), file, where, reader),
    )


def _safety_controller(
    joint: ET.Element, reader: ElementReader
) -> SafetyController | None:
    """Return the soft limits of a joint; a malformed one is left out, not the robot."""
    element = joint.find("safety_controller")
    if element is None:
        return None
    names = [field.name for field in dc.fields(SafetyController)]
    values = {name: reader.finite(element.get(name), name) for name in names}
    return SafetyController(**{n: v for n, v in values.items() if v is not None})


def _link_of(element: ET.Element, tag: str, reader: ElementReader) -> str:
    child = element.find(tag)
    link = None if child is None else child.get("link")
    if not link:
        raise reader.error(f'expected <{tag} link="...">')
    return link


def _report_lacking(
    limit: ET.Element | None, joint_type: str, reader: ElementReader
) -> None:
    """Record what a limit lacks for urdfdom: without it ROS refuses the robot."""
    if limit is None and joint_type in ("revolute", "prismatic"):
        what = f"no <limit>, without which ROS takes no {joint_type} joint"
        reader.note("warning", "missing", what, "it moves without limits")
    if limit is None:
        return
    for name in ("effort", "velocity"):
        if name not in limit.attrib:
            what = f"<limit> without {name!r}, which ROS takes in no joint"
            reader.note("warning", "missing", what, "taken as unset")
    # One of them is often meant to be 0.
    has_ends = "lower" in limit.attrib or "upper" in limit.attrib
    if not has_ends and joint_type in ("revolute", "prismatic"):
        what = "<limit> without 'lower' and 'upper'"
        reader.note("warning", "missing", what, "both are 0, as in ROS")


def _dynamics(
    element: ET.Element | None, file: Path, where: str, reader: ElementReader
) -> dict[str, float]:
    """Return damping and friction; a negative one would drive the joint."""
    found = {}
    for name in ("damping", "friction"):
        (number,) = read_numbers(element, name, (0.0,), file, where)
        if number < 0.0:
            what = f"{name} {number:g} is negative"
            reader.note("warning", "repair", what, "taken as 0")
        found[name] = max(0.0, number)
    return found


def _axis(joint: ET.Element, joint_type: str, file: Path, where: str) -> Vector:
    axis = read_vector(joint.find("axis"), "xyz", file, where, (1.0, 0.0, 0.0))
    length = max(map(abs, axis))
    if joint_type not in ("fixed", "floating") and length <= _SHORTEST_AXIS:
        problem = "<axis xyz>: expected a direction, got zeros"
        raise DescriptionError(problem, file=file, where=where)
    return axis


def _limits(
    element: ET.Element | None, joint_type: str, reader: ElementReader
) -> JointLimits:
    """Return the limits; 0 and inf mean "unset", which Drake would take literally."""
    _report_lacking(element, joint_type, reader)
    if element is None:
        return JointLimits()
    lower, upper = (_limit(element, end, reader) for end in ("lower", "upper"))
    if lower > upper and joint_type != "continuous":
        what = f"the lower limit {lower} is above the upper one, {upper}"
        reader.note("warning", "repair", what, "swapped")
        lower, upper = upper, lower
    found = {}
    for name in ("effort", "velocity"):
        text, number = element.get(name), _limit(element, name, reader)
        if 0.0 < abs(number) < math.inf:
            found[name] = abs(number)
        done = "taken without its sign" if name in found else "taken as unset"
        is_taken = number in (found.get(name), math.inf)
        if text is not None and not is_taken and joint_type != "fixed":
            reader.note("info", "repair", f"{name} limit {text}", done)
    if joint_type == "continuous" and {"lower", "upper"} & element.attrib.keys():
        what = "limits of a continuous joint"
        reader.note("info", "repair", what, "it turns without end")
    if joint_type in ("revolute", "prismatic"):
        ends = {"lower": lower, "upper": upper}
        found |= {name: end for name, end in ends.items() if math.isfinite(end)}
    return JointLimits(**found)


def _limit(element: ET.Element, attribute: str, reader: ElementReader) -> float:
    """Return a number, which may be infinite; 0 where there is none."""
    text = element.get(attribute, "0")
    number = parse_number(text)
    if number is None:
        problem = f"<{element.tag} {attribute}>: expected a number, got {text!r}"
        raise reader.error(problem)
    return number


def write_joint(joint: JointInfo) -> str:
    """Return a joint as URDF, as Drake takes it.

    Its friction is left out, which is modelled beside the plant.
    """
    name = quote_attribute(joint.name)
    parent, child = map(quote_attribute, (joint.parent, joint.child))
    text = (
        f'<joint name={name} type="{joint.type}">{write_origin(joint.origin)}'
        f"<parent link={parent}/><child link={child}/>"
    )
    if joint.type not in ("fixed", "floating"):
        text += f'<axis xyz="{write_vector(joint.axis)}"/>'
    limits = "".join(
        f' {name}="{value!r}"'
        for name in ("lower", "upper", "effort", "velocity")
        if (value := getattr(joint.limits, name)) is not None
    )
    if limits and joint.type != "fixed":
        text += f"<limit{limits}/>"
    if joint.damping:
        # Drake wants one for each degree of freedom.
        count = 3 if joint.type == "planar" else 1
        text += f'<dynamics damping="{write_vector([joint.damping] * count)}"/>'
    if joint.mimic is not None:
        text += (
            f"<mimic joint={quote_attribute(joint.mimic.joint)} "
            f'multiplier="{joint.mimic.multiplier!r}" offset="{joint.mimic.offset!r}"/>'
        )
    return f"{text}</joint>"


# Of the way that a mimic joint is taken, so much beyond its limits is rounding, and so
# much makes no difference to see.
_MIMIC_SHARES = 1e-6, 0.01


def fit_mimic_limits(
    joints: Sequence[JointInfo], file: Path, report: LoadReport
) -> tuple[JointInfo, ...]:
    """Return joints of which those that follow don't hold back their masters.

    In ROS a joint moves whatever its mimic joints are allowed: mock_components and
    robot_state_publisher compute their positions, and gz_ros2_control drives them by
    themselves, so that one at its limit stays behind. Here they are coupled, and one at
    its limit would stop all. Fingers that move against each other often have the limits
    of the same side.
    """
    by_name = {joint.name: joint for joint in joints}
    return tuple(
        joint
        if joint.mimic is None
        else dc.replace(joint, limits=_fit_limits(joint, by_name, file, report))
        for joint in joints
    )


def _fit_limits(
    joint: JointInfo,
    joints: Mapping[str, JointInfo],
    file: Path,
    report: LoadReport,
) -> JointLimits:
    """Return a mimic joint's limits with those of its master within, and report it."""
    lower, upper = joint.limits.range
    name, factor, offset = last_master(joint, joints)
    # 0 times infinity is no number, but a joint that stays where it is.
    ends = [factor * end if factor else 0.0 for end in joints[name].limits.range]
    low, high = (offset + end for end in sorted(ends))
    below = lower - low if low < lower else 0.0
    above = high - upper if high > upper else 0.0
    beyond = max(below, above)
    way = max(high - low, upper - lower)
    # Of a way without end nothing is small.
    rounding, small = (
        share * way if way < math.inf else 0.0 for share in _MIMIC_SHARES
    )
    if beyond <= rounding:
        return joint.limits
    report.add(
        "info" if beyond <= small else "warning",
        "repair",
        f"limits of {lower:.4g} to {upper:.4g} would stop {name!r}, which takes it "
        f"from {low:.4g} to {high:.4g}"
        if factor
        else f"it stands at {offset:.4g}, beyond its limits of {lower:.4g} to "
        f"{upper:.4g}",
        "it follows beyond them" if factor else "they don't hold it",
        where=f"joint {joint.name!r}",
        file=file,
    )
    low, high = min(low, lower), max(high, upper)
    return dc.replace(
        joint.limits,
        lower=low if math.isfinite(low) else None,
        upper=high if math.isfinite(high) else None,
    )


class _Finder(ElementReader):
    """Finds the mimic relation of one joint of a block."""

    def find(
        self,
        joint: JointInfo,
        component: ComponentInfo,
        block: HardwareInfo,
        joints: Mapping[str, JointInfo],
    ) -> Mimic | None:
        """Return the relation that holds, with lines about what is overridden."""
        where = f"joint {joint.name!r}"
        mimic, old = joint.mimic, component.parameters.get("mimic")
        if component.is_mimic is False:
            if old:
                what = f"mimic=\"false\", but <param> 'mimic' is {old!r}"
                self.note("warning", "invalid", what, "it moves on its own", where)
            return None
        if mimic is None and old:
            mimic = self._from_parameters(joint, component, joints, where)
        elif mimic is not None and old:
            self._compare(mimic, component, where)
        elif mimic is None and component.is_mimic:
            what = 'mimic="true", but the URDF\'s joint has no <mimic>'
            self.note("error", "invalid", what, "it moves on its own", where)
        if mimic is None:
            return None
        if component.command_interfaces:
            names = [interface.name for interface in component.command_interfaces]
            what = f"command interfaces {names} of a mimic joint"
            done = f"what they get has no effect; it follows {mimic.joint!r}"
            self.note("warning", "invalid", what, done, where)
        if all(other.name != mimic.joint for other in block.joints):
            what = f"the block lacks {mimic.joint!r}, which the joint mimics"
            self.note("warning", "missing", what, "it follows all the same", where)
        return mimic

    def _from_parameters(
        self,
        joint: JointInfo,
        component: ComponentInfo,
        joints: Mapping[str, JointInfo],
        where: str,
    ) -> Mimic | None:
        """Return the relation in the old form, or None if it is impossible."""
        master, multiplier = self._parameters(component, where)
        problem = _mimic_problem(joint, master, joints)
        if problem is not None:
            is_fixed = joint.type == "fixed"
            done = "it is fixed" if is_fixed else "it moves on its own"
            self.note("error", "invalid", problem, done, where)
            return None
        what = f"<param> 'mimic', which is the form up to Humble, names {master!r}"
        self.note("info", "repair", what, "taken as the URDF's <mimic>", where)
        return Mimic(master, multiplier)

    def _compare(self, mimic: Mimic, component: ComponentInfo, where: str) -> None:
        """Report a contradiction of the old form to the URDF's `<mimic>`."""
        master, multiplier = self._parameters(component, where)
        if (master, multiplier) != (mimic.joint, mimic.multiplier):
            what = (
                f"<param> 'mimic' says {multiplier} * {master!r}, "
                f"the URDF's <mimic> {mimic.multiplier} * {mimic.joint!r}"
            )
            self.note("warning", "invalid", what, "the URDF counts", where)

    def _parameters(self, component: ComponentInfo, where: str) -> tuple[str, float]:
        text = component.parameters.get("multiplier")
        multiplier = self.finite(text, "multiplier", where)
        return component.parameters["mimic"], 1.0 if multiplier is None else multiplier
