"""Pictures of a Meshcat page, and where a camera sees points in them."""

import dataclasses as dc
import io
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import (
    Browser,
    BrowserContext,
    Locator,
    Page,
    ViewportSize,
    expect,
)

from tests.waiting import PATIENCE

VIEWPORT = ViewportSize(width=640, height=640)

# Vertical field of view of the camera, the default of Drake's
# Meshcat.PerspectiveCamera [rad].
_FIELD_OF_VIEW = np.deg2rad(75.0)

# Two pixels differ if a channel does by more than this, out of 255.
_VISIBLE_DIFFERENCE = 8

# Shape (height, width, 3), 0 to 255.
Picture = NDArray[np.int16]

# Whether each pixel belongs to something, shape (height, width).
Mask = NDArray[np.bool_]


# Pages are drawn on the processor: shadows and smooth edges, which test_screenshot.py
# looks at, take two thirds of its time; what moves takes all of the rest, if there is
# no pause between pictures [ms].
_PAUSE = 60

_DRAW_LITTLE = f"""
    const {{getContext}} = HTMLCanvasElement.prototype;
    HTMLCanvasElement.prototype.getContext = function (kind, options) {{
        return getContext.call(this, kind, options && {{...options, antialias: false}});
    }};
    const {{defineProperty}} = Object;
    // Where others look at the viewer as it is set, too, as recordings do.
    Object.defineProperty = (on, name, how) => defineProperty(on, name,
        on !== window || name !== "viewer" ? how : {{
            ...how,
            set: (viewer) => {{
                viewer.renderer.shadowMap.enabled = false;
                how.set(viewer);
            }},
        }});
    let viewer_of_page;
    Object.defineProperty(window, "viewer", {{
        get: () => viewer_of_page,
        set: (viewer) => {{ viewer_of_page = viewer; }},
        configurable: true,
    }});
    const draw_next = window.requestAnimationFrame.bind(window);
    window.requestAnimationFrame = (draw) =>
        window.setTimeout(() => draw_next(draw), {_PAUSE});
    window.cancelAnimationFrame = window.clearTimeout.bind(window);
"""


def new_context(browser: Browser, **options: Any) -> BrowserContext:
    """Return a context whose pages draw little, and are waited for."""
    context = browser.new_context(**{"viewport": VIEWPORT, **options})
    context.set_default_timeout(1000.0 * PATIENCE)
    context.add_init_script(_DRAW_LITTLE)
    return context


@dc.dataclass(frozen=True)
class Camera:
    """Where a picture is taken from; z is up in it."""

    # Position, and what is in the middle of the picture, in the world [m].
    eye: tuple[float, float, float]
    target: tuple[float, float, float]

    def project(self, points: NDArray[np.float64]) -> NDArray[np.int_]:
        """Return the pixels, column and row, of points in the world [m]."""
        eye, target = np.array(self.eye), np.array(self.target)
        forward = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        x, y, depth = np.stack([right, down, forward]) @ (points - eye).T
        centre = np.array([VIEWPORT["width"], VIEWPORT["height"]]) / 2.0
        focal_length = centre[1] / np.tan(_FIELD_OF_VIEW / 2.0)
        pixels = centre + focal_length * np.stack([x, y], axis=1) / depth[:, None]
        return np.floor(pixels).astype(int)


def wait_until_drawn(page: Page, meshes: int, camera: Camera | None = None) -> None:
    """Wait until a Meshcat page has its robot, and its camera is in place.

    Args:
        page: Meshcat's page.
        meshes: How many meshes the robot has.
        camera: Where the page's camera is to be, if that is known.
    """
    page.wait_for_function(
        """(meshes) => {
            let count = 0;
            viewer.scene_tree.find(["drake", "visual"]).object.traverse(
                (object) => { count += object.isMesh ? 1 : 0; });
            return count === meshes;
        }""",
        arg=meshes,
        timeout=1000.0 * PATIENCE,
    )
    if camera is not None:
        page.wait_for_function(
            """([eye, target]) => {
                // The page's own y is up.
                const is_at = (p, place) =>
                    Math.hypot(p.x - place[0], p.y - place[2], p.z + place[1]) < 1e-6;
                return is_at(viewer.controls.target, target)
                    && is_at(viewer.camera.position, eye);
            }""",
            arg=[camera.eye, camera.target],
            timeout=1000.0 * PATIENCE,
        )


def hide_robot(page: Page) -> None:
    """Make the robot invisible, in this page only."""
    page.evaluate(
        """() => {
            viewer.scene_tree.find(["drake", "visual"]).object.visible = false;
            viewer.set_dirty();
        }"""
    )


def paint_robot(page: Page, colour: tuple[float, float, float]) -> None:
    """Give all of the robot one colour, in this page only."""
    page.evaluate(
        """(colour) => {
            viewer.scene_tree.find(["drake", "visual"]).object.traverse((object) => {
                if (object.isMesh) object.material.color.setRGB(...colour);
            });
            viewer.set_dirty();
        }""",
        colour,
    )


def take_picture(page: Page) -> Picture:
    """Return a picture of the page, once it doesn't change any more."""
    deadline = time.monotonic() + PATIENCE
    previous = b""
    while time.monotonic() < deadline:
        page.wait_for_function("() => !viewer.needs_render")
        data = page.screenshot()
        if data == previous:
            image = Image.open(io.BytesIO(data)).convert("RGB")
            return np.asarray(image).astype(np.int16)
        previous = data
    raise AssertionError(f"the page still changes after {PATIENCE:g} s")


def bar_widget(page: Page, name: str) -> Locator:
    """Return a widget of the bar of a recording."""
    return page.locator(f'#bar [data-id="{name}"]')


def picture_at(page: Page, time: float) -> Picture:
    """Return a picture at a time of a recording, typed into its bar."""
    button = bar_widget(page, "play")
    expect(button).to_be_enabled()
    # At once: what has come to its end meanwhile would begin anew by a click.
    button.evaluate("(button) => { if (button.innerText === 'pause') button.click(); }")
    expect(button).to_have_text("play")
    field = bar_widget(page, "time").locator("input[type=number]")
    field.fill(str(time))
    field.press("Enter")
    return take_picture(page)


def difference(one: Picture, other: Picture) -> Mask:
    """Return which pixels differ visibly."""
    return np.abs(one - other).max(axis=2) > _VISIBLE_DIFFERENCE


def box_around(pixels: NDArray[np.int_]) -> tuple[slice, slice]:
    """Return the rows and columns of the smallest box around some pixels."""
    (left, top), (right, bottom) = pixels.min(axis=0), pixels.max(axis=0)
    return slice(top, bottom + 1), slice(left, right + 1)


def grow(mask: Mask, radius: int) -> Mask:
    """Return a mask with all pixels up to some columns and rows away."""
    padded = np.pad(mask, radius)
    windows = np.lib.stride_tricks.sliding_window_view(
        padded, (2 * radius + 1, 2 * radius + 1)
    )
    return windows.any(axis=(2, 3))
