"""The robot in the browser, in Drake's Meshcat."""

import dataclasses as dc
import ipaddress
import socket
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import (
    Box,
    InMemoryMesh,
    Mesh,
    Meshcat,
    MeshcatParams,
    QueryObject,
    Rgba,
    Role,
)
from pydrake.math import RigidTransform

from arm_drake.arrays import Array
from arm_drake.description.meshes.surfaces import Surface, encode_gltf
from arm_drake.errors import InputError
from arm_drake.importing import dataclass
from arm_drake.plant.contact import box_corners
from arm_drake.worlds.sdf_models import GroundLook

# Where a robot is looked at from: in front of it, to its right, above it.
THREE_QUARTER = (0.8, -1.0, 0.45)

# A camera comes no closer to the only point that it sees [m].
_SMALLEST_DISTANCE = 1e-3


@dataclass(frozen=True)
class Camera:
    """Position of a camera, and the middle of its picture, z up [m]."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]

    @property
    def distance(self) -> float:
        """From the camera to the middle [m]."""
        return float(np.linalg.norm(np.subtract(self.target, self.eye)))


@dataclass(frozen=True)
class View:
    """View of a camera on something; its position follows from that."""

    # Vertical field of view [rad].
    field_of_view: float

    # Width of the picture over its height.
    aspect: float

    # Share of the width, and of the height, that stays free on each side.
    margin: float = 0.06

    # From the middle of the picture to the camera, any length; not vertical.
    direction: tuple[float, float, float] = THREE_QUARTER

    def normals(self) -> Array:
        """Return the outward normals of what the camera sees, shape (6, 3).

        These are right, left, top, bottom, back, front. What the camera sees of a set
        of points depends on nothing but its farthest points in these directions.
        """
        right, up, forward = self._axes()
        across, along = self._slopes()
        return np.stack(
            [
                right - across * forward,
                -right - across * forward,
                up - along * forward,
                -up - along * forward,
                forward,
                -forward,
            ]
        )

    def camera_for(self, points: Array) -> Camera:
        """Return the closest camera that sees all points [m], with the margin.

        There is at least one point in the world, shape (n, 3).
        """
        right, up, forward = self._axes()
        # The camera lies in each side of its own pyramid, and the points inside.
        to_right, to_left, to_top, to_bottom, back, front = (
            self.normals() @ points.T
        ).max(axis=1)
        across, along = self._slopes()
        depth = min(
            -(to_right + to_left) / (2.0 * across),
            -(to_top + to_bottom) / (2.0 * along),
            -front - _SMALLEST_DISTANCE,
        )
        eye = (
            right * (to_right - to_left) / 2.0
            + up * (to_top - to_bottom) / 2.0
            + forward * depth
        )
        target = eye + forward * ((back - front) / 2.0 - depth)
        return Camera(_triple(eye), _triple(target))

    def _axes(self) -> Array:
        """Return the directions right, up and forward of the picture, shape (3, 3)."""
        forward = -np.array(self.direction) / np.linalg.norm(self.direction)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(right, forward), forward])

    def _slopes(self) -> tuple[float, float]:
        """Return how fast what is to be filled widens with the depth."""
        along = float(np.tan(self.field_of_view / 2.0)) * (1.0 - 2.0 * self.margin)
        return along * self.aspect, along


def _triple(vector: Array) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return (x, y, z)


# Ports that Meshcat takes, and names of addresses.
_FIRST_PORT, _LAST_PORT = 1024, 65535
_HOSTS = ("localhost", "*")

# How Meshcat's camera looks at a robot; pages are seldom higher than wide.
_VIEW = View(field_of_view=np.deg2rad(75.0), aspect=1.0, margin=0.15)

# Distance of the camera in diameters of the robot: for Meshcat's field of view of 75°,
# a sphere around the robot then takes two thirds of the height of the page.
_VIEW_DISTANCE = 1.1

# A robot is framed as if it were at least this large [m]: its points may all be close
# together where its shapes are not.
_SMALLEST_DIAMETER = 0.3

_CAMERA = "/Cameras/default/rotated/<object>"
_GRID, _AXES = "/Grid", "/Axes"

# How far the camera has gone with a link.
_FOLLOWED = "/Followed"

# The page's own camera draws nothing nearer than that [m]; what share of the distance
# that is for a small robot; and the nearest at all.
_NEAR = 0.01
_NEAR_SHARE = 0.02
_NEAREST = 1e-5

# Ways that a robot may move.
_SIDES = ((0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))

# A small robot is longer than so many of the ground's finer cells.
_CELLS = 20.0

# The ground: half its length, of the lines that are 1 m apart, and of those that are
# 0.1 m apart; the lines' widths; how far its surface is below them [m]. All of it is
# ten, a hundred... times smaller for small robots.
_GROUND, _NEAR_GROUND = 10.0, 2.0
_WIDE, _NARROW = 0.006, 0.003
_BELOW = 0.002
_SURFACE = Rgba(0.68, 0.69, 0.71)
_METRES, _DECIMETRES = Rgba(0.42, 0.44, 0.47), Rgba(0.57, 0.58, 0.60)
_GROUND_PATH = f"{_GRID}/ground"
_PLANE = f"{_GROUND_PATH}/plane"

# The world's axes: their length, their width [m].
_AXIS, _AXIS_WIDTH = 0.5, 0.004
_AXIS_COLORS = {
    "x": Rgba(0.85, 0.1, 0.1),
    "y": Rgba(0.1, 0.6, 0.1),
    "z": Rgba(0.1, 0.2, 0.9),
}

# The ground of a world that says how its own looks: as large as that says.
_OWN_GROUND = "/Ground"
_OWN_PLANE = f"{_OWN_GROUND}/plane"

# Where robots reach so far below the ground, parts of their size, only lines are drawn.
_SUNK = 0.02

# The light that casts shadows: where it comes from [m], how bright it is, and how sharp
# its shadows are [pixels]. Meshcat draws them within 5 m around the origin.
_SUN = "/Lights/FillLight/<object>"
_SUN_POSITION = (3.0, -2.0, 8.0)
_SUN_INTENSITY = 1.4
_SHADOW_MAP = 2048.0


def start_meshcat(*, host: str = "localhost", port: int | None = None) -> Meshcat:
    """Start a Meshcat server and return it; its page is at `web_url()`.

    It stays as long as a diagram that draws on it, which may be for ever: call it once
    in a notebook, or use `view`, `simulate` and `animate`, which leave none behind.

    Args:
        host: Address to listen on; "localhost" is seen from this machine only.
        port: Port to listen on, 0 for any free one; by default the first free one from
            7000 on.

    Raises:
        InputError: If the server can't listen there.
    """
    place = host if port is None else f"{host}:{port}"
    if port and not _FIRST_PORT <= port <= _LAST_PORT:
        text = f"expected {_FIRST_PORT} to {_LAST_PORT}, or 0 for any free one"
        raise InputError(f"port {port}: {text}")
    if host not in _HOSTS:
        try:
            ipaddress.ip_address(host)
            with socket.create_server((host, 0)):
                pass
        except (ValueError, OSError):
            raise InputError(
                f"host {host!r}: expected localhost, * (all addresses) or an address "
                "of this machine"
            ) from None
    try:
        return Meshcat(MeshcatParams(host=host, port=port))
    # Drake's own checks end in a SystemExit.
    except (RuntimeError, SystemExit) as error:
        raise InputError(
            f"Meshcat can't listen on {place}: {' '.join(str(error).split())}"
        ) from None


def place_camera(meshcat: Meshcat, eye: Array, target: Array) -> None:
    """Put the camera somewhere, and let it look at something [m]."""
    meshcat.Delete(_FOLLOWED)
    meshcat.SetCameraPose(eye, target)


def move_camera(meshcat: Meshcat, way: Array) -> None:
    """Move the camera of pages by a way in the world since it was placed [m].

    Somebody may have turned it meanwhile. Pages know what this path is for.
    """
    meshcat.SetTransform(_FOLLOWED, RigidTransform(np.asarray(way, float)))


def has_moved_camera(meshcat: Meshcat) -> bool:
    """Return whether the camera was moved, if by nothing, since it was placed."""
    return bool(meshcat.HasPath(_FOLLOWED))


def frame_points(
    meshcat: Meshcat,
    points: Sequence[np.ndarray],
    direction: tuple[float, float, float] = THREE_QUARTER,
) -> None:
    """Point the camera so that it sees all of some points."""
    lower, upper = np.min(points, axis=0), np.max(points, axis=0)
    centre = (lower + upper) / 2.0
    diameter = max(float(np.linalg.norm(upper - lower)), _SMALLEST_DIAMETER)
    along = np.array(direction) / np.linalg.norm(direction)
    eye = centre + _VIEW_DISTANCE * diameter * along
    _look(meshcat, eye, centre, diameter)


def frame_shapes(
    meshcat: Meshcat,
    query: QueryObject,
    *,
    models: Collection[str] | None = None,
    room: float = 0.0,
    direction: tuple[float, float, float] = THREE_QUARTER,
) -> float:
    """Point the camera so that it sees all that is drawn of a scene, or of robots.

    Return how far that reaches below the ground, by more than a fiftieth of its size
    [m], else 0.

    Robots without shapes are framed by their links' origins. The ground's lines are
    closer for what is much smaller than they are, and its surface goes where a robot
    reaches below it. `models` are the model instances that count,
    by default all: a house around a robot would be all that is seen of it. They may
    move sideways by `room`, in parts of their diameter.
    """
    inspector = query.inspector()
    corners, origins, lowest = [], [], [np.inf]
    for frame in inspector.GetAllFrameIds():
        if models is not None and _model(inspector.GetName(frame)) not in models:
            continue
        if frame != inspector.world_frame_id():
            origins.append(query.GetPoseInWorld(frame).translation())
        for geometry in inspector.GetGeometries(frame, Role.kIllustration):
            box = inspector.GetObbInGeometryFrame(geometry)
            if box is not None:
                X_WG = query.GetPoseInWorld(geometry)
                corners.append(X_WG.multiply(box_corners(box).T).T)
                X_WB = X_WG @ box.pose()
                # Of the ellipsoid in the box: a wheel's box stands on its edge.
                down = X_WB.rotation().matrix()[2] * box.half_width()
                lowest.append(X_WB.translation()[2] - np.linalg.norm(down))
    if corners:
        points = np.concatenate(corners)
        diameter = float(np.linalg.norm(np.ptp(points, axis=0)))
        sideways = room * diameter * np.array(_SIDES)
        view = dc.replace(_VIEW, direction=direction)
        camera = view.camera_for((points + sideways[:, None, :]).reshape(-1, 3))
        _look(meshcat, np.array(camera.eye), np.array(camera.target), diameter)
        depth = -float(min(lowest))
        is_sunk = depth > max(_SUNK * diameter, 2.0 * _BELOW)
        for path in (_PLANE, _OWN_PLANE):
            meshcat.SetProperty(path, "visible", not is_sunk)
        return depth if is_sunk else 0.0
    if origins:
        frame_points(meshcat, origins, direction)
    return 0.0


def _model(frame: str) -> str:
    """Return the model instance of a frame's name, such as "arm::link1"."""
    return frame.rpartition("::")[0]


