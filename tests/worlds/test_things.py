"""Things of a world: where they are."""

import pytest

import arm_drake as ad
from arm_drake.worlds.things import with_things
from arm_drake.worlds.world import load_world
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
