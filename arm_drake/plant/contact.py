"""Contact: forces between bodies, friction, and overlaps before anything moves.

Gazebo takes the smaller one of the two coefficients of what touches (ODE and DART
alike). Drake takes their harmonic mean, and what states nothing, the ground too, has
a coefficient of 1. So a link that states mu gets mu / (2 - mu) here: with anything that
has 1 this makes min(mu, 1), as in Gazebo. Between two links that both state less it is
a bit more than the smaller one.

A hull fills the room between the pads of an L-shaped jaw and makes a wedge of it. So
fingers collide as their meshes are where there is something to be held; elsewhere hulls
do, and contact takes less time.
"""

import contextlib
import dataclasses as dc
import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddRigidHydroelasticProperties,
    Box,
    Capsule,
    CollisionFilterDeclaration,
    Cylinder,
    Ellipsoid,
    GeometryId,
    GeometryInstance,
    GeometrySet,
    HydroelasticContactRepresentation,
    Mesh,
    Obb,
    PenetrationAsPointPair,
    PerceptionProperties,
    PolygonSurfaceMesh,
    ProximityProperties,
    QueryObject,
    RenderLabel,
    Rgba,
    RoleAssign,
    SceneGraph,
    Sphere,
)
from pydrake.geometry import Shape as DrakeShape
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex, RigidBody, world_index
from pydrake.systems.framework import BasicVector, Context, Diagram

from arm_drake.arrays import Array
from arm_drake.description.links import ShapeInfo
from arm_drake.description.meshes.conversion import convert_surface
from arm_drake.description.urdf import RobotDescription
from arm_drake.messages.sensors import ContactsState
from arm_drake.options import GRAVITY
from arm_drake.python_system import PythonSystem

# What overlaps less than this only touches [m].
_SMALLEST_OVERLAP = 1e-3

# How far all of a robot's weight would press one shape in [m].
_SINKING = 1e-3

# Things of one size are in one place if they are closer than this part of it.
_SAME_PLACE = 0.1

# Hydroelastic modulus of things [Pa]: hard rubber. A gripper of 400 N presses its pads
# 0.1 mm into a box; at 1e7 it would be 1 mm, and while the effort grows the joint would
# be too fast to count as stalled.
_MODULUS = 1e8

# Size of the facets of round shapes [m], and of those of large ones, per radius: with
# facets of 1 cm a step with a ball of half a metre on the ground takes 70 ms.
_RESOLUTION = 0.01
_LARGE_FACET = 0.1

# Below this speed a thing that is held counts as still [m/s]; Drake's own 1e-4 lets it
# creep twice as far out of fingers that aren't parallel.
_STICTION_TOLERANCE = 1e-5


def carry_weight(scene_graph: SceneGraph, mass: float) -> None:
    """Let a robot of this mass [kg] not sink deep into the ground.

    Drake gives all shapes one stiffness, whatever they weigh: a truck of 2 t sinks by
    12 mm, and its wheels roll as if they were as much smaller. Where that is too soft,
    all shapes get one with which the robot on three points sinks by two thirds of
    `_SINKING`. With robots below 102 kg Drake's remains.
    """
    config = scene_graph.get_config()
    properties = config.default_proximity_properties
    properties.point_stiffness = max(
        properties.point_stiffness, GRAVITY * mass / _SINKING
    )
    config.default_proximity_properties = properties
    scene_graph.set_config(config)


def set_friction(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    model: ModelInstanceIndex,
    friction: Mapping[str, float],
) -> None:
    """Give the links of a robot the friction that they state."""
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    for name, mu in friction.items():
        link = plant.GetBodyByName(name, model)
        for geometry in plant.GetCollisionGeometriesForBody(link):
            properties = ProximityProperties(inspector.GetProximityProperties(geometry))
            properties.UpdateProperty(
                "material", "coulomb_friction", CoulombFriction(mu, mu)
            )
            scene_graph.AssignRole(source, geometry, properties, RoleAssign.kReplace)


