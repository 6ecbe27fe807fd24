import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from arm_drake.description.meshes import conversion as mesh_cache
from arm_drake.description.meshes import conversion as mut
from arm_drake.description.report import LoadReport
from arm_drake.errors import OutputError
from tests.description.meshes.samples import (
    BOX,
    ONE,
    Converter,
    binary_stl,
    dae,
    gltf_volume,
)

REPOSITORY = Path(__file__).parents[2]


@pytest.fixture
def converter(tmp_path):
    return Converter(tmp_path)


class FullDisk:
    """A disk on which files of some folders hold three bytes."""

    def __init__(self, monkeypatch, *folders):
        self._folders = folders
        self._fdopen = os.fdopen
        monkeypatch.setattr(mesh_cache.os, "fdopen", self.open)

    def open(self, handle, mode, **options):
        inode = os.fstat(handle).st_ino
        inside = [path for folder in self._folders for path in folder.rglob("*")]
        file = self._fdopen(handle, mode, **options)
        if inode in {path.stat().st_ino for path in inside}:
            return _FullFile(file)
        return file


class _FullFile:
    def __init__(self, file):
        self._file = file

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._file.close()

    def write(self, content):
        self._file.write(content[:3])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_costs_the_cache_and_nothing_else(converter, monkeypatch):
    source = converter.write("box.stl", binary_stl())
    FullDisk(monkeypatch, converter.cache)

    paths = [converter.visual(source), converter.collision(source)]

    assert gltf_volume(paths[0]) == pytest.approx(6.0)
    assert all(converter.cache not in path.parents for path in paths)
    assert list(converter.cache.iterdir()) == []
    assert converter.lines == [
        f"info: the mesh cache '{converter.cache}' can't be written (No space left on "
        "device); converted meshes last as long as this process"
    ]


def test_a_disk_that_is_full_everywhere_is_one_clear_message(converter, monkeypatch):
    source = converter.write("box.stl", binary_stl())
    temporary = converter.folder / "tmp"
    monkeypatch.setattr(mesh_cache, "_temporary_directory", lambda: temporary)
    FullDisk(monkeypatch, converter.cache, temporary)

    with pytest.raises(OutputError) as caught:
        converter.visual(source)

    assert caught.value.problem == (
        "no converted mesh can be written (No space left on device)"
    )
    assert str(temporary) in caught.value.file
    assert [path for path in temporary.rglob("*") if path.is_file()] == []


@pytest.mark.slow
def test_a_home_that_cannot_be_written_does_no_harm(tmp_path):
    source = tmp_path / "box.stl"
    source.write_bytes(binary_stl())
    code = f"""
from pathlib import Path
from arm_drake.description.meshes.conversion import convert_collision
from arm_drake.description.report import LoadReport

report = LoadReport()
(path,) = convert_collision(Path({str(source)!r}), (1.0, 1.0, 1.0), report, where="")
print(path.is_file(), report)
"""
    environment = {"HOME": "/dev/null", "PATH": os.environ["PATH"]}

    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=REPOSITORY,
        env=environment,
    )

    assert done.stdout.startswith("True info: the mesh cache '/dev/null/")
    assert "can't be written (Not a directory)" in done.stdout
    assert done.stderr == ""


# Each waits until all are there, then converts the same meshes in its own order.
WORKER = """
import sys, time
from pathlib import Path
import trimesh, collada, scipy.spatial
from arm_drake.description.meshes.conversion import convert_collision, convert_visual
from arm_drake.description.report import LoadReport

folder, number = Path(sys.argv[1]), int(sys.argv[2])
(folder / f"ready{number}").touch()
while not (folder / "go").exists():
    time.sleep(0.001)
report = LoadReport()
sources = sorted((folder / "meshes").iterdir())
for source in sources[number:] + sources[:number]:
    for convert in (convert_visual, convert_collision):
        for _ in range(3):
            made = convert(source, (1.0, 1.0, 1.0), report, where="",
                           cache_dir=folder / "cache")
            paths = made if isinstance(made, tuple) else (made,)
            assert all(path.parent == folder / "cache" for path in paths)
            assert all(path.stat().st_size for path in paths)
assert not len(report), report
"""


