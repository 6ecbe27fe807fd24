"""Parameters of ``joint_trajectory_controller/JointTrajectoryController``.

Source: ros2_controllers, `joint_trajectory_controller` (version 6.9.0; defaults of
jazzy, and by rule those of other distros).
"""

import dataclasses as dc
import math
from collections.abc import Mapping
from operator import attrgetter
from typing import Annotated, Literal, NamedTuple

import numpy as np

from arm_drake.arrays import Array, Mask
from arm_drake.control.pid import Pid, PidGains, adapt_saturation
from arm_drake.control.tolerances import make_default_tolerances
from arm_drake.controllers.joint_trajectory.goals import min_stop_points
from arm_drake.controllers.joint_trajectory.state import (
    Deceleration,
    JointTrajectoryRules,
    TrajectoryRules,
    needed_fields,
)
from arm_drake.description.parameters import (
    ParameterGroup,
    Rule,
    check_at_least,
    check_not_empty,
    check_unique,
    per_element_of,
)
from arm_drake.importing import dataclass
from arm_drake.messages import (
    NANOSECONDS,
    ActionRequest,
    GoalStatus,
    JointTrajectory,
    SpeedScalingFactor,
)

CommandInterface = Literal["position", "velocity", "acceleration", "effort"]
StateInterface = Literal["position", "velocity", "acceleration"]

# What may be commanded together.
_COMMANDS = (
    {"position"},
    {"position", "velocity"},
    {"position", "velocity", "acceleration"},
    {"velocity"},
    {"effort"},
    {"position", "effort"},
)

# Of these, what a PID computes.
_COMMANDS_OF_PID = ({"velocity"}, {"effort"})

# Groups of parameters, and what they act on.
_GROUPS = {
    "gains": ("gains act on 'velocity' or 'effort'", _COMMANDS_OF_PID),
    "speed_scaling": ("speed_scaling acts on 'position'", ({"position"},)),
}

# And what needs to know the measured velocity too.
_COMMANDS_WITH_FEEDBACK = (*_COMMANDS_OF_PID, {"position", "effort"})

_STATES = (
    {"position"},
    {"position", "velocity"},
    {"position", "velocity", "acceleration"},
)


@dataclass(frozen=True)
class JointConstraints:
    """Tolerances of one joint; 0 is not checked."""

    # Position tolerance along the way [rad].
    trajectory: float = 0.0

    # Position tolerance at the end [rad].
    goal: float = 0.0

    # Deceleration of decelerate_on_cancel, at least 0 [rad/s^2].
    max_deceleration_on_cancel: Annotated[float, Rule(since="jazzy")] = 0.0

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "max_deceleration_on_cancel")


@dataclass(frozen=True)
class Constraints:
    """Default tolerances of goals."""

    # Velocity tolerance at the end [rad/s].
    stopped_velocity_tolerance: float = 0.01

    # How late a goal may be reached [s]; 0 waits for ever.
    goal_time: float = 0.0

    # Whether joints brake evenly when a goal is cancelled or fails, not at once.
    decelerate_on_cancel: Annotated[bool, Rule(since="jazzy")] = False

    joint: dict[str, JointConstraints] = per_element_of("joints")

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "goal_time")


@dataclass(frozen=True)
class JointGains(PidGains):
    """PID of one joint, which acts on velocity alone or effort alone."""

    # How much of the trajectory's velocity is added to the output.
    ff_velocity_scale: float = 0.0

    # Whether errors are angles, which wrap.
    angle_wraparound: Annotated[
        bool,
        Rule(
            until="humble",
            was=("normalize_error",),
            instead="the joint's type 'continuous' decides",
        ),
    ] = False

    @staticmethod
    def adapt(params: ParameterGroup) -> None:
        """Take what older versions have."""
        PidGains.adapt(params)
        if params.is_before("kilted"):
            adapt_saturation(params)


