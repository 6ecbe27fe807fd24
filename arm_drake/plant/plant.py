"""A robot's model in a MultibodyPlant, with one actuator per commanded joint."""

import contextlib
import dataclasses as dc
import logging
import math
import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from pydrake.common import use_native_cpp_logging
from pydrake.geometry import (
    CollisionFilterDeclaration,
    GeometrySet,
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import (
    BodyIndex,
    FixedOffsetFrame,
    Frame,
    Joint,
    JointActuator,
    ModelInstanceIndex,
    PrismaticJoint,
    RevoluteJoint,
    SpatialInertia,
)
from pydrake.systems.framework import DiagramBuilder

from arm_drake.description.joints import FREE_TYPES, WORLD, JointInfo
from arm_drake.description.links import Origin, Pose
from arm_drake.description.report import LoadReport
from arm_drake.description.robot import Robot
from arm_drake.description.urdf import RobotDescription, write_urdf
from arm_drake.errors import DescriptionError, InputError
from arm_drake.options import SimulationOptions
from arm_drake.plant.payloads import Payload, add_payloads
from arm_drake.timing import choose_time_step

# The logger that Drake's messages go through, unless its own logging is used.
_DRAKE = "drake"


class _Collector(logging.Handler):
    """Keeps messages."""

    def __init__(self, messages: list[str]) -> None:
        super().__init__()
        self._messages = messages

    def emit(self, record: logging.LogRecord) -> None:
        self._messages.append(" ".join(record.getMessage().split()))


@contextlib.contextmanager
def drake_messages() -> Iterator[list[str]]:
    """Collect Drake's warnings instead of printing them."""
    logger = logging.getLogger(_DRAKE)
    messages: list[str] = []
    handlers, propagate = logger.handlers, logger.propagate
    logger.handlers, logger.propagate = [_Collector(messages)], False
    try:
        yield messages
    finally:
        logger.handlers, logger.propagate = handlers, propagate


def use_native_logging() -> None:
    """Let Drake log without Python, and only errors.

    Its Meshcat may wait for ever at the end if its threads log through Python. What
    Drake warns about a robot is in the robot's report already.
    """
    logging.getLogger(_DRAKE).setLevel(logging.ERROR)
    use_native_cpp_logging()


# Drake wants a period for what is drawn on demand [s].
_NEVER = 1e9

# Larger numbers of a pose [m], [rad] are no places: their squares aren't numbers.
_FARTHEST = 1e9

# Plants on trial. A Drake plant can't be pickled, so it is no part of its Robot.
_trials: "weakref.WeakKeyDictionary[Robot, MultibodyPlant]" = (
    weakref.WeakKeyDictionary()
)


def add_plant(
    builder: DiagramBuilder, time_step: float, options: SimulationOptions
) -> tuple[MultibodyPlant, SceneGraph]:
    """Add an empty discrete plant of step `time_step` [s], and its scene graph."""
    # Sampled ports would delay every command by a step.
    config = MultibodyPlantConfig(time_step=time_step, use_sampled_output_ports=False)
    plant, scene_graph = AddMultibodyPlant(config, builder)
    set_gravity(plant, options)
    return plant, scene_graph


def add_visualizer(
    builder: DiagramBuilder,
    scene_graph: SceneGraph,
    meshcat: Meshcat,
    *,
    frame_rate: float = 0.0,
) -> None:
    """Add what draws the robots' visual shapes.

    `frame_rate` is pictures per second of simulated time [Hz]; 0 draws at time 0 and
    when the visualizer is told to.
    """
    params = MeshcatVisualizerParams(
        publish_period=1.0 / frame_rate if frame_rate else _NEVER,
        role=Role.kIllustration,
        prefix="visual",
        # What is drawn on demand stays when a simulation is reset.
        delete_on_initialization_event=frame_rate > 0.0,
    )
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, params)


def set_gravity(plant: MultibodyPlant, options: SimulationOptions) -> None:
    """Let gravity act, or not, as the options say."""
    if isinstance(options.gravity, tuple):
        plant.mutable_gravity_field().set_gravity_vector(options.gravity)
    elif options.gravity is False:
        plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])