@pytest.mark.slow
def test_several_processes_share_an_empty_cache(converter):
    folder = converter.folder
    for i in range(12):
        converter.write(f"meshes/{i}.stl", binary_stl(BOX * (1 + i % 6)))
        converter.write(f"meshes/{i}.dae", dae(nodes=[("", f"0.{i % 6} 0 0 1")]))

    workers = [
        subprocess.Popen(
            [sys.executable, "-c", WORKER, str(folder), str(i)],
            stderr=subprocess.PIPE,
            text=True,
            cwd=REPOSITORY,
        )
        for i in range(3)
    ]
    while not all((folder / f"ready{i}").exists() for i in range(3)):
        assert all(worker.poll() is None for worker in workers)
    (folder / "go").touch()
    errors = [worker.communicate(timeout=120)[1] for worker in workers]

    assert errors == ["", "", ""]
    # Six different meshes of each type, drawn and collided, with a record each. All
    # DAE files collide alike.
    names = sorted(path.name for path in converter.cache.iterdir())
    assert len(names) == 2 * (6 + 6 + 6 + 6)
    alone = folder / "alone"
    for source in sorted((folder / "meshes").iterdir()):
        for convert in (converter.visual, converter.collision):
            path = convert(source, cache_dir=alone)
            assert (converter.cache / path.name).read_bytes() == path.read_bytes()


DAMAGED = [
    b"[]",
    b"null",
    b"{}",
    b'{"sha256": 3, "notes": []}',
    b'{"sha256": [], "notes": []}',
    b'{"sha256": ["0"], "notes": []}',
    b"\xff\xfe\x00",
    b"[" * 100_000,
]


@pytest.mark.parametrize("content", DAMAGED)
def test_a_damaged_record_is_rewritten(converter, content):
    source = converter.write("box.stl", binary_stl())
    path = converter.visual(source)
    record = path.with_name(path.name.partition("_")[0] + ".json")
    good = record.read_bytes()
    record.write_bytes(content)

    assert converter.visual(source) == path
    assert record.read_bytes() == good


def test_a_record_with_notes_of_another_kind_is_rewritten(converter):
    source = converter.write("box.stl", binary_stl())
    path = converter.visual(source)
    record = path.with_name(path.name.partition("_")[0] + ".json")
    good = json.loads(record.read_bytes())
    record.write_text(json.dumps(good | {"notes": [{"text": "former version"}]}))

    assert converter.visual(source) == path
    assert json.loads(record.read_bytes()) == good


def test_a_folder_in_the_place_of_a_file_does_no_harm(converter):
    source = converter.write("box.stl", binary_stl())
    path = converter.visual(source)
    path.unlink()
    (path / "something").mkdir(parents=True)

    assert gltf_volume(converter.visual(source)) == pytest.approx(6.0)
    (line,) = converter.lines
    assert line.startswith(f"info: the mesh cache '{converter.cache}' can't be written")


def test_the_key_is_the_content_not_the_place(converter):
    first = converter.write("a/box.stl", binary_stl())
    second = converter.write("b/other.STL", binary_stl())

    assert converter.collision(first) == converter.collision(second)
    assert len(list(converter.cache.iterdir())) == 2


def test_what_former_versions_and_stopped_processes_left_is_cleared(converter):
    digits = "0123456789abcdef" * 4
    ours = [
        f"{digits}.gltf",
        f"{digits}.gltf.json",
        f"{digits}.obj",
        f"{digits}.obj.json",
        f"{digits}_0.obj",
        f"{digits}.json",
        f"{digits}_12.obj.ab_c1x.tmp",
        f"{digits}.json.ab_c1x.tmp",
    ]
    others = [f"{digits}.txt", "a.json", f"{digits}x.obj"]
    for name in ours + others:
        converter.write(f"cache/{name}", b"")

    assert mut.clear_cache(converter.cache) == len(ours)
    assert sorted(p.name for p in converter.cache.iterdir()) == sorted(others)


def test_a_home_of_nobody_is_a_name_like_any_other(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ARM_DRAKE_CACHE", "~no_such_user/cache")
    source = tmp_path / "box.stl"
    source.write_bytes(binary_stl())

    (path,) = mut.convert_collision(source, ONE, LoadReport(), where="")

    assert path.parent == tmp_path / "~no_such_user/cache/meshes"
