"""Poses of a robot's links, and kinematics for controllers: plants without physics.

For poses at many positions at once, the joints above a link are screws: turns and
slides of joints are matrices exp(S q), whose product is the pose. numpy makes those of
a hundred positions in little more time than those of one; what the joints are is read
from Drake's Jacobian at zero.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, JacobianWrtVariable, ModelInstanceIndex
from pydrake.systems.framework import Context, DiagramBuilder, InputPort

from arm_drake.arrays import Array
from arm_drake.description.joints import MOVABLE_TYPES, WORLD, joints_above
from arm_drake.description.urdf import RobotDescription
from arm_drake.plant.plant import add_robot_model, set_initial_positions, state_indices
from arm_drake.python_system import PythonSystem


class PlantKinematics:
    """Poses and Jacobians of a robot's links, seen from one of them.

    Joints that aren't asked for, mimic joints too, stay at their initial positions. Its
    plant holds nothing between two calls.
    """

    def __init__(
        self,
        description: RobotDescription,
        initial_positions: Mapping[str, float],
        joints: Sequence[str],
        base: str,
    ) -> None:
        """Create it for n joints that move, with all seen from the link `base`."""
        self._description = description
        self._plant = plant = MultibodyPlant(0.0)
        model = add_robot_model(plant, description, "robot", None, is_reduced=True)
        plant.Finalize()
        set_initial_positions(plant, model, dict(initial_positions))
        self._frames = {
            link: plant.world_frame()
            if link == WORLD
            else plant.GetBodyByName(link, model).body_frame()
            for link in description.links
        }
        self._name, self._base = base, self._frames[base]
        self._context = plant.CreateDefaultContext()
        # Nothing but the robot is in the plant, whose positions are those of its model.
        self._q = plant.GetPositions(self._context)
        self._q_at, v_at = state_indices(plant, model, joints)
        self._v_at = [at - plant.num_positions() for at in v_at]

    def pose(self, q: Array, link: str) -> Array:
        """Return the pose of a link in the base at q [rad] or [m], shape (4, 4)."""
        self._set(q)
        pose = self._frames[link].CalcPose(self._context, self._base)
        return np.asarray(pose.GetAsMatrix4())

    def jacobian(self, q: Array, link: str) -> Array:
        """Return what joint velocities move a link by at q, in the base, shape (6, n).

        Rows are the velocity along x, y and z [m/s], then about them [rad/s].
        """
        self._set(q)
        J = self._plant.CalcJacobianSpatialVelocity(
            self._context,
            JacobianWrtVariable.kV,
            self._frames[link],
            np.zeros(3),
            self._base,
            self._base,
        )
        return np.roll(J, 3, axis=0)[:, self._v_at]

    def joints_to(self, link: str) -> tuple[str, ...]:
        """Return the movable joints between the base and a link, in that order."""
        joints = self._description.joints
        up, down = joints_above(joints, self._name), joints_above(joints, link)
        while up and down and up[-1] == down[-1]:
            up.pop()
            down.pop()
        path = (*up, *reversed(down))
        return tuple(joint.name for joint in path if joint.type in MOVABLE_TYPES)

    def _set(self, q: Array) -> None:
        positions = self._q.copy()
        positions[self._q_at] = q
        self._plant.SetPositions(self._context, positions)


class KinematicPlant(PythonSystem):
    """Computes the poses of links from the set positions of joints.

    .. pydrake_system::

        name: KinematicPlant
        output_ports:
        - positions
        - state
        - body_poses

    ==========  =======  ====  ========================================================
    port        size     unit  meaning
    ==========  =======  ====  ========================================================
    positions   nq       rad   positions of the plant
    state       nq + nv  rad   positions and velocities of the plant
    body_poses  --       --    list of RigidTransform: pose of every body in the world
    ==========  =======  ====  ========================================================

    There is an input port for each robot, of its name: positions and velocities of its
    J joints, size 2J. Free bases stay where they start.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        robots: Mapping[str, tuple[ModelInstanceIndex, Sequence[str]]],
    ) -> None:
        """Create it for a finalized plant, and the models and joints of its robots."""
        super().__init__()
        # What knows the robots; its own ports are not connected.
        self.plant = plant
        # Where positions are set and poses are read; nothing is kept there.
        self._scratch = plant.CreateDefaultContext()
        self._rest = plant.GetPositionsAndVelocities(self._scratch)
        nq = plant.num_positions()
        self._robots: list[tuple[InputPort, list[int]]] = []
        for name, (model, names) in robots.items():
            joints = [plant.GetJointByName(joint, model) for joint in names]
            at = [joint.position_start() for joint in joints]
            at += [nq + joint.velocity_start() for joint in joints]
            port = self.DeclareVectorInputPort(name, len(at))
            self._robots.append((port, at))
        inputs = {self.all_input_ports_ticket()}
        self.DeclareVectorOutputPort(
            "positions",
            nq,
            lambda context, output: output.SetFromVector(self._evaluate(context)[:nq]),
            inputs,
        )
        self.DeclareVectorOutputPort(
            "state",
            len(self._rest),
            lambda context, output: output.SetFromVector(self._evaluate(context)),
            inputs,
        )
        self.DeclareAbstractOutputPort(
            "body_poses",
            lambda: AbstractValue.Make([RigidTransform()]),
            self._calc_body_poses,
            inputs,
        )

    def _evaluate(self, context: Context) -> Array:
        state = self._rest.copy()
        for port, at in self._robots:
            state[at] = port.Eval(context)
        return state

    def _calc_body_poses(self, context: Context, output: AbstractValue) -> None:
        plant, scratch = self.plant, self._scratch
        plant.SetPositionsAndVelocities(scratch, self._evaluate(context))
        bodies = [plant.get_body(BodyIndex(i)) for i in range(plant.num_bodies())]
        output.set_value([plant.EvalBodyPoseInWorld(scratch, body) for body in bodies])

    def connect_geometry(
        self, builder: DiagramBuilder, scene_graph: SceneGraph
    ) -> None:
        """Move the shapes of the plant along."""
        from pydrake.systems.rendering import MultibodyPositionToGeometryPose

        shapes = builder.AddSystem(MultibodyPositionToGeometryPose(self.plant))
        builder.Connect(self.GetOutputPort("positions"), shapes.get_input_port())
        source = self.plant.get_source_id()
        builder.Connect(
            shapes.get_output_port(), scene_graph.get_source_pose_port(source)
        )