def add_robot_model(
    plant: MultibodyPlant,
    description: RobotDescription,
    name: str,
    pose: Pose | None,
    *,
    has_free_base: bool = False,
    is_reduced: bool = False,
    collides: bool = True,
    report: LoadReport | None = None,
) -> ModelInstanceIndex:
    """Add a robot's bodies and joints to a plant that isn't finalized.

    Its base is at a pose in the world, None is the origin. `is_reduced` leaves out what
    is seen and what collides, and fixes joints of several degrees of freedom: what a
    servo computes with. DescriptionError if Drake refuses it.
    """
    X_WB = transform_of(pose)
    if is_reduced:
        description = fix_free_joints(without_shapes(description))
    elif not collides:
        description = without_shapes(description, "collisions")
    joints = description.joints
    if pose is not None:
        joints = tuple(_moved_with_base(joint, X_WB) for joint in joints)
    text = write_urdf(name, description.link_infos, joints)
    parser = Parser(plant)
    parser.SetAutoRenaming(True)
    try:
        with drake_messages() as messages:
            (model,) = parser.AddModelsFromString(text, "urdf")
        for name_of_root in description.roots:
            if name_of_root != description.base or not has_free_base:
                frame = plant.GetBodyByName(name_of_root, model).body_frame()
                plant.WeldFrames(plant.world_frame(), frame, X_WB)
    except (RuntimeError, ValueError, LookupError, SystemExit) as error:
        problem = " ".join(str(error).split())
        raise DescriptionError(
            f"Drake refuses the description: {problem}", file=description.file
        ) from None
    if report is not None:
        for message in messages:  # Its place is one in our text, not in the file.
            what, file = message.partition("warning: ")[2] or message, description.file
            report.add("warning", "ignored", what, "so says Drake", file=file)
    return model


def make_reduced_plant(
    description: RobotDescription,
    pose: Pose | None,
    time_step: float,
    report: LoadReport | None = None,
    payloads: Mapping[str, Payload] | None = None,
) -> MultibodyPlant:
    """Return a finalized plant of one robot on a fixed base, without geometry.

    Each joint has an actuator without limits.
    """
    plant = MultibodyPlant(time_step)
    model = add_robot_model(
        plant, description, "robot", pose, is_reduced=True, report=report
    )
    names = [joint.name() for joint in simple_joints(plant)]
    add_actuators(plant, model, names, [math.inf] * len(names))
    add_payloads(plant, model, payloads or {}, collides=False)
    plant.Finalize()
    return plant


def fuse_fixed_links(whole: MultibodyPlant) -> MultibodyPlant | None:
    """Return a finalized plant that moves as a reduced one, with fewer bodies.

    A link and all that is fixed to it are one body there, called as the link that its
    joint moves; joints and actuators stay as they are. None if nothing is fixed to a
    link that moves.
    """
    joints = [whole.get_joint(index) for index in whole.GetJointIndices()]
    fixed = {j.child_body().index(): j for j in joints if j.num_velocities() == 0}

    def find_owner(index: BodyIndex) -> tuple[BodyIndex, RigidTransform]:
        """Return the body that a link is a part of, and its pose in that body."""
        joint = fixed.get(index)
        if joint is None:
            return index, RigidTransform()
        owner, X_OP = find_owner(joint.parent_body().index())
        X_PF = joint.frame_on_parent().GetFixedPoseInBodyFrame()
        X_BM = joint.frame_on_child().GetFixedPoseInBodyFrame()
        return owner, X_OP @ X_PF @ joint.X_FM() @ X_BM.inverse()

    world = whole.world_body().index()
    bodies = [BodyIndex(i) for i in range(whole.num_bodies())]
    owners = {index: find_owner(index) for index in bodies}
    moving = [joint for joint in joints if joint.num_velocities()]
    if all(owners[index][0] == world for index in fixed) or not all(
        isinstance(joint, RevoluteJoint | PrismaticJoint) for joint in moving
    ):
        return None
    plant = MultibodyPlant(whole.time_step())
    # Links apart from joints and their frames: one may be called as a frame.
    model, links = map(plant.AddModelInstance, ("robot", "links"))
    fused = {world: plant.world_body()}
    for index, inertia in _sum_inertias(whole, owners).items():
        name = whole.get_body(index).name()
        fused[index] = plant.AddRigidBody(name, links, inertia)
    # Velocities have the order of joints along each branch, in the order of these.
    for joint in sorted(moving, key=Joint.velocity_start):
        ends: list[Frame] = []
        for frame in (joint.frame_on_parent(), joint.frame_on_child()):
            owner, X_OB = owners[frame.body().index()]
            X_OF = X_OB @ frame.GetFixedPoseInBodyFrame()
            name, base = f"{joint.name()}_{len(ends)}", fused[owner].body_frame()
            end = FixedOffsetFrame(name, base, X_OF, model)
            ends.append(plant.AddFrame(end))
        plant.AddJoint(_copy_joint(joint, *ends))
    for index in whole.GetJointActuatorIndices():
        old = whole.get_joint_actuator(index)
        driven = plant.GetJointByName(old.joint().name())
        new = plant.AddJointActuator(old.name(), driven, old.effort_limit())
        new.set_default_rotor_inertia(old.default_rotor_inertia())
        new.set_default_gear_ratio(old.default_gear_ratio())
    plant.Finalize()
    return plant


