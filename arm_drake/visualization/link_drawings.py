"""Drawings beside links' visual shapes: RViz's displays.

Everything lies below ``/drake``, where Drake's MeshcatVisualizer has its shapes: one
transform of ``/drake`` moves it all.
"""

import functools
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    HalfSpace,
    Mesh,
    Meshcat,
    MeshcatCone,
    Rgba,
    Role,
    SceneGraph,
    SceneGraphInspector,
    Shape,
    TriangleSurfaceMesh,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    ModelInstanceIndex,
    PrismaticJoint,
    RigidBody,
    SpatialInertia,
)
from pydrake.systems.framework import Context

from arm_drake.arrays import Array
from arm_drake.description.inertia import DENSITY
from arm_drake.description.joints import WORLD
from arm_drake.description.meshes.reading import read_surfaces
from arm_drake.description.meshes.surfaces import stack
from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import check_known
from arm_drake.plant.contact import box_corners, hull_triangles, hull_vertices

# A robot without shapes whose links are all in one place counts as so large [m].
_SMALLEST = 0.1


class Part(NamedTuple):
    """A body of the plant, and the link that it moves with."""

    body: RigidBody
    link: str

    # Pose of the body in the link.
    X_LB: RigidTransform


class DrawnRobot:
    """A robot in a plant, as it stands by default.

    A plant may have more bodies than the description has links: rollers of wheels, and
    wheels on axles that the description lacks. They are parts of the link that carries
    them, drawn where they start; they are round.

    A link called "world" is the world itself. What is fixed to it has no shape of the
    robot's own: the world has the ground, too.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        model: ModelInstanceIndex,
        description: RobotDescription,
    ) -> None:
        """Create it with a finalized plant, which is kept, as its scene graph is."""
        self.plant = plant
        self.model = model
        self.description = description
        self._scene_graph = scene_graph

    @property
    def inspector(self) -> SceneGraphInspector:
        """The scene."""
        return self._scene_graph.model_inspector()

    @functools.cached_property
    def parts(self) -> tuple[Part, ...]:
        """The robot's bodies; those that no link carries are left out."""
        plant, links = self.plant, set(self.description.links)
        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(self.model)]
        joints = [plant.get_joint(index) for index in plant.GetJointIndices(self.model)]
        carriers = {joint.child_body().name(): joint.parent_body() for joint in joints}
        parts = []
        for body in bodies:
            link = body
            while link.name() not in links and link.name() in carriers:
                link = carriers[link.name()]
            if link.name() in links:
                X_LB = self._pose(link).inverse() @ self._pose(body)
                parts.append(Part(body, link.name(), X_LB))
        return tuple(parts)

    @functools.cached_property
    def link_poses(self) -> dict[str, RigidTransform]:
        """Default poses of the links, in the order of the description."""
        plant = self.plant
        return {
            link: RigidTransform()
            if link == WORLD
            else self._pose(plant.GetBodyByName(link, self.model))
            for link in self.description.links
        }

    @functools.cached_property
    def size(self) -> float:
        """Diagonal of the box around all links and shapes, by default [m]."""
        points = [X_WL.translation() for X_WL in self.link_poses.values()]
        for part in self.parts:
            X_WB = self._pose(part.body)
            for role in (Role.kIllustration, Role.kProximity):
                for geometry in self.shapes(part.body, role):
                    box = self.inspector.GetObbInGeometryFrame(geometry)
                    if box is not None:
                        X_WG = X_WB @ self.inspector.GetPoseInFrame(geometry)
                        points += list(X_WG.multiply(box_corners(box).T).T)
        return max(float(np.linalg.norm(np.ptp(points, axis=0))), _SMALLEST)

    def shapes(self, body: RigidBody, role: Role) -> list[GeometryId]:
        """Return the shapes that a body has for a purpose."""
        frame = self.plant.GetBodyFrameIdIfExists(body.index())
        return [] if frame is None else list(self.inspector.GetGeometries(frame, role))

    def _pose(self, body: RigidBody) -> RigidTransform:
        return self.plant.EvalBodyPoseInWorld(self._default, body)

    @functools.cached_property
    def _default(self) -> Context:
        return self.plant.CreateDefaultContext()


class Triangles(NamedTuple):
    """Triangles of one colour; n vertices, m triangles, as Meshcat takes them."""

    # [m], shape (3, n).
    vertices: NDArray[np.float64]

    # Columns of `vertices`, counter-clockwise seen from outside, shape (3, m).
    faces: NDArray[np.int32]


Solid: TypeAlias = Shape | Triangles


