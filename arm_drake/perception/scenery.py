"""Scenery of cameras: the shapes of a diagram, lights, and Drake's renderer.

The shapes are copied out of the diagram's scene graph into one of their own when the
first picture is taken: who reads no picture pays for none, and several cameras share
what was loaded. A picture depends on the poses of that moment alone.
"""

import ctypes
import dataclasses as dc
import functools
import gc
import itertools
import math
import sys
import threading
import weakref
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import (
    Box,
    Capsule,
    ColorRenderCamera,
    Cylinder,
    DepthRenderCamera,
    Ellipsoid,
    FrameId,
    FramePoseVector,
    GeometryFrame,
    GeometryId,
    GeometryInstance,
    HalfSpace,
    InMemoryMesh,
    LightParameter,
    MakeRenderEngineVtk,
    Mesh,
    PerceptionProperties,
    QueryObject,
    RenderEngineVtkParams,
    RenderLabel,
    Rgba,
    Role,
    SceneGraph,
    SceneGraphInspector,
    Shape,
    SourceId,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from arm_drake.arrays import Array
from arm_drake.description.meshes.surfaces import (
    Surface,
    decode_gltf,
    encode_gltf,
    join,
    move,
    to_linear,
)
from arm_drake.errors import ArmDrakeError
from arm_drake.worlds.lights import DAYLIGHT, Light

RENDERER: Final = "arm_drake"

# Library that Drake's renderer opens on Linux.
_EGL: Final = "libEGL.so.1"

# EGL_PLATFORM_DEVICE_EXT, and of how many devices it is asked.
_PLATFORM_DEVICE: Final = 0x313F
_MOST_DEVICES: Final = 64

# Side of the square in which shadows are computed [pixels].
_SHADOW_SIZE: Final = 1024

# A matt material of the renderer shines with this part of the light that it gets.
_BRIGHTNESS: Final = math.pi

# Sides of what stands for a circle: of a radius of 1 m it is 0.5 mm off at most.
_SIDES: Final = 96

# Half of the side of the square that stands for a plane without an end [m].
_HORIZON: Final = 1000.0

# Corners of a box by x, then y, then z.
_BOX_FACES: Final = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)

# Label of what is nothing: sky.
NOTHING: Final = 0

_WHITE: Final = (1.0, 1.0, 1.0, 1.0)

# Colour of what has none.
_GRAY: Final = Rgba(0.7, 0.7, 0.7)

# Shapes that are drawn as meshes, and the property of those that have a texture.
_SOLIDS: Final = (Box, Capsule, Cylinder, Ellipsoid, Sphere)
_TEXTURE: Final = ("phong", "diffuse_map")

# Colour behind everything where the world names none.
SKY: Final = (0.7, 0.7, 0.7)


class _Loaded(NamedTuple):
    """The copy of a scene."""

    scene_graph: SceneGraph
    context: Context
    source: SourceId

    # Of each frame of the diagram that anything hangs on: its place among all of them.
    frames: Sequence[tuple[int, FrameId]]


class Mark(NamedTuple):
    """A shape that is seen, and isn't in the diagram."""

    shape: Shape

    # In the world.
    pose: RigidTransform
    color: Rgba


