"""Output files that can't be written: found out first, and old ones stay."""

import os

import pytest

from arm_drake.errors import OutputError
from arm_drake.output_files import check_suffix, check_writable, writing


@pytest.mark.parametrize(
    ("suffixes", "expected"), [((".png",), ".png"), ((".a", ".b"), "one of .a, .b")]
)
def test_an_unknown_suffix_is_said_with_the_known_ones(tmp_path, suffixes, expected):
    file = tmp_path / "picture.bmp"

    with pytest.raises(OutputError) as caught:
        check_suffix(file, "a picture", suffixes)

    assert str(caught.value) == (
        f"{file}: unknown type '.bmp' of a picture; expected {expected}"
    )


def test_a_known_suffix_passes(tmp_path):
    check_suffix(tmp_path / "picture.b", "a picture", (".a", ".b"))


def test_a_check_leaves_nothing_behind_and_changes_nothing(tmp_path):
    new, old = tmp_path / "new", tmp_path / "old"
    old.write_text("precious")

    check_writable(new)
    check_writable(old)

    assert list(tmp_path.iterdir()) == [old]
    assert old.read_text() == "precious"


def test_a_link_to_a_file_that_is_not_there_yet_stays(tmp_path):
    link = tmp_path / "link"
    link.symlink_to("target")

    check_writable(link)

    assert link.is_symlink()
    assert not link.exists()


def test_a_pipe_is_refused_without_waiting_for_its_reader(tmp_path):
    file = tmp_path / "pipe"
    os.mkfifo(file)

    with pytest.raises(OutputError) as caught:
        check_writable(file)

    assert str(caught.value) == (f"{file}: can't be written: it is a pipe; name a file")


def test_a_file_in_a_missing_folder_is_refused(tmp_path):
    file = tmp_path / "missing" / "file"

    with pytest.raises(OutputError) as caught:
        check_writable(file)

    folder = f"the folder '{file.parent}' doesn't exist"
    assert str(caught.value) == f"{file}: can't be written: {folder}"


def test_a_failure_to_write_names_the_file(tmp_path):
    with pytest.raises(OutputError) as caught, writing(tmp_path):
        tmp_path.write_text("a folder is no file")

    assert str(caught.value) == f"{tmp_path}: can't be written: Is a directory"