def make_things_compliant(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    robots: Collection[ModelInstanceIndex],
) -> bool:
    """Let things of the world be touched by areas, where points can't hold them.

    Drake's point contact has one point for each pair of shapes: what is held between
    two fingers turns about the line through its two points and creeps out. Hydroelastic
    contact presses on an area, and a step that has it takes two to five times as long.
    So only things that move are compliant. Robots and what stands still are rigid: they
    touch each other at points, as they do in a world without things, which is left as
    it is. Properties that a shape has already are kept.
    """
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    is_thing: dict[GeometryId, bool] = {}
    for index in range(plant.num_bodies()):
        body = plant.get_body(BodyIndex(index))
        moves = body.model_instance() not in robots and not plant.IsAnchored(body)
        shapes = plant.GetCollisionGeometriesForBody(body)
        is_thing.update(dict.fromkeys(shapes, moves))
    if not any(is_thing.values()):
        return False
    plant.set_stiction_tolerance(_STICTION_TOLERANCE)
    for geometry, moves in is_thing.items():
        properties = ProximityProperties(inspector.GetProximityProperties(geometry))
        if properties.HasProperty("hydroelastic", "compliance_type"):
            continue
        resolution = _resolution(inspector.GetShape(geometry))
        if moves:
            AddCompliantHydroelasticProperties(resolution, _MODULUS, properties)
        else:
            AddRigidHydroelasticProperties(resolution, properties)
        scene_graph.AssignRole(source, geometry, properties, RoleAssign.kReplace)
    return True


def _resolution(shape: DrakeShape) -> float:
    """Return the size of the facets that stand for a round shape [m]."""
    radius = 0.0
    if isinstance(shape, Capsule | Cylinder | Sphere):
        radius = shape.radius()
    elif isinstance(shape, Ellipsoid):
        # Neither a needle nor a disk has more facets than a ball.
        radius = sorted((shape.a(), shape.b(), shape.c()))[1]
    return max(_RESOLUTION, _LARGE_FACET * radius)


# A shape: its body's index, and which one of the body's it is. Identifiers of Drake's
# would keep the plant alive.
Shape = tuple[int, int]


class Overlaps(NamedTuple):
    """Overlaps in the initial pose."""

    # Of each robot, in words.
    robots: Mapping[ModelInstanceIndex, list[str]]

    # Things of the world in one place, in words.
    things: Sequence[str]

    # Shapes of robots that pass through each other, until they are apart.
    parted: Sequence[tuple[Shape, Shape]]


def separate(
    diagram: Diagram,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    free_links: Mapping[ModelInstanceIndex, Collection[str]],
) -> Overlaps:
    """Let bodies pass through each other that overlap in the initial pose.

    Before that, things of the world are made fit to be held, see
    `make_things_compliant`. Contact would throw them apart: hulls are larger than
    meshes, and many robots are drawn with a part in the ground. Links that nothing
    holds keep their contact with the world, which carries them.
    """
    has_things = make_things_compliant(plant, scene_graph, free_links)
    context = diagram.CreateDefaultContext()
    port = plant.get_geometry_query_input_port()
    query = port.Eval(plant.GetMyContextFromRoot(context))
    inspector = query.inspector()
    merged: list[str] = []
    if has_things:
        merged = _part_things(plant, scene_graph, query, free_links)
    if merged:  # With what they are told now.
        context = diagram.CreateDefaultContext()
        query = port.Eval(plant.GetMyContextFromRoot(context))
    found: dict[ModelInstanceIndex, set[str]] = {model: set() for model in free_links}
    parted = []
    for pair in _overlapping_pairs(query, has_things=has_things):
        geometries = (pair.id_A, pair.id_B)
        bodies = [
            plant.GetBodyFromFrameId(inspector.GetFrameId(geometry))
            for geometry in geometries
        ]
        if not any(body.model_instance() in found for body in bodies):
            continue  # Things of the world, or what they stand on.
        if pair.depth < _SMALLEST_OVERLAP or _is_free_link_on_world(bodies, free_links):
            continue
        _part(scene_graph, geometries)
        one, two = (
            (
                int(body.index()),
                plant.GetCollisionGeometriesForBody(body).index(geometry),
            )
            for body, geometry in zip(bodies, geometries, strict=True)
        )
        parted.append((one, two))
        for body, other in (bodies, bodies[::-1]):
            model = body.model_instance()
            if model in found:
                name = "the world" if other.index() == world_index() else other.name()
                if (owner := other.model_instance()) in {*found} - {model}:
                    name = f"{plant.GetModelInstanceName(owner)}/{name}"
                found[model].add(f"{body.name()} and {name}")
    robots = {model: sorted(texts) for model, texts in found.items()}
    return Overlaps(robots, merged, parted)


