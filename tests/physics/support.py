"""Robots of one joint under an effort interface, and the means to run them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

import arm_drake as ad
from tests import models

# No limit is to act, and nothing that goes with one.
WIDE = 'lower="-1000" upper="1000" effort="1000" velocity="100"'

# A bob beside an axis along z, or below one along y. On a slide it doesn't matter.
BESIDE = f"{models.LENGTH} 0 0"
BELOW = f"0 0 {-models.LENGTH}"

# The controller that tells every joint its effort.
EFFORT = "effort"


def one_joint(type: str, axis: str, *, center: str = BESIDE, dynamics: str = "") -> str:
    """Return a bob of 1 kg on a joint "axis" with an effort interface.

    Args:
        type: URDF type of the joint.
        axis: Its axis.
        center: Centre of mass of the bob, from the joint [m].
        dynamics: Attributes of `<dynamics>`; empty leaves it out.
    """
    inside = f"<dynamics {dynamics}/>" if dynamics else ""
    joint = models.joint(
        "axis", "base", "bob", axis=axis, type=type, limit=WIDE, inside=inside
    )
    control = models.ros2_control("axis", command="effort")
    links = f'<link name="base"/>{models.bob("bob", center)}'
    return f'<robot name="one_joint">{links}{joint}{control}</robot>'


def inertia(type: str) -> float:
    """Return what the joint of `one_joint` moves, [kg] or [kg·m^2]."""
    return models.MASS if type == "prismatic" else models.INERTIA


def effort_controller(joints: Sequence[str] = ("axis",), *, rate: int = 100) -> str:
    """Return a YAML with a controller that writes efforts; at first it writes 0."""
    names = ", ".join(joints)
    return f"""
controller_manager:
  ros__parameters:
    update_rate: {rate}
    {EFFORT}: {{type: forward_command_controller/ForwardCommandController}}
{EFFORT}:
  ros__parameters: {{joints: [{names}], interface_name: effort}}
"""


def simulate(
    folder: Path,
    urdf: str,
    yaml: str,
    *,
    step: float,
    start: dict[str, float] | None = None,
    speed: Sequence[float] | None = None,
    log_rate: float | None = None,
    preset: str = "accurate",
) -> ad.Simulation:
    """Return a simulation that logs at every step of the plant.

    Args:
        folder: Where to write the robot.
        urdf: The robot.
        yaml: Its controllers.
        step: Step of the plant [s].
        start: Initial positions [rad] or [m].
        speed: Initial velocities [rad/s] or [m/s], as the plant orders them; None is
            rest. The first row of the log doesn't show them.
        log_rate: Rate of the log [Hz]; None logs every step.
        preset: Preset of the simulation.
    """
    robot = models.load(folder, urdf, yaml, initial_positions=start)
    rate = 1.0 / step if log_rate is None else log_rate
    options = ad.SimulationOptions(preset, time_step=step, log_rate=rate)
    diagram = ad.build_diagram(robot, world="void", options=options)
    simulation = ad.Simulation(diagram)
    if speed is not None:
        plant = diagram.GetSubsystemByName("plant")
        assert isinstance(plant, MultibodyPlant)
        root = simulation.simulator.get_mutable_context()
        plant.SetVelocities(plant.GetMyMutableContextFromRoot(root), np.array(speed))
    return simulation