# Properties of three.js of what is drawn beside visual shapes, by Meshcat's names.
#
# Often it coincides with them: it is drawn as if it were a little closer to the camera,
# by half a millimetre at a distance of 1 m, else both would be seen in patches.
_CLOSER: Mapping[str, bool | float] = {
    "material.polygonOffset": True,
    "material.polygonOffsetFactor": -1.0,
    "material.polygonOffsetUnits": -80.0,
}
# Or it is inside of them, and drawn last of all, whatever is before it.
_ON_TOP: Mapping[str, bool | float] = {"material.depthTest": False, "renderOrder": 1.0}

# What is on top has no depth; what is transparent, if only hardly, is drawn in its
# order from the back to the front.
_HARDLY_TRANSPARENT = 0.99


def draw_solid(
    meshcat: Meshcat, path: str, solid: Solid, rgba: Rgba, *, is_on_top: bool = False
) -> None:
    """Draw a solid in place of what was at its path.

    One that is on top is seen through all that is before it; then the colour's alpha
    isn't used.
    """
    if is_on_top:
        rgba = Rgba(rgba.r(), rgba.g(), rgba.b(), _HARDLY_TRANSPARENT)
    if isinstance(solid, Triangles):
        meshcat.SetTriangleMesh(path, solid.vertices, solid.faces, rgba)
    else:
        meshcat.SetObject(path, solid, rgba)
    for name, value in (_ON_TOP if is_on_top else _CLOSER).items():
        meshcat.SetProperty(f"{path}/<object>", name, value)


def draw_triad(meshcat: Meshcat, path: str, length: float) -> None:
    """Draw a frame's axes [m], seen through all else: x red, y green, z blue."""
    for piece in _triad("", length):
        _draw_piece(meshcat, path, piece)


def visual_solid(inspector: SceneGraphInspector, geometry: GeometryId) -> Solid | None:
    """Return a visual shape whose colour can be chosen, or None: a half space.

    Meshcat draws a glTF file in the file's own colours, so here it becomes triangles.
    """
    shape = inspector.GetShape(geometry)
    if isinstance(shape, HalfSpace):
        return None
    if isinstance(shape, Mesh) and shape.source().is_path():
        path = Path(shape.source().path())
        if path.suffix == ".gltf":
            return _read_triangles(path, shape.scale3())
    return shape


def collision_solid(
    inspector: SceneGraphInspector, geometry: GeometryId
) -> Solid | None:
    """Return a collision shape as the physics sees it.

    Drake takes the convex hull of a mesh; its triangles only where they touch things
    over areas, as rigid hydroelastic surfaces.
    """
    shape = inspector.GetShape(geometry)
    if isinstance(shape, HalfSpace):
        return None
    if not isinstance(shape, Mesh | Convex):
        return shape
    surface = inspector.maybe_get_hydroelastic_mesh(geometry)
    if isinstance(surface, TriangleSurfaceMesh):
        return _from_triangles(surface)
    hull = inspector.GetConvexHull(geometry)
    return _pack(hull_vertices(hull), hull_triangles(hull))


def _read_triangles(path: Path, scale: NDArray[np.float64]) -> Triangles:
    surfaces = read_surfaces(path, path.read_bytes(), tuple(scale.tolist()), [])
    return _pack(*stack(surfaces))


def _from_triangles(mesh: TriangleSurfaceMesh) -> Triangles:
    corners = range(3)
    faces = [[face.vertex(i) for i in corners] for face in mesh.triangles()]
    return _pack(np.array(mesh.vertices()), np.array(faces))