def _look(
    meshcat: Meshcat, eye: np.ndarray, target: np.ndarray, diameter: float
) -> None:
    """Point the camera at something of a diameter [m]."""
    place_camera(meshcat, eye, target)
    distance = float(np.linalg.norm(eye - target))
    # Nearer than that nothing is drawn: whoever looks at a small robot comes closer.
    near = min(_NEAR, max(_NEAR_SHARE * distance, _NEAREST))
    meshcat.SetProperty(_CAMERA, "near", near)
    scale = min(grid_scale(diameter), 1.0)
    for path in (_GRID, _AXES):
        meshcat.SetTransform(path, np.diag([scale, scale, scale, 1.0]))
    meshcat.SetTransform(_OWN_GROUND, np.diag([1.0, 1.0, scale, 1.0]))


def grid_scale(diameter: float) -> float:
    """Return how far the ground's lines are apart for what is so large [m]."""
    cell = max(diameter, _NEAREST) / _CELLS
    return float(10.0 ** np.ceil(np.log10(10.0 * cell) - 1e-9))


def show_ground(
    meshcat: Meshcat, *, has_lines: bool = True, look: GroundLook | None = None
) -> None:
    """Draw the plane z = 0 with lines 1 m and 0.1 m apart, axes, a sun with shadows.

    Lines and plane are below `/Grid`, in the place of Meshcat's own grid, and as
    visible; axes are below `/Axes`, in the place of Meshcat's own, which are a pixel
    wide. A world's own `look` takes the plane's place; without lines there is no other.
    """
    if has_lines:
        meshcat.SetProperty(f"{_GRID}/<object>", "visible", False)
        _show_lines(meshcat)
        if look is None:
            plane = Box(2.0 * _GROUND, 2.0 * _GROUND, _BELOW)
            meshcat.SetObject(_PLANE, plane, _SURFACE)
            meshcat.SetTransform(_PLANE, RigidTransform([0.0, 0.0, -1.5 * _BELOW]))
    if look is not None:
        color = _SURFACE if look.color is None else Rgba(*look.color)
        top = look.X_WG @ RigidTransform([0.0, 0.0, -_BELOW])
        if look.texture is None:
            meshcat.SetObject(_OWN_PLANE, Box(*look.size, _BELOW), color)
            top = top @ RigidTransform([0.0, 0.0, -_BELOW / 2.0])
        else:
            meshcat.SetObject(_OWN_PLANE, _textured(look.size, look.texture), color)
        meshcat.SetTransform(_OWN_PLANE, top)
    _show_axes(meshcat)
    _show_sun(meshcat)


