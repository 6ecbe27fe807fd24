"""Robots on wheels in the plant: their wheels, their true motion, and the ground."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    ModelInstanceIndex,
    MultibodyForces,
    RigidBody,
)
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, OutputPort

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import ControllerInterface
from arm_drake.description.base_wheels import (
    Axle,
    MobileBase,
    Rollers,
    find_axles,
    find_bases,
    find_load_inertia,
    find_rollers,
    moved_joints,
    report_axles,
    report_bases,
    report_rollers,
    rigid_links,
    with_axles,
    with_rollers,
)
from arm_drake.description.joints import joints_above
from arm_drake.description.report import LoadReport, Severity
from arm_drake.description.robot import Robot
from arm_drake.description.urdf import RobotDescription
from arm_drake.importing import dataclass
from arm_drake.manager.loaded_controllers import LoadedController
from arm_drake.messages import (
    NANOSECONDS,
    Header,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    Twist,
    TwistWithCovariance,
    Vector3,
)
from arm_drake.plant.contact import GROUND, for_drake, set_friction
from arm_drake.plant.initial_poses import (
    RestingShape,
    find_shapes,
    lowest_height,
    lowest_points,
    resting_shape,
)
from arm_drake.python_system import PythonSystem

if TYPE_CHECKING:
    from arm_drake.controllers.gazebo.velocity_control import HeldTwist

# Directions across a wheel's axis in which its radius is looked for.
_NUM_DIRECTIONS = 64


class Wheel(NamedTuple):
    """A driven wheel of a base, in the frame of the body that turns."""

    # Joint that turns it.
    joint: str

    # Index of the body.
    body: int

    # Middle of the wheel [m], and its axis, to the left of the base. Shapes (3,).
    center: Array
    axis: Array

    # [m].
    radius: float

    # Indices of the bodies that touch the ground.
    touching: tuple[int, ...] = ()

    # Where the axis of a roller that is down points: forwards, and to the left of the
    # wheel. None without rollers.
    roller: tuple[float, float] | None = None


def find_wheels(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    model: ModelInstanceIndex,
    description: RobotDescription,
    base: MobileBase,
    axles: Sequence[Axle],
    rollers: Sequence[Rollers] = (),
) -> list[Wheel]:
    """Return the driven wheels of a base: what its joints turn, and what can collide.

    They are in the order of the joints, mimic joints where their masters are.
    """
    turning = {axle.link: axle.wheel for axle in axles}
    context = plant.CreateDefaultContext()
    link = plant.GetBodyByName(base.link, model)
    left = plant.EvalBodyPoseInWorld(context, link).rotation().matrix()[:, 1]
    wheels = []
    for moved in (j for name in base.driven for j in moved_joints(description, name)):
        parts = rigid_links(description, moved.child)
        rolling = [rim for rim in rollers if rim.link in parts]
        if rolling:
            wheels.append(_with_rollers(plant, model, moved.name, rolling[0], left))
            continue
        body = plant.GetBodyByName(turning.get(moved.child, moved.child), model)
        shapes = _shapes(plant, scene_graph, body)
        if not shapes:
            continue
        axis = moved.unit_axis
        R_WB = plant.EvalBodyPoseInWorld(context, body).rotation()
        if R_WB @ axis @ left < 0.0:
            axis = -axis
        radius = max(_reach(shapes, direction) for direction in _across(axis))
        center = (_reach(shapes, axis) - _reach(shapes, -axis)) / 2.0 * axis
        index = int(body.index())
        wheels.append(Wheel(moved.name, index, center, axis, radius, (index,)))
    return wheels


def _with_rollers(
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    joint: str,
    rim: Rollers,
    left: Array,
) -> Wheel:
    """Return a wheel with rollers."""
    body = plant.GetBodyByName(rim.link, model)
    X_WB = plant.EvalBodyPoseInWorld(plant.CreateDefaultContext(), body)
    axis = rim.axis * (1.0 if X_WB.rotation() @ rim.axis @ left >= 0.0 else -1.0)
    forwards = np.cross(axis, -rim.down)
    return Wheel(
        joint,
        int(body.index()),
        rim.center,
        axis,
        rim.radius,
        tuple(int(plant.GetBodyByName(n, model).index()) for n in rim.wheels),
        (float(rim.roller @ forwards), float(rim.roller @ axis)),
    )


def _shapes(
    plant: MultibodyPlant, scene_graph: SceneGraph, body: RigidBody
) -> list[RestingShape]:
    inspector = scene_graph.model_inspector()
    return [
        resting_shape(inspector, geometry, inspector.GetPoseInFrame(geometry))
        for geometry in plant.GetCollisionGeometriesForBody(body)
    ]


def _reach(shapes: Sequence[RestingShape], direction: Array) -> float:
    """Return how far shapes reach in a direction from the origin [m]."""
    points = np.vstack([lowest_points(shape, -direction) for shape in shapes])
    return float((points @ direction).max())


def _across(axis: Array) -> Iterator[Array]:
    """Yield directions across an axis."""
    first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    for angle in np.linspace(0.0, 2.0 * np.pi, _NUM_DIRECTIONS, endpoint=False):
        yield np.cos(angle) * first + np.sin(angle) * second


_UP = np.array([0.0, 0.0, 1.0])


class BaseTruth(PythonSystem):
    """Measures a base and its wheels against the ground z = 0, which is at rest.

    .. pydrake_system::

        name: BaseTruth
        input_ports:
        - body_poses
        - body_velocities
        - odometry
        output_ports:
        - wheel_slip
        - ground_truth

    ===============  ====  =====  =====================================================
    port             size  unit   meaning
    ===============  ====  =====  =====================================================
    body_poses       --    --     list of RigidTransform: pose of every body
    body_velocities  --    --     list of SpatialVelocity: that of every body
    odometry         --    --     Odometry as the controller publishes it; its frames
                                  are those of ground_truth. May be unconnected
    wheel_slip       2n    m/s    velocity of the lowest point of each of n wheels:
                                  forwards along them, then across them to the left.
                                  Of wheels with rollers: along the axis of the roller
                                  that is down; then 0
    ground_truth     --    --     Odometry: pose of the base from where it started, on
                                  the ground below it; its velocity in its own frame
    ===============  ====  =====  =====================================================

    It has no state.
    """

    def __init__(
        self, link: str, body: int, start: RigidTransform, wheels: Sequence[Wheel]
    ) -> None:
        """Create the system."""
        super().__init__()
        self._link, self._body, self.wheels = link, body, tuple(wheels)
        yaw = RollPitchYaw(start.rotation()).yaw_angle()
        x, y, _ = start.translation()
        self._X_OW = RigidTransform(RollPitchYaw(0.0, 0.0, yaw), [x, y, 0.0]).inverse()
        poses = AbstractValue.Make([RigidTransform()])
        velocities = AbstractValue.Make([SpatialVelocity()])
        odometry = AbstractValue.Make(Odometry())
        self._poses = self.DeclareAbstractInputPort("body_poses", poses)
        self._velocities = self.DeclareAbstractInputPort("body_velocities", velocities)
        self._odometry = self.DeclareAbstractInputPort("odometry", odometry)
        motion = {self._poses.ticket(), self._velocities.ticket()}
        self.DeclareVectorOutputPort(
            "wheel_slip", 2 * len(self.wheels), self._calc_wheel_slip, motion
        )
        self.DeclareAbstractOutputPort(
            "ground_truth",
            lambda: AbstractValue.Make(Odometry()),
            self._calc_ground_truth,
            {*motion, self._odometry.ticket(), self.time_ticket()},
        )

    def _calc_wheel_slip(self, context: Context, output: BasicVector) -> None:
        poses, velocities = self._poses.Eval(context), self._velocities.Eval(context)
        slips = [
            _slip(wheel, poses[wheel.body], velocities[wheel.body])
            for wheel in self.wheels
        ]
        output.SetFromVector(np.array(slips).reshape(-1, 2).T.ravel())

    def _calc_ground_truth(self, context: Context, output: AbstractValue) -> None:
        X_WB = self._poses.Eval(context)[self._body]
        V_WB = self._velocities.Eval(context)[self._body]
        X_OB, R_BW = self._X_OW @ X_WB, X_WB.rotation().inverse()
        v, w = R_BW @ V_WB.translational(), R_BW @ V_WB.rotational()
        known = Odometry()
        if self._odometry.HasValue(context):
            known = self._odometry.Eval(context)
        time, frame = round(context.get_time() * NANOSECONDS), known.header.frame_id
        position = Point(*map(float, X_OB.translation()))
        wxyz = X_OB.rotation().ToQuaternion().wxyz()
        pose = Pose(position, Quaternion.from_wxyz(wxyz))
        twist = Twist(Vector3(*map(float, v)), Vector3(*map(float, w)))
        truth = Odometry(
            Header.from_nanoseconds(time, frame or "odom"),
            known.child_frame_id or self._link,
            PoseWithCovariance(pose),
            TwistWithCovariance(twist),
        )
        output.set_value(truth)


def _slip(
    wheel: Wheel, X_WB: RigidTransform, V_WB: SpatialVelocity
) -> tuple[float, float]:
    """Return the velocity of a wheel's lowest point, along and across it [m/s]."""
    R_WB = X_WB.rotation()
    axis = R_WB @ wheel.axis
    forwards = np.cross(axis, _UP)
    forwards /= np.linalg.norm(forwards)
    down = np.cross(forwards, axis)
    # From the body's origin to the lowest point.
    p = R_WB @ wheel.center - wheel.radius * down * np.sign(down[2])
    v = V_WB.translational() + np.cross(V_WB.rotational(), p)
    along, across = float(v @ forwards), float(v @ np.cross(_UP, forwards))
    if wheel.roller is None:
        return along, across
    return along * wheel.roller[0] + across * wheel.roller[1], 0.0