@dataclass(frozen=True)
class Gains:
    """PIDs by joint."""

    joint: dict[str, JointGains] = per_element_of("joints")


@dataclass(frozen=True)
class SpeedScaling:
    """Scaling of time along trajectories."""

    # Factor from the start, at least 0.
    initial_scaling_factor: float = 1.0

    # Full names of interfaces that tell the factor and are told it; "" is none.
    state_interface: str = ""
    command_interface: str = ""

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "initial_scaling_factor")


@dataclass(frozen=True)
class PositionsUpsampling:
    """Spline through positions that come at a low rate."""

    enable: bool = False

    # Rate of positions without times, at least 0 [Hz]; 0 is none.
    policy_frequency: float = 0.0

    def __post_init__(self) -> None:
        check_at_least(self, 0.0, "policy_frequency")


@dataclass(frozen=True)
class JointTrajectoryControllerParameters:
    """Parameters of a JointTrajectoryController."""

    # Joints to control, in the order of every port.
    joints: tuple[str, ...]

    # Interfaces to claim on each joint.
    command_interfaces: tuple[CommandInterface, ...]

    # Interfaces to read of each joint.
    state_interfaces: tuple[StateInterface, ...]

    # Joints to command, if not all of them or by other names; () is `joints`.
    command_joints: tuple[str, ...] = ()

    # Whether a trajectory may leave joints out; those stay where they are.
    allow_partial_joints_goal: bool = False

    # Whether a new trajectory is blended with the one that runs.
    allow_trajectory_replacement: Annotated[
        bool, Rule(rolling=True, since="rolling")
    ] = False

    # Whether trajectories start from the last command, not from the measured state.
    interpolate_from_desired_state: Annotated[
        bool, Rule(since="jazzy", is_kept=True)
    ] = False

    # Humble's name of interpolate_from_desired_state, which there switches the PID of
    # velocity commands off too.
    open_loop_control: Annotated[bool, Rule(until="humble")] = False

    # Whether points may leave positions out, to be integrated.
    allow_integration_in_goal_trajectories: bool = False

    # Whether it starts from what was commanded before. Nothing is, before time 0.
    set_last_command_interface_value_as_state_on_activation: bool = True

    # Rate of feedback and results, at least 0.1 [Hz].
    action_monitor_rate: float = 20.0

    # "none" jumps from point to point.
    interpolation_method: Literal["splines", "none"] = "splines"

    # Whether a trajectory may end in motion.
    allow_nonzero_velocity_at_trajectory_end: Annotated[bool, Rule(humble=True)] = False

    # How long the last point is held before the joints stop where they are [s]; used if
    # it exceeds constraints.goal_time, 0 is for ever.
    cmd_timeout: float = 0.0

    # Rate of the topic of its state [Hz]; here, and later, it is told at every tick.
    state_publish_rate: Annotated[float, Rule(until="humble", is_harmless=True)] = 50.0

    # Whether it holds still from the start; it always does.
    start_with_holding: Annotated[
        bool, Rule(until="humble", is_harmless=True, only=True)
    ] = True

    positions_upsampling: Annotated[PositionsUpsampling, Rule(since="rolling")] = (
        PositionsUpsampling()
    )
    speed_scaling: SpeedScaling = SpeedScaling()
    constraints: Constraints = Constraints()
    gains: Gains = Gains()

    @staticmethod
    def adapt(params: ParameterGroup) -> None:
        """Take the older open_loop_control, and refuse what humble doesn't have."""
        is_open_loop = params.get("open_loop_control", bool)
        if is_open_loop is not None:
            new = {"interpolate_from_desired_state": is_open_loop}
            if params.distro == "humble":
                new["open_loop_control"] = is_open_loop
            params.replace("open_loop_control", new)
        commands = params.get("command_interfaces", tuple[CommandInterface, ...])
        for group, (what, choices) in _GROUPS.items():
            name = params.first_of(group)
            if name and commands and set(commands) not in choices:
                what = f"{what} alone, not on {list(commands)}"
                params.add(name, "info", "ignored", what, "none of them has an effect")
        timeout = params.get("cmd_timeout", float) or 0.0
        goal_time = params.get("constraints.goal_time", float) or 0.0
        if goal_time < 0.0 and params.distro == "rolling":
            what = f"{goal_time} is how versions after 6.9.0 wait for ever"
            params.set("constraints.goal_time", 0.0)
            params.add("constraints.goal_time", "info", "repair", what, "taken as 0")
        if 0.0 < timeout <= goal_time:
            what = f"it must exceed constraints.goal_time, {goal_time}"
            params.add("cmd_timeout", "warning", "ignored", what, "there is no timeout")
        joints = params.get("joints", tuple[str, ...]) or ()
        own = [f"{joint}.{kind}" for joint in joints for kind in ("trajectory", "goal")]
        for name in (*own, "stopped_velocity_tolerance"):
            params.warn_of_nan(f"constraints.{name}", "no tolerance holds, as for 0")
        if params.distro == "humble":
            if set(commands or ()) == {"position", "effort"}:
                what = f"humble takes 'effort' alone only, got {list(commands)}"
                params.reject("command_interfaces", what)
            others = params.get("command_joints", tuple[str, ...])
            if joints and others and len(others) != len(joints):
                what = f"humble takes as many as joints only, got {list(others)}"
                params.reject("command_joints", what)

    def __post_init__(self) -> None:
        names = ("joints", "command_interfaces", "state_interfaces")
        check_not_empty(self, *names)
        check_unique(self, *names, "command_joints")
        commands, states = set(self.command_interfaces), set(self.state_interfaces)
        self._check_choice("command_interfaces", _COMMANDS)
        if "position" not in states:
            raise ValueError(
                f"state_interfaces must have 'position', "
                f"got {list(self.state_interfaces)}"
            )
        self._check_choice("state_interfaces", _STATES)
        if commands in _COMMANDS_WITH_FEEDBACK and "velocity" not in states:
            raise ValueError(
                f"state_interfaces must have 'velocity' to command "
                f"{list(self.command_interfaces)}, got {list(self.state_interfaces)}"
            )
        own = self.command_joints
        if len(own) > len(self.joints) or (
            len(own) < len(self.joints) and not set(own) <= set(self.joints)
        ):
            raise ValueError(
                f"command_joints must be some of {list(self.joints)}, or as many, "
                f"got {list(own)}"
            )
        check_at_least(self, 0.0, "cmd_timeout")
        if not 0.1 <= self.action_monitor_rate < math.inf:
            raise ValueError(
                f"action_monitor_rate must be at least 0.1 Hz, "
                f"got {self.action_monitor_rate}"
            )
        if commands in _COMMANDS_OF_PID:
            for joint, gains in self.gains.joint.items():
                gains.check(f"gains.{joint}")

    def _check_choice(self, name: str, choices: tuple[set[str], ...]) -> None:
        values = getattr(self, name)
        if set(values) not in choices:
            listed = ", ".join(str(sorted(choice)) for choice in choices)
            raise ValueError(f"{name} must be one of {listed}, got {list(values)}")


