"""Rollouts: what a simulation leaves behind, as arrays with names."""

import dataclasses as dc
import enum
import importlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.errors import MissingExtraError, counted, suggest
from arm_drake.importing import dataclass
from arm_drake.messages import Message
from arm_drake.rollout.formats import load_fields, save_rollout
from arm_drake.rollout.link_poses import find_tip, read_link_poses

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

# What draws rollouts knows them, and needs Matplotlib: it is imported when it is used.
_PLOT = "arm_drake.visualization.plots"

# Name of the column of times.
TIME = "time [s]"
_POSE = ("x [m]", "y [m]", "z [m]", "qw", "qx", "qy", "qz")

# Units of command interfaces of joints that turn, and of those that slide.
_UNITS = {"acceleration": ("rad/s^2", "m/s^2")}

# An effort within this part of its limit is at the limit.
_AT_LIMIT = 1e-6


@dataclass(frozen=True)
class GoalRecord:
    """A goal of an action, and what became of it."""

    # Name of the controller, with that of its robot in front if there are several.
    controller: str

    # Class of the goal, such as "FollowJointTrajectoryGoal".
    type: str

    # When it was sent [s].
    sent_at: float

    # When its end was noticed [s], at most 50 cycles late; None if it is not done.
    ended_at: float | None

    # A GoalStatus: "SUCCEEDED", "ABORTED", ...
    status: str

    # Of a FollowJointTrajectory result; None if there is no such result.
    error_code: int | None = None

    # Why, in words; empty if there is nothing to say.
    error_string: str = ""

    # The goal's fields.
    goal: Mapping[str, Any] = dc.field(default_factory=dict)

    # Fields of the result, if there is one.
    result: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class SentMessage:
    """A message that was sent to a controller, or a request to the manager."""

    # When [s].
    time: float

    # Name as in ROS.
    topic: str

    # Class of the message, such as "JointTrajectory".
    type: str

    # Its fields.
    data: Mapping[str, Any]


@dataclass(frozen=True)
class ClientInput:
    """Request of an external client while a simulation ran."""

    # When it was done [s].
    time: float

    # "publish", "call", "goal" or "cancel".
    kind: str

    # Topic, service or action.
    name: str

    # Who asked: protocol and address.
    sender: str

    # The message, request or goal, as its type in ROS has it.
    data: Mapping[str, Any]

    # Of a goal.
    goal_id: str = ""

    # How much later the sender's clock was [ns].
    offset_ns: int = 0


@dataclass(frozen=True, eq=False)
class Reference:
    """Reference of a controller for its joints."""

    # Joints, k of them.
    joint_names: tuple[str, ...]

    # Positions [rad] or [m], shape (N, k); NaN before the first command.
    position: Array


