"""Payloads weigh what they weigh, where they are, from when they are there."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import Box, Cylinder, Sphere
from pydrake.multibody.tree import SpatialInertia

import arm_drake as ad
from arm_drake.cli import main
from arm_drake.errors import InputError, MotionError
from arm_drake.simulation.motion_files import parse_motion

GRAVITY = np.array([0.0, 0.0, -9.81])
COM = (0.03, -0.02, 0.1)

# Bent, so that every joint but the first feels it.
ANGLES = (0.3, 0.5, 0.9, 0.4, -0.6, 0.2)
POSE = {f"joint{number}": angle for number, angle in enumerate(ANGLES, 1)}

POST = """<robot name="post">
  <link name="world"/>
  <link name="base"/>
  <joint name="fix" type="fixed"><parent link="world"/><child link="base"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def robot() -> ad.Robot:
    return ad.load_robot("doosan_a0912", initial_positions=POSE)


def start(robot: ad.Robot, payloads: Any = None, **options: Any) -> ad.Simulation:
    settings = ad.SimulationOptions(time_step=0.01, friction=False, **options)
    diagram = ad.build_diagram(robot, options=settings, payloads=payloads)
    return ad.Simulation(diagram)


def efforts(sim: ad.Simulation) -> np.ndarray:
    """Return the efforts of the joints when all is at rest [N·m]."""
    sim.run(3.0)
    return np.array(sim.joint_states().effort)


def needed(sim: ad.Simulation, mass: float, com: Any) -> np.ndarray:
    """Return what holds a mass on link6 [N·m], by its lever about each axis."""
    poses = sim.link_poses()
    place = poses["link6"] @ np.array(com)
    return np.array(
        [
            -X.rotation().col(2) @ np.cross(place - X.translation(), mass * GRAVITY)
            for X in (poses[f"link{n}"] for n in range(1, 7))
        ]
    )


@pytest.fixture(scope="module")
def bare(robot: ad.Robot) -> np.ndarray:
    return efforts(start(robot))


@pytest.mark.slow
@pytest.mark.parametrize("shape", [None, Sphere(0.04)])
def test_it_is_held_by_what_its_lever_asks_for(
    robot: ad.Robot, bare: np.ndarray, shape: Any
) -> None:
    sim = start(robot, {"link6": ad.Payload(2.0, COM, shape=shape)})

    extra = efforts(sim) - bare

    assert np.abs(extra).max() > 10.0
    np.testing.assert_allclose(extra, needed(sim, 2.0, COM), atol=2e-3)


@pytest.mark.slow
def test_it_comes_changes_and_goes_on_the_way(
    robot: ad.Robot, bare: np.ndarray
) -> None:
    sim = start(robot)
    for payload, mass, com in (
        (2.0, 2.0, (0, 0, 0)),
        (ad.Payload(1.0, COM), 1.0, COM),
        (0.0, 0.0, (0, 0, 0)),
    ):
        sim.set_payload("link6", payload)
        np.testing.assert_allclose(
            efforts(sim) - bare, needed(sim, mass, com), atol=2e-3
        )

    sim.set_payload("link6", 5.0)
    sim.reset()
    np.testing.assert_allclose(efforts(sim), bare, atol=1e-9)


@pytest.mark.slow
def test_one_that_is_built_in_can_be_changed(robot: ad.Robot, bare: np.ndarray) -> None:
    sim = start(robot, {"link6": 2.0})
    sim.set_payload("link6", ad.Payload(0.5, COM))

    np.testing.assert_allclose(efforts(sim) - bare, needed(sim, 0.5, COM), atol=2e-3)


@pytest.mark.slow
def test_a_motion_brings_it_at_its_time(robot: ad.Robot, bare: np.ndarray) -> None:
    payload = {"link6": {"mass": 2.0, "com": list(COM)}}
    sim = start(robot)

    sim.run(6.0, parse_motion([{"at": 3.0, "payload": payload}]))

    rollout = sim.rollout()
    before = rollout.effort[np.searchsorted(rollout.time, 2.99)]
    np.testing.assert_allclose(before, bare, atol=2e-3)
    after = rollout.effort[-1] - bare
    np.testing.assert_allclose(after, needed(sim, 2.0, COM), atol=5e-3)


