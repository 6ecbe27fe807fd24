"""Films: the whole recording, in time, all of the robot inside, always playable."""

import importlib
import re
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.geometry import Box, Meshcat, Rgba
from pydrake.math import RigidTransform

from arm_drake.cli import main
from arm_drake.errors import InputError
from arm_drake.visualization.screenshot import BrowserError, Photographer
from arm_drake.visualization.video import Film, save_video
from tests.browser.test_screenshot import assert_framed, magenta_arm, magenta_of, read
from tests.robots import skip_or_fail

pytestmark = [pytest.mark.browser, pytest.mark.slow]

StartMeshcat = Callable[[], Meshcat]

# Small pictures are drawn fast.
SIZE = (240, 180)
RATE = 30.0

# Shape (frames, height, width, 3), 0 to 255.
Frames = NDArray[np.int16]


@pytest.fixture(scope="module")
def photographer() -> Iterator[Photographer]:
    try:
        photographer = Photographer().__enter__()
    except BrowserError as error:
        skip_or_fail(str(error))
    yield photographer
    photographer.__exit__()


def record(meshcat: Meshcat, way: dict[float, float]) -> None:
    """Record a magenta cube that is at some places y [m] at some times [s]."""
    path = "/drake/visual/cube"
    meshcat.SetObject(path, Box(0.2, 0.2, 0.2), Rgba(1.0, 0.0, 1.0, 1.0))
    meshcat.StartRecording(RATE)
    for time, y in way.items():
        # In the middle of a picture's time: Meshcat rounds down.
        when = (round(RATE * time) + 0.5) / RATE
        meshcat.SetTransform(path, RigidTransform([0.0, y, 0.0]), when)
    meshcat.StopRecording()
    meshcat.PublishRecording()


def read_film(path: Path) -> tuple[str, Frames]:
    """Return what ffmpeg says of a film, and its pictures."""
    ffmpeg = importlib.import_module("imageio_ffmpeg").get_ffmpeg_exe()
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(
        [ffmpeg, "-nostdin", "-i", str(path), *raw], capture_output=True, check=True
    )
    about = done.stderr.decode().partition("Output #0")[0]
    found = re.search(r", (\d+)x(\d+)", about)
    assert found is not None, about
    width, height = map(int, found.groups())
    frames = np.frombuffer(done.stdout, np.uint8)
    return about, frames.reshape(-1, height, width, 3).astype(np.int16)


def columns(frames: Frames) -> NDArray[np.float64]:
    """Return the mean column of what is magenta in each picture."""
    return np.array([np.nonzero(magenta_of(frame))[1].mean() for frame in frames])


def test_every_moment_is_shown_at_its_time(
    photographer: Photographer, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    meshcat = start_meshcat()
    # It stands on the left, for 15 pictures and the one at 0.5 s, then on the right.
    record(meshcat, {0.0: -0.5, 0.5: -0.5, 16 / 30: 0.5, 1.0: 0.5})
    path = tmp_path / "film.mp4"

    film = save_video(meshcat, path, size=SIZE, photographer=photographer)

    about, frames = read_film(path)
    assert film == Film(31, 31 / 30)
    assert len(frames) == 31
    assert "Duration: 00:00:01.03" in about
    assert "Video: h264" in about
    assert "yuv420p" in about
    assert "240x180" in about
    assert "30 fps" in about
    # The camera looks to the left and back, so +y is on the right.
    places = columns(frames)
    assert places[:16].max() < SIZE[0] / 2 < places[16:].min()
    assert np.ptp(places[:16]) < 1.0
    assert np.ptp(places[16:]) < 1.0


def test_a_film_has_the_colours_of_the_page(
    photographer: Photographer, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    meshcat = start_meshcat()
    record(meshcat, {0.0: 0.0, 0.1: 0.0})
    path = tmp_path / "film.mp4"

    save_video(meshcat, path, size=SIZE, photographer=photographer)

    _, frames = read_film(path)
    # JPEG, H.264 and YUV of 8 bits change flat colours by 2 to 3 of 255 each.
    data, _ = photographer.take_picture(meshcat, size=SIZE)
    still = read(data)
    inside = magenta_of(still) & magenta_of(frames[-1])
    assert inside.mean() > 0.1
    error = (frames[-1] - still)[inside].mean(axis=0)
    np.testing.assert_allclose(error, 0.0, atol=9.0)


def test_all_of_the_motion_is_in_the_picture(
    photographer: Photographer, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    meshcat = start_meshcat()
    # Neither the first nor the last moment shows how far it goes.
    record(meshcat, {0.0: 0.0, 0.2: 0.0, 7 / 30: 2.0, 8 / 30: 0.0, 0.5: -1.0, 0.6: 0.0})
    path = tmp_path / "film.mp4"
    size = (640, 480)

    save_video(meshcat, path, size=size, photographer=photographer)

    _, frames = read_film(path)
    assert_framed(np.any([magenta_of(frame) for frame in frames], axis=0))


def test_what_is_filmed_until_ctrl_c_is_kept(
    photographer: Photographer, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    meshcat = start_meshcat()
    record(meshcat, {0.0: 0.0, 40.0: 1.0})
    path = tmp_path / "film.mp4"

    def interrupt(taken: int, total: int) -> None:
        assert total in (0, 1201)
        if taken:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        save_video(
            meshcat, path, size=SIZE, progress=interrupt, photographer=photographer
        )

    _, frames = read_film(path)
    assert 0 < len(frames) < 1201
    assert [file.name for file in tmp_path.iterdir()] == ["film.mp4"]


def test_without_a_recording_there_is_no_film(
    photographer: Photographer, start_meshcat: StartMeshcat, tmp_path: Path
) -> None:
    meshcat = start_meshcat()
    meshcat.SetObject("/drake/visual/cube", Box(1.0, 1.0, 1.0))

    with pytest.raises(InputError) as caught:
        save_video(meshcat, tmp_path / "film.mp4", size=SIZE, photographer=photographer)

    assert str(caught.value) == (
        "no film: nothing is recorded; expected StartRecording() before the "
        "simulation, StopRecording() and PublishRecording() after it"
    )
    assert list(tmp_path.iterdir()) == []


def test_the_command_films_a_simulation(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, path = tmp_path / "robot.urdf", tmp_path / "film.mp4"
    robot.write_text(magenta_arm(1.0), encoding="utf-8")

    words = ["sim", str(robot), "--headless", "--duration", "0.5"]
    code = main([*words, "--video", str(path)])

    assert code == 0
    _, frames = read_film(path)
    assert len(frames) == 16
    assert_framed(np.any([magenta_of(frame) for frame in frames], axis=0))
    size = path.stat().st_size / 1e6
    assert f"video: {path} (0.5 s, {size:.1f} MB)\n" in capsys.readouterr().out