def _sum_inertias(
    plant: MultibodyPlant, owners: Mapping[BodyIndex, tuple[BodyIndex, RigidTransform]]
) -> dict[BodyIndex, SpatialInertia]:
    """Return inertias of bodies with what is fixed to them, about their own origins.

    `owners` are of all bodies the one that each is a part of, and its pose there.
    """
    inertias: dict[BodyIndex, SpatialInertia] = {}
    for index, (owner, X_OB) in owners.items():
        if owner != plant.world_body().index():
            total = inertias.setdefault(owner, SpatialInertia.Zero())
            own = plant.get_body(index).default_spatial_inertia()
            # A sum of nothing and nothing has no center.
            if own.get_mass() > 0.0:
                total += own.ReExpress(X_OB.rotation()).Shift(-X_OB.translation())
    return inertias


def _copy_joint(joint: Joint, parent: Frame, child: Frame) -> Joint:
    """Return a joint of one degree of freedom as another one, between frames."""
    limits = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
    damping = joint.default_damping_vector()[0]
    if isinstance(joint, RevoluteJoint):
        axis = joint.revolute_axis()
        return RevoluteJoint(joint.name(), parent, child, axis, *limits, damping)
    axis = joint.translation_axis()
    return PrismaticJoint(joint.name(), parent, child, axis, *limits, damping)


def simple_joints(plant: MultibodyPlant) -> list[Joint]:
    """Return the joints of one degree of freedom."""
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    return [joint for joint in joints if joint.num_velocities() == 1]


def trial_plant(robot: Robot, report: LoadReport | None = None) -> MultibodyPlant:
    """Return a robot's reduced plant, made once; take a clone of it to change it.

    Its step is that of a diagram of this robot alone with default options. Where it is
    made, the report learns what Drake warns about.
    """
    plant = _trials.get(robot)
    if plant is None:
        options, rate = SimulationOptions(), robot.controllers.update_rate
        step, _ = choose_time_step(options.largest_step, [rate], options.log_rate)
        plant = make_reduced_plant(robot.description, robot.pose, step, report)
        _trials[robot] = plant
    return plant


def _moved_with_base(joint: JointInfo, X_WB: RigidTransform) -> JointInfo:
    """Return a joint; one on a link called "world", the world itself, moves."""
    if joint.parent != WORLD:
        return joint
    x, y, z, roll, pitch, yaw = pose_of(X_WB @ origin_transform(joint.origin))
    return dc.replace(joint, origin=Origin((x, y, z), (roll, pitch, yaw)))


def without_shapes(
    description: RobotDescription, *kinds: Literal["visuals", "collisions"]
) -> RobotDescription:
    """Return a description without what is drawn or collides; by default both."""
    none: dict[str, Any] = dict.fromkeys(kinds or ("visuals", "collisions"), ())
    links = tuple(dc.replace(link, **none) for link in description.link_infos)
    return dc.replace(description, link_infos=links)


def fix_free_joints(description: RobotDescription) -> RobotDescription:
    """Return a description whose joints of several degrees of freedom are fixed."""
    joints = tuple(
        dc.replace(joint, type="fixed") if joint.type in FREE_TYPES else joint
        for joint in description.joints
    )
    return dc.replace(description, joints=joints)


def add_actuators(
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    joints: Sequence[str],
    effort_limits: Iterable[float],
) -> list[JointActuator]:
    """Add the command actuator of each joint, named as the joint.

    Effort limits are [N·m] or [N], infinite where unset.
    """
    return [
        plant.AddJointActuator(name, plant.GetJointByName(name, model), limit)
        for name, limit in zip(joints, effort_limits, strict=True)
    ]