@dataclass(frozen=True, eq=False)
class Rollout:
    """The recorded motion of a robot: N rows, J movable joints.

    A row is the state right after a read at a tick of the controller manager, before
    the tick's command acts.
    """

    # Times of the rows [s], shape (N,).
    time: Array

    # In the order of the description.
    joint_names: tuple[str, ...]

    # [rad] or [m], [rad/s] or [m/s], [N·m] or [N], each of shape (N, J). The effort is
    # what the joint's actuator applies, gravity compensation included, friction not.
    position: Array
    velocity: Array
    effort: Array

    # Effort limit of each joint, infinite where there is none, shape (J,).
    effort_limit: Array

    # URDF type of each joint.
    joint_types: tuple[str, ...]

    # What each controller wanted, by its name.
    references: Mapping[str, Reference]

    # Name of the robot, and what its topics' names start with: "" or a name space such
    # as "/cell", with several robots "/<robot>".
    robot_name: str = ""
    namespace: str = ""

    # Whether that is a name space of a robot alone, which isn't in front of its frames.
    has_own_namespace: bool = False

    # Command interfaces "<joint>/<interface>", C of them, and what they held until the
    # row's tick, shape (N, C), each in the unit of its interface; NaN where nothing was
    # commanded yet, or recorded. Without any, shape (N, 0).
    command_names: tuple[str, ...] = ()
    command: Array = dc.field(default_factory=lambda: np.zeros((0, 0)))

    # Controllers by name with their types, K of them, and whether they were active in
    # the cycle before the row, 1 or 0, shape (N, K); NaN where it wasn't recorded.
    controllers: Mapping[str, str] = dc.field(default_factory=dict)
    active: Array = dc.field(default_factory=lambda: np.zeros((0, 0)))

    # Pose in the world of links that no joint with a position holds, such as a mobile
    # base: x, y, z [m], quaternion w, x, y, z, shape (N, 7).
    free_poses: Mapping[str, Array] = dc.field(default_factory=dict)

    # Total contact force on each link in the world [N], shape (N, 3); only where that
    # was asked for, see `SimulationOptions.log_contacts`.
    contact_forces: Mapping[str, Array] = dc.field(default_factory=dict)

    # What cameras and lidars published, by topic and in order; only of those for which
    # that was asked, see `SimulationOptions.log_images`.
    sensor_messages: Mapping[str, tuple[Message, ...]] = dc.field(default_factory=dict)

    # Goals and messages that were sent, in order.
    goals: tuple[GoalRecord, ...] = ()
    messages: tuple[SentMessage, ...] = ()

    # What programs outside asked for; with several robots it is with the first one.
    inputs: tuple[ClientInput, ...] = ()

    # What made it: versions, files with hashes, options, world, motions; plain data.
    info: Mapping[str, Any] = dc.field(default_factory=dict)

    # The robot's expanded description as it was written, but with package URIs in place
    # of this machine's paths.
    description: str = ""

    def __post_init__(self) -> None:
        """Give what wasn't recorded its shape."""
        for field, names in (
            ("command", self.command_names),
            ("active", self.controllers),
        ):
            if not names:
                empty = np.zeros((len(self.time), 0))
                object.__setattr__(self, field, empty)

    def __repr__(self) -> str:
        """Return its robot, how long it is, and what moves; its fields are long."""
        length = float(self.time[-1] - self.time[0]) if len(self.time) else 0.0
        size = f"{counted(len(self.time), 'row')}, {length:.2f} s"
        joints = list(self.joint_names)
        return f"<Rollout {self.robot_name!r}, {size}, joints {joints}>"

    @property
    def is_at_limit(self) -> NDArray[np.bool_]:
        """Whether each joint is at its effort limit in each row, shape (N, J)."""
        limit = (1.0 - _AT_LIMIT) * self.effort_limit
        return np.abs(self.effort) >= limit

    def effort_saturation(self) -> dict[str, float]:
        """Return how long joints were at their effort limit [s], by joint.

        Joints that never were are left out. The time is counted in rows.
        """
        return self.time_at_limit(np.ones(len(self.time), dtype=bool))

    def time_at_limit(self, rows: NDArray[np.bool_]) -> dict[str, float]:
        """Return how long joints were at their effort limit in some rows [s], by joint.

        Args:
            rows: Which rows count, shape (N,).
        """
        if len(self.time) < 2:
            return {}
        row = float(self.time[-1] - self.time[0]) / (len(self.time) - 1)
        is_at_limit = self.is_at_limit[rows]
        return {
            name: count * row
            for name, count in zip(
                self.joint_names, is_at_limit.sum(axis=0).tolist(), strict=True
            )
            if count
        }

    def tracking_error(self, controller: str) -> Array:
        """Return reference less measured positions, shape (N, k).

        Args:
            controller: Name of the controller whose k joints to look at.

        Raises:
            KeyError: If there is no such controller.
        """
        if controller not in self.references:
            problem = f"no references of {controller!r}"
            if not len(self.time):
                raise KeyError(f"{problem}; nothing has been simulated yet")
            raise KeyError(f"{problem}; {suggest(controller, self.references)}")
        reference = self.references[controller]
        columns = [self.joint_names.index(name) for name in reference.joint_names]
        return reference.position - self.position[:, columns]

    def save(self, path: str | Path) -> None:
        """Write the rollout; the same rollout always gives the same bytes.

        Args:
            path: `.npz` for arrays, with everything; `.csv` for a table of the rows,
                with units in its head; `.mcap` for a bag of ROS 2 messages, with
                everything, which needs the extra `bag`.

        Raises:
            MissingExtraError: If what the file needs isn't installed.
            OutputError: If the file can't be written, or its type is unknown.
        """
        save_rollout(self, Path(path))

    @classmethod
    def load(cls, path: str | Path, robot: str | None = None) -> Self:
        """Return the rollout of a file that `save` has written.

        From a table alone come the rows: no goals, messages, limits, description and
        provenance; joints are "revolute" or "prismatic", as their units say.

        Args:
            path: `.npz`, `.csv` or `.mcap` file.
            robot: Name of the robot, in a bag of several; by default the first one.

        Raises:
            InputError: If the file can't be read, or is no rollout.
            MissingExtraError: If what the file needs isn't installed.
        """
        fields = load_fields(Path(path), robot)
        read = fields.pop("references").items()
        references = {name: Reference(*parts) for name, parts in read}
        return cls(**fields, references=references)

    def columns(self) -> dict[str, Array]:
        """Return every quantity of the rows, each of shape (N,), with unit in its name.

        They are the columns of a `.csv` file.
        """
        columns = {TIME: self.time}
        types = dict(zip(self.joint_names, self.joint_types, strict=True))
        for quantity in interfaces.STATE_INTERFACES:
            values = getattr(self, quantity)
            for index, (name, kind) in enumerate(types.items()):
                unit = interfaces.unit(quantity, kind)
                columns[f"{name} {quantity} [{unit}]"] = values[:, index]
        for controller, reference in self.references.items():
            for index, name in enumerate(reference.joint_names):
                unit = interfaces.unit(interfaces.POSITION, types[name])
                head = f"{controller} {name} reference [{unit}]"
                columns[head] = reference.position[:, index]
        for index, name in enumerate(self.command_names):
            columns[f"command {name}{_unit(name, types)}"] = self.command[:, index]
        for index, name in enumerate(self.controllers):
            columns[f"{name} active"] = self.active[:, index]
        for link, poses in self.free_poses.items():
            for index, part in enumerate(_POSE):
                columns[f"pose {link} {part}"] = poses[:, index]
        for link, forces in self.contact_forces.items():
            for index, axis in enumerate("xyz"):
                columns[f"contact force {link} {axis} [N]"] = forces[:, index]
        return columns

    def to_pandas(self) -> "pd.DataFrame":
        """Return the rows as a data frame: one column for each quantity, as a `.csv`.

        Its index is the time [s].

        Raises:
            MissingExtraError: If pandas isn't installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise MissingExtraError("Rollout.to_pandas", "pandas") from None
        columns = self.columns()
        index = pd.Index(columns.pop(TIME), name=TIME)
        return pd.DataFrame(columns, index=index)

    def link_poses(self, link: str) -> Array:
        """Return where a link was in the world: x, y, z [m], quaternion w, x, y, z.

        Shape (N, 7).

        Args:
            link: Name of the link.

        Raises:
            InputError: If the rollout has no description, or no such link.
        """
        return read_link_poses(self, link)

    def find_tip(self) -> str:
        """Return the end effector's link, or the base that moves without an arm.

        Raises:
            InputError: If the rollout has no description.
        """
        return find_tip(self)

    def plot(
        self,
        path: str | Path | None = None,
        kind: str = "overview",
        *,
        joints: Sequence[str] | None = None,
        link: str | None = None,
    ) -> "Figure":
        """Return a picture of the rollout, which a notebook shows; see docs/plots.md.

        Args:
            path: `.png`, `.svg` or `.pdf` file to write, too; None writes none.
            kind: What to look at: "tracking" (reference and measurement), "error",
                "effort" (with its limit), "phase" (velocity over position), "path" (the
                way of a link) or "overview".
            joints: Which joints, in this order; None is all of them.
            link: The link of "path" and "overview"; None is the end effector.

        Raises:
            InputError: If there is no such kind, joint or link, or "path" lacks a
                description.
            OutputError: If the picture can't be written, or its type is unknown.
        """
        path = None if path is None else Path(path)
        draw: Callable[..., Figure] = importlib.import_module(_PLOT).draw_rollout
        return draw(self, path, kind=kind, joints=joints, link=link)


def _unit(command: str, types: dict[str, str]) -> str:
    """Return the unit of a command interface, where it is known."""
    joint, _, name = command.rpartition("/")
    if joint not in types:
        return ""
    if name in interfaces.STATE_INTERFACES:
        return f" [{interfaces.unit(name, types[joint])}]"
    if name in _UNITS:
        return f" [{_UNITS[name][types[joint] == 'prismatic']}]"
    return ""


# Plain data: what JSON can hold.
Plain = Any


def to_plain(value: Any) -> Plain:
    """Return a message, or part of one, as data that JSON can hold.

    Numbers beyond all limits become the texts that `float` reads.
    """
    if dc.is_dataclass(value) and not isinstance(value, type):
        fields = (field.name for field in dc.fields(value))
        return {name: to_plain(getattr(value, name)) for name in fields}
    if isinstance(value, enum.Enum):
        return to_plain(value.value)
    if isinstance(value, Mapping):
        return {str(key): to_plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [to_plain(each) for each in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else repr(value)
    if value is None or isinstance(value, bool | int | str):
        return value
    return str(value)


# Grows when a reader of before couldn't understand what is written.
_VERSION = 1

# Fields of a Rollout that `read_static` returns as they are.
STATIC_FIELDS = (
    "robot_name",
    "namespace",
    "has_own_namespace",
    "joint_names",
    "joint_types",
    "command_names",
    "controllers",
    "goals",
    "messages",
    "inputs",
    "info",
    "description",
)


def make_static(rollout: Rollout, *, is_whole: bool = True) -> str:
    """Return what isn't in the rows, as JSON; not whole without what a bag has beside.

    That are goals, messages, what came from outside, and the robot's description.
    """
    more = (
        {
            "goals": rollout.goals,
            "messages": rollout.messages,
            "inputs": rollout.inputs,
            "description": rollout.description,
        }
        if is_whole
        else {}
    )
    return json.dumps(
        to_plain(
            {
                "version": _VERSION,
                "robot_name": rollout.robot_name,
                "namespace": rollout.namespace,
                **({"has_own_namespace": True} if rollout.has_own_namespace else {}),
                "joint_names": rollout.joint_names,
                "joint_types": rollout.joint_types,
                "effort_limit": rollout.effort_limit.tolist(),
                "command_names": rollout.command_names,
                "controllers": rollout.controllers,
                "references": {
                    name: reference.joint_names
                    for name, reference in rollout.references.items()
                },
                "free_poses": list(rollout.free_poses),
                "contact_forces": list(rollout.contact_forces),
                "sensor_messages": {
                    topic: type(messages[0]).__name__
                    for topic, messages in rollout.sensor_messages.items()
                    if messages
                },
                "info": rollout.info,
                **more,
            }
        ),
        ensure_ascii=False,
    )


def read_static(text: str) -> dict[str, Any]:
    """Return what `make_static` has written; raise ValueError if it isn't that."""
    data = json.loads(text)
    if not isinstance(data, dict) or data.pop("version", None) != _VERSION:
        raise ValueError(f"expected version {_VERSION} of a rollout")
    for name in ("joint_names", "joint_types", "command_names"):
        data[name] = tuple(data[name])
    data["references"] = {k: tuple(v) for k, v in data["references"].items()}
    goals, messages = data.get("goals", ()), data.get("messages", ())
    data["goals"] = tuple(GoalRecord(**goal) for goal in goals)
    data["messages"] = tuple(SentMessage(**message) for message in messages)
    data.setdefault("has_own_namespace", False)
    inputs = data.get("inputs", ())
    data["inputs"] = tuple(ClientInput(**each) for each in inputs)
    data["effort_limit"] = [float(limit) for limit in data["effort_limit"]]
    return data