class Scenery:
    """The shapes of a diagram, as cameras see them."""

    def __init__(
        self, lights: Sequence[Light] | None, background: Sequence[float] | None
    ) -> None:
        """Remember what is needed; nothing is loaded yet."""
        self._lights = DAYLIGHT if lights is None else lights
        self._background = background
        # By whether it is labelled.
        self._loaded: dict[bool, _Loaded] = {}
        self._marks: list[GeometryId] = []

        # Place of each frame of the diagram by name.
        self._places: dict[str, int] = {}

        # What lidars cast their rays at, by the role of the shapes.
        self.ray_scenes: dict[Role, Any] = {}

        # Names of what labels mean, the first one of nothing.
        self.label_names: list[str] = ["nothing"]

    @property
    def is_loaded(self) -> bool:
        """Whether a picture was taken."""
        return bool(self._loaded)

    def look(self, query: QueryObject, *, is_labelled: bool = False) -> QueryObject:
        """Return what renders the scene as it is now, by frames of its own.

        Only the one that is labelled can tell shapes of a frame from each other.
        """
        loaded = self._load(query, is_labelled=is_labelled)
        everywhere = query.inspector().GetAllFrameIds()
        poses = FramePoseVector()
        for place, frame in loaded.frames:
            poses.set_value(frame, query.GetPoseInWorld(everywhere[place]))
        port = loaded.scene_graph.get_source_pose_port(loaded.source)
        port.FixValue(loaded.context, poses)
        output = loaded.scene_graph.get_query_output_port()
        found: QueryObject = output.Eval(loaded.context)
        return found

    def mark(self, query: QueryObject, marks: Sequence[Mark]) -> None:
        """Show marks, in place of those of before."""
        loaded = self._load(query)
        scene_graph, context = loaded.scene_graph, loaded.context
        for old in self._marks:
            scene_graph.RemoveGeometry(context, loaded.source, old)
        self._marks.clear()
        for index, (shape, pose, color) in enumerate(marks):
            instance = GeometryInstance(pose, shape, f"mark_{index}")
            properties = PerceptionProperties()
            properties.AddProperty("phong", "diffuse", _to_linear(color))
            properties.AddProperty("label", "id", RenderLabel(self._label("mark")))
            instance.set_perception_properties(properties)
            world = scene_graph.world_frame_id()
            added = scene_graph.RegisterGeometry(
                context, loaded.source, world, instance
            )
            self._marks.append(added)

    def pose_of(self, query: QueryObject, frame: str) -> RigidTransform:
        """Return the pose in the world of a frame, "<robot>::<link>" or "world"."""
        inspector = query.inspector()
        if frame == "world":
            return RigidTransform()
        frames = inspector.GetAllFrameIds()
        if not self._places:
            self._places = {inspector.GetName(f): i for i, f in enumerate(frames)}
        return RigidTransform(query.GetPoseInWorld(frames[self._places[frame]]))

    def color(
        self, query: QueryObject, camera: ColorRenderCamera, X_WC: RigidTransform
    ) -> Array:
        """Return a picture, shape (height, width, 3), uint8; z ahead, y down."""
        seen = self.look(query)
        picture = seen.RenderColorImage(camera, _world(seen), X_WC)
        _let_go()
        return np.array(picture.data[..., :3])

    def depth(
        self, query: QueryObject, camera: DepthRenderCamera, X_WC: RigidTransform
    ) -> Array:
        """Return depths [m], shape (height, width), float32.

        What is drawn nearer than the camera can tell is -inf, farther +inf (REP 117).
        """
        seen = self.look(query)
        picture = seen.RenderDepthImage(camera, _world(seen), X_WC)
        _let_go()
        depths = np.array(picture.data[..., 0])
        depths[depths == 0.0] = -np.inf
        return depths

    def labels(
        self, query: QueryObject, camera: ColorRenderCamera, X_WC: RigidTransform
    ) -> Array:
        """Return what each pixel shows, shape (height, width), uint16.

        The numbers are those of `label_names`.
        """
        seen = self.look(query, is_labelled=True)
        picture = seen.RenderLabelImage(camera, _world(seen), X_WC)
        _let_go()
        labels = np.array(picture.data[..., 0])
        labels[(labels < 0) | (labels >= len(self.label_names))] = NOTHING
        return labels.astype(np.uint16)

    def _load(self, query: QueryObject, *, is_labelled: bool = False) -> _Loaded:
        """Return a copy of the scene, which is made once."""
        if is_labelled in self._loaded:
            return self._loaded[is_labelled]
        require_renderer()
        _forget_others(self)
        scene_graph = SceneGraph()
        scene_graph.AddRenderer(RENDERER, MakeRenderEngineVtk(self._parameters()))
        source = scene_graph.RegisterSource("seen")
        inspector = query.inspector()
        frames: list[tuple[int, FrameId]] = []
        for place, frame in enumerate(inspector.GetAllFrameIds()):
            name = inspector.GetName(frame)
            copies = self._copy(inspector, frame, name)
            if not copies:
                continue
            target = scene_graph.world_frame_id()
            if frame != inspector.world_frame_id():
                target = scene_graph.RegisterFrame(source, GeometryFrame(str(place)))
                frames.append((place, target))
            for copy in copies if is_labelled else _join(copies):
                scene_graph.RegisterGeometry(source, target, copy)
        context = scene_graph.CreateDefaultContext()
        self._loaded[is_labelled] = _Loaded(scene_graph, context, source, frames)
        return self._loaded[is_labelled]

    def _copy(
        self, inspector: SceneGraphInspector, frame: FrameId, name: str
    ) -> list[GeometryInstance]:
        """Return the shapes of a frame that can be seen, labelled."""
        copies = []
        is_world = frame == inspector.world_frame_id()
        for geometry in inspector.GetGeometries(frame, Role.kPerception):
            copy = inspector.CloneGeometryInstance(geometry)
            X_FG = RigidTransform(copy.pose())
            only_seen = GeometryInstance(X_FG, copy.shape(), copy.name())
            # What stands still hangs on the world, and is called by its model.
            owner = copy.name().rpartition("::")[0] or copy.name() if is_world else name
            properties = copy.mutable_perception_properties()
            label = RenderLabel(self._label(owner))
            properties.UpdateProperty("label", "id", label)
            if properties.HasProperty("phong", "diffuse"):
                color = _to_linear(properties.GetProperty("phong", "diffuse"))
                properties.UpdateProperty("phong", "diffuse", color)
            only_seen.set_perception_properties(properties)
            copies.append(only_seen)
        return copies

    def _label(self, owner: str) -> int:
        """Return the label of a thing, a new one if it has none."""
        if owner not in self.label_names:
            self.label_names.append(owner)
        return self.label_names.index(owner)

    def _parameters(self) -> RenderEngineVtkParams:
        background = SKY if self._background is None else self._background
        return RenderEngineVtkParams(
            backend="EGL" if sys.platform == "linux" else "",
            default_clear_color=np.array(background),
            default_diffuse=np.array(_to_linear(_GRAY).rgba),
            lights=[_make_light(light) for light in self._lights],
            cast_shadows=any(light.cast_shadows for light in self._lights),
            shadow_map_size=_SHADOW_SIZE,
            # Else its materials would depend on whether a mesh has physical ones.
            force_to_pbr=True,
        )