class BaseServo(PythonSystem):
    """Lets a free base have a velocity, whatever it takes.

    .. pydrake_system::

        name: BaseServo
        input_ports:
        - state
        - held_twist
        output_ports:
        - generalized_force

    =================  ====  ==========  ===============================================
    port               size  unit        meaning
    =================  ====  ==========  ===============================================
    state              --    --          of the robot in the plant
    held_twist         --    --          HeldTwist; None is no force
    generalized_force  n     N, N·m, ..  along the robot's n velocities
    =================  ====  ==========  ===============================================

    It has no state. As Gazebo, which sets the base's velocity before a step of the
    physics, it makes for the step dt that lies ahead, with the mass matrix M::

        force = M a, a = (v_held - v) / dt of the base's velocities v, 0 of the joints'

    so that joints keep theirs, and all else that acts in the step, such as friction and
    gravity, changes what is held by what it does in this step.
    """

    def __init__(
        self, plant: MultibodyPlant, model: ModelInstanceIndex, link: str
    ) -> None:
        """Create the system for a finalized plant."""
        super().__init__()
        self._plant, self._model = plant, model
        self._body = plant.GetBodyByName(link, model)
        # Its angular velocity comes first, then the linear one, both in the world.
        start = self._body.floating_velocities_start_in_v()
        self._own = slice(start, start + 6)
        self._dt = plant.time_step()
        self._nothing = MultibodyForces(plant)
        # To compute in; what it holds before doesn't count.
        self._scratch = plant.CreateDefaultContext()
        size = plant.num_multibody_states(model)
        self._state = self.DeclareVectorInputPort("state", size)
        # Robots whose bases go on wheels pay for nothing.
        from arm_drake.controllers.gazebo.velocity_control import HeldTwist

        twist = AbstractValue.Make(HeldTwist())
        self._twist = self.DeclareAbstractInputPort(interfaces.TWIST_PORT, twist)
        self.DeclareVectorOutputPort(
            "generalized_force",
            plant.num_velocities(model),
            self._calc_force,
            {self._state.ticket(), self._twist.ticket()},
        )

    def _calc_force(self, context: Context, output: BasicVector) -> None:
        twist: HeldTwist | None = self._twist.Eval(context)
        plant, model = self._plant, self._model
        if twist is None:
            output.SetZero()
            return
        own = self._scratch
        plant.SetPositionsAndVelocities(own, model, self._state.Eval(context))
        R_WB = plant.EvalBodyPoseInWorld(own, self._body).rotation()
        if twist.is_level:
            R_WB = RotationMatrix.MakeZRotation(RollPitchYaw(R_WB).yaw_angle())
        held = [*(R_WB @ np.array(twist.angular)), *(R_WB @ np.array(twist.linear))]
        a = np.zeros(plant.num_velocities())
        a[self._own] = (held - plant.GetVelocities(own)[self._own]) / self._dt
        # At rest no velocity makes a force of its own.
        plant.SetVelocities(own, np.zeros(len(a)))
        force = plant.CalcInverseDynamics(own, a, self._nothing)
        output.SetFromVector(plant.GetVelocitiesFromArray(model, force))