def set_ground_visible(meshcat: Meshcat, *, is_visible: bool) -> None:
    """Show the ground's surface and lines, or don't."""
    for path in (_GROUND_PATH, _OWN_GROUND):
        meshcat.SetProperty(path, "visible", is_visible)


def _textured(size: tuple[float, float], texture: Path) -> Mesh:
    """Return a rectangle on the plane z = 0 that a picture covers once."""
    x, y = size[0] / 2.0, size[1] / 2.0
    try:
        picture = texture.read_bytes()
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror}", file=texture) from None
    rectangle = Surface(
        np.array([(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)]),
        np.array([(0, 1, 2), (0, 2, 3)]),
        normals=np.tile([0.0, 0.0, 1.0], (4, 1)),
        uv=np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]),
        texture=picture,
    )
    content = encode_gltf([rectangle], (1.0, 1.0, 1.0, 1.0)).decode()
    file = MemoryFile(content, ".gltf", texture.name)
    return Mesh(mesh_data=InMemoryMesh(mesh_file=file), scale=1.0)


def _show_lines(meshcat: Meshcat) -> None:
    for name, color, step, length, width, height in (
        ("decimetres", _DECIMETRES, 0.1, _NEAR_GROUND, _NARROW, -0.3 * _BELOW),
        ("metres", _METRES, 1.0, _GROUND, _WIDE, -0.1 * _BELOW),
    ):
        vertices, faces = _stripes(step, length, width, height)
        meshcat.SetTriangleMesh(f"{_GRID}/{name}", vertices, faces, color)