def _pack(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Triangles:
    return Triangles(
        np.asfortranarray(vertices.T, dtype=float),
        np.asfortranarray(faces.T, dtype=np.int32),
    )


# Length of a triad, as a part of the robot's size, and of the distance to what is near:
# between the fingers of a hand they are shorter than at an arm, yet not too short.
_LONGEST, _SHORTEST = 0.08, 0.03
_OF_DISTANCE = 0.8

# Links that are closer are in the same place, as a part of the robot's size.
_SAME_PLACE = 1e-3

# Length of an arrow in lengths of a triad.
_ARROW = 1.5

# Radius of an axis of a triad, as a part of its length.
_TRIAD_RADIUS = 0.035

# Radii of an arrow's shaft and head, and length of its head, as parts of its length.
_SHAFT_RADIUS, _HEAD_RADIUS, _HEAD = 0.035, 0.1, 0.3

# Semi-axes of an ellipsoid are at least this part of the robot's size: a rod and a
# point of mass are seen, too.
_THINNEST = 2e-3

_AXES = (
    ("x", Rgba(0.95, 0.1, 0.1)),
    ("y", Rgba(0.1, 0.8, 0.1)),
    ("z", Rgba(0.15, 0.25, 1.0)),
)
_COLLISION = Rgba(1.0, 0.45, 0.0, 0.5)
_INERTIA = Rgba(0.6, 0.15, 0.85, 0.5)
_REVOLUTE = Rgba(1.0, 0.8, 0.0)
_PRISMATIC = Rgba(0.0, 0.8, 0.9)


class Piece(NamedTuple):
    """Something that moves with a link."""

    link: str

    # Unique among the pieces of the link and its kind.
    name: str
    solid: Solid
    rgba: Rgba

    # Its pose in the link.
    X_LP: RigidTransform

    # Whether it is seen through the robot, in which it would hide.
    is_on_top: bool = False


def frame_pieces(robot: DrawnRobot) -> Iterator[Piece]:
    """Yield a triad for each link: x red, y green, z blue."""
    for link, length in _lengths(robot).items():
        yield from _triad(link, length)


def _triad(link: str, length: float) -> Iterator[Piece]:
    shape = Cylinder(_TRIAD_RADIUS * length, length)
    for axis, (name, rgba) in zip(np.eye(3), _AXES, strict=True):
        X_LP = _along(axis, length / 2.0)
        yield Piece(link, name, shape, rgba, X_LP, is_on_top=True)


def _draw_piece(meshcat: Meshcat, path: str, piece: Piece) -> None:
    own = path_below(path, piece.name)
    meshcat.SetTransform(own, piece.X_LP)
    draw_solid(meshcat, own, piece.solid, piece.rgba, is_on_top=piece.is_on_top)


def collision_pieces(robot: DrawnRobot) -> Iterator[Piece]:
    """Yield what of each link collides, see `collision_solid`."""
    inspector = robot.inspector
    for body, link, X_LB in robot.parts:
        for index, geometry in enumerate(robot.shapes(body, Role.kProximity)):
            solid = collision_solid(inspector, geometry)
            if solid is not None:
                X_LP = X_LB @ inspector.GetPoseInFrame(geometry)
                name = f"{body.name()} {index}"
                yield Piece(link, name, solid, _COLLISION, X_LP)


def inertia_pieces(robot: DrawnRobot) -> Iterator[Piece]:
    """Yield an ellipsoid for each body with mass, see `equivalent_ellipsoid`."""
    for body, link, X_LB in robot.parts:
        found = equivalent_ellipsoid(body.default_spatial_inertia())
        if found is not None:
            semi_axes, X_BE = found
            semi_axes = np.maximum(semi_axes, _THINNEST * robot.size)
            solid = Ellipsoid(*semi_axes.tolist())
            yield Piece(link, body.name(), solid, _INERTIA, X_LB @ X_BE)


def axis_pieces(robot: DrawnRobot) -> Iterator[Piece]:
    """Yield an arrow for each joint of one degree of freedom.

    It starts at the joint's frame, which is that of its child link, and points along
    the axis of the description: yellow for joints that turn, cyan for those that slide.
    """
    lengths = _lengths(robot)
    flip = RigidTransform(RotationMatrix.MakeXRotation(np.pi))
    for info in robot.description.movable_joints:
        length = _ARROW * lengths[info.child]
        shaft_length = (1.0 - _HEAD) * length
        shaft = Cylinder(_SHAFT_RADIUS * length, shaft_length)
        # Its tip is at its origin, and it opens along z.
        head = MeshcatCone(_HEAD * length, *2 * [_HEAD_RADIUS * length])
        joint = robot.plant.GetJointByName(info.name, robot.model)
        slides = isinstance(joint, PrismaticJoint)
        axis = joint.translation_axis() if slides else joint.revolute_axis()
        X_LM = joint.frame_on_child().GetFixedPoseInBodyFrame()
        rgba = _PRISMATIC if slides else _REVOLUTE
        X_LS = X_LM @ _along(axis, shaft_length / 2.0)
        yield Piece(info.child, "shaft", shaft, rgba, X_LS, is_on_top=True)
        X_LH = X_LM @ _along(axis, length) @ flip
        yield Piece(info.child, "head", head, rgba, X_LH, is_on_top=True)


# In the order in which they are offered.
PIECES: dict[str, Callable[[DrawnRobot], Iterator[Piece]]] = {
    "frames": frame_pieces,
    "collision": collision_pieces,
    "inertia": inertia_pieces,
    "joint_axes": axis_pieces,
}


def equivalent_ellipsoid(
    inertia: SpatialInertia,
) -> tuple[Array, RigidTransform] | None:
    """Return the solid ellipsoid of uniform density with a body's mass and inertia.

    An inertia that no body has is shown as a sphere of that mass and of the density of
    water, so that it is seen where the mass is.
    """
    mass, center = inertia.get_mass(), inertia.get_com()
    if not (0.0 < mass < np.inf and np.isfinite(center).all()):
        return None
    if inertia.IsPhysicallyValid():
        found = inertia.CalcPrincipalSemiDiametersAndPoseForSolidEllipsoid()
        return np.asarray(found[0]), found[1]
    radius = (mass / (DENSITY * 4.0 / 3.0 * np.pi)) ** (1.0 / 3.0)
    return np.full(3, radius), RigidTransform(center)


def _lengths(robot: DrawnRobot) -> dict[str, float]:
    """Return the length of each link's triad [m]."""
    places = np.array([X_WL.translation() for X_WL in robot.link_poses.values()])
    distances = np.linalg.norm(places[:, None] - places, axis=2)
    distances[distances < _SAME_PLACE * robot.size] = np.inf
    lengths = np.clip(
        _OF_DISTANCE * distances.min(axis=1),
        _SHORTEST * robot.size,
        _LONGEST * robot.size,
    )
    return dict(zip(robot.link_poses, lengths.tolist(), strict=True))


def _along(axis: Array, distance: float) -> RigidTransform:
    """Return a pose at a distance along an axis, with its z along the axis."""
    return RigidTransform(
        RotationMatrix.MakeFromOneVector(axis, axis_index=2), distance * axis
    )


# What can be shown: "frames", "collision", "inertia", "joint_axes".
KINDS = tuple(PIECES)

VISUAL_PATH = "/drake/visual"


def show_visual(meshcat: Meshcat, is_shown: bool) -> None:
    """Show or hide what Drake draws of all models, their visual shapes."""
    meshcat.SetProperty(VISUAL_PATH, "visible", is_shown)


def path_below(root: str, *names: str) -> str:
    """Return a Meshcat path of names, in which a slash is no separator."""
    return "/".join([root, *(name.replace("/", "|") for name in names)])


class LinkDrawings:
    """Frames, collision shapes, inertia and joint axes, which move with links.

    Each kind is sent at its first `show`, below ``/drake/<kind>/<robot>/<link>``, and
    then only hidden and shown again. Meshcat wants all calls in the thread that made
    it.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        models: Mapping[str, ModelInstanceIndex],
        descriptions: Mapping[str, RobotDescription],
    ) -> None:
        """Create it; nothing is shown yet, and links are where they are by default."""
        self._meshcat = meshcat
        self._robots = {
            name: DrawnRobot(plant, scene_graph, model, descriptions[name])
            for name, model in models.items()
        }
        self._poses = {
            (name, link): X_WL
            for name, robot in self._robots.items()
            for link, X_WL in robot.link_poses.items()
        }
        # Of the kinds that were sent: paths by robot and link.
        self._paths: dict[str, dict[tuple[str, str], str]] = {}
        self._shown: set[str] = set()

    def show(self, kind: str, is_shown: bool = True) -> None:
        """Show or hide one of `KINDS`; raise InputError if it is none."""
        check_known("drawing", kind, KINDS)
        if is_shown == (kind in self._shown):
            return
        if not is_shown:
            self._shown.remove(kind)
            self._meshcat.SetProperty(f"/drake/{kind}", "visible", False)
            return
        self._shown.add(kind)
        if kind not in self._paths:
            self._draw(kind)
        for link, path in self._paths[kind].items():
            self._meshcat.SetTransform(path, self._poses[link])
        self._meshcat.SetProperty(f"/drake/{kind}", "visible", True)

    def update(
        self,
        poses: Mapping[str, Mapping[str, RigidTransform]],
        time: float | None = None,
    ) -> None:
        """Move the drawings along with the links, by their poses in the world.

        Only links that moved since the last call are sent, or all to a recording, at
        its `time` [s]. What is left out stays where it was, and what isn't drawn is
        ignored.
        """
        moved = []
        for robot, of_links in poses.items():
            for name, X_WL in of_links.items():
                link = (robot, name)
                known = self._poses.get(link)
                if known is None:
                    continue
                # Between pictures of a recording, Meshcat interpolates.
                if time is not None or not known.IsExactlyEqualTo(X_WL):
                    # Drake may compute the next pose in the same place.
                    self._poses[link] = RigidTransform(X_WL)
                    moved.append(link)
        for kind in self._shown:
            paths = self._paths[kind]
            for link in moved:
                if link in paths:
                    self._meshcat.SetTransform(paths[link], self._poses[link], time)

    def frame_paths(self) -> dict[str, str]:
        """Return the names of all links by the Meshcat paths of their frames.

        The paths exist once the frames have been shown.
        """
        return {
            path_below("/drake/frames", robot, link): link
            for robot, link in self._poses
        }

    def clear(self) -> None:
        """Delete everything; as after the creation, nothing is shown."""
        for kind in self._paths:
            self._meshcat.Delete(f"/drake/{kind}")
        self._paths.clear()
        self._shown.clear()

    def _draw(self, kind: str) -> None:
        paths = self._paths[kind] = {}
        for name, robot in self._robots.items():
            for piece in PIECES[kind](robot):
                path = path_below(f"/drake/{kind}", name, piece.link)
                paths[name, piece.link] = path
                _draw_piece(self._meshcat, path, piece)
