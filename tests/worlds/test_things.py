"""Things of a world: where they are."""

from pathlib import Path

import pytest
from pydrake.geometry import Role, SceneGraph

import arm_drake as ad
from arm_drake.worlds.things import with_things
from arm_drake.worlds.world import load_world
from tests import models
from tests.robots import load_real_robot


@pytest.mark.slow
def test_a_simulation_says_where_what_moves_freely_is() -> None:
    ball = ad.Thing("ball", "sphere", (0.02,), mass=0.1, pose=(2.0, 0, 1.0, 0, 0, 0))
    size, pose = (0.1, 0.1, 0.1), (3.0, 0, 0.05, 0, 0, 0)
    post = ad.Thing("post", "box", size, fixed=True, pose=pose)
    world = with_things(load_world("empty"), [ball, post])
    base = load_real_robot("pmb2")  # It moves freely, too.
    simulation = ad.Simulation(ad.build_diagram(base, world=world))

    simulation.advance_to(0.2)

    assert list(simulation.things) == ["ball"]
    assert simulation.eval_output("things.ball").IsExactlyEqualTo(
        simulation.things["ball"]
    )
    assert not simulation.diagram.HasOutputPort("things.post")
    fallen = 1.0 - 0.5 * 9.81 * 0.2**2  # But for the steps of the integration.
    assert simulation.things["ball"].translation() == pytest.approx(
        [2.0, 0.0, fallen], abs=2e-3
    )


def test_a_large_ball_has_no_more_facets_than_one_that_is_held(tmp_path: Path) -> None:
    radii = (0.1, 1.0)  # [m]. With facets of one size it would have a thousand times.
    balls = [
        ad.Thing(f"ball{r}", "sphere", (r,), mass=1.0, pose=(5 * r + 2, 0, r, 0, 0, 0))
        for r in radii
    ]
    world = with_things(load_world("empty"), balls)
    robot = models.load(tmp_path, models.TWO_LINKS)

    diagram = ad.build_diagram(robot, world=world)

    scene_graph = diagram.GetSubsystemByName("scene_graph")
    assert isinstance(scene_graph, SceneGraph)
    inspector = scene_graph.model_inspector()
    small, large = (
        inspector.maybe_get_hydroelastic_mesh(geometry).num_elements()
        for radius in radii
        for geometry in inspector.GetAllGeometryIds(Role.kProximity)
        if f"ball{radius}" in inspector.GetName(inspector.GetFrameId(geometry))
    )
    assert large <= 2 * small


def test_a_flat_ellipsoid_has_few_facets(tmp_path: Path) -> None:
    disk = "<geometry><ellipsoid><radii>1 0.01 1</radii></ellipsoid></geometry>"
    path = tmp_path / "world.sdf"
    path.write_text(
        '<sdf version="1.9"><world name="w"><model name="disk"><link name="link">'
        f'<collision name="c">{disk}</collision></link></model></world></sdf>'
    )
    robot = models.load(tmp_path, models.TWO_LINKS)

    diagram = ad.build_diagram(robot, world=path)

    scene_graph = diagram.GetSubsystemByName("scene_graph")
    assert isinstance(scene_graph, SceneGraph)
    inspector = scene_graph.model_inspector()
    (mesh,) = (
        inspector.maybe_get_hydroelastic_mesh(geometry)
        for geometry in inspector.GetAllGeometryIds(Role.kProximity)
        if "disk" in inspector.GetName(inspector.GetFrameId(geometry))
    )
    # With facets of 1 cm it has half a million.
    assert mesh.num_elements() < 10_000