def _add_base_truths(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    controllers: Sequence[LoadedController],
    bases: Sequence[tuple[MobileBase, Sequence[Wheel]]],
    prefix: str,
) -> None:
    """Add what measures bases with their wheels, and export its ports.

    They are called `<controller>.wheel_slip` and `<controller>.ground_truth`.
    """
    systems = {c.name: c.system for c in controllers if c.system is not None}
    for base, wheels in bases:
        if base.controller not in systems:
            continue
        context, body = plant.CreateDefaultContext(), plant.GetBodyByName
        link = body(base.link, model)
        start = plant.EvalBodyPoseInWorld(context, link)
        name = f"{prefix}{base.controller}:truth"
        truth = builder.AddNamedSystem(
            name, BaseTruth(base.link, int(link.index()), start, wheels)
        )
        for port, name in (
            (plant.get_body_poses_output_port(), "body_poses"),
            (plant.get_body_spatial_velocities_output_port(), "body_velocities"),
            (_odometry(systems[base.controller]), "odometry"),
        ):
            if port is not None:
                builder.Connect(port, truth.GetInputPort(name))
        for port_name in ("wheel_slip", "ground_truth"):
            exported = f"{prefix}{base.controller}.{port_name}"
            builder.ExportOutput(truth.GetOutputPort(port_name), exported)


