"""Shapes around a robot, for planning: those of a world, and of what is simulated."""

import functools
import weakref
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydrake.geometry import CalcObb, GeometryId, HalfSpace, SceneGraph, Shape
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    ModelInstanceIndex,
    RigidBody,
    default_model_instance,
)
from pydrake.systems.framework import Context, Diagram

from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, suggest
from arm_drake.plant.contact import GROUND
from arm_drake.plant.kinematics import KinematicPlant
from arm_drake.worlds.things import LoadedWorld
from arm_drake.worlds.world import World, load_world

# Drake keeps what is filtered for each pair of shapes of a SceneGraph: time and memory
# grow with the square of their number. More of them are in several.
_MOST_SHAPES = 256

# How shapes look that aren't seen otherwise.
_COLOR = np.array([0.75, 0.65, 0.5, 1.0])


class PlacedShape(NamedTuple):
    """A shape that a link carries, or that stands in the world."""

    # What it is called.
    name: str

    shape: Shape

    # Where it is in the frame of the link, or in the world.
    pose: RigidTransform

    # Who carries it; None is the world.
    link: str | None = None


class _Recorder(MultibodyPlant):
    """A plant that only writes down the shapes of functions that add very many."""

    def __init__(self, scene_graph: SceneGraph) -> None:
        """Register it as a source of shapes.

        It has neither the SceneGraph nor bodies: they hold it, and would be kept.
        """
        super().__init__(time_step=1e-3)
        self.count = 0
        self.recorded: list[tuple[BodyIndex, str, Shape, RigidTransform]] = []
        self.RegisterAsSourceForSceneGraph(scene_graph)

    def RegisterCollisionGeometry(
        self,
        body: RigidBody,
        X_BG: RigidTransform,
        shape: Shape,
        name: str,
        *properties: object,
        **named_properties: object,
    ) -> GeometryId:
        """Take a shape as MultibodyPlant does, whose time for each grows with them."""
        self.count += 1
        if self.count > _MOST_SHAPES:
            self.recorded.append((body.index(), name, shape, RigidTransform(X_BG)))
            return GeometryId.get_new_id()
        known = super().RegisterCollisionGeometry(
            body, X_BG, shape, name, *properties, **named_properties
        )
        assert isinstance(known, GeometryId)
        return known


def find_standing(
    world: World, package_paths: Sequence[Path] = ()
) -> list[PlacedShape]:
    """Return the shapes of a world, as they stand at the start."""
    scene_graph = SceneGraph()
    source = _Recorder(scene_graph)
    load_world(world, package_paths).add_to(source)
    source.Finalize()
    context = source.CreateDefaultContext()
    poses = [
        source.EvalBodyPoseInWorld(context, source.get_body(BodyIndex(index)))
        for index in range(source.num_bodies())
    ]
    bodies = range(source.num_bodies())
    standing = _find_shapes(source, scene_graph, poses, bodies)
    for body, name, shape, X_BG in source.recorded:
        index = int(body)
        label = _name_of(source, source.get_body(body)) if index else name
        standing.append(PlacedShape(label, shape, poses[index] @ X_BG))
    return standing


def divide_shapes(
    shapes: Sequence[PlacedShape], base: np.ndarray
) -> list[tuple[PlacedShape, ...]]:
    """Return shapes in parts of few that are near to each other, the nearest first."""
    endless = [each for each in shapes if isinstance(each.shape, HalfSpace)]
    finite = [each for each in shapes if not isinstance(each.shape, HalfSpace)]
    if len(finite) <= _MOST_SHAPES:
        return [tuple(shapes)]
    waiting, parts = [finite], []
    while waiting:
        several = waiting.pop()
        if len(several) <= _MOST_SHAPES:
            parts.append(tuple(several))
            continue
        at = np.array([each.pose.translation() for each in several])
        order = np.argsort(at[:, np.argmax(np.ptp(at, axis=0))], kind="stable")
        half = len(order) // 2
        waiting += [[several[i] for i in some] for some in (order[:half], order[half:])]
    parts.sort(key=lambda part: distance_to(part, base))
    return [(*endless, *parts[0]), *parts[1:]]


def distance_to(shapes: Sequence[PlacedShape], base: np.ndarray) -> float:
    """Return how far any of some shapes is from a point at least [m]."""
    return min(
        float(np.linalg.norm((each.pose @ box.pose()).translation() - base))
        - float(np.linalg.norm(box.half_width()))
        for each in shapes
        for box in (CalcObb(each.shape),)
    )


def _find_shapes(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    poses: Sequence[RigidTransform],
    bodies: Iterable[int],
) -> list[PlacedShape]:
    """Return the shapes of bodies that have poses in the world."""
    inspector, found = scene_graph.model_inspector(), []
    for index in bodies:
        body = plant.get_body(BodyIndex(index))
        for geometry in plant.GetCollisionGeometriesForBody(body):
            name = _name_of(plant, body) if index else inspector.GetName(geometry)
            X_BG = RigidTransform(inspector.GetPoseInFrame(geometry))
            # A copy: what the inspector returns keeps the diagram alive.
            shape = inspector.GetShape(geometry).Clone()
            found.append(PlacedShape(name, shape, poses[index] @ X_BG))
    return found


def _name_of(plant: MultibodyPlant, body: RigidBody) -> str:
    """Return what a body is called: as its model, if that has no other."""
    model = body.model_instance()
    name = plant.GetModelInstanceName(model)
    if model == default_model_instance():
        return str(body.name())
    is_only = len(plant.GetBodyIndices(model)) == 1
    return name if is_only else f"{name}/{body.name()}"