def rejoin(
    diagram: Diagram, context: Context, parted: Iterable[tuple[Shape, Shape]]
) -> None:
    """Have shapes that `separate` has parted collide, once they are apart.

    It changes the filter that the root context of the diagram holds.
    """
    plant = diagram.GetSubsystemByName("plant")
    scene_graph = diagram.GetSubsystemByName("scene_graph")
    assert isinstance(plant, MultibodyPlant)
    assert isinstance(scene_graph, SceneGraph)
    own = scene_graph.GetMyMutableContextFromRoot(context)
    filters = scene_graph.collision_filter_manager(own)
    port = plant.get_geometry_query_input_port()
    query = port.Eval(plant.GetMyContextFromRoot(context))
    apart = []
    for pair in parted:
        one, two = (
            plant.GetCollisionGeometriesForBody(plant.get_body(BodyIndex(body)))[number]
            for body, number in pair
        )
        # Of half spaces and meshes Drake doesn't know all distances.
        with contextlib.suppress(RuntimeError):
            if query.inspector().CollisionFiltered(one, two) and (
                query.ComputeSignedDistancePairClosestPoints(one, two).distance > 0.0
            ):
                apart.append((GeometrySet([one]), GeometrySet([two])))
    for sets in apart:
        filters.Apply(CollisionFilterDeclaration().AllowBetween(*sets))


def _part(scene_graph: SceneGraph, geometries: Iterable[GeometryId]) -> None:
    """Let two shapes pass through each other."""
    declaration = CollisionFilterDeclaration()
    declaration.ExcludeBetween(*(GeometrySet([g]) for g in geometries))
    scene_graph.collision_filter_manager().Apply(declaration)


def _part_things(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    query: QueryObject,
    robots: Collection[ModelInstanceIndex],
) -> list[str]:
    """Let things pass through each other that are in one place; return their names.

    Compliant bodies that are in one place meet in all of their volumes, which takes
    Drake seconds for each step. Hulls of meshes may be in one place where they aren't.
    """
    inspector = query.inspector()
    names: set[str] = set()
    for pair in query.ComputePointPairPenetration():
        geometries = (pair.id_A, pair.id_B)
        boxes = [inspector.GetObbInGeometryFrame(g) for g in geometries]
        bodies = [plant.GetBodyFromFrameId(inspector.GetFrameId(g)) for g in geometries]
        if None in boxes or any(
            body.model_instance() in robots or body.index() == world_index()
            for body in bodies
        ):
            continue
        one, other = (np.sort(box.half_width()) for box in boxes)
        places = [
            query.GetPoseInWorld(g).multiply(box.center())
            for g, box in zip(geometries, boxes, strict=True)
        ]
        apart = np.linalg.norm(places[0] - places[1])
        is_near = apart < _SAME_PLACE * min(one[0], other[0])
        if is_near and np.allclose(one, other, rtol=_SAME_PLACE):
            _part(scene_graph, geometries)
            scoped = sorted(body.scoped_name().get_full() for body in bodies)
            names.add(" and ".join(scoped))
    return sorted(names)


def _overlapping_pairs(
    query: QueryObject, *, has_things: bool
) -> list[PenetrationAsPointPair]:
    """Return pairs of shapes that overlap, with how deep their hulls do.

    Points know a mesh by its hull: what touches over areas must do so in truth.
    """
    pairs: list[PenetrationAsPointPair] = query.ComputePointPairPenetration()
    if not has_things:
        return pairs
    kind = HydroelasticContactRepresentation.kTriangle
    areas, points = query.ComputeContactSurfacesWithFallback(kind)
    touching = {frozenset((area.id_M(), area.id_N())) for area in areas}
    touching |= {frozenset((point.id_A, point.id_B)) for point in points}
    shape_of = query.inspector().GetShape
    return [
        pair
        for pair in pairs
        if frozenset((pair.id_A, pair.id_B)) in touching
        or not any(isinstance(shape_of(g), Mesh) for g in (pair.id_A, pair.id_B))
    ]


def _is_free_link_on_world(
    bodies: Sequence[RigidBody],
    free_links: Mapping[ModelInstanceIndex, Collection[str]],
) -> bool:
    """Return whether the world carries a link that nothing else holds."""
    free = [b.name() in free_links.get(b.model_instance(), ()) for b in bodies]
    robots = [b.model_instance() in free_links for b in bodies]
    return any(free) and not all(robots)


# Name of the log, after the prefix of its robot.
CONTACT_LOG = "contact_forces"