def _odometry(system: ControllerInterface) -> OutputPort | None:
    """Return the port on which a controller publishes its odometry."""
    for index in range(system.num_output_ports()):
        port = system.get_output_port(index)
        if port.get_name().rpartition("/")[2] in ("odom", "odometry"):
            return port
    return None


# So far above or below the ground a base doesn't stand on it [m].
_OFF_GROUND = 0.01

# Heights that differ less are one [m].
_TOUCHING = 1e-6

# So far above the lowest point of the robot a wheel doesn't touch the ground [m].
_GAP = 1e-3


def _report_ground(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    model: ModelInstanceIndex,
    robot: Robot,
    report: LoadReport,
    bases: Sequence[tuple[MobileBase, Sequence[Wheel]]],
) -> None:
    """Record a base that has no ground, or isn't on it, or whose wheels aren't.

    Heights are known above a ground at z = 0 alone, as the built-in worlds have it.
    Wheels with springs reach what they reach by themselves.
    """
    if not robot.has_free_base:
        return
    file = robot.description.file
    fixed = [
        index
        for index in map(BodyIndex, range(plant.num_bodies()))
        if plant.IsAnchored(plant.get_body(index))
    ]
    if not find_shapes(plant, scene_graph, fixed):
        what = "a mobile base in a world without a ground"
        done = "it falls; expected world='empty', or one that has something to stand on"
        report.add("error", "missing", what, done, file=file)
        return
    shapes = find_shapes(plant, scene_graph, plant.GetBodyIndices(model))
    grounds = find_shapes(plant, scene_graph, fixed, GROUND)
    if not shapes or not any(map(_is_at_zero, grounds)):
        return
    lowest = min(lowest_height(shape) for shape in shapes)
    _report_height(robot, lowest, report)
    for base, wheels in bases:
        gaps = {}
        for wheel in wheels:
            if not _is_sprung(robot, wheel.joint, base.link):
                indices = map(BodyIndex, wheel.touching)
                own = find_shapes(plant, scene_graph, indices)
                gaps[wheel.joint] = min(map(lowest_height, own)) - lowest
        off = {joint: gap for joint, gap in gaps.items() if gap > _GAP}
        for joint, gap in off.items():
            severity: Severity = "error" if len(off) == len(wheels) else "warning"
            what = f"a driven wheel ends {gap:.3g} m above what the robot stands on"
            done = "it turns in the air; expected a wheel that reaches the ground"
            where = f"joint {joint!r}"
            report.add(severity, "invalid", what, done, where=where, file=file)


