"""Videos of a recorded Meshcat scene."""

import base64
import contextlib
import subprocess
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import wait
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np
from pydrake.geometry import Meshcat

from arm_drake.arrays import Array
from arm_drake.errors import InputError, MissingExtraError, OutputError
from arm_drake.importing import dataclass
from arm_drake.output_files import check_suffix, check_writable, writing
from arm_drake.visualization.meshcat import View
from arm_drake.visualization.screenshot import (
    FIELD_OF_VIEW,
    Photographer,
    find_extremes,
    set_up,
)

if TYPE_CHECKING:
    from playwright.sync_api import Page

VIDEO_SUFFIXES = (".mp4",)

# Pictures per second of simulated time.
FRAME_RATE = 30.0

# Width and height [pixels].
DEFAULT_SIZE = (960, 720)

# Works in the page.
_SCRIPT = Path(__file__).with_suffix(".js")

# H.264 that every browser plays. The pictures of the page have colours of the full
# range (JPEG), films of the limited one, told by BT.709.
_ENCODING = (
    *("-vf", "scale=in_range=full:out_range=tv:out_color_matrix=bt709,format=yuv420p"),
    *("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"),
    *("-c:v", "libx264", "-preset", "veryfast", "-crf", "18"),
    *("-movflags", "+faststart", "-f", "mp4"),
)


@dataclass(frozen=True)
class Film:
    """Number of pictures and duration of a film."""

    # How many pictures it has.
    frames: int

    # Simulated time that it shows [s].
    duration: float


def check_video_installed() -> None:
    """Raise MissingExtraError if the extra `video` isn't installed."""
    try:
        import imageio_ffmpeg  # type: ignore[import-untyped]  # noqa: F401
        import playwright.sync_api  # noqa: F401
    except ImportError:
        raise MissingExtraError("a film of the simulation", "video") from None


def save_video(
    meshcat: Meshcat,
    path: Path,
    *,
    size: tuple[int, int] = DEFAULT_SIZE,
    paths: Sequence[str] = ("drake/visual",),
    progress: Callable[[int, int], None] | None = None,
    photographer: Photographer | None = None,
) -> Film:
    """Write an MP4 film of the recording that a Meshcat scene has published.

    The camera stands still, where it sees all below `paths` from the first to the last
    moment. The file appears when it is complete; what is filmed until Ctrl-C is kept.
    `size` is in even numbers of pixels; `progress` hears how many pictures of how many
    are taken. It may raise MissingExtraError, BrowserError, InputError (nothing was
    recorded) and OutputError.
    """
    check_video_installed()
    check_suffix(path, "a film", VIDEO_SUFFIXES)
    if min(size) < 2 or any(length % 2 for length in size):
        raise InputError(
            f"size of a film: expected even numbers of pixels, 2 or more, got {size}"
        )
    check_writable(path)
    camera = _FrameRecorder(path, size, paths)
    with contextlib.ExitStack() as stack:
        if photographer is None:
            photographer = stack.enter_context(Photographer())
        task = photographer.begin(meshcat, camera.film, size)
        try:
            tell = progress or (lambda taken, total: None)
            return photographer.wait(
                meshcat, task, lambda: tell(camera.taken, camera.total)
            )
        except BaseException:
            camera.is_stopped.set()
            wait([task])
            raise


class _FrameRecorder:
    """Films in the browser's thread, and can be read from another one."""

    def __init__(
        self,
        path: Path,
        size: tuple[int, int],
        paths: Sequence[str],
    ) -> None:
        self.is_stopped = threading.Event()
        # Pictures so far, and in the end.
        self.taken = 0
        self.total = 0
        self._path = path
        self._size = size
        self._paths = paths

    def film(self, page: "Page") -> Film:
        """Film the recording of a page."""
        page.evaluate(_SCRIPT.read_text(encoding="utf-8"))
        duration = page.evaluate("() => arm_drake_film.start()")
        if duration is None:
            raise InputError(
                "no film: nothing is recorded; expected StartRecording() before the "
                "simulation, StopRecording() and PublishRecording() after it"
            )
        # Recordings end a rounding error before or after their last picture.
        count = int(np.floor(duration * FRAME_RATE + 1e-6)) + 1
        times = (np.arange(count) / FRAME_RATE).tolist()
        self.total = count
        view = View(FIELD_OF_VIEW, self._size[0] / self._size[1])
        set_up(page, view, self._find_extremes(page, view, times), self._size)
        with _encoder(self._path) as stream:
            while self.taken < count and not self.is_stopped.is_set():
                pictures = page.evaluate(
                    "(times) => arm_drake_film.take_pictures(times)",
                    times[self.taken :],
                )
                for uri in pictures:
                    stream.write(base64.b64decode(uri.partition(",")[2]))
                self.taken += len(pictures)
        return Film(self.taken, self.taken / FRAME_RATE)

    def _find_extremes(self, page: "Page", view: View, times: list[float]) -> Array:
        """Return the farthest points that are drawn at any time, shape (n, 3)."""
        extreme = page.evaluate(
            "([p, d, t]) => arm_drake_film.find_extreme_times(p, d, t)",
            [[p.split("/") for p in self._paths], view.normals().tolist(), times],
        )
        points = []
        for time in extreme or times[:1]:
            page.evaluate("(time) => arm_drake_film.seek(time)", time)
            points.append(find_extremes(page, view, self._paths))
        return np.concatenate(points)


@contextlib.contextmanager
def _encoder(path: Path) -> Iterator[IO[bytes]]:
    """Take JPEG files, one after the other, and write a film of them.

    What it has got is a film also if an exception ends it, unless that is nothing.
    """
    from imageio_ffmpeg import get_ffmpeg_exe

    # Whoever opens the file while it is written would find it broken.
    unfinished = path.with_name(f"{path.name}.part")
    command = [get_ffmpeg_exe(), "-y", "-loglevel", "error"]
    command += ["-f", "image2pipe", "-framerate", str(FRAME_RATE), "-c:v", "mjpeg"]
    command += ["-i", "-", *_ENCODING, str(unfinished)]
    process = subprocess.Popen(  # noqa: S603
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,  # Ctrl-C is for us: it still has to end its file.
    )
    assert process.stdin is not None
    try:
        with contextlib.suppress(BrokenPipeError):  # It tells why when it ends.
            yield process.stdin
    finally:
        with contextlib.suppress(BrokenPipeError):
            process.stdin.close()
        process.stdin = None  # Or `communicate` uses it.
        _, stderr = process.communicate()
        if process.returncode == 0:
            with writing(path):
                unfinished.replace(path)
        else:
            unfinished.unlink(missing_ok=True)
            reason = " ".join(stderr.decode(errors="replace").split())
            raise OutputError(f"can't be written: {reason}", file=path)
