"""Messages of pictures and points as arrays, and as pictures that people look at."""

import functools
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from arm_drake.description.meshes.surfaces import linear
from arm_drake.errors import InputError
from arm_drake.messages import CompressedImage, Header, Image, PointCloud2, PointField
from arm_drake.output_files import writing

# Numbers of a pixel, and their type, by encoding of `sensor_msgs/Image`.
ENCODINGS: Final[Mapping[str, tuple[int, str]]] = {
    "rgb8": (3, "u1"),
    "bgr8": (3, "u1"),
    "mono8": (1, "u1"),
    "8UC1": (1, "u1"),
    "16UC1": (1, "<u2"),
    "32FC1": (1, "<f4"),
}

# Those of how bright pixels are.
_MONO: Final = ("mono8", "8UC1")

_LUMA: Final = np.array([0.299, 0.587, 0.114])

# From linear red, green and blue to CIE XYZ (IEC 61966-2-1).
_XYZ: Final = np.array(
    [[0.4124, 0.2126, 0.0193], [0.3576, 0.7152, 0.1192], [0.1805, 0.0722, 0.9505]]
)

# Darker and grayer colours label nothing: in L*, and in a* and b*.
_DARK: Final = 25.0
_GRAY: Final = 25.0

_POINT_FIELDS: Final = tuple(
    PointField(name, 4 * index) for index, name in enumerate(("x", "y", "z", "rgb"))
)

# Of lidars' clouds; a ring is a uint16.
_RAY_FIELDS: Final = (
    *_POINT_FIELDS[:3],
    PointField("intensity", 12),
    PointField("ring", 16, datatype=4),
)


def make_image(header: Header, pixels: NDArray[Any], encoding: str) -> Image:
    """Return a picture as a message.

    `pixels` are red, green and blue, shape (height, width, 3), uint8; or depths [m] or
    labels, shape (height, width).
    """
    if encoding == "bgr8":
        pixels = pixels[..., ::-1]
    elif encoding in _MONO:
        pixels = np.round(pixels @ _LUMA)
    elif encoding == "16UC1" and pixels.dtype != np.uint16:
        pixels = to_millimetres(pixels)
    count, kind = ENCODINGS[encoding]
    height, width = pixels.shape[:2]
    step = width * count * np.dtype(kind).itemsize
    data = np.ascontiguousarray(pixels, dtype=kind).tobytes()
    return Image(header, height, width, encoding, 0, step, data)


def to_array(image: Image) -> NDArray[Any]:
    """Return a picture's numbers, shape (height, width) or (height, width, 3).

    They are in its encoding's order and unit.

    Raises:
        InputError: If the encoding isn't one of `ENCODINGS`.
    """
    if image.encoding not in ENCODINGS:
        known = ", ".join(ENCODINGS)
        raise InputError(f"unknown encoding {image.encoding!r}; known: {known}")
    count, kind = ENCODINGS[image.encoding]
    pixels = np.frombuffer(image.data, kind)
    shape = (image.height, image.width, count)
    return pixels.reshape(shape if count > 1 else shape[:2])


def compress(image: Image, kind: str) -> CompressedImage:
    """Return a picture of 8 bits as a file, a "jpeg" or "png".

    Qualities and names of formats are those of compressed_image_transport.
    """
    from PIL import Image as Picture  # Large, and seldom wanted.

    is_mono = image.encoding in _MONO
    pixels, file = to_array(image) if is_mono else to_rgb(image), io.BytesIO()
    how = {"quality": 80} if kind == "jpeg" else {"compress_level": 3}
    Picture.fromarray(np.ascontiguousarray(pixels)).save(file, kind, **how)
    target = "" if is_mono else "bgr8"
    name = f"{image.encoding}; {kind} compressed {target}"
    return CompressedImage(image.header, name, file.getvalue())


def to_rgb(image: Image) -> NDArray[np.uint8]:
    """Return what to show of a picture, shape (height, width, 3).

    Depths are coloured from near, red, to far, blue; what can't be told is black.
    """
    pixels = to_array(image)
    if image.encoding == "bgr8":
        return pixels[..., ::-1]
    if pixels.ndim == 3:
        return pixels
    if image.encoding in _MONO:
        return np.repeat(pixels[..., None], 3, axis=2)
    if image.encoding == "16UC1":
        return color_depths(np.where(pixels, pixels / 1000.0, np.nan))
    return color_depths(pixels)


def color_depths(depths: NDArray[Any]) -> NDArray[np.uint8]:
    """Return colours of depths, by where they are between the nearest and farthest."""
    known = np.isfinite(depths)
    near, far = depth_range(depths)
    part = np.clip((depths - near) / max(far - near, 1e-9), 0.0, 1.0)
    rows = np.where(known, np.round(255.0 * np.where(known, part, 0.0)), 0.0)
    colors = _SCALE[rows.astype(int)]
    colors[~known] = 0
    return colors


def depth_range(depths: NDArray[Any]) -> tuple[float, float]:
    """Return the depths [m] that have the first and the last colour; 0 without any."""
    known = depths[np.isfinite(depths)]
    if not known.size:
        return 0.0, 0.0
    near, far = np.percentile(known, [1.0, 99.0])
    return float(near), float(far)


def color_labels(labels: NDArray[Any]) -> NDArray[np.uint8]:
    """Return a colour for each label, black for 0; the 256th has that of the first."""
    palette = _make_palette()
    names = np.arange(int(labels.max(initial=0)) + 1)
    colors = palette[(names - 1) % len(palette)]
    colors[0] = 0
    return colors[labels]


