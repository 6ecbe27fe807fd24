"""Sensor readings from the plant: forces, motions, poses, distances."""

import dataclasses as dc
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    ContactSurface,
    Mesh,
    QueryObject,
    SceneGraph,
    SceneGraphInspector,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialAcceleration
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex, RigidBody
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    InputPort,
    LeafSystem,
    OutputPort,
)

from arm_drake.arrays import Array, cross
from arm_drake.description.gazebo_plugins import shape_name
from arm_drake.description.joints import WORLD
from arm_drake.description.sensors import SensorInfo
from arm_drake.importing import dataclass
from arm_drake.interfaces import (
    ACCELERATIONS,
    FORCES,
    IMU,
    ORIENTATIONS,
    POSITIONS,
    RANGE,
    RATES,
    SENSORS,
)
from arm_drake.messages import Header, Vector3, Wrench
from arm_drake.messages.sensors import ContactsState, ContactState
from arm_drake.plant.plant import transform_of
from arm_drake.python_system import PythonSystem

# A beam that meets nothing on this way meets nothing at all [m].
_LONGEST = 100.0

# What is nearer than this is met [m].
_TOUCH = 1e-6

# Steps along a beam. Along a mesh they get short.
_MAX_STEPS = 1000


def find_range(
    query: QueryObject, start: Array, along: Array, own: Collection[int]
) -> float:
    """Return how far a beam goes to the first shape [m]; infinite if it meets none.

    Drake casts no rays. But it knows how far a shape is from a point of the beam, and
    in which direction; so far the beam is free from there. NaN is a beam so close along
    a mesh that this takes too long.
    """
    inspector, way = query.inspector(), 0.0
    for _ in range(_MAX_STEPS):
        free = np.inf
        for near in query.ComputeSignedDistanceToPoint(
            start + way * along, _LONGEST - way
        ):
            if near.id_G.get_value() in own:
                continue
            if near.distance < _TOUCH:
                return way
            if isinstance(inspector.GetShape(near.id_G), Mesh):
                free = min(free, near.distance)
            elif (nearing := -float(near.grad_W @ along)) > 0.0:
                # What is convex lies behind the plane in front of its nearest point.
                free = min(free, near.distance / nearing)
        way += free
        if way > _LONGEST:
            return np.inf
    return np.nan


# Names of what can be read from the plant itself, and of its ports.
_PLANT: Final = {
    "body_poses": "body_poses",
    "spatial_velocities": "body_spatial_velocities",
    "spatial_accelerations": "body_spatial_accelerations",
    "reaction_forces": "reaction_forces",
    "generalized_acceleration": "generalized_acceleration",
    "contact_results": "contact_results",
}

_QUERY: Final = "geometry_query"


@dataclass(frozen=True)
class PlantPorts:
    """Declares input ports of a system as they are needed, each once."""

    system: LeafSystem
    plant: MultibodyPlant
    scene_graph: SceneGraph

    # The ports so far, with those that they are connected to.
    ports: dict[str, tuple[InputPort, OutputPort]] = dc.field(default_factory=dict)

    def take(self, name: str) -> InputPort:
        """Return the input port for an output of the plant."""
        if name not in self.ports:
            source = self._source(name)
            if source.size():
                target = self.system.DeclareVectorInputPort(name, source.size())
            else:
                target = self.system.DeclareAbstractInputPort(name, source.Allocate())
            self.ports[name] = (target, source)
        return self.ports[name][0]

    def connect(self, builder: DiagramBuilder) -> None:
        """Connect the system, which is in a builder with the plant."""
        for target, source in self.ports.values():
            builder.Connect(source, target)

    def _source(self, name: str) -> OutputPort:
        if name == _QUERY:
            return self.scene_graph.GetOutputPort("query")
        return self.plant.GetOutputPort(_PLANT[name])


class _Mount(NamedTuple):
    """Mounting of a sensor."""

    # Index of its body.
    body: int

    # Pose of the sensor in the body, and which parts of it count.
    X_LS: RigidTransform
    is_turned: bool
    is_moved: bool

    @classmethod
    def of(cls, body: RigidBody, X_LS: RigidTransform) -> "_Mount":
        """Return where a sensor of a pose in a body sits."""
        is_turned = not X_LS.rotation().IsExactlyIdentity()
        return cls(int(body.index()), X_LS, is_turned, bool(X_LS.translation().any()))

    def pose(self, poses: Sequence[RigidTransform]) -> RigidTransform:
        """Return the pose of the sensor in the world, by those of all bodies."""
        X_WL = poses[self.body]
        return X_WL @ self.X_LS if self.is_turned or self.is_moved else X_WL

    def rotation(self, poses: Sequence[RigidTransform]) -> RotationMatrix:
        """Return how the sensor is turned in the world."""
        R_WL = poses[self.body].rotation()
        return R_WL @ self.X_LS.rotation() if self.is_turned else R_WL

    def acceleration(
        self,
        poses: Sequence[RigidTransform],
        w: Array,
        accelerations: Sequence[SpatialAcceleration],
    ) -> Array:
        """Return the sensor's acceleration in the world, by what its body does."""
        A_WL = accelerations[self.body]
        a: Array = A_WL.translational()
        if self.is_moved:
            arm = poses[self.body].rotation() @ self.X_LS.translation()
            a = a + cross(A_WL.rotational(), arm) + cross(w, cross(w, arm))
        return a


