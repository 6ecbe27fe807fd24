"""Pictures of a simulation as it is now."""

import math

from pydrake.geometry import Meshcat, MeshcatVisualizer

from arm_drake.motion import Motion
from arm_drake.playback import Player
from arm_drake.simulation import TICK_TOLERANCE, Simulation
from arm_drake.visualization.meshcat import frame_shapes, start_recording


def draw(simulation: Simulation) -> None:
    """Have a simulation's diagram draw its robots.

    Args:
        simulation: One whose diagram has a Meshcat.
    """
    root = simulation.simulator.get_context()
    for system in simulation.diagram.GetSystems():
        if isinstance(system, MeshcatVisualizer):
            system.ForcedPublish(system.GetMyContextFromRoot(root))


def record(simulation: Simulation, meshcat: Meshcat, frame_rate: float) -> None:
    """Record what is drawn from now on, beginning with what is to be seen now.

    Args:
        simulation: What is drawn.
        meshcat: Where it is drawn, at this rate.
        frame_rate: Pictures per simulated second [Hz].
    """
    start_recording(meshcat, frame_rate)
    draw(simulation)


def frame_robots(simulation: Simulation, meshcat: Meshcat) -> None:
    """Point the camera so that all of the robots is to be seen, where they are now.

    Args:
        simulation: A simulation with robots.
        meshcat: Where they are drawn.
    """
    scene_graph = simulation.diagram.GetSubsystemByName("scene_graph")
    root = simulation.simulator.get_context()
    context = scene_graph.GetMyContextFromRoot(root)
    query = scene_graph.get_query_output_port().Eval(context)
    frame_shapes(meshcat, query, models=list(simulation.robots))


def film(
    simulation: Simulation,
    meshcat: Meshcat,
    duration: float,
    motion: Motion | None = None,
    *,
    frame_rate: float,
) -> str:
    """Simulate for a while; return a page of HTML on which it plays.

    Args:
        simulation: What to simulate. Its diagram draws on the Meshcat when it is told
            to, see `SimulationOptions.frame_rate`.
        meshcat: Where it is drawn.
        duration: How long [s].
        motion: What to send, its times counted from now.
        frame_rate: Pictures per simulated second [Hz].

    Raises:
        MotionError: As `Simulation.run`.
    """
    player = Player(simulation, motion, TICK_TOLERANCE * simulation.period)
    record(simulation, meshcat, frame_rate)
    start, count = simulation.time, math.floor(duration * frame_rate + 1e-9)
    for picture in (*range(1, count + 1), None):
        passed = duration if picture is None else picture / frame_rate
        player.play(max(start + passed - simulation.time, 0.0))
        draw(simulation)
    meshcat.StopRecording()
    meshcat.PublishRecording()
    return meshcat.StaticHtml()