@dataclass(frozen=True)
class ScaledJointTrajectoryControllerParameters(JointTrajectoryControllerParameters):
    """Parameters of ur_controllers' ScaledJointTrajectoryController."""

    @staticmethod
    def adapt(params: ParameterGroup) -> None:
        """Rename the parameter of the speed scaling's state interface."""
        JointTrajectoryControllerParameters.adapt(params)
        params.rename("speed_scaling_interface_name", "speed_scaling.state_interface")


# Parameters that can't change while the controller runs.
_READ_ONLY = (
    "joints",
    "command_joints",
    "command_interfaces",
    "state_interfaces",
    "interpolate_from_desired_state",
    "open_loop_control",
    "action_monitor_rate",
    "interpolation_method",
    "speed_scaling",
    "constraints.decelerate_on_cancel",
)

# Fields of points by state interface.
_FIELDS = {
    "position": "positions",
    "velocity": "velocities",
    "acceleration": "accelerations",
}

_HUMBLE_PREEMPTED_TEXT = "Current goal cancelled due to new incoming action."


def make_rules(
    parameters: JointTrajectoryControllerParameters,
    *,
    update_rate: int,
    joint_types: Mapping[str, str],
    velocity_limits: Mapping[str, float],
    distro: str,
) -> JointTrajectoryRules:
    """Return the rules of a controller; rates [Hz], `velocity_limits` [rad/s]."""
    joints, constraints = parameters.joints, parameters.constraints
    by_joint = [constraints.joint.get(joint, JointConstraints()) for joint in joints]
    endless = _find_endless(parameters, joint_types)
    upsampling, scaling = parameters.positions_upsampling, parameters.speed_scaling
    period_ns = NANOSECONDS // update_rate
    pid, ff_velocity_scale = _make_pid(parameters, distro)
    is_scaled = parameters.command_interfaces == ("position",)
    rules = JointTrajectoryRules(
        allowed=_make_allowed(parameters),
        tolerances=make_default_tolerances(
            [constraint.trajectory for constraint in by_joint],
            [constraint.goal for constraint in by_joint],
            stopped_velocity_tolerance=constraints.stopped_velocity_tolerance,
            goal_time=constraints.goal_time,
        ),
        look_ahead_ns=period_ns,
        monitor_period_ns=int(NANOSECONDS / parameters.action_monitor_rate),
        command_interfaces=parameters.command_interfaces,
        commanded_joints=_commanded_joints(parameters),
        interpolation=parameters.interpolation_method,
        interpolate_from_desired_state=(
            parameters.interpolate_from_desired_state or parameters.open_loop_control
        ),
        cmd_timeout=parameters.cmd_timeout,
        wraparound=endless if endless.any() else None,
        is_prismatic=np.array([joint_types.get(j) == "prismatic" for j in joints]),
        pid=pid,
        ff_velocity_scale=ff_velocity_scale,
        starts_from_commands=(
            parameters.set_last_command_interface_value_as_state_on_activation
        ),
        deceleration=_make_deceleration(parameters, velocity_limits, period_ns),
        allow_replacement=parameters.allow_trajectory_replacement,
        upsampling_frequency=upsampling.policy_frequency if upsampling.enable else None,
        initial_scaling_factor=scaling.initial_scaling_factor,
        has_scaling_state=is_scaled and bool(scaling.state_interface),
        has_scaling_command=bool(scaling.command_interface),
        is_cursor_pinned=distro == "jazzy",
    )
    if distro != "humble":
        return rules
    return dc.replace(
        rules,
        allowed=dc.replace(rules.allowed, has_effort_command=False),
        starts_at_last_command=False,
        carries_effort=False,
        preempted_status=GoalStatus.CANCELED,
        preempted_text=_HUMBLE_PREEMPTED_TEXT,
    )


