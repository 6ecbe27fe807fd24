"""Films that can't be: refused before anything is filmed."""

import sys
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from arm_drake.commands.output import Speaker, needs_recording, write_outputs
from arm_drake.errors import InputError, MissingExtraError, OutputError
from arm_drake.visualization.video import check_video_installed, save_video


@pytest.mark.parametrize("library", ["imageio_ffmpeg", "playwright.sync_api"])
def test_a_missing_library_names_its_extra(
    monkeypatch: pytest.MonkeyPatch, library: str
) -> None:
    monkeypatch.setitem(sys.modules, library, None)

    with pytest.raises(MissingExtraError) as caught:
        check_video_installed()

    assert str(caught.value) == (
        "a film of the simulation needs `pip install 'arm-drake[video]'`"
    )


def test_other_types_of_films_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "film.gif"

    with pytest.raises(OutputError) as caught:
        save_video(None, file)

    assert str(caught.value) == f"{file}: unknown type '.gif' of a film; expected .mp4"


@pytest.mark.parametrize("size", [(961, 720), (960, 721), (0, 720), (-2, 720)])
def test_sizes_that_the_format_has_not_are_refused(
    tmp_path: Path, size: tuple[int, int]
) -> None:
    with pytest.raises(InputError) as caught:
        save_video(None, tmp_path / "film.mp4", size=size)

    assert str(caught.value) == (
        f"size of a film: expected even numbers of pixels, 2 or more, got {size}"
    )


def test_a_folder_that_does_not_exist_is_named(tmp_path: Path) -> None:
    file = tmp_path / "missing" / "film.mp4"

    with pytest.raises(OutputError) as caught:
        save_video(None, file)

    folder = f"the folder '{file.parent}' doesn't exist"
    assert str(caught.value) == f"{file}: can't be written: {folder}"


@pytest.mark.parametrize(
    ("record", "video", "is_needed"),
    [
        (None, None, False),
        (Path("a.html"), None, True),
        (None, Path("a.mp4"), True),
    ],
)
def test_pages_and_films_need_a_recording(
    record: Path | None, video: Path | None, is_needed: bool
) -> None:
    assert needs_recording(Namespace(record=record, video=video)) is is_needed


def test_an_interrupted_film_says_where_it_is(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    def interrupted(
        *_: object, progress: Callable[[int, int], None], **__: object
    ) -> None:
        for taken in (0, 1, 50, 51, 100):
            progress(taken, 200)
        raise KeyboardInterrupt

    monkeypatch.setattr("arm_drake.commands.output.save_video", interrupted)
    words = ["log", "plot", "record", "screenshot"]
    file = tmp_path / "film.mp4"
    options = Namespace(**dict.fromkeys(words), video=file, json=False)
    robot = SimpleNamespace(name="arm")

    with pytest.raises(KeyboardInterrupt):
        write_outputs(None, options, Mock(), Speaker(is_quiet=False), robot)

    assert capsys.readouterr().out == (
        "video: 50 of 200 pictures\nvideo: 100 of 200 pictures\n"
        f"video: {file} ends where it was interrupted\n"
    )
