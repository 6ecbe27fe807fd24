import sys

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from arm_drake.description.meshes import conversion
from arm_drake.description.meshes import conversion as mut
from arm_drake.errors import MissingExtraError
from tests.description.meshes.samples import (
    ONE,
    Converter,
    binary_stl,
    obj_arrays,
    obj_volume,
)

# An L of two 3 x 1 x 1 arms in metres: volume 5, its hull 7.
_OUTLINE = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)]
L_SHAPE = np.array([(x, y, z) for z in (0, 1) for x, y in _OUTLINE], float)
_TOP = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)])
_SIDES = [(i, (i + 1) % 6, (i + 1) % 6 + 6) for i in range(6)]
_SIDES += [(i, (i + 1) % 6 + 6, i + 6) for i in range(6)]
L_FACES = np.concatenate([_TOP[:, ::-1], _TOP + 6, _SIDES])

# In the angle of the L, and all over its two arms.
NOTCH = np.array([[1.4, 1.4, 0.5]])
INSIDE = np.array(
    [
        (x, y, z)
        for x in np.linspace(0.1, 2.9, 15)
        for y in np.linspace(0.1, 2.9, 15)
        for z in (0.1, 0.5, 0.9)
        if x < 0.9 or y < 0.9
    ]
)


class PartsConverter(Converter):
    def parts(self, source, scale=ONE, **options):
        options = {"where": "link 'a', collision 0", "cache_dir": self.cache} | options
        return mut.convert_collision(
            source, scale, self.report, decompose=True, **options
        )


@pytest.fixture
def converter(tmp_path):
    return PartsConverter(tmp_path)


@pytest.fixture
def source(converter):
    return converter.write("l.stl", binary_stl(L_SHAPE, L_FACES))


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """Return a cache for tests that may find there what others made."""
    return tmp_path_factory.mktemp("shared")


def covers(path, points):
    """Return which points lie in the convex hull of an OBJ file's vertices."""
    planes = ConvexHull(obj_arrays(path)[0]).equations
    return (points @ planes[:, :3].T + planes[:, 3] <= 1e-9).all(axis=1)


def test_the_hull_covers_the_notch(converter, source):
    hull = converter.collision(source)

    assert covers(hull, NOTCH).all()
    assert obj_volume(hull) == pytest.approx(7.0)


@pytest.mark.slow
def test_parts_leave_the_notch_free_and_cover_the_rest(converter, source, shared):
    paths = converter.parts(source, cache_dir=shared)

    assert len(paths) >= 2
    assert not any(covers(path, NOTCH).any() for path in paths)
    assert np.logical_or.reduce([covers(path, INSIDE) for path in paths]).all()
    # Parts hardly overlap; the library's default tolerance is 5 %.
    assert sum(obj_volume(path) for path in paths) == pytest.approx(5.0, rel=0.02)
    assert converter.lines == []


@pytest.mark.slow
def test_parts_are_convex_closed_and_face_outward(converter, source, shared):
    for path in converter.parts(source, cache_dir=shared):
        points, faces = obj_arrays(path)
        edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).tolist()
        assert sorted(edges) == sorted([b, a] for a, b in edges)
        assert obj_volume(path) == pytest.approx(ConvexHull(points).volume)


@pytest.mark.slow
def test_parts_follow_the_scale(converter, source):
    paths = converter.parts(source, (-0.1, 0.1, 0.2))

    points = np.concatenate([obj_arrays(path)[0] for path in paths])
    np.testing.assert_allclose(points.min(axis=0), [-0.3, 0, 0], atol=1e-3)
    np.testing.assert_allclose(points.max(axis=0), [0, 0.3, 0.2], atol=1e-3)
    assert sum(map(obj_volume, paths)) == pytest.approx(5.0 * 0.002, rel=0.02)


@pytest.mark.slow
def test_parts_are_the_same_every_time(converter, source, shared):
    first = converter.parts(source, cache_dir=shared)
    second = converter.parts(source, cache_dir=converter.folder / "other")

    assert [p.name for p in first] == [p.name for p in second]
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]


def test_parts_come_from_the_cache_the_second_time(
    converter, source, shared, monkeypatch
):
    first = converter.parts(source, cache_dir=shared)
    monkeypatch.setattr(conversion, "decompose", None)

    assert converter.parts(source, cache_dir=shared) == first
    assert converter.collision(source, cache_dir=shared) not in first


@pytest.mark.slow
def test_a_lost_part_is_made_again(converter, source, shared):
    paths = converter.parts(source, cache_dir=shared)
    content = paths[-1].read_bytes()
    paths[-1].unlink()

    assert converter.parts(source, cache_dir=shared) == paths
    assert paths[-1].read_bytes() == content


@pytest.mark.slow
def test_another_version_of_the_library_decomposes_again(
    converter, source, shared, monkeypatch
):
    first = converter.parts(source, cache_dir=shared)
    monkeypatch.setattr(conversion, "require_decomposition", lambda: "0.0.1")

    assert not set(converter.parts(source)) & set(first)


@pytest.mark.slow
def test_the_library_prints_nothing(converter, source, capfd):
    converter.parts(source)

    assert capfd.readouterr() == ("", "")


def test_without_the_library_nothing_is_touched(converter, monkeypatch):
    monkeypatch.setitem(sys.modules, "coacd", None)

    with pytest.raises(MissingExtraError) as caught:
        converter.parts(converter.folder / "no such file.stl")

    assert str(caught.value) == (
        "convex decomposition of meshes needs `pip install 'arm-drake[decompose]'`"
    )
    assert converter.lines == []
    assert not converter.cache.exists()


FAILURES = {
    "crash": ("import os; os.abort()", "its decomposition failed (-6)"),
    "exception": (
        "raise MemoryError('too many')",
        "its decomposition failed (MemoryError: too many)",
    ),
    "nothing": (
        "import sys, numpy as np; np.savez(sys.stdout.buffer)",
        "its decomposition gave no parts",
    ),
    "endless": (
        "import time; time.sleep(60)",
        "its decomposition takes more than 1 s",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(("code", "problem"), FAILURES.values(), ids=FAILURES)
def test_a_mesh_that_cannot_be_decomposed_gets_its_hull(
    converter, source, monkeypatch, code, problem
):
    monkeypatch.setattr(conversion, "_DECOMPOSE", code)
    # The others start Python, which takes its time on a busy machine.
    timeout = 1.0 if "sleep" in code else 60.0
    monkeypatch.setattr(conversion, "DECOMPOSITION_TIMEOUT", timeout)

    (path,) = converter.parts(source)

    assert obj_volume(path) == pytest.approx(7.0)
    assert converter.lines == [
        f"warning: link 'a', collision 0: mesh file '{source}': {problem}; its convex "
        "hull is used"
    ]


def test_a_flat_mesh_is_one_part(converter):
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    source = converter.write("flat.stl", binary_stl(square, faces))

    (path,) = converter.parts(source)

    assert obj_volume(path) == pytest.approx(1e-4)
    assert [entry.what for entry in converter.report] == [
        f"mesh file '{source}': the mesh is flat"
    ]


def test_a_missing_mesh_has_no_parts(converter):
    assert converter.parts(converter.folder / "gone.stl") == ()
    assert [entry.kind for entry in converter.report] == ["missing"]