def register_shapes(plant: MultibodyPlant, shapes: Sequence[PlacedShape]) -> None:
    """Fix shapes to the world; numbers tell those of one name apart."""
    friction = CoulombFriction(1.0, 1.0)  # Nothing slides.
    for number, (name, shape, pose, _) in enumerate(shapes):
        plant.RegisterCollisionGeometry(
            plant.world_body(), pose, shape, f"{name}::{number}", friction
        )


def show_standing(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    robot: ModelInstanceIndex,
    things: Sequence[PlacedShape],
) -> None:
    """Let shapes be seen that aren't: those of the world, and things around a robot."""
    inspector = scene_graph.model_inspector()
    for index in range(plant.num_bodies()):
        body = plant.get_body(BodyIndex(index))
        # The ground that cameras see isn't drawn on pages.
        is_seen = any(
            inspector.GetIllustrationProperties(geometry) is not None
            for geometry in plant.GetVisualGeometriesForBody(body)
        )
        if body.model_instance() == robot or is_seen:
            continue
        for geometry in plant.GetCollisionGeometriesForBody(body):
            name = inspector.GetName(geometry)
            if GROUND not in name:
                X = RigidTransform(inspector.GetPoseInFrame(geometry))
                shape = inspector.GetShape(geometry)
                plant.RegisterVisualGeometry(body, X, shape, f"{name}_seen", _COLOR)
    for number, each in enumerate(things):
        body = plant.world_body()
        if each.link is not None:
            body = plant.GetBodyByName(each.link, robot)
        name = f"thing_{number}"
        plant.RegisterVisualGeometry(body, each.pose, each.shape, name, _COLOR)


class PlanningScene(NamedTuple):
    """Present surroundings of a robot of a diagram."""

    # What never moves.
    world: LoadedWorld

    # What stands somewhere, and what its links carry.
    things: tuple[PlacedShape, ...]

    # Where its base is, if that moves.
    X_WB: RigidTransform | None


# What never moves, around a robot of a diagram.
_worlds: "weakref.WeakKeyDictionary[Diagram, dict[str, LoadedWorld]]" = (
    weakref.WeakKeyDictionary()
)


def read_planning_scene(
    diagram: Diagram,
    context: Context,
    robot: Robot,
    attached_bodies: Mapping[str, str],
    ignored: Collection[str],
) -> PlanningScene:
    """Return what is around a robot of a running diagram, but for bodies ignored.

    `attached_bodies` says which links hold which bodies; these are where they are on
    the links. InputError if there is no such body, or it has no shape.
    """
    plant, scene_graph = diagram.GetSubsystemByName("plant"), _scene_graph_of(diagram)
    own = plant.GetMyContextFromRoot(context)
    poses = plant.GetOutputPort("body_poses").Eval(own)
    plant = plant.plant if isinstance(plant, KinematicPlant) else plant
    model = plant.GetModelInstanceByName(robot.name)
    ours = {int(index) for index in plant.GetBodyIndices(model)}
    others = [index for index in range(plant.num_bodies()) if index not in ours]
    still = [i for i in others if plant.IsAnchored(plant.get_body(BodyIndex(i)))]
    known = _worlds.setdefault(diagram, {})
    if robot.name not in known:
        shapes = _find_shapes(plant, scene_graph, poses, still)
        add_to = functools.partial(register_shapes, shapes=shapes)  # It can be pickled.
        known[robot.name] = LoadedWorld("surroundings", add_to)
    moving = [index for index in others if index not in set(still)]
    standing = _find_shapes(plant, scene_graph, poses, moving)
    unseen = {*attached_bodies.values(), *ignored}
    things = [each for each in standing if each.name not in unseen]
    links = {
        link: poses[int(plant.GetBodyByName(link, model).index())]
        for link in robot.description.links
        if plant.HasBodyNamed(link, model)
    }
    names = {each.name for each in standing}
    for name in (*attached_bodies.values(), *ignored):
        if name not in names:
            raise InputError(
                f"no body {name!r} that could move; {suggest(name, names)}"
            )
    for link, name in attached_bodies.items():
        things += [
            each._replace(link=link, pose=links[link].inverse() @ each.pose)
            for each in standing
            if each.name == name and name not in ignored
        ]
    things += _payloads(plant, scene_graph, model, links)
    X_WB = links[robot.description.base] if robot.has_free_base else None
    return PlanningScene(known[robot.name], tuple(things), X_WB)


def _payloads(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    model: ModelInstanceIndex,
    links: Iterable[str],
) -> Iterator[PlacedShape]:
    """Yield the shapes of payloads on links of a robot in a diagram."""
    inspector = scene_graph.model_inspector()
    for link in links:
        body = plant.GetBodyByName(link, model)
        for geometry in plant.GetCollisionGeometriesForBody(body):
            if inspector.GetName(geometry).rpartition("::")[2] == "payload":
                pose = RigidTransform(inspector.GetPoseInFrame(geometry))
                shape = inspector.GetShape(geometry).Clone()
                yield PlacedShape(f"payload of {link}", shape, pose, link)


def _scene_graph_of(diagram: Diagram) -> SceneGraph:
    found = diagram.GetSubsystemByName("scene_graph")
    assert isinstance(found, SceneGraph)
    return found