@functools.cache
def _make_palette() -> NDArray[np.uint8]:
    """Return 255 colours, shape (255, 3), the first of which differ most.

    Each is the one in a grid that is farthest from black, from white and from those
    before it, in CIE 1976 (L*, a*, b*); grays are left to what isn't labelled.
    """
    steps = np.linspace(0.0, 1.0, 9)
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)
    colors = np.vstack([[[0.0] * 3, [1.0] * 3], grid.reshape(-1, 3)])
    xyz = linear(colors) @ _XYZ / _XYZ.sum(axis=0)
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    x, y, z = f.T
    lab = np.column_stack([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])
    is_vivid = (lab[:, 0] > _DARK) & (np.hypot(lab[:, 1], lab[:, 2]) > _GRAY)
    away = np.linalg.norm(lab[:, None] - lab[:2], axis=2).min(axis=1)
    chosen = []
    for _ in range(255):
        chosen.append(int(np.where(is_vivid, away, -1.0).argmax()))
        away = np.minimum(away, np.linalg.norm(lab - lab[chosen[-1]], axis=1))
    return np.round(255.0 * colors[chosen]).astype(np.uint8)


def to_millimetres(depths: NDArray[Any]) -> NDArray[np.uint16]:
    """Return whole depths [mm], 0 where out of range, from depths [m]."""
    known = (depths > 0.0) & (depths <= 65.535)
    whole = np.where(known, depths, 0.0).astype(np.float64) / 0.001
    # As RealSense's plugin has them, which cuts off what is less.
    return np.minimum(whole, 65535.0).astype(np.uint16)


def project(
    depths: NDArray[Any], rays: tuple[NDArray[Any], NDArray[Any]]
) -> NDArray[np.float32]:
    """Return the points that a depth image shows, shape (height, width, 3) [m].

    They are in the optical frame, z ahead and y down; NaN where a depth can't be told.
    `rays` are x and y of where pixels look, at a depth of 1.
    """
    height, width = depths.shape
    z = np.where(np.isfinite(depths), depths, np.nan).astype(np.float32)
    points = np.empty((height, width, 3), np.float32)
    points[..., 0] = z * rays[0]
    points[..., 1] = z * rays[1]
    points[..., 2] = z
    return points


def make_cloud(
    header: Header, points: NDArray[Any], colors: NDArray[Any] | None
) -> PointCloud2:
    """Return points as a message.

    `points` have the shape (height, width, 3), `colors` too if there are any.
    """
    height, width = points.shape[:2]
    count = 3 if colors is None else 4
    numbers = np.empty((height, width, count), "<f4")
    numbers[..., :3] = points
    if colors is not None:
        red, green, blue = (colors[..., i].astype(np.uint32) for i in range(3))
        packed = (red << 16) | (green << 8) | blue
        numbers[..., 3] = packed.astype("<u4").view("<f4")
    return _pack(header, numbers, _POINT_FIELDS[:count])


def _pack(
    header: Header, numbers: NDArray[Any], fields: tuple[PointField, ...]
) -> PointCloud2:
    """Return points with their fields, shape (height, width, n), as a message."""
    height, width, count = numbers.shape
    is_dense = bool(np.isfinite(numbers[..., :3]).all())
    data, size = numbers.tobytes(), 4 * count
    return PointCloud2(
        header, height, width, fields, False, size, size * width, data, is_dense
    )


def make_ray_cloud(
    header: Header, points: NDArray[Any], *, has_rings: bool
) -> PointCloud2:
    """Return the points of rays, shape (rings, n, 3), as a message.

    The intensity is 0, as of Gazebo's lidars where nothing has a `<laser_retro>`.
    """
    height, width = points.shape[:2]
    fields = _RAY_FIELDS if has_rings else _RAY_FIELDS[:4]
    numbers = np.zeros((height, width, len(fields)), "<f4")
    numbers[..., :3] = points
    if has_rings:
        rings = np.arange(height, dtype="<u4").view("<f4")
        numbers[..., 4] = rings[:, None]
    return _pack(header, numbers, fields)


def to_points(cloud: PointCloud2) -> NDArray[np.float32]:
    """Return the points of a cloud, shape (height, width, 3) [m]."""
    numbers = np.frombuffer(cloud.data, "<f4").reshape(cloud.height, cloud.width, -1)
    return numbers[..., :3]


def to_colors(cloud: PointCloud2) -> NDArray[np.uint8] | None:
    """Return the colours of a cloud's points, shape (height, width, 3), if it has."""
    if "rgb" not in [field.name for field in cloud.fields]:
        return None
    numbers = np.frombuffer(cloud.data, "<u4").reshape(cloud.height, cloud.width, -1)
    packed = numbers[..., 3]
    shifts = np.array([16, 8, 0], np.uint32)
    return ((packed[..., None] >> shifts) & 255).astype(np.uint8)


def to_png(pixels: NDArray[np.uint8]) -> bytes:
    """Return red, green and blue, shape (height, width, 3), as a file."""
    from PIL import Image as Picture  # Large, and seldom wanted.

    file = io.BytesIO()
    Picture.fromarray(pixels).save(file, "png")
    return file.getvalue()


def save_image(pixels: NDArray[np.uint8], path: Path) -> None:
    """Write red, green and blue, shape (height, width, 3), to a file."""
    from PIL import Image as Picture  # Large, and seldom wanted.

    with writing(path):
        Picture.fromarray(pixels).save(path)


def _make_scale() -> NDArray[np.uint8]:
    """Return colours from red over yellow, green and cyan to blue, shape (256, 3)."""
    knots = np.linspace(0.0, 255.0, 5)
    channels = ([255, 255, 0, 0, 30], [30, 220, 200, 200, 60], [30, 0, 60, 255, 255])
    at = np.arange(256)
    columns = [np.interp(at, knots, channel) for channel in channels]
    return np.round(np.stack(columns, axis=1)).astype(np.uint8)


_SCALE: Final = _make_scale()