# Those of which pictures were taken.
_looked_at: "weakref.WeakSet[Scenery]" = weakref.WeakSet()


def _forget_others(scenery: Scenery) -> None:
    """Let go what was seen of simulations that nobody has any more.

    A diagram of Python's systems is a circle of references. Python looks for these as
    its objects grow in number, and a renderer is few objects, but 100 MB. In other
    threads than the main one they are left to Python: a Meshcat among what is let go
    ends the process where it isn't in the thread that made it.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if is_main and any(other is not scenery for other in _looked_at):
        gc.collect()
    _looked_at.add(scenery)


def _to_linear(color: Rgba) -> Rgba:
    """Return a colour as physical materials take it, as those of glTF files are."""
    return Rgba(*to_linear((color.r(), color.g(), color.b(), color.a())))


def _join(copies: Sequence[GeometryInstance]) -> list[GeometryInstance]:
    """Return the shapes of a frame, with one mesh in place of many.

    A picture takes time for each mesh and each of its materials, several times as long
    with shadows. What is seen through is one mesh more, and its parts have materials of
    their own. Meshes with textures stay as they are, as do those of others. Shapes
    become meshes, too: the renderer would have them shine, whatever their colour is.
    """
    rest: list[GeometryInstance] = []
    surfaces: list[Surface] = []
    for copy in copies:
        found = _read(copy)
        if not found:
            rest.append(copy)
            continue
        matrix = copy.pose().GetAsMatrix34()
        if isinstance(copy.shape(), Mesh):
            matrix = matrix @ np.diag([*copy.shape().scale3(), 1.0])
        surfaces += [move(surface, matrix) for surface in found]
    if len(surfaces) < 2 and all(isinstance(c.shape(), Mesh) for c in copies):
        return list(copies)
    clear = [surface for surface in surfaces if not _is_opaque(surface)]
    opaque = [surface for surface in surfaces if _is_opaque(surface)]
    # Colours by vertex take a shader of their own.
    opaque = [join(opaque)] if len(opaque) > 1 else opaque
    joined = {"opaque": opaque, "clear": clear}
    made = [_to_gltf(parts, name) for name, parts in joined.items() if parts]
    return [*made, *rest]


def _to_gltf(surfaces: list[Surface], name: str) -> GeometryInstance:
    file = MemoryFile(encode_gltf(surfaces, _WHITE), ".gltf", name)
    mesh = Mesh(InMemoryMesh(mesh_file=file), 1.0)
    made = GeometryInstance(RigidTransform(), mesh, name)
    properties = PerceptionProperties()
    properties.AddProperty("label", "id", RenderLabel.kDontCare)
    made.set_perception_properties(properties)
    return made


def _read(copy: GeometryInstance) -> list[Surface]:
    """Return the surfaces of a shape if it can be taken apart."""
    shape, properties = copy.shape(), copy.perception_properties()
    if not isinstance(shape, Mesh):
        if not isinstance(shape, _SOLIDS) or properties.HasProperty(*_TEXTURE):
            return []
        color = properties.GetPropertyOrDefault("phong", "diffuse", _to_linear(_GRAY))
        rgba = (color.r(), color.g(), color.b(), color.a())
        return [dc.replace(make_surface(shape, _SIDES), color=rgba)]
    if min(shape.scale3()) <= 0.0:
        return []
    path = Path(str(shape.source().path()))
    surfaces = decode_gltf(path.read_bytes()) if path.suffix == ".gltf" else []
    return surfaces if all(surface.uv is None for surface in surfaces) else []


def make_surface(shape: Shape, sides: int) -> Surface:
    """Return the surface of a shape that has no file, circles with a number of sides.

    Of a shape that isn't known it is empty.
    """
    if isinstance(shape, HalfSpace):
        size = 2.0 * _HORIZON
        surface = make_surface(Box(size, size, size), sides)
        return dc.replace(surface, vertices=surface.vertices - [0.0, 0.0, _HORIZON])
    if isinstance(shape, Box):
        corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
        return Surface(corners * shape.size(), _BOX_FACES)
    if isinstance(shape, Cylinder):
        r, h = shape.radius(), shape.length() / 2.0
        rings = np.array([[0.0, -h], [r, -h], [r, h], [0.0, h]])
        normals = np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
        parts = [(rings[k : k + 2], normals[[k, k]]) for k in range(3)]
        return _revolve(parts, sides)
    angles = np.linspace(-np.pi / 2.0, np.pi / 2.0, sides // 4 * 2 + 2)
    ways = np.column_stack([np.cos(angles), np.sin(angles)])
    ways[[0, -1], 0] = 0.0
    if isinstance(shape, Sphere | Capsule):
        length = shape.length() if isinstance(shape, Capsule) else 0.0
        ends = np.sign(ways[:, 1]) * length / 2.0
        return _revolve(
            [(shape.radius() * ways + np.column_stack([0.0 * ends, ends]), ways)], sides
        )
    if isinstance(shape, Ellipsoid):
        ball, axes = _revolve([(ways, ways)], sides), [shape.a(), shape.b(), shape.c()]
        normals = ball.vertices / axes
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return Surface(ball.vertices * axes, ball.faces, normals=normals)
    return Surface(np.zeros((0, 3)), np.zeros((0, 3), int))


def _revolve(parts: Sequence[tuple[Array, Array]], sides: int) -> Surface:
    """Return what lines make that turn about the z axis, from below to above.

    Of each there are points, radii and heights, and the normals, shape (n, 2) both.
    """
    turns = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    around = np.column_stack([np.cos(turns), np.sin(turns)])
    vertices: list[Array] = []
    normals: list[Array] = []
    faces: list[Array] = []
    start = 0
    for points, ways in parts:
        for rows, found in ((points, vertices), (ways, normals)):
            ring = rows[:, None, :1] * around
            height = np.broadcast_to(rows[:, None, 1:], (*ring.shape[:2], 1))
            found.append(np.concatenate([ring, height], axis=2).reshape(-1, 3))
        k, n = np.mgrid[: len(points) - 1, :sides]
        a, b = start + k * sides + n, start + k * sides + (n + 1) % sides
        lower = np.stack([a, b, b + sides], axis=-1)[points[:-1, 0] > 0.0]
        upper = np.stack([a, b + sides, a + sides], axis=-1)[points[1:, 0] > 0.0]
        faces += [lower.reshape(-1, 3), upper.reshape(-1, 3)]
        start += len(points) * sides
    return Surface(
        np.concatenate(vertices),
        np.concatenate(faces),
        normals=np.concatenate(normals),
    )


def _is_opaque(surface: Surface) -> bool:
    colors = surface.vertex_colors
    is_clear = surface.color is not None and surface.color[3] < 1.0
    return not is_clear and (colors is None or colors[:, 3].min() >= 1.0)


def require_renderer() -> None:
    """Raise ArmDrakeError if the libraries that Drake's renderer opens are missing."""
    try:
        _egl()
    except OSError as error:
        raise ArmDrakeError(
            f"pictures of cameras need OpenGL by EGL: {error}; Debian and Ubuntu have "
            "what is needed in packages: apt-get install libegl1 libgl1-mesa-dri"
        ) from None