# What is on the input ports of sensors, by name.
_Inputs = Mapping[str, Any]
_Measure = Callable[[_Inputs], Array]


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
        """Create the system."""
        super().__init__()
        self._plant = plant
        self._gravity: Array = np.array(plant.gravity_field().gravity_vector())
        self._ports = PlantPorts(self, plant, scene_graph)
        self._parts: list[tuple[slice | list[int], _Measure]] = []
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
        mount = _Mount.of(body, transform_of(sensor.pose))
        if names == IMU:
            here = slice(start, start + len(names))
            self._parts.append((here, self._measure_imu(mount)))
            return
        for known in SENSORS:
            if not any(name in known for name in names):
                continue
            measure = _MEASURES[known](self, sensor, model, mount)
            if names == known:
                self._parts.append((slice(start, start + len(names)), measure))
                continue
            source_indices = [known.index(name) for name in names if name in known]
            target_indices = [
                start + i for i, name in enumerate(names) if name in known
            ]
            self._parts.append(
                (target_indices, partial(_pick, measure, source_indices))
            )

    def _body(self, link: str, model: ModelInstanceIndex) -> RigidBody:
        if link == WORLD:
            return self._plant.world_body()
        return self._plant.GetBodyByName(link, model)

    def _measure_load(
        self, sensor: SensorInfo, model: ModelInstanceIndex, mount: _Mount
    ) -> _Measure:
        self._ports.take("reaction_forces")
        joint = self._plant.GetJointByName(sensor.joint, model)
        # Joint and link have one frame, and the sensor is at its origin.
        index, R_SJ = int(joint.index()), mount.X_LS.rotation().matrix().T
        R_SJ = R_SJ if sensor.is_on_child else -R_SJ

        def measure(inputs: _Inputs) -> Array:
            F_J = inputs["reaction_forces"][index]
            return np.concatenate([R_SJ @ F_J.translational(), R_SJ @ F_J.rotational()])

        return measure

    def _measure_rate(
        self, sensor: SensorInfo, model: ModelInstanceIndex, mount: _Mount
    ) -> _Measure:
        self._ports.take("body_poses")
        self._ports.take("spatial_velocities")

        def measure(inputs: _Inputs) -> Array:
            R_WS = mount.rotation(inputs["body_poses"]).matrix()
            w: Array = inputs["spatial_velocities"][mount.body].rotational()
            return R_WS.T @ w

        return measure

    def _measure_acceleration(
        self, sensor: SensorInfo, model: ModelInstanceIndex, mount: _Mount
    ) -> _Measure:
        find_motion = self._find_motion(mount)

        def measure(inputs: _Inputs) -> Array:
            R_WS, _, a = find_motion(inputs)
            return R_WS.matrix().T @ a

        return measure

    def _measure_imu(self, mount: _Mount) -> _Measure:
        """Return what measures all that an IMU does."""
        find_motion = self._find_motion(mount)

        def measure(inputs: _Inputs) -> Array:
            R_WS, w, a = find_motion(inputs)
            R_SW = R_WS.matrix().T
            return np.concatenate([_orientation(R_WS), R_SW @ w, R_SW @ a])

        return measure

    def _find_motion(
        self, mount: _Mount
    ) -> Callable[[_Inputs], tuple[RotationMatrix, Array, Array]]:
        """Return a function of an IMU's orientation, angular velocity and acceleration.

        Its angular velocity [rad/s] and acceleration less gravity [m/s^2] are in the
        world, shape (3,).
        """
        for name in ("body_poses", "spatial_velocities", "spatial_accelerations"):
            self._ports.take(name)

        def find(inputs: _Inputs) -> tuple[RotationMatrix, Array, Array]:
            poses = inputs["body_poses"]
            w = inputs["spatial_velocities"][mount.body].rotational()
            a = mount.acceleration(poses, w, inputs["spatial_accelerations"])
            return mount.rotation(poses), w, a - self._gravity

        return find

    def _measure_pose(
        self, sensor: SensorInfo, model: ModelInstanceIndex, mount: _Mount
    ) -> _Measure:
        reference = int(self._body(sensor.reference or WORLD, model).index())
        self._ports.take("body_poses")

        def measure(inputs: _Inputs) -> Array:
            poses = inputs["body_poses"]
            X_WS = mount.pose(poses)
            X_RS = poses[reference].inverse() @ X_WS if reference else X_WS
            return np.concatenate([X_RS.translation(), _orientation(X_RS.rotation())])

        return measure

    def _measure_range(
        self, sensor: SensorInfo, model: ModelInstanceIndex, mount: _Mount
    ) -> _Measure:
        body = self._body(sensor.link, model)
        self._ports.take("body_poses")
        self._ports.take(_QUERY)
        # Numbers: identifiers would keep the plant in memory.
        own = {
            geometry.get_value()
            for other in self._plant.GetBodiesWeldedTo(body)
            for geometry in self._plant.GetCollisionGeometriesForBody(other)
            if other.index() != self._plant.world_body().index()
        }

        def measure(inputs: _Inputs) -> Array:
            X_WS = mount.pose(inputs["body_poses"])
            along = X_WS.rotation().matrix()[:, 0]
            start = X_WS.translation()
            return np.array([find_range(inputs[_QUERY], start, along, own)])

        return measure

    def _add_accelerations(
        self, model: ModelInstanceIndex, joints: Sequence[str], start: int
    ) -> None:
        name = "generalized_acceleration"
        self._ports.take(name)
        at = [self._plant.GetJointByName(n, model).velocity_start() for n in joints]
        here = slice(start, start + len(at))
        self._parts.append((here, lambda inputs: inputs[name][at]))

    def _calc_readings(self, context: Context, output: BasicVector) -> None:
        values = np.empty(output.size())
        # Each port once: pydrake makes lists of all bodies.
        ports = self._ports.ports.items()
        inputs = {name: port.Eval(context) for name, (port, _) in ports}
        for here, measure in self._parts:
            values[here] = measure(inputs)
        output.SetFromVector(values)