def _report_height(robot: Robot, lowest: float, report: LoadReport) -> None:
    """Record a robot whose lowest point [m] isn't on the ground."""
    if abs(lowest) > _OFF_GROUND:
        z = 0.0 if robot.pose is None else robot.pose[2]
        is_above = lowest > 0.0
        side, does = ("above", "falls") if is_above else ("below", "is pushed out")
        what = f"the base starts {abs(lowest):.3g} m {side} the ground"
        # To the tenth of a millimetre; rounding may leave some of the zero.
        done = f"it {does}; expected z = {round(z - lowest, 4) + 0.0:g} m"
        file = robot.description.file
        report.add("warning", "invalid", what, done, where="pose", file=file)


def _report_steering(
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    description: RobotDescription,
    base: MobileBase,
    report: LoadReport,
) -> None:
    """Record steered joints whose positive angle turns a base to the right.

    The kinematics of steering controllers has them in front of the driven ones, on
    axes that point up; in ROS, too, such a base goes the wrong way.
    """
    context = plant.CreateDefaultContext()

    def find(names: Sequence[str]) -> tuple[Array, Array]:
        """Return where joints are in the middle [m], and the mean of their axes."""
        joints = [description.joint(name) for name in names]
        bodies = [plant.GetBodyByName(joint.child, model) for joint in joints]
        poses = [plant.EvalBodyPoseInWorld(context, body) for body in bodies]
        axes = [
            pose.rotation() @ joint.unit_axis
            for pose, joint in zip(poses, joints, strict=True)
        ]
        places = [pose.translation() for pose in poses]
        return np.mean(places, axis=0), np.mean(axes, axis=0)

    if not (base.driven and base.steered):
        return
    (driven, roll), (steered, up) = find(base.driven), find(base.steered)
    forward = np.cross(roll, [0.0, 0.0, 1.0])
    if float(forward @ (steered - driven)) * float(up[2]) > -_TOUCHING:
        return
    what = f"a positive angle of {', '.join(map(repr, base.steered))} turns the base to"
    what += " the right"
    done = "it turns the other way than commanded, as in ROS; expected an axis that "
    done += "points up of wheels in front of the driven ones, down of those behind them"
    where = f"controller {base.controller!r}"
    report.add("warning", "invalid", what, done, where=where, file=description.file)


def _is_at_zero(shape: RestingShape) -> bool:
    """Return whether the top of a shape is at z = 0."""
    highest = lowest_points(shape, np.array([0.0, 0.0, -1.0]))[:, 2].max()
    return bool(abs(highest) < _TOUCHING)


def _is_sprung(robot: Robot, joint: str, base: str) -> bool:
    """Return whether another joint than its own lets a wheel move up and down."""
    link = robot.description.joint(joint).parent
    for carrier in joints_above(robot.description.joints, link):
        if carrier.child == base:
            return False
        if carrier.type not in ("fixed", "revolute", "continuous"):
            return True
    return False