class ContactForces(PythonSystem):
    """Adds up the contact forces on each link.

    .. pydrake_system::

        name: ContactForces
        input_ports:
        - contacts
        output_ports:
        - force

    ========  ====  ====  ============================================================
    port      size  unit  meaning
    ========  ====  ====  ============================================================
    contacts  --    --    ContactsState: what touches the robot
    force     3L    [N]   total force on each link in the world, x, y, z
    ========  ====  ====  ============================================================

    It has no state.
    """

    def __init__(self, links: Sequence[str]) -> None:
        """Create the system."""
        super().__init__()
        self._rows = {link: row for row, link in enumerate(links)}
        nothing = AbstractValue.Make(ContactsState())
        self._contacts = self.DeclareAbstractInputPort("contacts", nothing)
        self.DeclareVectorOutputPort(
            "force",
            3 * len(links),
            self._calc_force,
            prerequisites_of_calc={self._contacts.ticket()},
        )

    def _calc_force(self, context: Context, output: BasicVector) -> None:
        total = np.zeros((len(self._rows), 3))
        for state in self._contacts.Eval(context).states:
            # "<robot>::<link>::<shape>".
            link = state.collision1_name.split("::")[-2]
            if link in self._rows:
                force = state.total_wrench.force
                total[self._rows[link]] += (force.x, force.y, force.z)
        output.SetFromVector(total.ravel())


# Name of its shape, also of the ground plane of an SDF file.
GROUND = "ground"

# Friction of the ground, static and dynamic.
GROUND_FRICTION = 1.0

# A box, for Drake warns about half spaces [m].
_SIZE = (100.0, 100.0, 1.0)

# Gazebo's.
_GROUND_COLOR = Rgba(0.8, 0.8, 0.8, 1.0)


def hull_vertices(hull: PolygonSurfaceMesh) -> Array:
    """Return the vertices of a hull [m], shape (n, 3)."""
    return np.array([hull.vertex(i) for i in range(hull.num_vertices())])


def box_corners(box: Obb) -> Array:
    """Return the corners of a box around a shape [m], in its frame, shape (8, 3)."""
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1)
    corners: Array = box.pose().multiply(box.half_width()[:, None] * signs).T
    return corners


def hull_triangles(hull: PolygonSurfaceMesh) -> NDArray[np.int64]:
    """Return triangles that cover a hull, as indices of vertices, shape (n, 3)."""
    triangles = []
    for index in range(hull.num_faces()):
        face = hull.element(index)
        corners = [face.vertex(i) for i in range(face.num_vertices())]
        # A face of a hull is convex: a fan covers it.
        triangles += [(corners[0], b, c) for b, c in itertools.pairwise(corners[1:])]
    return np.array(triangles)


def add_ground(plant: MultibodyPlant) -> None:
    """Add the ground plane z = 0, as Gazebo's empty world has it."""
    X_WG = RigidTransform([0.0, 0.0, -_SIZE[2] / 2.0])
    plant.RegisterCollisionGeometry(
        plant.world_body(),
        X_WG,
        Box(*_SIZE),
        GROUND,
        CoulombFriction(GROUND_FRICTION, GROUND_FRICTION),
    )
    # Only cameras see it; the page has a ground of its own.
    seen = GeometryInstance(X_WG, Box(*_SIZE), GROUND)
    properties = PerceptionProperties()
    properties.AddProperty("phong", "diffuse", _GROUND_COLOR)
    properties.AddProperty("label", "id", RenderLabel(int(world_index())))
    seen.set_perception_properties(properties)
    plant.RegisterVisualGeometry(plant.world_body(), seen)


def for_drake(mu: float) -> float:
    """Return what makes mu with a coefficient of 1, by Drake's harmonic mean."""
    return mu / (2.0 - mu)


def with_surfaces(
    description: RobotDescription, links: Collection[str]
) -> RobotDescription:
    """Return a description whose collision meshes are surfaces, not hulls."""
    return dc.replace(
        description,
        link_infos=tuple(
            dc.replace(link, collisions=tuple(map(_with_surface, link.collisions)))
            if link.name in links
            else link
            for link in description.link_infos
        ),
    )


def _with_surface(shape: ShapeInfo) -> ShapeInfo:
    """Return a shape to collide with, as a surface where it is the hull of a mesh."""
    mesh = shape.geometry
    if not mesh.source:
        return shape
    surface = convert_surface(Path(mesh.source), mesh.source_scale)
    if surface is None:
        return shape
    return dc.replace(shape, geometry=dc.replace(mesh, filename=surface.as_uri()))
