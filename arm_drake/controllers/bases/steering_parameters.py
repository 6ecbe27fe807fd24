"""Parameters of the steering controllers: bicycle, tricycle and ackermann.

Source: ros2_controllers, `steering_controllers_library`, `bicycle_steering_controller`,
`tricycle_steering_controller`, `ackermann_steering_controller` (version 6.9.0; names of
humble by `adapt`).
"""

import dataclasses as dc
from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, ClassVar

from arm_drake.control.steering import SteeringGeometry
from arm_drake.description.given import Given
from arm_drake.description.parameters import Rule
from arm_drake.description.validation import (
    check_above,
    check_at_least,
    check_duration,
    check_length,
    check_not_empty,
    check_unique,
)

_WHEELS = (
    "traction_joints_names",
    "steering_joints_names",
    "traction_joints_state_names",
    "steering_joints_state_names",
)


@dc.dataclass(frozen=True)
class SteeringControllerParameters:
    """Parameters that all steering controllers have."""

    # How many driven and how many steered wheels there are.
    wheels: ClassVar[tuple[int, int]]

    # Humble's names of measures, of front and rear wheels: what they are where these
    # are driven, and where they are steered; "" is without use.
    front_and_rear: ClassVar[Mapping[tuple[str, str], tuple[str, str]]]

    # Driven joints, each once; of two the right one first.
    traction_joints_names: Annotated[tuple[str, ...], Rule(since="jazzy", is_kept=True)]

    # Steered joints, each once; of two the right one first.
    steering_joints_names: Annotated[tuple[str, ...], Rule(since="jazzy", is_kept=True)]

    # Joints to read in their places; () is the same.
    traction_joints_state_names: tuple[str, ...] = ()
    steering_joints_state_names: tuple[str, ...] = ()

    # Distance between front and rear wheels, above 0 [m].
    wheelbase: float = 0.0

    # Age from which a command counts no more [s]; 0 uses each one once.
    reference_timeout: float = 1.0

    # Whether odometry is computed from commands, not from measurements.
    open_loop: bool = False

    # Whether wheels slow down until they are steered.
    reduce_wheel_speed_until_steering_reached: bool = False

    # How many ticks the odometry's velocity is a mean of.
    velocity_rolling_window_size: int = 10

    # Frames of the odometry, and what goes before their names.
    base_frame_id: str = "base_link"
    odom_frame_id: str = "odom"
    tf_frame_prefix: str = ""

    # Whether the odometry goes to /tf too.
    enable_odom_tf: bool = True

    # Diagonals of the odometry's covariances: x, y, z, roll, pitch, yaw.
    twist_covariance_diagonal: tuple[float, ...] = (0.0, 7.0, 14.0, 21.0, 28.0, 35.0)
    pose_covariance_diagonal: tuple[float, ...] = (0.0, 7.0, 14.0, 21.0, 28.0, 35.0)

    # Whether the driven joints' positions are read, not their velocities.
    position_feedback: bool = False

    # Whether commands are TwistStamped, not Twist; later they always are.
    use_stamped_vel: Annotated[
        bool, Rule(until="humble", is_kept=True, is_harmless=True)
    ] = True

    @abstractmethod
    def make_geometry(self) -> SteeringGeometry:
        """Return the dimensions of the base."""

    @classmethod
    def adapt(cls, given: Given) -> None:
        """Take humble's names, by front and rear."""
        is_front = given.get("front_steering", bool)
        steers_front = is_front is None or is_front
        driven, steered = ("rear", "front") if steers_front else ("front", "rear")
        for end, use in ((driven, "traction"), (steered, "steering")):
            given.rename(f"{end}_wheels_names", f"{use}_joints_names")
            given.rename(f"{end}_wheels_state_names", f"{use}_joints_state_names")
        for (front, rear), (traction, steering) in cls.front_and_rear.items():
            of_driven, of_steered = (rear, front) if steers_front else (front, rear)
            given.rename(of_driven, traction)
            if steering:
                given.rename(of_steered, steering)
            elif of_steered in given:
                what = "the steered wheels' radius has no use"
                given.add(of_steered, "info", "ignored", what, "it has no effect")
                given.drop(of_steered)
        if is_front is not None:
            if given.distro != "humble":
                what = "a parameter of humble"
                done = f"{driven} wheels are the traction joints"
                given.add("front_steering", "info", "repair", what, done)
            given.drop("front_steering")
        for name in _WHEELS:
            joints: tuple[str, ...] = given.get(name, tuple[str, ...]) or ()
            if len(joints) == 2 and "left" in joints[0] and "right" in joints[1]:
                what = f"the right joint comes first, got {list(joints)}"
                done = "taken as written: left and right are swapped"
                given.add(name, "warning", "invalid", what, done)

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        check_not_empty(self, *_WHEELS[:2])
        check_unique(self, *_WHEELS)
        check_length(self, self.wheels[0], "traction_joints_names")
        check_length(self, self.wheels[1], "steering_joints_names")
        for name in _WHEELS[2:]:
            use = name.replace("_state", "")
            if getattr(self, name):
                check_length(self, len(getattr(self, use)), name)
        check_above(self, 0.0, "wheelbase")
        check_duration(self, "reference_timeout")
        check_at_least(self, 1, "velocity_rolling_window_size")
        check_length(self, 6, "pose_covariance_diagonal", "twist_covariance_diagonal")


