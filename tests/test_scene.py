"""Scene files: what they say becomes a diagram, errors say where."""

import dataclasses as dc
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from jsonschema import Draft202012Validator
from pydrake.systems.analysis import Simulator

import arm_drake as ad
from arm_drake.errors import InputError
from arm_drake.plant.payloads import Payload
from arm_drake.scene import Scene
from arm_drake.simulation.motion_files import parse_motion
from tests import carts, models
from tests.snippets import read_blocks

SCHEMA = Path(ad.__file__).parent / "schemas/scene.schema.json"

# A ball that falls past a second one, which stands on a shelf with a cube.
SCENE = """
robots:
- {robot: ball.urdf, name: one, pose: [0, 1, 0, 0, 0, 0], initial: {fall: 0.5}}
- robot: ./ball.urdf
  name: two
  payload: {ball: {mass: 2.0, com: [0, 0, 0.1]}}
  frames: {top: {parent: ball, pose: [0, 0, 0.1]}}
world: empty
things:
- {name: cube, box: [0.05, 0.05, 0.05], mass: 0.1, color: red, pose: [2, 0, 0.2]}
- {name: shelf, box: [1, 1, 0.1], fixed: true, pose: [2, 0, 0.05, 0, 0, 0]}
- {name: can, cylinder: [0.05, 0.2], mass: 0.3, color: [0, 0.5, 1, 0.8], friction: 0}
- {name: ball, sphere: 0.1, mass: 1, pose: [-2, 0, 0.1]}
options: {time_step: 0.002, gravity: [0, 0, -9.81], active: []}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scene")
    (folder / "ball.urdf").write_text(models.FALLING_BALL, encoding="utf-8")
    (folder / "wait.yaml").write_text("[]", encoding="utf-8")
    return folder


def load(folder: Path, text: str) -> Scene:
    file = folder / "scene.yaml"
    file.write_text(text, encoding="utf-8")
    return ad.load_scene(file)


@pytest.fixture(scope="module")
def scene(folder: Path) -> Scene:
    return load(folder, SCENE)


def test_a_scene_and_its_motion_are_said_in_a_line(folder: Path, scene: Scene) -> None:
    assert repr(scene) == (
        f"<Scene '{folder / 'scene.yaml'}', robots ['one', 'two'], world 'empty', "
        "things ['cube', 'shelf', 'can', 'ball']>"
    )
    step = {"at": 1.5, "controller": "arm", "cancel": True}
    motion = parse_motion([step, {**step, "at": 0.5, "controller": "leg"}])
    text = "2 steps, 1.50 s, controllers ['arm', 'leg']>"
    assert repr(motion) == f"<Motion {text}"
    assert repr(dc.replace(motion, file=Path("m.yaml"))) == f"<Motion 'm.yaml', {text}"
    both = dc.replace(scene, motions={"one": motion, "two": motion}).motion
    assert repr(both) == (
        "<Motion 4 steps, 1.50 s, controllers "
        "['one/arm', 'one/leg', 'two/arm', 'two/leg']>"
    )


def test_a_scene_is_what_its_file_says(scene: Scene) -> None:
    one, two = scene.robots

    assert (one.name, two.name) == ("one", "two")
    assert one.pose == (0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    assert one.initial_positions["fall"] == 0.5
    assert scene.payloads == {"two/ball": Payload(2.0, (0.0, 0.0, 0.1))}
    assert scene.things[1] == ad.Thing(
        "shelf",
        "box",
        (1.0, 1.0, 0.1),
        pose=(2.0, 0.0, 0.05, 0.0, 0.0, 0.0),
        fixed=True,
    )
    assert scene.options == ad.SimulationOptions(
        time_step=0.002, gravity=(0.0, 0.0, -9.81)
    )


@pytest.mark.slow
def test_robots_and_things_fall_where_they_are(scene: Scene) -> None:
    sim = ad.Simulation(ad.build_diagram(scene))

    sim.run(1.0, scene.motion)

    context = sim.plant.GetMyContextFromRoot(sim.context)
    heights = {
        name: sim.plant.EvalBodyPoseInWorld(
            context,
            sim.plant.GetBodyByName(name, sim.plant.GetModelInstanceByName(name)),
        ).translation()[2]
        for name in ("cube", "ball")
    }
    # On the shelf and on the ground, into which they sink a little.
    assert heights["cube"] == pytest.approx(0.125, abs=1e-3)
    assert heights["ball"] == pytest.approx(0.1, abs=1e-3)
    assert sim.link_poses("one")["ball"].translation()[:2] == pytest.approx([0, 1])
    assert sim.link_poses("two")["ball"].translation()[:2] == pytest.approx([0, 0])


def test_a_thing_falls_without_a_robot(folder: Path) -> None:
    scene = load(
        folder,
        "{things: [{name: b, sphere: 0.1, mass: 1, pose: [0, 0, 9]}], world: void}",
    )
    simulator = Simulator(ad.build_diagram(scene))

    simulator.AdvanceTo(1.0)

    plant = simulator.get_system().GetSubsystemByName("plant")
    context = plant.GetMyContextFromRoot(simulator.get_context())
    height = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName("b"))
    # 1000 steps of Drake's symplectic Euler.
    expected = 9.0 - models.GRAVITY * 1e-6 * 1000 * 1001 / 2.0
    assert height.translation()[2] == pytest.approx(expected, abs=1e-9)


def test_each_robot_has_its_motion_in_its_own_time(tmp_path: Path) -> None:
    step = "- {at: 0.5, topic: /t, data: 1}\n"
    (tmp_path / "once.yaml").write_text(step, encoding="utf-8")
    (tmp_path / "again.yaml").write_text(
        "- {at: 0, every: 0.4, count: 1, controller: c, commands: [1]}\n"
        "- {repeat: true}\n",
        encoding="utf-8",
    )
    (tmp_path / "ball.urdf").write_text(models.FALLING_BALL, encoding="utf-8")
    scene = load(
        tmp_path,
        "robots:\n- {robot: ball.urdf, name: a, motion: once.yaml}\n"
        "- {robot: ball.urdf, name: b, motion: again.yaml}\n",
    )

    assert scene.motion is not None
    timeline = scene.motion.timeline()
    first = [next(timeline) for _ in range(4)]

    assert [time for time, _ in first] == pytest.approx([0.0, 0.4, 0.5, 0.8])
    assert [step.controller for _, step in first] == ["b/c", "b/c", None, "b/c"]
    assert scene.motion.duration == 0.5


def test_a_robot_has_the_controllers_of_its_name_space(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(models.TWO_LINKS)
    kind = "forward_command_controller/ForwardCommandController"
    own = "joints: [elbow], interface_name: position"
    sections = [
        f"/{side}:\n  controller_manager:\n    ros__parameters:\n"
        f"      {side}_arm: {{type: {kind}}}\n"
        f"  {side}_arm:\n    ros__parameters: {{{own}}}\n"
        for side in ("left", "right")
    ]
    (tmp_path / "both.yaml").write_text("".join(sections))
    robot = "{robot: arm.urdf, controllers: both.yaml, namespace: right}"

    scene = load(tmp_path, f"robots: [{robot}]")
    scene.save(tmp_path / "again.yaml")

    for each in (scene, ad.load_scene(tmp_path / "again.yaml")):
        names = [c.name for c in each.robots[0].controllers.controllers]
        assert names == ["right_arm"]


def test_a_saved_scene_is_loaded_as_it_was(scene: Scene, folder: Path) -> None:
    scene.save(folder / "again.yaml")

    again = ad.load_scene(folder / "again.yaml")

    assert again.to_data() == scene.to_data()
    assert again.things == scene.things
    assert again.options == scene.options
    assert dict(again.payloads) == dict(scene.payloads)
    # Its folder can be anywhere.
    text = (folder / "again.yaml").read_text(encoding="utf-8")
    assert str(folder) not in text
    validator().validate(yaml.safe_load(text))


@pytest.mark.slow
def test_a_scene_is_saved_as_it_is_now(scene: Scene, folder: Path) -> None:
    sim = ad.Simulation(ad.build_diagram(scene))
    sim.run(0.2)

    scene.at(sim).save(folder / "now.yaml")

    again = ad.Simulation(ad.build_diagram(ad.load_scene(folder / "now.yaml")))
    assert sim.joint_states("one").position != pytest.approx([0.5])
    for name in ("one", "two"):
        positions = sim.joint_states(name).position
        assert again.joint_states(name).position == pytest.approx(positions)
    # Quaternion and position of what moves, by the same names.
    before, after = (
        s.plant.GetPositions(s.plant.GetMyContextFromRoot(s.context))
        for s in (sim, again)
    )
    np.testing.assert_allclose(after, before, atol=1e-9)


@pytest.mark.slow
def test_a_base_is_saved_where_it_has_driven(tmp_path: Path) -> None:
    text = carts.cart(carts.diff_drive())
    (tmp_path / "cart.urdf").write_text(text, encoding="utf-8")
    scene = load(tmp_path, "robots: [{robot: cart.urdf, pose: [1, 2, 0.1, 0, 0, 0.5]}]")
    sim = ad.Simulation(ad.build_diagram(scene))
    sim.run(0.2)
    base = scene.robots[0].description.base

    scene.at(sim).save(tmp_path / "now.yaml")

    (now,) = ad.load_scene(tmp_path / "now.yaml").robots
    again = ad.Simulation(ad.build_diagram(now))
    pose = sim.link_poses()[base]
    assert now.has_free_base
    assert pose.translation()[2] < 0.1 - 1e-3  # It has fallen.
    assert again.link_poses()[base].IsNearlyEqualTo(pose, 1e-9)


def robot(more: str) -> str:
    return f"robots:\n- robot: ball.urdf\n  {more}\n"


def thing(more: str) -> str:
    return f"things:\n- {{name: a, {more}}}\n"


BALL = "sphere: 1, mass: 1"

# Malformed scenes: the line, and what is said.
MALFORMED = [
    ("", " it is empty; expected robots, things or both"),
    ("3", "1: expected a mapping with some of robots, world, things, options, got 3"),
    ("robots: []", "1: expected robots, things or both"),
    ("robots: 3", "1: robots: expected a list, got 3"),
    (
        "robos: []",
        "1: unknown key 'robos'; did you mean 'robots'? "
        "known: options, robots, things, world",
    ),
    (
        "robots:\n- {name: a}",
        "2: robots[0]: expected robot: a name, a file or a folder",
    ),
    (
        robot("pose: [0, 0]"),
        "3: robots[0].pose: expected 3 or 6 numbers, got 2",
    ),
    (
        robot("pose: [0, 0, up]"),
        "3: robots[0].pose[2]: expected a finite number, got 'up'",
    ),
    (
        robot("payload: {ball: -1}"),
        "3: robots[0].payload.ball: expected a finite number of at least 0, got -1",
    ),
    (
        robot("motion_parameters: {a: 1}"),
        "3: robots[0].motion_parameters: there is no motion beside them",
    ),
    (robot("decompose: 1"), "3: robots[0].decompose: expected true or false, got 1"),
    (
        robot("max_faces: 0"),
        "3: robots[0].max_faces: expected an integer of at least 1, got 0",
    ),
    (
        thing("box: [1, 1, 1]"),
        "2: things[0]: expected mass [kg], or fixed: true",
    ),
    (
        thing("mass: 1"),
        "2: things[0]: expected a name and one of box, cylinder, sphere, "
        "got name, mass",
    ),
    (
        thing("box: [1, 1, 0], mass: 1"),
        "2: things[0].box[2]: expected a finite number above 0, got 0",
    ),
    (
        thing(f"{BALL}, color: rde"),
        "2: things[0].color: unknown color 'rde'; did you mean 'red'? known: black, "
        "blue, brown, cyan, gray, green, orange, pink, purple, red, white, yellow",
    ),
    (
        thing(f"{BALL}, color: [0, 0, 2]"),
        "2: things[0].color: expected numbers from 0 to 1, got [0.0, 0.0, 2.0, 1.0]",
    ),
    (
        f"{thing(BALL)}options:\n  friction: true\n  time_step: -1",
        "5: options: time_step must be at least 1e-06 s, got -1.0",
    ),
    (
        f"{thing(BALL)}options: {{preset: quick}}",
        "3: options: no preset 'quick'; known: accurate, fast, kinematic",
    ),
    (f"{thing(BALL)}world: 3", "3: world: expected a text, got 3"),
]


# What only the files know that a scene names.
UNKNOWN = [
    (
        robot("payload: {bal: 1}"),
        "3: robots[0].payload: no link 'bal'; did you mean 'ball'? known: ball, base",
    ),
    (
        robot("payload: {world: 1}"),
        "3: robots[0].payload: 'world' is the world itself, it carries nothing",
    ),
    (
        robot("initial: {fal: 1}"),
        "2: robots[0]: initial position of joint 'fal': the robot has no such joint; "
        "did you mean 'fall'? known: fall",
    ),
    (
        f"{thing(BALL)}{robot('name: a')}",
        "2: things[0].name: something else is called 'a'; give it another name",
    ),
    (
        f"{robot('name: a')}- robot: ball.urdf\n  name: a",
        "5: robots[1].name: something else is called 'a'; give it another name",
    ),
    (
        f"{robot('pose: [0, 0, 0]')}- robot: ball.urdf",
        "4: robots[1]: something else is called 'falling_ball'; give it another name",
    ),
    (
        robot("controllers: missing.yaml"),
        "2: robots[0]: {folder}/missing.yaml: can't be read: No such file or directory",
    ),
    (
        robot("motion: missing.yaml"),
        "3: robots[0].motion: {folder}/missing.yaml: can't be read: No such file or "
        "directory",
    ),
    (
        robot("motion: wait.yaml\n  motion_parameters: {b: 1}"),
        "3: robots[0].motion: {folder}/wait.yaml: no parameter 'b'; the motion "
        "declares none",
    ),
    (
        f"{thing(BALL)}world: missing.sdf",
        "3: world: {folder}/missing.sdf: can't be read: No such file or directory",
    ),
    (
        f"{robot('name: a')}  pose: [0, 0, 1]\n  name: b\n",
        "5: the key 'name' stands twice",
    ),
    (
        f"{thing(BALL)}world: emty",
        "3: world: unknown world 'emty'; did you mean 'empty'? known: empty, house, "
        "house_table, void, or a .world or .sdf file",
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(("text", "message"), [*MALFORMED, *UNKNOWN])
def test_what_is_wrong_is_said_with_its_line(
    folder: Path, text: str, message: str
) -> None:
    with pytest.raises(InputError) as caught:
        load(folder, text)

    # Files beside one that isn't there are named, too; which is tested elsewhere.
    said = str(caught.value).partition("; there are")[0]
    message = message.replace("{folder}", str(folder))
    assert said == f"{folder / 'scene.yaml'}:{message}"


def validator() -> Draft202012Validator:
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


@pytest.mark.slow
@pytest.mark.parametrize("text", [text for text, _ in MALFORMED])
def test_the_schema_refuses_what_the_loader_does(text: str) -> None:
    assert not validator().is_valid(yaml.safe_load(text))


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        SCENE,
        robot("{}").replace("  {}\n", ""),
        robot("payload: {ball: 1}\n  pose: [1, 2, 3]\n  controllers: []"),
        robot("motion: wait.yaml\n  motion_parameters: {}\n  max_faces: 100"),
        robot("xacro_args: {}\n  variables: {a: 1}\n  package_paths: ./"),
        thing(f"{BALL}, fixed: true, color: [1, 1, 1]"),
        thing("cylinder: [1, 2], fixed: true"),
        f"{thing(BALL)}options: {{preset: fast, gravity: false, log_rate: 50}}",
        f"{thing(BALL)}options: {{time_step: null, reflected_inertia: true}}",
        f"{thing(BALL)}options: {{seed: 3, state_noise: {{effort: 1}}}}",
    ],
)
def test_the_loader_accepts_what_the_schema_does(folder: Path, text: str) -> None:
    validator().validate(yaml.safe_load(text))

    assert load(folder, text).file == folder / "scene.yaml"


def test_the_schema_knows_the_keys_that_the_loader_does() -> None:
    definitions: dict[str, Any] = json.loads(SCHEMA.read_text(encoding="utf-8"))[
        "$defs"
    ]
    options = {field.name for field in dc.fields(ad.SimulationOptions)}

    # Who draws says how often.
    assert set(definitions["options"]["properties"]) == options - {"frame_rate"}
    things = {field.name for field in dc.fields(ad.Thing)} - {"kind", "size"}
    shapes = {"box", "cylinder", "sphere"}
    assert set(definitions["thing"]["properties"]) == things | shapes


def test_a_name_of_the_world_is_taken(folder: Path) -> None:
    scene = dc.replace(
        load(folder, thing("sphere: 0.1, mass: 1")),
        world=lambda p: p.AddModelInstance("a"),
    )

    with pytest.raises(InputError, match="thing 'a': the world has a model of this"):
        ad.build_diagram(scene)
    with pytest.raises(InputError, match="expected a world by name, or of a file"):
        scene.to_data()


def test_colors_are_seen(scene: Scene) -> None:
    assert scene.things[0].color == pytest.approx((0.8, 0.1, 0.1, 1.0))
    np.testing.assert_array_equal(scene.things[2].color, [0.0, 0.5, 1.0, 0.8])


@pytest.mark.slow
def test_the_example_of_the_docs_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    page = Path(__file__).parents[1] / "docs/scenes.md"
    blocks = {block.language: block.text for block in read_blocks(page)}
    Path("scene.yaml").write_text(blocks["yaml"], encoding="utf-8")
    validator().validate(yaml.safe_load(blocks["yaml"]))
    names: dict[str, Any] = {}

    exec(compile(blocks["python"], page, "exec"), names)  # noqa: S102  our own text.

    later = ad.load_scene("later.yaml")
    left = names["sim"].joint_states("left")
    assert later.robots[0].initial_positions == pytest.approx(
        dict(zip(left.name, left.position, strict=True))
    )
    # The cube stands on the table.
    assert later.things[0].pose[2] == pytest.approx(0.125, abs=1e-3)
    assert later.robots[1].pose == (0.0, -0.8, 0.0, 0.0, 0.0, 0.0)