def set_initial_positions(
    plant: MultibodyPlant, model: ModelInstanceIndex, positions: dict[str, float]
) -> None:
    """Set the default positions of joints, [rad] or [m], by name."""
    for name, position in positions.items():
        joint = plant.GetJointByName(name, model)
        joint.set_default_positions([position])


def filter_self_collision(
    plant: MultibodyPlant, scene_graph: SceneGraph, model: ModelInstanceIndex
) -> None:
    """Let the links of a robot pass through each other, as Gazebo does."""
    geometries = [
        geometry
        for body in plant.GetBodyIndices(model)
        for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(body))
    ]
    declaration = CollisionFilterDeclaration()
    declaration.ExcludeWithin(GeometrySet(geometries))
    scene_graph.collision_filter_manager().Apply(declaration)


def filter_pairs(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    model: ModelInstanceIndex,
    pairs: Iterable[tuple[str, str]],
) -> None:
    """Let pairs of a robot's links pass through each other."""
    for names in pairs:
        sets = [
            GeometrySet(
                plant.GetCollisionGeometriesForBody(plant.GetBodyByName(name, model))
            )
            for name in names
        ]
        declaration = CollisionFilterDeclaration().ExcludeBetween(*sets)
        scene_graph.collision_filter_manager().Apply(declaration)


def state_indices(
    plant: MultibodyPlant, model: ModelInstanceIndex, joints: Sequence[str]
) -> tuple[list[int], list[int]]:
    """Return where joints stand in the state [q; v] of a model instance."""
    # Drake numbers positions by its tree, not by the order of the file.
    names = plant.GetPositionNames(model, add_model_instance_prefix=False)
    velocities = plant.GetVelocityNames(model, add_model_instance_prefix=False)
    positions_at, velocities_at = [], []
    for name in joints:
        joint = plant.GetJointByName(name, model)
        suffix = joint.position_suffix(0), joint.velocity_suffix(0)
        positions_at.append(names.index(f"{name}_{suffix[0]}"))
        velocities_at.append(len(names) + velocities.index(f"{name}_{suffix[1]}"))
    return positions_at, velocities_at


def link_bodies(
    plant: MultibodyPlant, model: ModelInstanceIndex, links: Iterable[str]
) -> list[int]:
    """Return the indices of the bodies of links, one of which may be the world."""
    bodies = [
        plant.world_body() if link == WORLD else plant.GetBodyByName(link, model)
        for link in links
    ]
    return [int(body.index()) for body in bodies]


def transform_of(pose: Sequence[float] | None) -> RigidTransform:
    """Return a pose as a transform; None is the identity."""
    if pose is None:
        return RigidTransform()
    return RigidTransform(RollPitchYaw(np.array(pose[3:])), np.array(pose[:3]))


def pose_of(X: RigidTransform) -> Pose:
    """Return a transform as x, y, z [m], roll, pitch, yaw [rad]."""
    x, y, z = X.translation().tolist()
    roll, pitch, yaw = RollPitchYaw(X.rotation()).vector().tolist()
    return x, y, z, roll, pitch, yaw


def read_pose(pose: RigidTransform | Sequence[float]) -> RigidTransform:
    """Return a pose as a transform, or raise InputError."""
    if isinstance(pose, RigidTransform):
        numbers = np.append(pose.rotation().matrix(), pose.translation())
        if not np.all(np.abs(numbers) <= _FARTHEST):
            raise InputError(f"pose: expected finite numbers up to {_FARTHEST:g}")
        if not pose.rotation().IsValid():
            raise InputError(
                f"pose: expected a rotation, whose axes have the length 1 and are at "
                f"right angles; got {pose.rotation().matrix().tolist()}"
            )
        return pose
    expected = "expected a RigidTransform, or x, y, z [m], roll, pitch, yaw [rad]"
    try:
        x, y, z, roll, pitch, yaw = (float(number) for number in pose)
    except (TypeError, ValueError):
        raise InputError(f"pose: {expected}; got {pose!r}") from None
    if not all(abs(n) <= _FARTHEST for n in (x, y, z, roll, pitch, yaw)):
        raise InputError(
            f"pose: {expected}, all finite, up to {_FARTHEST:g}; got {list(pose)}"
        )
    return transform_of((x, y, z, roll, pitch, yaw))


def origin_transform(origin: Origin) -> RigidTransform:
    """Return an `<origin>` as a transform."""
    return transform_of((*origin.xyz, *origin.rpy))
