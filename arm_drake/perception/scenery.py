"""What cameras look at: the shapes of a diagram, lights, and Drake's renderer.

The shapes are copied out of the diagram's scene graph into one of their own when the
first picture is taken: who reads no picture pays for none, and several cameras share
what was loaded. A picture depends on the poses of that moment alone.
"""

import ctypes
import functools
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import (
    ColorRenderCamera,
    DepthRenderCamera,
    FrameId,
    FramePoseVector,
    GeometryFrame,
    GeometryId,
    GeometryInstance,
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

# The renderer's physical materials reflect a part of the light to each side.
_BRIGHTNESS: Final = 2.6

# Label of what is nothing: sky.
NOTHING: Final = 0

_WHITE: Final = (1.0, 1.0, 1.0, 1.0)

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

        Raises:
            ArmDrakeError: If the renderer's libraries are missing.
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
        """Have marks seen, in place of those of before.

        Raises:
            ArmDrakeError: If the renderer's libraries are missing.
        """
        loaded = self._load(query)
        scene_graph, context = loaded.scene_graph, loaded.context
        for old in self._marks:
            scene_graph.RemoveGeometry(context, loaded.source, old)
        self._marks.clear()
        for index, (shape, pose, color) in enumerate(marks):
            instance = GeometryInstance(pose, shape, f"mark_{index}")
            properties = PerceptionProperties()
            properties.AddProperty("phong", "diffuse", color)
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

        What is nearer than the camera can tell is -inf, what is farther +inf (REP 117).
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
            default_diffuse=np.array([0.7, 0.7, 0.7, 1.0]),
            lights=[_make_light(light) for light in self._lights],
            cast_shadows=any(light.cast_shadows for light in self._lights),
            shadow_map_size=_SHADOW_SIZE,
            # Else its materials would depend on whether a mesh has physical ones.
            force_to_pbr=True,
        )


def _join(copies: Sequence[GeometryInstance]) -> list[GeometryInstance]:
    """Return the shapes of a frame, with one mesh in place of many.

    A picture takes time for each mesh and each of its materials, several times as long
    with shadows. What is seen through is one mesh more, and its parts have materials of
    their own. Meshes with textures stay as they are, as do those of others.
    """
    rest: list[GeometryInstance] = []
    surfaces: list[Surface] = []
    for copy in copies:
        found = _read(copy.shape())
        if not found:
            rest.append(copy)
            continue
        matrix = copy.pose().GetAsMatrix34()
        matrix = matrix @ np.diag([*copy.shape().scale3(), 1.0])
        surfaces += [move(surface, matrix) for surface in found]
    if len(surfaces) < 2:
        return list(copies)
    clear = [surface for surface in surfaces if not _is_opaque(surface)]
    opaque = [surface for surface in surfaces if _is_opaque(surface)]
    joined = {"opaque": [join(opaque)] if opaque else [], "clear": clear}
    made = [_make_mesh(parts, name) for name, parts in joined.items() if parts]
    return [*made, *rest]


def _make_mesh(surfaces: list[Surface], name: str) -> GeometryInstance:
    file = MemoryFile(encode_gltf(surfaces, _WHITE), ".gltf", name)
    mesh = Mesh(InMemoryMesh(mesh_file=file), 1.0)
    made = GeometryInstance(RigidTransform(), mesh, name)
    properties = PerceptionProperties()
    properties.AddProperty("label", "id", RenderLabel.kDontCare)
    made.set_perception_properties(properties)
    return made


def _read(shape: Shape) -> list[Surface]:
    """Return the surfaces of a mesh if it can be taken apart."""
    if not isinstance(shape, Mesh) or min(shape.scale3()) <= 0.0:
        return []
    path = Path(str(shape.source().path()))
    surfaces = decode_gltf(path.read_bytes()) if path.suffix == ".gltf" else []
    return surfaces if all(surface.uv is None for surface in surfaces) else []


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