def _orientation(rotation: RotationMatrix) -> Array:
    """Return a rotation as x, y, z, w."""
    return rotation.ToQuaternion().wxyz()[_XYZW]


_XYZW = [1, 2, 3, 0]


# What measures each row of SENSORS: called with a sensor, its robot's model and where
# it sits, it takes the ports that it reads and returns the function of a reading.
_Make = Callable[..., _Measure]
_MEASURES: Final[Mapping[tuple[str, ...], _Make]] = {
    FORCES: SensorReadings._measure_load,
    RATES: SensorReadings._measure_rate,
    ACCELERATIONS: SensorReadings._measure_acceleration,
    POSITIONS + ORIENTATIONS: SensorReadings._measure_pose,
    (RANGE,): SensorReadings._measure_range,
}


def _pick(measure: _Measure, at: list[int], inputs: _Inputs) -> Array:
    return measure(inputs)[at]


_WORLD = "world"


class _Touch(NamedTuple):
    """Two shapes that touch."""

    # Their numbers.
    first: int
    second: int

    # Where [m], the force on the second shape [N] and its torque about that point
    # [N·m], the direction from the second one to the first, and the overlap [m].
    point: Array
    force: Array
    torque: Array
    normal: Array
    depth: float


class ContactReadings(PythonSystem):
    """Publishes the contacts of a robot.

    .. pydrake_system::

        name: ContactReadings
        input_ports:
        - contact_results
        - body_poses
        output_ports:
        - contacts

    ===============  ====  ==========================================================
    port             size  meaning
    ===============  ====  ==========================================================
    contact_results  --    what touches in the plant
    body_poses       --    poses of all bodies in the world
    contacts         --    ContactsState: each pair of shapes of which one or both
                           are the robot's, in the world's frame
    ===============  ====  ==========================================================

    It has no state. The first shape of a pair is the robot's; two shapes of the robot
    are two pairs. The n-th shape of a link is called "<link>_collision" and, from the
    second on, "<link>_collision_1" and so on, as in Gazebo. What is pressed together
    over an area has one force, at the area's centroid, and no depth.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        model: ModelInstanceIndex,
        links: Collection[str],
    ) -> None:
        """Create the system for the links of a model in a finalized plant.

        A body "<link>:..." that the plant has besides is part of the link.
        """
        super().__init__()
        self._shapes = _shapes(plant, scene_graph.model_inspector(), model, links)
        # Numbers of shapes: their identifiers would keep the plant in memory.
        self._own = {
            geometry.get_value()
            for body in plant.GetBodyIndices(model)
            for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(body))
        }
        self._ports = PlantPorts(self, plant, scene_graph)
        self._results = self._ports.take("contact_results")
        self._poses = self._ports.take("body_poses")
        self.DeclareAbstractOutputPort(
            "contacts",
            lambda: AbstractValue.Make(ContactsState()),
            self._calc_contacts,
            # The time is in the header.
            {self.time_ticket(), self.all_input_ports_ticket()},
        )

    def connect(self, builder: DiagramBuilder) -> None:
        """Connect the system with the plant, both being in a builder."""
        self._ports.connect(builder)

    def _calc_contacts(self, context: Context, output: AbstractValue) -> None:
        poses = None
        states = []
        for touch in _touches(self._results.Eval(context)):
            pair = (touch.first, touch.second)
            for own, other, sign in ((*pair, -1.0), (*pair[::-1], 1.0)):
                if own in self._own:
                    if poses is None:  # A list of all bodies takes long.
                        poses = self._poses.Eval(context)
                    body, name = self._shapes[own]
                    origin = poses[body].translation()
                    state = _state(touch, sign, origin)
                    names = (name, self._shapes[other][1])
                    states.append((names, state))
        time_ns = round(context.get_time() * 1e9)
        message = ContactsState(
            Header.from_nanoseconds(time_ns, _WORLD),
            tuple(
                ContactState(f"{first} touches {second}", first, second, *parts)
                for (first, second), parts in sorted(states, key=lambda row: row[0])
            ),
        )
        output.set_value(message)


def _shapes(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    model: ModelInstanceIndex,
    links: Collection[str],
) -> Mapping[int, tuple[int, str]]:
    """Return body and name of all collision shapes, by their numbers."""
    found = {}
    for index in range(plant.num_bodies()):
        body = plant.get_body(BodyIndex(index))
        robot, link, at = body.model_instance(), body.name(), index
        owner = link.rpartition(":")[0]
        if robot == model and link not in links and owner in links:
            link = owner
            at = int(plant.GetBodyByName(link, model).index())
        shapes = plant.GetCollisionGeometriesForBody(body)
        for number, geometry in enumerate(shapes):
            name = f"{plant.GetModelInstanceName(robot)}::{link}"
            name = f"{name}::{shape_name(link, number)}"
            if not index:  # Drake puts the instance in front.
                name = f"{_WORLD}::{inspector.GetName(geometry).rpartition('::')[2]}"
            found[geometry.get_value()] = (at, name)
    return found


def _touches(results: ContactResults) -> Iterator[_Touch]:
    """Yield what touches at points, and over areas."""
    nothing = np.zeros(3)
    for index in range(results.num_point_pair_contacts()):
        info = results.point_pair_contact_info(index)
        pair = info.point_pair()
        yield _Touch(
            pair.id_A.get_value(),
            pair.id_B.get_value(),
            info.contact_point(),
            info.contact_force(),
            nothing,
            pair.nhat_BA_W,
            float(pair.depth),
        )
    for index in range(results.num_hydroelastic_contacts()):
        area = results.hydroelastic_contact_info(index)
        surface, F_A = area.contact_surface(), area.F_Ac_W()
        force, torque = F_A.translational(), F_A.rotational()
        yield _Touch(
            surface.id_M().get_value(),
            surface.id_N().get_value(),
            surface.centroid(),
            -force,
            -torque,
            _normal(surface),
            0.0,
        )


def _normal(surface: ContactSurface) -> Array:
    """Return the mean direction of an area, out of its second shape, of length 1."""
    total = np.zeros(3)
    for face in range(surface.num_faces()):
        total += surface.area(face) * surface.face_normal(face)
    size = float(np.linalg.norm(total))
    return total / size if size else total


def _state(
    touch: _Touch, sign: float, origin: Array
) -> tuple[tuple[Wrench], Wrench, tuple[Vector3], tuple[Vector3], tuple[float]]:
    """Return a contact of a shape whose link has its origin at a point [m].

    The sign is -1 for the first shape, 1 for the second one.
    """
    force, torque = sign * touch.force, sign * touch.torque
    total = torque + cross(touch.point - origin, force)
    return (
        (_wrench(force, torque),),
        _wrench(force, total),
        (_vector(touch.point),),
        (_vector(-sign * touch.normal),),
        (touch.depth,),
    )


def _wrench(force: Array, torque: Array) -> Wrench:
    return Wrench(_vector(force), _vector(torque))


def _vector(values: Array) -> Vector3:
    return Vector3(*values.tolist())
