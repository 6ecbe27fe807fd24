"""ROS 2 robot packages, unchanged, as Drake diagrams."""

import importlib
from typing import TYPE_CHECKING, Any

from arm_drake.importing import without_collection

if TYPE_CHECKING:
    from arm_drake.batch import Outcome as Outcome
    from arm_drake.batch import Run as Run
    from arm_drake.batch import RunError as RunError
    from arm_drake.batch import RunResult as RunResult
    from arm_drake.batch import RunResults as RunResults
    from arm_drake.batch import RunsInterrupted as RunsInterrupted
    from arm_drake.batch import iterate_many as iterate_many
    from arm_drake.batch import run_many as run_many
    from arm_drake.controllers import ControllerType as ControllerType
    from arm_drake.controllers import register_controller as register_controller
    from arm_drake.controllers.controller_interface import (
        ControllerInterface as ControllerInterface,
    )
    from arm_drake.controllers.controller_interface import (
        ControllerInterfaceParams as ControllerInterfaceParams,
    )
    from arm_drake.controllers.controller_interface import (
        TickingController as TickingController,
    )
    from arm_drake.controllers.cycles import Now as Now
    from arm_drake.description.report import LoadReport as LoadReport
    from arm_drake.description.robot import Robot as Robot
    from arm_drake.diagram import build_diagram as build_diagram
    from arm_drake.errors import ArmDrakeError as ArmDrakeError
    from arm_drake.errors import ParameterError as ParameterError
    from arm_drake.loading import load_robot as load_robot
    from arm_drake.messages import Float64MultiArray as Float64MultiArray
    from arm_drake.messages import (
        FollowJointTrajectoryGoal as FollowJointTrajectoryGoal,
    )
    from arm_drake.messages import GoalStatus as GoalStatus
    from arm_drake.messages import Header as Header
    from arm_drake.messages import JointState as JointState
    from arm_drake.messages import JointTolerance as JointTolerance
    from arm_drake.messages import JointTrajectory as JointTrajectory
    from arm_drake.messages import JointTrajectoryPoint as JointTrajectoryPoint
    from arm_drake.messages import MultiDOFCommand as MultiDOFCommand
    from arm_drake.messages import SpeedScalingFactor as SpeedScalingFactor
    from arm_drake.messages import SwitchController as SwitchController
    from arm_drake.notebook import PageHandle as PageHandle
    from arm_drake.notebook import Recording as Recording
    from arm_drake.notebook import animate as animate
    from arm_drake.notebook import simulate as simulate
    from arm_drake.notebook import view as view
    from arm_drake.options import SimulationOptions as SimulationOptions
    from arm_drake.rollout.rollout import Rollout as Rollout
    from arm_drake.simulation.clients import ControllerHandle as ControllerHandle
    from arm_drake.simulation.mailbox import GoalHandle as GoalHandle
    from arm_drake.simulation.motion import Motion as Motion
    from arm_drake.simulation.motion_files import load_motion as load_motion
    from arm_drake.simulation.simulation import Simulation as Simulation
    from arm_drake.visualization.meshcat import start_meshcat as start_meshcat
    from arm_drake.visualization.page import Page as Page
    from arm_drake.visualization.page.live_simulation import (
        LiveSimulation as LiveSimulation,
    )
    from arm_drake.visualization.page.robot_viewer import RobotViewer as RobotViewer

# Where each public name is defined; imported when it is first used.
_MODULES = {
    "ArmDrakeError": "errors",
    "ControllerHandle": "simulation.clients",
    "ControllerInterface": "controllers.controller_interface",
    "ControllerInterfaceParams": "controllers.controller_interface",
    "ControllerType": "controllers",
    "Float64MultiArray": "messages",
    "FollowJointTrajectoryGoal": "messages",
    "GoalHandle": "simulation.mailbox",
    "GoalStatus": "messages",
    "Header": "messages",
    "JointState": "messages",
    "JointTolerance": "messages",
    "JointTrajectory": "messages",
    "JointTrajectoryPoint": "messages",
    "LiveSimulation": "visualization.page.live_simulation",
    "LoadReport": "description.report",
    "Motion": "simulation.motion",
    "MultiDOFCommand": "messages",
    "Now": "controllers.cycles",
    "Outcome": "batch",
    "Page": "visualization.page",
    "PageHandle": "notebook",
    "ParameterError": "errors",
    "Recording": "notebook",
    "Robot": "description.robot",
    "RobotViewer": "visualization.page.robot_viewer",
    "Rollout": "rollout.rollout",
    "Run": "batch",
    "RunError": "batch",
    "RunResult": "batch",
    "RunResults": "batch",
    "RunsInterrupted": "batch",
    "Simulation": "simulation.simulation",
    "SimulationOptions": "options",
    "SpeedScalingFactor": "messages",
    "SwitchController": "messages",
    "TickingController": "controllers.controller_interface",
    "animate": "notebook",
    "build_diagram": "diagram",
    "iterate_many": "batch",
    "load_motion": "simulation.motion_files",
    "load_robot": "loading",
    "register_controller": "controllers",
    "run_many": "batch",
    "simulate": "notebook",
    "start_meshcat": "visualization.meshcat",
    "view": "notebook",
}

__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    with without_collection():
        module = importlib.import_module(f"{__name__}.{_MODULES[name]}")
    value = getattr(module, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names."""
    return __all__