def _let_go() -> None:
    """Leave the renderer's contexts to other threads; each draws in one at a time."""
    egl = _egl()
    if egl is not None:
        egl.eglReleaseThread()


@functools.cache
def _egl() -> ctypes.CDLL | None:
    """Return the library that Drake's renderer opens on Linux, or raise OSError.

    Without a driver the renderer would end the process. What is initialised here it
    needn't initialise again.
    """
    if sys.platform != "linux":
        return None
    egl = ctypes.CDLL(_EGL)
    if not any(egl.eglInitialize(display, None, None) for display in _displays(egl)):
        raise OSError(f"{_EGL} has no driver that draws")
    return egl


def _displays(egl: ctypes.CDLL) -> Iterator[ctypes.c_void_p]:
    """Yield where the renderer may draw: on each device, or where EGL chooses to."""
    pointer, integer = ctypes.c_void_p, ctypes.c_int
    egl.eglGetProcAddress.restype = egl.eglGetDisplay.restype = pointer
    query, find = map(
        egl.eglGetProcAddress, (b"eglQueryDevicesEXT", b"eglGetPlatformDisplayEXT")
    )
    if not query or not find:
        yield pointer(egl.eglGetDisplay(None))
        return
    array, count = (pointer * _MOST_DEVICES)(), integer()
    kind = ctypes.CFUNCTYPE(integer, integer, pointer, pointer)
    kind(query)(_MOST_DEVICES, array, ctypes.byref(count))
    make = ctypes.CFUNCTYPE(pointer, integer, pointer, pointer)(find)
    for device in array[: count.value]:
        yield pointer(make(_PLATFORM_DEVICE, device, None))


def _make_light(light: Light) -> LightParameter:
    return LightParameter(
        type=light.type,
        color=Rgba(*light.color),
        attenuation_values=np.array(light.attenuation),
        position=np.array(light.position),
        frame=light.frame,
        intensity=_BRIGHTNESS * light.intensity,
        direction=np.array(light.direction),
        cone_angle=light.cone_angle,
    )


def _world(query: QueryObject) -> FrameId:
    return query.inspector().world_frame_id()
