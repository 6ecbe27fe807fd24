"""World files that can't be used: one message, with file and line."""

from pathlib import Path

import pytest

from arm_drake.errors import InputError
from arm_drake.worlds import sdf_files
from arm_drake.worlds.world import load_world
from tests.worlds.sdf import TABLE, box, model, write, write_model

_PLANE = '<collision name="c">{}<geometry><plane>{}</plane></geometry></collision>'


def message(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        load_world(path)
    return str(caught.value).removeprefix(str(path))


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("<gravity>0 0</gravity>", ":3: <gravity>: expected x y z [m/s^2], got '0 0'"),
        (
            "<gravity>0 0 inf</gravity>",
            ":3: <gravity>: expected x y z [m/s^2], got '0 0 inf'",
        ),
        (
            model("m", _PLANE.format("<pose>1 2 x 0 0 0</pose>", "")),
            ":5: <pose>: expected x y z roll pitch yaw, got '1 2 x 0 0 0'",
        ),
        (
            model("m", _PLANE.format("", "<normal>0 1</normal>")),
            ":5: <normal>: expected 3 numbers, got '0 1'",
        ),
        (
            model(
                "m",
                box("1 1 1", tag="visual").replace(
                    "</visual>",
                    "<material><diffuse>red</diffuse></material></visual>",
                ),
            ),
            ":7: <material>: expected red green blue alpha, got 'red'",
        ),
    ],
)
def test_a_malformed_number_is_refused(
    tmp_path: Path, content: str, expected: str
) -> None:
    assert message(write(tmp_path, content)) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (b"", ":1: the file is empty"),
        (
            b"<sdf version='1.6'>\n<world></sdf>",
            ":2: malformed XML: mismatched tag, inside <world> of line 2: "
            "'<world></sdf>'",
        ),
        (b"<robot/>", ":1: expected <sdf> at the top, got <robot>"),
        (
            b"<sdf version='99999999999'><world/></sdf>",
            ":1: <sdf> has the version '99999999999'; expected such as version=\"1.6\"",
        ),
        (
            b"<sdf><world/></sdf>",
            ':1: <sdf> has no version; expected such as version="1.6"',
        ),
        (b"<sdf version='1.6'/>", ":1: <sdf> has no <world>, and no model either"),
        (b"\xff\xfe\x00", ": can't be read: it is not UTF-8 text"),
        (
            b"<?xml version='1.0'?>\n<!DOCTYPE sdf [<!ENTITY a SYSTEM 'file:///etc/passwd'>]>"
            b"<sdf version='1.6'><world name='w'>&a;</world></sdf>",
            ":2: a document type isn't read; expected <sdf> without <!DOCTYPE>",
        ),
        (
            b"<sdf version='1.6'>" + 300 * b"<world>",
            ":1: elements are nested more than 200 deep; no SDF needs that",
        ),
    ],
)
def test_what_is_no_sdf_is_refused(tmp_path: Path, text: bytes, expected: str) -> None:
    path = tmp_path / "bad.world"
    path.write_bytes(text)

    assert message(path) == expected


def test_a_version_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    assert message(write(tmp_path, TABLE, version="99")).startswith(":2: ")


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    expected = ": can't be read: No such file or directory"

    assert message(tmp_path / "no.world") == expected


def test_a_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.world").mkdir()

    assert message(tmp_path / "a.world") == ": can't be read: it is no file"


def test_a_file_that_is_too_large_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sdf_files, "MAX_SIZE", 100)

    expected = ": can't be read: it is larger than 0.0001 MB"
    assert message(write(tmp_path, TABLE)) == expected


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("<model", "malformed XML: the file ends inside a tag"),
        (
            model("m", _PLANE.format("<pose>1</pose>", "")),
            "<pose>: expected x y z roll",
        ),
        ("", "<sdf> has no <model> to include"),
    ],
)
def test_a_bad_model_is_reported_and_the_rest_stands(
    tmp_path: Path, content: str, problem: str
) -> None:
    path = write_model(tmp_path, "bad", content)
    if content.startswith("<model") and ">" not in content:
        path.write_text(content)

    world = load_world(
        write(tmp_path, TABLE + "<include><uri>model://bad</uri></include>")
    )

    (entry,) = world.report
    assert (entry.severity, entry.file) == ("error", str(path))
    assert entry.what.startswith(problem)


def test_models_that_include_each_other_are_left_out(tmp_path: Path) -> None:
    for name, other in (("a", "b"), ("b", "a")):
        inside = f"<include><uri>model://{other}</uri></include>"
        write_model(tmp_path, name, model(name, "", inside=inside))

    world = load_world(write(tmp_path, "<include><uri>model://a</uri></include>"))

    assert [entry.what for entry in world.report] == ["the model includes itself"]


@pytest.mark.slow
@pytest.mark.parametrize("tag", ["visual", "collision"])
@pytest.mark.parametrize(
    ("geometry", "what"),
    [
        (
            "<heightmap><uri>x</uri></heightmap>",
            "a <heightmap>, which Drake doesn't have",
        ),
        ("<mesh><uri>https://a/b.dae</uri></mesh>", "no mesh file 'https://a/b.dae'"),
        ("<mesh><uri>model://no/b.dae</uri></mesh>", "no mesh file 'model://no/b.dae'"),
        (
            "<box><size>1 -1 1</size></box>",
            "a <box> with a size that isn't 1e-09 m to 1e+06 m",
        ),
        ("<plane><size>0 1</size></plane>", "a <plane> without a direction or a size"),
    ],
)
def test_a_shape_that_can_not_be_is_reported(
    tmp_path: Path, tag: str, geometry: str, what: str
) -> None:
    shape = f'<{tag} name="x"><geometry>{geometry}</geometry></{tag}>'
    path = write(tmp_path, model("m", shape, inside="<pose>0 0 1 0 0 0</pose>"))

    (entry,) = load_world(path).report

    assert entry.what == what
    assert entry.where == f"model 'm', link 'link', {tag} 'x'"
    is_lost = tag == "collision"
    assert entry.severity == ("error" if is_lost else "warning")