def _find_endless(
    parameters: JointTrajectoryControllerParameters, joint_types: Mapping[str, str]
) -> Mask:
    """Return which joints turn without end, shape (n,): by URDF, or humble's gains."""
    gains = parameters.gains.joint
    return np.array(
        [
            joint_types.get(joint) == "continuous"
            or (joint in gains and gains[joint].angle_wraparound)
            for joint in parameters.joints
        ]
    )


def _make_allowed(parameters: JointTrajectoryControllerParameters) -> TrajectoryRules:
    commands, states = parameters.command_interfaces, parameters.state_interfaces
    return TrajectoryRules(
        joints=parameters.joints,
        allow_partial_joints_goal=parameters.allow_partial_joints_goal,
        allow_nonzero_velocity_at_trajectory_end=(
            parameters.allow_nonzero_velocity_at_trajectory_end
        ),
        allow_integration_in_goal_trajectories=(
            parameters.allow_integration_in_goal_trajectories
        ),
        has_effort_command="effort" in commands,
        needed=needed_fields(commands, parameters.interpolation_method),
        known_at_start=("effort", *(_FIELDS[name] for name in states)),
    )


def _commanded_joints(
    parameters: JointTrajectoryControllerParameters,
) -> tuple[int, ...] | None:
    """Return which joints are commanded; None if all are, whatever they are called."""
    joints, commanded = parameters.joints, parameters.command_joints
    if not commanded or len(commanded) == len(joints):
        return None
    return tuple(joints.index(joint) for joint in commanded)


