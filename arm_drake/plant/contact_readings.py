"""What touches a robot, as messages."""

from collections.abc import Collection, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import ContactSurface, SceneGraph, SceneGraphInspector
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex
from pydrake.systems.framework import Context, DiagramBuilder

from arm_drake.arrays import Array
from arm_drake.description.gazebo_bumpers import shape_name
from arm_drake.messages import Header, Vector3, Wrench
from arm_drake.messages.contacts import ContactsState, ContactState
from arm_drake.plant.plant_ports import PlantPorts
from arm_drake.python_system import PythonSystem

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
    """Tells what touches a robot.

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
        """Create the system.

        Args:
            plant: The finalized plant.
            scene_graph: Its scene graph.
            model: The robot's model instance.
            links: Its links; a body "<link>:..." that the plant has besides is part of
                the link.
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
            prerequisites_of_calc={
                self.time_ticket(),
                self.all_input_ports_ticket(),
            },
        )

    def connect(self, builder: DiagramBuilder) -> None:
        """Connect the system with the plant, both being in a builder."""
        self._ports.connect(builder)

    def _calc_contacts(self, context: Context, output: AbstractValue) -> None:
        poses = self._poses.Eval(context)
        states = []
        for touch in _touches(self._results.Eval(context)):
            pair = (touch.first, touch.second)
            for own, other, sign in ((*pair, -1.0), (*pair[::-1], 1.0)):
                if own in self._own:
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
    """Return a contact as one shape feels it.

    Args:
        touch: The contact.
        sign: -1 for the first shape, 1 for the second one.
        origin: Origin of the shape's link in the world [m].
    """
    force, torque = sign * touch.force, sign * touch.torque
    total = torque + np.cross(touch.point - origin, force)
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
