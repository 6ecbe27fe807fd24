"""Pictures of the current state of a simulation."""

import math
from collections.abc import Callable

from pydrake.geometry import Meshcat, MeshcatVisualizer

from arm_drake.simulation.motion import Motion, default_duration
from arm_drake.simulation.playback import Player
from arm_drake.simulation.simulation import TICK_TOLERANCE, Simulation
from arm_drake.visualization.meshcat import THREE_QUARTER, frame_shapes

# Room for a robot that is going to move, in parts of its diameter.
ROOM_TO_MOVE = 0.3


def draw(simulation: Simulation) -> None:
    """Draw the robots of a simulation by its diagram."""
    root = simulation.simulator.get_context()
    for system in simulation.diagram.GetSystems():
        if isinstance(system, MeshcatVisualizer):
            system.ForcedPublish(system.GetMyContextFromRoot(root))


def frame_robots(
    simulation: Simulation,
    meshcat: Meshcat,
    *,
    room: float = 0.0,
    direction: tuple[float, float, float] = THREE_QUARTER,
) -> float:
    """Point the camera so that all of the robots is to be seen, where they are now.

    Return how far they reach below the ground; see `frame_shapes`.
    """
    scene_graph = simulation.diagram.GetSubsystemByName("scene_graph")
    root = simulation.simulator.get_context()
    context = scene_graph.GetMyContextFromRoot(root)
    query = scene_graph.get_query_output_port().Eval(context)
    models = list(simulation.robots)
    return frame_shapes(meshcat, query, models=models, room=room, direction=direction)


def run_drawing(
    simulation: Simulation,
    duration: float | None,
    motion: Motion | None = None,
    *,
    draw: Callable[[], None],
    frame_rate: float,
    realtime_rate: float = 0.0,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Simulate for a while [s] and draw at equal times, and at once.

    `duration` is None for that of the motion, as `Simulation.run` has it.

    The diagram draws when it is told to, see `SimulationOptions.frame_rate`. Times of
    the motion are counted from now. `frame_rate` is in pictures per simulated second,
    `realtime_rate` in simulated seconds per second; 0 is as fast as it goes.
    """
    player = Player(simulation, motion, TICK_TOLERANCE * simulation.period)
    draw()
    ends = duration is None
    if duration is None:
        duration = default_duration(motion)
    start, count = simulation.time, math.floor(duration * frame_rate + 1e-9)
    with player.paced(realtime_rate):
        for picture in (*range(1, count + 1), None):
            passed = duration if picture is None else picture / frame_rate
            player.play(max(start + passed - simulation.time, 0.0), ends=ends)
            draw()
            if progress is not None:
                progress(simulation.time)
            if ends and player.is_over:
                break