@dataclass(frozen=True)
class RobotBases:
    """The bases of a robot, and what its plant has besides what is described."""

    robot: Robot
    bases: tuple[MobileBase, ...]
    axles: tuple[Axle, ...]
    rollers: tuple[Rollers, ...]

    @classmethod
    def of(cls, robot: Robot, *, has_physics: bool = True) -> "RobotBases":
        """Return the bases of a robot; without physics their wheels need nothing."""
        description = robot.description
        bases: tuple[MobileBase, ...] = ()
        if robot.has_free_base:
            bases = find_bases(description, robot.controllers)
        rolling = bases if has_physics else ()
        axles = find_axles(description, rolling)
        rollers = find_rollers(description, rolling)
        return cls(robot, bases, tuple(axles), tuple(rollers))

    def describe(self) -> RobotDescription:
        """Return the robot's description with the wheels that its plant has."""
        return with_rollers(
            with_axles(self.robot.description, self.axles), self.rollers
        )

    @property
    def free_links(self) -> set[str]:
        """The bodies that nothing holds."""
        added = {axle.wheel for axle in self.axles}
        added.update(name for rim in self.rollers for name in rim.wheels)
        return self.robot.free_links | added

    @property
    def load_inertia(self) -> dict[str, float]:
        """Inertia that wheels move on the ground [kg·m^2], by their joints."""
        return find_load_inertia(self.robot.description, self.bases)

    def report(self, report: LoadReport) -> None:
        """Record what is the matter with the wheels, and what is done about it."""
        description = self.robot.description
        report_bases(description, self.bases, report)
        report_axles(description, self.axles, report)
        report_rollers(description, self.rollers, report)

    def set_friction(
        self, plant: MultibodyPlant, scene_graph: SceneGraph, model: ModelInstanceIndex
    ) -> None:
        """Give the links in a finalized plant the friction that they state."""
        turning = {axle.link: [axle.wheel] for axle in self.axles}
        turning |= {rim.link: rim.wheels for rim in self.rollers}
        friction = {
            body: for_drake(mu)
            for link, mu in self.robot.description.friction.items()
            for body in turning.get(link, [link])
        }
        set_friction(plant, scene_graph, model, friction)

    def add_servo(
        self,
        builder: DiagramBuilder,
        plant: MultibodyPlant,
        model: ModelInstanceIndex,
        controllers: Sequence[LoadedController],
        report: LoadReport,
        prefix: str,
    ) -> OutputPort | None:
        """Return the forces by which a system sets the velocity of the base, if any.

        Of several systems the last one does. The plant is finalized.
        """
        holders = [
            controller
            for controller in controllers
            if controller.system is not None
            and controller.system.HasOutputPort(interfaces.TWIST_PORT)
        ]
        where = f"controller {', '.join(repr(each.name) for each in holders)}"
        file = self.robot.description.file
        if holders and not self.robot.has_free_base:
            what = "a joint holds the base in the world"
            done = "it doesn't move; expected a base without a link 'world'"
            report.add("warning", "unsupported", what, done, where=where, file=file)
            return None
        if len(holders) > 1:
            what, done = "several plugins set the velocity of the base", "the last does"
            report.add("warning", "ignored", what, done, where=where, file=file)
        if not holders or holders[-1].system is None:
            return None
        link = self.robot.description.base
        servo = builder.AddNamedSystem(
            f"{prefix}base_servo", BaseServo(plant, model, link)
        )
        state = plant.get_state_output_port(model)
        builder.Connect(state, servo.GetInputPort("state"))
        twist = holders[-1].system.GetOutputPort(interfaces.TWIST_PORT)
        builder.Connect(twist, servo.GetInputPort(interfaces.TWIST_PORT))
        return servo.get_output_port()

    def add_truths(
        self,
        builder: DiagramBuilder,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        model: ModelInstanceIndex,
        controllers: Sequence[LoadedController],
        report: LoadReport,
        prefix: str,
    ) -> None:
        """Add the outputs that compare odometry with the truth, see `wheel_slip`.

        The plant is finalized, and the robot stands where it starts.
        """
        description, added = self.robot.description, (self.axles, self.rollers)
        wheels = [
            find_wheels(plant, scene_graph, model, description, base, *added)
            for base in self.bases
        ]
        bases = list(zip(self.bases, wheels, strict=True))
        for base in self.bases:
            _report_steering(plant, model, description, base, report)
        _report_ground(plant, scene_graph, model, self.robot, report, bases)
        _add_base_truths(builder, plant, model, controllers, bases, prefix)