@pytest.mark.slow
def test_a_run_has_it_as_the_command_line_has(robot: ad.Robot, tmp_path: Path) -> None:
    words = [f"--initial={name}={value}" for name, value in POSE.items()]
    log = tmp_path / "log.npz"
    x, y, z = COM
    code = main(
        [
            *("sim", "doosan_a0912", "--headless", "--duration", "1", *words),
            *("--payload", f"link6=2.0,{x},{y},{z}", "--log", str(log)),
        ]
    )
    (result,) = ad.run_many(
        [ad.Run(robot=robot, duration=1.0, payloads={"link6": ad.Payload(2.0, COM)})]
    )

    assert code == 0
    rollout = ad.Rollout.load(log)
    assert np.array_equal(rollout.effort, result.value.rollout.effort)
    assert np.abs(rollout.effort).max() > 10.0


@pytest.mark.slow
def test_of_several_robots_each_has_its_own(robot: ad.Robot) -> None:
    left, right = (
        ad.load_robot("lab5_arm", name=name, pose=[0, y, 0, 0, 0, 0])
        for name, y in (("left", 1.0), ("right", -1.0))
    )
    diagram = ad.build_diagram([left, right], payloads={"right/arm3_link": 3.0})
    plant = ad.Simulation(diagram).plant
    context = plant.CreateDefaultContext()
    masses = [
        plant.CalcTotalMass(context, [plant.GetModelInstanceByName(name)])
        for name in ("left", "right")
    ]

    assert masses[1] - masses[0] == pytest.approx(3.0)


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["accurate", "fast"])
def test_its_shape_is_seen_and_collides(robot: ad.Robot, preset: str) -> None:
    rod = ad.Payload(0.5, COM, shape=Cylinder(0.02, 1.2))
    sim = start(robot, {"link6": rod}, preset=preset)

    inspector = sim.diagram.GetSubsystemByName("scene_graph").model_inspector()
    link = sim.plant.GetBodyByName("link6")
    seen, solid = (
        [g for g in shapes if inspector.GetName(g).endswith("payload")]
        for shapes in (
            sim.plant.GetVisualGeometriesForBody(link),
            sim.plant.GetCollisionGeometriesForBody(link),
        )
    )

    # The preset fast is for robots that touch nothing.
    assert (len(seen), len(solid)) == (1, preset == "accurate")
    for shape in (*seen, *solid):
        place = inspector.GetPoseInFrame(shape).translation()
        np.testing.assert_array_equal(place, COM)
        assert inspector.GetShape(shape).length() == 1.2


@pytest.mark.slow
def test_what_it_touches_pushes_the_arm(robot: ad.Robot) -> None:
    # A rod across the hand of an arm that bends forward, until the rod stands.
    above = ad.load_robot("doosan_a0912", initial_positions={"joint2": 0.8})
    rod = ad.Payload(0.1, (0.3, 0.0, 0.0), shape=Box(0.8, 0.04, 0.04))
    options = ad.SimulationOptions(log_contacts=True)
    diagram = ad.build_diagram(
        above, world="house", payloads={"link6": rod}, options=options
    )
    sim = ad.Simulation(diagram)
    sim.controller("joint_trajectory_controller").send_trajectory(
        ad.JointTrajectory(
            joint_names=list(POSE),
            points=[
                ad.JointTrajectoryPoint(
                    positions=[0, 1.5, 0, 0, 0, 0], time_from_start=1.0
                )
            ],
        )
    )
    sim.run(2.0)

    rollout = sim.rollout()
    touching = rollout.contact_forces["link6"][:, 2]
    assert touching[0] == 0.0
    assert touching[-1] > 10.0
    assert rollout.contact_forces["link5"][-1, 2] == 0.0