class LinkFrames(PythonSystem):
    """Picks the poses of a robot's links out of those of all bodies.

    .. pydrake_system::

        name: LinkFrames
        input_ports:
        - body_poses
        output_ports:
        - frames

    ==========  ====  ====  =========================================================
    port        size  unit  meaning
    ==========  ====  ====  =========================================================
    body_poses  --    --    list of RigidTransform: pose of every body in the world
    frames      --    --    list of RigidTransform: pose of each link in the world, in
                            the order of the description
    ==========  ====  ====  =========================================================

    It has no state.
    """

    def __init__(self, bodies: Sequence[int]) -> None:
        """Create the system."""
        super().__init__()
        self._bodies = tuple(bodies)
        poses = AbstractValue.Make([RigidTransform()])
        self._poses = self.DeclareAbstractInputPort("body_poses", poses)
        self.DeclareAbstractOutputPort(
            "frames",
            lambda: AbstractValue.Make([RigidTransform()]),
            self._calc_frames,
            prerequisites_of_calc={self._poses.ticket()},
        )

    def _calc_frames(self, context: Context, output: AbstractValue) -> None:
        poses = self._poses.Eval(context)
        output.set_value([poses[body] for body in self._bodies])


class BodyPoses(PythonSystem):
    """Publishes the pose of each of some bodies on a port of its own.

    .. pydrake_system::

        name: BodyPoses
        input_ports:
        - body_poses
        output_ports:
        - <name>

    ==========  ====  ====  =========================================================
    port        size  unit  meaning
    ==========  ====  ====  =========================================================
    body_poses  --    --    list of RigidTransform: pose of every body in the world
    <name>      --    --    RigidTransform: pose of the body of this name in the world
    ==========  ====  ====  =========================================================

    It has no state.
    """

    def __init__(self, bodies: Mapping[str, int]) -> None:
        """Create the system, for the indices of bodies by name."""
        super().__init__()
        poses = self.DeclareAbstractInputPort(
            "body_poses", AbstractValue.Make([RigidTransform()])
        )
        for name, index in bodies.items():
            self.DeclareAbstractOutputPort(
                name,
                lambda: AbstractValue.Make(RigidTransform()),
                lambda context, output, index=index: output.set_value(
                    poses.Eval(context)[index]
                ),
                prerequisites_of_calc={poses.ticket()},
            )


# The axes after x, y, z, and those before.
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


