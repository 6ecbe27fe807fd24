"""The public names, for type checkers and for `__init__.py`, which imports them."""

# One statement for each module.
# ruff: isort: skip_file

from arm_drake import testing as testing
from arm_drake.batch.api import (
    iterate_many as iterate_many,
    run_many as run_many,
)
from arm_drake.batch.linear_model import (
    LinearModel as LinearModel,
    Margins as Margins,
    Pole as Pole,
)
from arm_drake.batch.linearization import linearize as linearize
from arm_drake.batch.processes import RunError as RunError
from arm_drake.batch.runs import (
    Outcome as Outcome,
    Run as Run,
    RunResult as RunResult,
    RunResults as RunResults,
    RunsInterrupted as RunsInterrupted,
)
from arm_drake.batch.statistics import (
    Interval as Interval,
    mean_interval as mean_interval,
    rate_interval as rate_interval,
)
from arm_drake.batch.study import (
    Study as Study,
    load_study as load_study,
)
from arm_drake.batch.tuning import (
    Tuning as Tuning,
    measure_gains as measure_gains,
    tune_gains as tune_gains,
)
from arm_drake.controllers import (
    ControllerType as ControllerType,
    register_controller as register_controller,
)
from arm_drake.controllers.controller_interface import (
    ControllerInterface as ControllerInterface,
    ControllerInterfaceParams as ControllerInterfaceParams,
    TickingController as TickingController,
)
from arm_drake.controllers.cycles import Now as Now
from arm_drake.controllers.cycles import UpdateContext as UpdateContext
from arm_drake.description.report import LoadReport as LoadReport
from arm_drake.description.robot import Robot as Robot
from arm_drake.diagram import build_diagram as build_diagram
from arm_drake.environments.environment import (
    Environment as Environment,
    Evaluation as Evaluation,
    ReachTask as ReachTask,
    Task as Task,
    TaskShape as TaskShape,
    make_env as make_env,
)
from arm_drake.errors import (
    ArmDrakeError as ArmDrakeError,
    DescriptionError as DescriptionError,
    InputError as InputError,
    ArmDrakeWarning as ArmDrakeWarning,
    MissingExtraError as MissingExtraError,
    MotionError as MotionError,
    OutputError as OutputError,
    PackageError as PackageError,
    ParameterError as ParameterError,
    SimulationError as SimulationError,
)
from arm_drake.loading import load_robot as load_robot
from arm_drake.messages import (
    Float64MultiArray as Float64MultiArray,
    FollowJointTrajectoryGoal as FollowJointTrajectoryGoal,
    GoalStatus as GoalStatus,
    Header as Header,
    JointState as JointState,
    JointTolerance as JointTolerance,
    JointTrajectory as JointTrajectory,
    JointTrajectoryPoint as JointTrajectoryPoint,
    MultiDOFCommand as MultiDOFCommand,
    SpeedScalingFactor as SpeedScalingFactor,
    SwitchController as SwitchController,
)
from arm_drake.launch.launch_files import load_launch as load_launch
from arm_drake.launch.plan import LaunchArgument as LaunchArgument
from arm_drake.launch.plan import LaunchPlan as LaunchPlan
from arm_drake.launch.robot import LaunchedRobot as LaunchedRobot
from arm_drake.planning.grasps import Grasp as Grasp
from arm_drake.planning.grasps import find_grasps as find_grasps
from arm_drake.planning.grippers import Gripper as Gripper
from arm_drake.planning.grippers import find_gripper as find_gripper
from arm_drake.manipulation.hand import PickOptions as PickOptions
from arm_drake.manipulation.pick_and_place import (
    Attempt as Attempt,
    PickResult as PickResult,
    PlaceResult as PlaceResult,
    held_thing as held_thing,
    pick as pick,
    place as place,
)
from arm_drake.manipulation.visual_servoing import (
    FollowOptions as FollowOptions,
    FollowResult as FollowResult,
    follow as follow,
)
from arm_drake.notebook import (
    PageHandle as PageHandle,
    Recording as Recording,
    animate as animate,
    simulate as simulate,
    view as view,
)
from arm_drake.options import SimulationOptions as SimulationOptions
from arm_drake.perception.boxes import FoundBox as FoundBox
from arm_drake.perception.boxes import find_box as find_box
from arm_drake.perception.cameras import (
    CameraHandle as CameraHandle,
    add_camera as add_camera,
)
from arm_drake.perception.lidar import LidarHandle as LidarHandle
from arm_drake.planning.groups import (
    PlanningGroup as PlanningGroup,
    planning_groups as planning_groups,
)
from arm_drake.planning.inverse_kinematics import (
    IkSolution as IkSolution,
    NoSolution as NoSolution,
    forward_kinematics as forward_kinematics,
    solve_ik as solve_ik,
)
from arm_drake.planning.motion_planning import Plan as Plan
from arm_drake.planning.motion_planning import plan as plan
from arm_drake.planning.orientation_constraint import (
    OrientationConstraint as OrientationConstraint,
)
from arm_drake.planning.setting import PlanningError as PlanningError
from arm_drake.planning.setting import PlanOptions as PlanOptions
from arm_drake.plant.payloads import Payload as Payload
from arm_drake.rollout.rollout import Rollout as Rollout
from arm_drake.scene import Scene as Scene
from arm_drake.scene import load_scene as load_scene
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
from arm_drake.wire.server import RosServer as RosServer
from arm_drake.worlds.things import Thing as Thing
