"""What sensors measure in the plant: forces, motions, poses, distances."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
)

from arm_drake.arrays import Array
from arm_drake.description.joints import WORLD
from arm_drake.description.sensors import SensorInfo
from arm_drake.interfaces import (
    ACCELERATIONS,
    FORCES,
    ORIENTATIONS,
    POSITIONS,
    RANGE,
    RATES,
)
from arm_drake.plant.beams import find_range
from arm_drake.plant.plant import transform_of
from arm_drake.plant.plant_ports import PlantPorts
from arm_drake.python_system import PythonSystem


class _Mount(NamedTuple):
    """Where a sensor sits."""

    # Index of its body.
    body: int

    # Pose of the sensor in the body.
    X_LS: RigidTransform

    def pose(self, poses: Sequence[RigidTransform]) -> RigidTransform:
        """Return the pose of the sensor in the world, by those of all bodies."""
        return poses[self.body] @ self.X_LS


class SensorReadings(PythonSystem):
    """Measures what sensors do, in the plant as it is.

    .. pydrake_system::

        name: SensorReadings
        input_ports:
        - reaction_forces
        - body_poses
        - spatial_velocities
        - spatial_accelerations
        - geometry_query
        - generalized_acceleration
        output_ports:
        - readings

    ========================  ====  ====================================================
    port                      size  meaning
    ========================  ====  ====================================================
    reaction_forces           --    what each joint does to its child
    body_poses                --    poses of all bodies in the world
    spatial_velocities        --    their velocities
    spatial_accelerations     --    their accelerations
    geometry_query            --    where the shapes are
    generalized_acceleration  nv    of the whole plant
    readings                  k     what is measured, see below
    ========================  ====  ====================================================

    Of the input ports there are those that are needed. The readings are the interfaces
    of each sensor, then the accelerations of joints. With S the sensor's frame, W the
    world::

        force, torque        the load behind the sensor: what the link does to the one
                             that carries it, about the joint between them, along the
                             axes of S [N], [N·m]
        orientation          of S in W as x, y, z, w
        angular_velocity     of S in W, along the axes of S [rad/s]
        linear_acceleration  of S in W less that of free fall, along the axes of S
                             [m/s^2]
        position             of S in W, or in the sensor's reference [m]; likewise
                             orientation, if there is a position
        range                along x of S to the first shape of another body [m];
                             infinite if there is none

    Forces and accelerations are those of the step of the plant that begins now, with
    the commands that hold now; a controller that reads them in its tick reads what its
    last commands cause. There is no noise.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        model: ModelInstanceIndex,
        sensors: Sequence[SensorInfo],
        accelerations: Sequence[str] = (),
    ) -> None:
        """Create the system.

        Args:
            plant: The finalized plant.
            scene_graph: Its scene graph.
            model: The robot's model instance.
            sensors: The sensors.
            accelerations: Joints whose acceleration is measured.
        """
        super().__init__()
        self._plant = plant
        self._gravity: Array = np.array(plant.gravity_field().gravity_vector())
        self._ports = PlantPorts(self, plant, scene_graph)
        self._parts: list[tuple[slice | list[int], Callable[[Context], Array]]] = []
        start = 0
        for sensor in sensors:
            self._add_sensor(sensor, model, start)
            start += len(sensor.interfaces)
        if accelerations:
            self._add_accelerations(model, accelerations, start)
        self.DeclareVectorOutputPort(
            "readings",
            start + len(accelerations),
            self._calc_readings,
            # They are of the inputs alone.
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def connect(self, builder: DiagramBuilder) -> None:
        """Connect the system with the plant, both being in a builder."""
        self._ports.connect(builder)

    def _add_sensor(
        self, sensor: SensorInfo, model: ModelInstanceIndex, start: int
    ) -> None:
        names = sensor.interfaces
        body = self._body(sensor.link, model)
        mount = _Mount(int(body.index()), transform_of(sensor.pose))
        parts: dict[tuple[str, ...], Callable[[Context], Array]] = {}
        if any(name in FORCES for name in names):
            parts[FORCES] = self._measure_load(sensor, model, mount)
        if any(name in RATES for name in names):
            parts[RATES] = self._measure_rate(mount)
        if any(name in ACCELERATIONS for name in names):
            parts[ACCELERATIONS] = self._measure_acceleration(mount)
        if any(name in (*POSITIONS, *ORIENTATIONS) for name in names):
            reference = self._body(sensor.reference or WORLD, model)
            pose = self._measure_pose(mount, int(reference.index()))
            parts[POSITIONS + ORIENTATIONS] = pose
        if RANGE in names:
            parts[(RANGE,)] = self._measure_range(mount, body)
        for known, measure in parts.items():
            there = [known.index(name) for name in names if name in known]
            here = [start + i for i, name in enumerate(names) if name in known]
            self._parts.append((here, partial(_pick, measure, there)))

    def _body(self, link: str, model: ModelInstanceIndex) -> RigidBody:
        if link == WORLD:
            return self._plant.world_body()
        return self._plant.GetBodyByName(link, model)

    def _measure_load(
        self, sensor: SensorInfo, model: ModelInstanceIndex, mount: "_Mount"
    ) -> Callable[[Context], Array]:
        forces = self._ports.take("reaction_forces")
        joint = self._plant.GetJointByName(sensor.joint, model)
        # Joint and link have one frame, and the sensor is at its origin.
        index, R_SJ = int(joint.index()), mount.X_LS.rotation().matrix().T
        R_SJ = R_SJ if sensor.is_on_child else -R_SJ

        def measure(context: Context) -> Array:
            F_J = forces.Eval(context)[index]
            return np.concatenate([R_SJ @ F_J.translational(), R_SJ @ F_J.rotational()])

        return measure

    def _measure_rate(self, mount: "_Mount") -> Callable[[Context], Array]:
        poses = self._ports.take("body_poses")
        velocities = self._ports.take("spatial_velocities")

        def measure(context: Context) -> Array:
            R_WS = mount.pose(poses.Eval(context)).rotation().matrix()
            w: Array = velocities.Eval(context)[mount.body].rotational()
            return R_WS.T @ w

        return measure

    def _measure_acceleration(self, mount: "_Mount") -> Callable[[Context], Array]:
        poses = self._ports.take("body_poses")
        velocities = self._ports.take("spatial_velocities")
        accelerations = self._ports.take("spatial_accelerations")

        def measure(context: Context) -> Array:
            X_WL: RigidTransform = poses.Eval(context)[mount.body]
            arm = X_WL.rotation() @ mount.X_LS.translation()
            w = velocities.Eval(context)[mount.body].rotational()
            A_WL = accelerations.Eval(context)[mount.body]
            a: Array = (
                A_WL.translational()
                + np.cross(A_WL.rotational(), arm)
                + np.cross(w, np.cross(w, arm))
            )
            R_WS = (X_WL @ mount.X_LS).rotation().matrix()
            return R_WS.T @ (a - self._gravity)

        return measure

    def _measure_pose(
        self, mount: "_Mount", reference: int
    ) -> Callable[[Context], Array]:
        poses = self._ports.take("body_poses")

        def measure(context: Context) -> Array:
            all_poses = poses.Eval(context)
            X_RS = all_poses[reference].inverse() @ mount.pose(all_poses)
            q = X_RS.rotation().ToQuaternion()
            return np.concatenate([X_RS.translation(), q.xyz(), [q.w()]])

        return measure

    def _measure_range(
        self, mount: "_Mount", body: RigidBody
    ) -> Callable[[Context], Array]:
        poses = self._ports.take("body_poses")
        query = self._ports.take("geometry_query")
        # Numbers: identifiers would keep the plant in memory.
        own = {
            geometry.get_value()
            for other in self._plant.GetBodiesWeldedTo(body)
            for geometry in self._plant.GetCollisionGeometriesForBody(other)
            if other.index() != self._plant.world_body().index()
        }

        def measure(context: Context) -> Array:
            X_WS = mount.pose(poses.Eval(context))
            along = X_WS.rotation().matrix()[:, 0]
            start = X_WS.translation()
            return np.array([find_range(query.Eval(context), start, along, own)])

        return measure

    def _add_accelerations(
        self, model: ModelInstanceIndex, joints: Sequence[str], start: int
    ) -> None:
        vdot = self._ports.take("generalized_acceleration")
        at = [self._plant.GetJointByName(n, model).velocity_start() for n in joints]
        here = slice(start, start + len(at))
        self._parts.append((here, lambda context: vdot.Eval(context)[at]))

    def _calc_readings(self, context: Context, output: BasicVector) -> None:
        values = np.empty(output.size())
        for here, measure in self._parts:
            values[here] = measure(context)
        output.SetFromVector(values)


def _pick(
    measure: Callable[[Context], Array], at: list[int], context: Context
) -> Array:
    return measure(context)[at]