class Screws:
    """The joints above a link: each turns about an axis, or slides along one."""

    def __init__(self, plant: MultibodyPlant, link: str, at: Sequence[int]) -> None:
        """Read them from a plant; velocities of joints are where their positions are.

        `at` is where the joints that carry the link are in q, the first one first.
        """
        self.at = np.array(at, dtype=int)
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, np.zeros(plant.num_positions()))
        frame, world = plant.GetBodyByName(link).body_frame(), plant.world_frame()
        J = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, frame, np.zeros(3), world, world
        )
        X = frame.CalcPoseInWorld(context)
        self._X = X.GetAsMatrix4()
        w = J[:3, self.at].T
        # How a point at the world's origin moves. exp(S q) is 1 + sin(q) S + (1 -
        # cos(q)) S^2 where a joint turns, and 1 + q S where it slides.
        v = J[3:, self.at].T - _cross(w, X.translation())
        self._twists = np.stack((w, v), axis=2)
        S = np.zeros((len(at), 4, 4))
        S[:, :3, :3], S[:, :3, 3] = _cross(w[:, np.newaxis], -np.eye(3)), v
        turns = w.any(axis=1)[:, np.newaxis, np.newaxis]
        self._sin, self._versine, self._slide = S * turns, S @ S * turns, S * ~turns
        self._one, self._slides = np.eye(4) + self._versine, not turns.all()

    def poses(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return turns, places and Jacobians of the frame in the world.

        q: The joints' positions, shape (k, n). Shapes (k, 3, 3), (k, 3), (k, 6, n),
        places first.
        """
        angle = q[:, :, np.newaxis, np.newaxis]
        T = self._one + np.sin(angle) * self._sin - np.cos(angle) * self._versine
        if self._slides:
            T += angle * self._slide
        before = np.empty_like(T)
        before[:, 0] = np.eye(4)
        for m in range(1, len(self.at)):
            np.matmul(before[:, m - 1], T[:, m - 1], out=before[:, m])
        X = before[:, -1] @ T[:, -1] @ self._X
        p = X[:, np.newaxis, :3, 3] - before[:, :, :3, 3]
        twists = before[:, :, :3, :3] @ self._twists
        J = np.empty((len(q), len(self.at), 6))
        J[:, :, 3:] = axes = twists[..., 0]
        J[:, :, :3] = twists[..., 1] + _cross(axes, p)
        return X[:, :3, :3], X[:, :3, 3], J.swapaxes(1, 2)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(  # numpy's takes ten times as long.
        a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT]
    )


def rotation_vector(R: np.ndarray) -> np.ndarray:
    """Return the axis of a rotation times its angle [rad]."""
    v = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    s, c = math.sqrt(v @ v), R[0, 0] + R[1, 1] + R[2, 2] - 1.0
    if s > 1e-6:
        return v * (math.atan2(s, c) / s)
    if c > 0.0:
        return 0.5 * v
    # Half a turn: the axis is the largest column of R + 1.
    column = (R + np.eye(3))[:, int(np.argmax(np.diag(R)))]
    return column * (math.pi / math.sqrt(column @ column))


def rotation_vectors(R: np.ndarray) -> np.ndarray:
    """Return the axes of rotations (k, 3, 3) times their angles [rad], (k, 3)."""
    v = R[:, [2, 0, 1], [1, 2, 0]] - R[:, [1, 2, 0], [2, 0, 1]]
    s, c = np.sqrt((v * v).sum(axis=1)), R[:, 0, 0] + R[:, 1, 1] + R[:, 2, 2] - 1.0
    angle = np.arctan2(s, c)
    vectors = v * np.where(s > 1e-6, angle / np.maximum(s, 1e-6), 0.5)[:, np.newaxis]
    for k in np.flatnonzero((s <= 1e-6) & (c <= 0.0)):  # Half a turn.
        vectors[k] = rotation_vector(R[k])
    return vectors


def swings(directions: np.ndarray, axis: int) -> np.ndarray:
    """Return the turns [rad] that bring an axis of frames to directions in them."""
    one, two = (axis + 1) % 3, (axis + 2) % 3
    turns = np.zeros_like(directions)
    s = np.hypot(directions[:, one], directions[:, two])
    angle = np.arctan2(s, directions[:, axis])
    aside = s > 1e-9
    part = np.where(aside, angle / np.maximum(s, 1e-9), 0.0)
    turns[:, one] = np.where(aside, -directions[:, two] * part, angle)
    turns[:, two] = directions[:, one] * part
    return turns