def _make_pid(
    parameters: JointTrajectoryControllerParameters, distro: str
) -> tuple[Pid | None, Array | None]:
    """Return the PIDs of all joints and their feed-forward scales, shape (n,)."""
    commands = parameters.command_interfaces
    is_open = distro == "humble" and parameters.open_loop_control
    if commands not in (("velocity",), ("effort",)) or (
        is_open and commands == ("velocity",)
    ):
        return None, None
    by_joint = parameters.gains.joint
    gains = [by_joint.get(joint, JointGains()) for joint in parameters.joints]
    scales = np.array([gain.ff_velocity_scale for gain in gains])
    return Pid.from_gains(gains, is_humble=distro == "humble"), scales


def _make_deceleration(
    parameters: JointTrajectoryControllerParameters,
    velocity_limits: Mapping[str, float],
    period_ns: int,
) -> Deceleration | None:
    """Return how joints brake; None unless all of them can.

    That takes a deceleration, a velocity limit in the URDF and measured velocities.
    """
    constraints, joints = parameters.constraints, parameters.joints
    if not constraints.decelerate_on_cancel:
        return None
    by_joint = [constraints.joint.get(joint, JointConstraints()) for joint in joints]
    decelerations = np.array([c.max_deceleration_on_cancel for c in by_joint])
    limits = np.array([velocity_limits.get(joint, 0.0) for joint in joints])
    if "velocity" not in parameters.state_interfaces or not (
        (decelerations > 0.0).all() and (limits > 0.0).all()
    ):
        return None
    num_points = min_stop_points(decelerations, limits, period_ns)
    return Deceleration(decelerations, num_points)


def check_change(
    old: JointTrajectoryControllerParameters, new: object
) -> JointTrajectoryControllerParameters:
    """Return parameters that may take the place of others while a controller runs."""
    if not isinstance(new, JointTrajectoryControllerParameters):
        raise ValueError(f"expected JointTrajectoryControllerParameters, got {new!r}")
    changed = [n for n in _READ_ONLY if attrgetter(n)(new) != attrgetter(n)(old)]
    for joint in old.joints:
        was, is_ = (_decelerations(p).get(joint, 0.0) for p in (old, new))
        if was != is_:
            changed.append(f"constraints.{joint}.max_deceleration_on_cancel")
    if changed:
        raise ValueError(f"{changed[0]} can't change while the controller runs")
    return new


def _decelerations(parameters: JointTrajectoryControllerParameters) -> dict[str, float]:
    by_joint = parameters.constraints.joint.items()
    return {joint: c.max_deceleration_on_cancel for joint, c in by_joint}


class Inbox(NamedTuple):
    """Input received on the ports of a JointTrajectoryController."""

    # Parameters in effect, and what was made of them.
    parameters: JointTrajectoryControllerParameters
    rules: JointTrajectoryRules

    # What was on the ports at the last tick.
    received_parameters: object = ()
    topics: tuple[JointTrajectory, ...] = ()
    requests: tuple[ActionRequest, ...] = ()
    factors: tuple[SpeedScalingFactor, ...] = ()