def _show_axes(meshcat: Meshcat) -> None:
    meshcat.SetProperty(f"{_AXES}/<object>", "visible", False)
    for (name, color), along in zip(_AXIS_COLORS.items(), np.eye(3), strict=True):
        path = f"{_AXES}/{name}"
        meshcat.SetObject(
            path, Box(*(_AXIS_WIDTH + (_AXIS - _AXIS_WIDTH) * along)), color
        )
        meshcat.SetTransform(path, RigidTransform(_AXIS / 2.0 * along))


def _show_sun(meshcat: Meshcat) -> None:
    """Let a light from above cast shadows."""
    # Once a page has drawn shadows, their map can't change its size: all the ground
    # would be dark. So a page must hear of it before `castShadow`. When it connects it
    # is told of a path before what is below, and of one path's properties by name.
    for side in ("width", "height"):
        size = f"children.0.shadow.mapSize.{side}"
        meshcat.SetProperty(_SUN.removesuffix("/<object>"), size, _SHADOW_MAP)
    meshcat.SetProperty(_SUN, "position", list(_SUN_POSITION))
    meshcat.SetProperty(_SUN, "intensity", _SUN_INTENSITY)
    meshcat.SetProperty(_SUN, "shadow.bias", -0.0005)
    meshcat.SetProperty(_SUN, "castShadow", True)


def _stripes(
    step: float, length: float, width: float, height: float
) -> tuple[Array, Array]:
    """Return vertices, shape (3, n), and faces of stripes on a plane, both ways."""
    count, half = round(length / step), width / 2.0
    at = step * np.arange(-count, count + 1)
    ends = [(c - half, c + half, -length, length) for c in at]
    ends += [(-length, length, c - half, c + half) for c in at]
    corners = [
        (x, y, height)
        for a, b, c, d in ends
        for x, y in ((a, c), (b, c), (b, d), (a, d))
    ]
    first = 4 * np.arange(len(ends))[:, None, None]
    faces = first + np.array([[0, 1, 2], [0, 2, 3]])
    return np.array(corners).T, faces.reshape(-1, 3).T