@dc.dataclass(frozen=True)
class BicycleSteeringControllerParameters(SteeringControllerParameters):
    """Parameters of a BicycleSteeringController: one driven, one steered wheel."""

    wheels = (1, 1)
    front_and_rear: ClassVar = {
        ("front_wheel_radius", "rear_wheel_radius"): ("traction_wheel_radius", "")
    }

    # Radius of the driven wheel, above 0 [m].
    traction_wheel_radius: float = 0.0

    def make_geometry(self) -> SteeringGeometry:
        """Return the dimensions of the base."""
        return SteeringGeometry(self.wheelbase, self.traction_wheel_radius)

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        super().__post_init__()
        check_above(self, 0.0, "traction_wheel_radius")


@dc.dataclass(frozen=True)
class TricycleSteeringControllerParameters(SteeringControllerParameters):
    """Parameters of a TricycleSteeringController: two driven, one steered wheel."""

    wheels = (2, 1)
    front_and_rear: ClassVar = {
        ("front_wheels_radius", "rear_wheels_radius"): ("traction_wheels_radius", "")
    }

    # Distance between the driven wheels, above 0 [m].
    traction_track_width: Annotated[float, Rule(was=("wheel_track",))] = 0.0

    # Radius of the driven wheels, above 0 [m].
    traction_wheels_radius: float = 0.0

    def make_geometry(self) -> SteeringGeometry:
        """Return the dimensions of the base."""
        return SteeringGeometry(
            self.wheelbase,
            self.traction_wheels_radius,
            num_driven=2,
            traction_track_width=self.traction_track_width,
        )

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        super().__post_init__()
        check_above(self, 0.0, "traction_track_width", "traction_wheels_radius")


@dc.dataclass(frozen=True)
class AckermannSteeringControllerParameters(SteeringControllerParameters):
    """Parameters of an AckermannSteeringController: two driven, two steered wheels."""

    wheels = (2, 2)
    front_and_rear: ClassVar = {
        ("front_wheels_radius", "rear_wheels_radius"): ("traction_wheels_radius", ""),
        ("front_wheel_track", "rear_wheel_track"): (
            "traction_track_width",
            "steering_track_width",
        ),
    }

    # Distance between the driven wheels, above 0 [m].
    traction_track_width: float = 0.0

    # Distance between the steered wheels [m]; 0 is traction_track_width.
    steering_track_width: float = 0.0

    # Radius of the driven wheels, above 0 [m].
    traction_wheels_radius: float = 0.0

    def make_geometry(self) -> SteeringGeometry:
        """Return the dimensions of the base."""
        return SteeringGeometry(
            self.wheelbase,
            self.traction_wheels_radius,
            num_driven=2,
            num_steered=2,
            traction_track_width=self.traction_track_width,
            steering_track_width=self.steering_track_width or self.traction_track_width,
        )

    def __post_init__(self) -> None:
        """Reject what the types alone can't express."""
        super().__post_init__()
        check_above(self, 0.0, "traction_track_width", "traction_wheels_radius")