def test_inertia_is_that_of_the_shape_or_as_given() -> None:
    box = ad.Payload(2.0, COM, shape=Box(0.1, 0.2, 0.3))
    given = [2.0 / 12.0 * s for s in (0.04 + 0.09, 0.01 + 0.09, 0.01 + 0.04)]
    same = ad.Payload(2.0, COM, inertia=[*given, 0.0, 0.0, 0.0])
    expected = SpatialInertia.SolidBoxWithMass(2.0, 0.1, 0.2, 0.3)

    central = box.spatial_inertia().Shift(np.array(COM))
    for payload in (box, same):
        np.testing.assert_allclose(
            payload.spatial_inertia().CopyToFullMatrix6(),
            box.spatial_inertia().CopyToFullMatrix6(),
            atol=1e-15,
        )
    np.testing.assert_allclose(
        central.CopyToFullMatrix6(), expected.CopyToFullMatrix6(), atol=1e-15
    )


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"mass": -1.0}, "mass: expected at least 0 kg, got -1.0"),
        ({"mass": float("nan")}, "mass: expected at least 0 kg, got nan"),
        ({"mass": True}, "mass: expected at least 0 kg, got True"),
        ({"mass": 10**400}, f"mass: expected at least 0 kg, got {10**400}"),
        ({"mass": 1.0, "com": (1, 2)}, "com: expected 3 numbers, got (1, 2)"),
        (
            {"mass": 1.0, "inertia": (1, 1, 5, 0, 0, 0)},
            "inertia: no thing of its mass has [1, 1, 5, 0, 0, 0]",
        ),
        (
            {"mass": 1.0, "shape": "box"},
            "shape: expected one of Box, Capsule, Cylinder, Ellipsoid, Sphere, "
            "got 'box'",
        ),
    ],
)
def test_what_no_thing_has_is_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        ad.Payload(**fields)

    assert str(caught.value) == message


@pytest.mark.parametrize("payloads", [{"link9": 1.0}, {"link6": "heavy"}, 3.0])
def test_what_no_link_carries_is_refused(robot: ad.Robot, payloads: Any) -> None:
    with pytest.raises(InputError, match="payload"):
        start(robot, payloads)


def test_the_world_carries_nothing(tmp_path: Path) -> None:
    # Its own link of that name doesn't change that; it has no body of the robot.
    file = tmp_path / "post.urdf"
    file.write_text(POST)
    text = "'world' is the world itself, it carries nothing"
    with pytest.raises(InputError, match=f"^payload: {text}$"):
        start(ad.load_robot(file), {"world": 1.0})
    sim = start(ad.load_robot(file))
    with pytest.raises(InputError, match=f"^payload: {text}$"):
        sim.set_payload("world", 1.0)
    with pytest.raises(MotionError, match=rf"^\[0\].payload: {text}$"):
        sim.run(1.0, parse_motion([{"payload": {"world": 1.0}}]))
    with pytest.raises(InputError, match=r"no link 'wrld'; known: base$"):
        sim.set_payload("wrld", 1.0)

    two = [ad.load_robot(file, name=name) for name in ("a", "b")]
    with pytest.raises(InputError, match="'b/world' is the world itself"):
        ad.build_diagram(two, payloads={"b/world": 1.0})


def test_without_physics_there_is_nothing_to_weigh(robot: ad.Robot) -> None:
    with pytest.raises(InputError, match="no physics"):
        start(robot, {"link6": 1.0}, preset="kinematic")
    sim = start(robot, preset="kinematic")
    with pytest.raises(InputError, match="no physics"):
        sim.set_payload("link6", 1.0)


@pytest.mark.parametrize(
    ("step", "message"),
    [
        ({"payload": {"link9": 1}}, "[0].payload: no link 'link9'"),
        ({"payload": {"link6": "a"}}, "[0].payload.link6.mass: expected a finite"),
        ({"payload": {"link6": -1}}, "[0].payload.link6: mass: expected at least 0"),
        ({"payload": {"link6": {"com": [0, 0, 0]}}}, "[0].payload.link6.mass: "),
        ({"payload": {}}, "[0].payload: expected payloads by link"),
        ({"payload": {"link6": 1}, "controller": "a"}, "[0].controller: payload is"),
    ],
)
def test_a_step_that_cannot_be_says_where(
    robot: ad.Robot, step: dict[str, Any], message: str
) -> None:
    sim = start(robot)

    with pytest.raises(MotionError) as caught:
        sim.run(1.0, parse_motion([step]))

    assert str(caught.value).startswith(message)


@pytest.mark.slow
@pytest.mark.parametrize("text", ["x", "1,2", "", "-1", "nan"])
def test_words_that_are_no_payload_are_one_message(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--headless", "--duration", "0.1", "--payload", f"link6={text}"]

    assert main(["sim", "doosan_a0912", *words]) == 2

    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith(f"arm-drake: --payload link6={text}: ")
