"""An arm gives way as its mass, damper and spring say, and otherwise does as told."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pydrake.common.value import Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from scipy.spatial.transform import Rotation

import arm_drake as ad
from arm_drake.controllers.admittance_controller import (
    AdmittanceController,
    AdmittanceControllerParameters,
)
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.errors import ParameterError
from arm_drake.manager.hardware_interfaces import find_hardware_interfaces
from arm_drake.messages import (
    Header,
    JointTrajectory,
    JointTrajectoryPoint,
    Quaternion,
    WrenchStamped,
)
from tests import models
from tests.controllers.driving import NAME, Driven
from tests.controllers.parameters import ADMITTANCE, MINIMAL, load

# What hangs on the slide [kg], and how hard it pulls [N].
FORCE = 10.0
LOAD = FORCE / models.GRAVITY

MASS, STIFFNESS, RATE = 20.0, 200.0, 200

WRENCH = ("force.x", "force.y", "force.z", "torque.x", "torque.y", "torque.z")


def hardware(joints: tuple[str, ...], wrench: tuple[float, ...]) -> str:
    """Return a block of joints, and of a sensor that starts with a wrench."""
    blocks = [
        f"""
    <joint name="{name}">
      <command_interface name="position"/><command_interface name="velocity"/>
      <state_interface name="position"/><state_interface name="velocity"/>
    </joint>"""
        for name in joints
    ]
    states = [
        f'<state_interface name="{name}">'
        f'<param name="initial_value">{value!r}</param></state_interface>'
        for name, value in zip(WRENCH, wrench, strict=True)
    ]
    return f"""
  <ros2_control name="hardware" type="system">
    <hardware><plugin>gz_ros2_control/GazeboSimSystem</plugin></hardware>
    {"".join(blocks)}
    <sensor name="ft">{"".join(states)}</sensor>
  </ros2_control>"""


def slide(wrench: tuple[float, ...] = (0.0, 0.0, -FORCE, 0.0, 0.0, 0.0)) -> str:
    """Return a load on a vertical slide; the sensor's frame is that of the load."""
    up = models.joint(
        "slide",
        "base",
        "tool",
        axis="0 0 1",
        type="prismatic",
        limit='lower="-1" upper="1" effort="500" velocity="5"',
    )
    load = models.bob("tool", "0 0 0").replace(
        f'value="{models.MASS}"', f'value="{LOAD}"'
    )
    return f"""
<robot name="slide">
  <link name="base"/>{load}{up}{hardware(("slide",), wrench)}
</robot>"""


SIX = ("one", "two", "three", "four", "five", "six")


def arm(wrench: tuple[float, ...]) -> str:
    """Return six joints in a row, and a flange."""
    axes = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")
    links = ("base", *(f"{name}_link" for name in SIX))
    parts = [
        models.bob(child, "0.1 0 0")
        + models.joint(name, parent, child, axis=axis, xyz="0.3 0 0.1")
        for name, parent, child, axis in zip(SIX, links, links[1:], axes, strict=False)
    ]
    flange = """
  <link name="flange"/>
  <joint name="flange_joint" type="fixed">
    <origin xyz="0.1 0 0" rpy="0.3 -0.5 0.8"/>
    <parent link="six_link"/><child link="flange"/>
  </joint>"""
    return (
        f'<robot name="arm"><link name="base"/>{"".join(parts)}{flange}'
        f"{hardware(SIX, wrench)}</robot>"
    )


BENT = dict(zip(SIX, (0.3, -0.4, 1.0, 0.5, 0.9, -0.2), strict=True))


def parameters_of(
    joints: tuple[str, ...], tip: str, **parameters: Any
) -> dict[str, Any]:
    """Return parameters by dotted names; without filter and damping of joints."""
    return {
        "joints": list(joints),
        "kinematics.tip": tip,
        "kinematics.alpha": 0.0,
        "ft_sensor.frame.id": tip,
        "ft_sensor.filter_coefficient": 1.0,
        "control.frame.id": tip,
        "gravity_compensation.frame.id": tip,
        "gravity_compensation.CoG.pos": [0.0, 0.0, 0.0],
        "admittance.mass": [MASS] * 6,
        "admittance.stiffness": [STIFFNESS] * 6,
        "admittance.damping_ratio": [1.0] * 6,
        "admittance.joint_damping": 0.0,
        **{name.replace("__", "."): value for name, value in parameters.items()},
    }


def make_parameters(
    joints: tuple[str, ...] = ("slide",), tip: str = "tool", **parameters: Any
) -> AdmittanceControllerParameters:
    loaded = load(ADMITTANCE, parameters_of(joints, tip, **parameters))
    assert isinstance(loaded, AdmittanceControllerParameters)
    return loaded


def make_params(robot: ad.Robot, distro: str = "jazzy") -> ControllerInterfaceParams:
    hardware_interfaces = find_hardware_interfaces(
        robot.description, robot.initial_positions
    )
    return ControllerInterfaceParams(
        controller_name=NAME,
        update_rate=100,
        period=0.01,
        joint_types=hardware_interfaces.joint_types,
        command_interfaces=frozenset(hardware_interfaces.command_interfaces),
        state_interfaces=frozenset(hardware_interfaces.state_interfaces),
        measured=hardware_interfaces.measured,
        distro=distro,
        links=hardware_interfaces.links,
        followed=hardware_interfaces.followed,
        make_kinematics=hardware_interfaces.make_kinematics,
    )


class Pushed(Driven):
    """The slide's controller, and what is measured of it."""

    def __init__(
        self,
        folder: Path,
        distro: str = "jazzy",
        urdf: str | None = None,
        **parameters: Any,
    ) -> None:
        params = make_params(models.load(folder, urdf or slide()), distro)
        super().__init__(AdmittanceController(make_parameters(**parameters), params))
        self.order = params.measured

    def feel(
        self, position: float, velocity: float = 0.0, wrench: Any = (0.0,) * 6
    ) -> None:
        """Set what is measured."""
        values = {"slide/position": position, "slide/velocity": velocity}
        values |= {f"ft/{n}": w for n, w in zip(WRENCH, wrench, strict=True)}
        self.measure([values.get(name, 0.0) for name in self.order])

    def offset(self) -> float:
        """Return how far the joint gives way."""
        (position,) = self.output("status").joint_state.position
        return float(position)


@pytest.fixture
def pushed(tmp_path: Path) -> Pushed:
    return Pushed(tmp_path)


def point(*positions: float, **fields: Any) -> JointTrajectoryPoint:
    return JointTrajectoryPoint(positions, **fields)


def push(z: float, frame: str = "tool") -> WrenchStamped:
    return WrenchStamped(Header(frame_id=frame), {"force": {"z": z}})


def test_a_position_that_is_unknown_at_the_start_is_a_failure(pushed) -> None:  # AD5
    pushed.feel(np.nan)

    tick = pushed.run()

    assert not tick.is_ok
    assert tick.fault == "the position of joint 'slide' isn't known"
    assert np.isnan(tick.command).all()


def test_a_controller_that_has_failed_starts_anew(pushed) -> None:
    pushed.feel(np.nan)
    pushed.run()
    pushed.run(activation=None)
    pushed.feel(0.25)

    tick = pushed.run(activation=2)

    assert (tick.is_ok, tick.command.tolist()) == (True, [0.25])


UNBOUNDED = (
    "it gives way beyond all bounds; mass is too small, or stiffness or damping_ratio "
    "too large, for a period of "
)
STIFF = {"admittance__mass": [1e-4] * 6, "admittance__stiffness": [1e8] * 6}


# Humble's manager goes on with a controller that has failed.
@pytest.mark.slow
@pytest.mark.parametrize("distro", ["jazzy", "humble"])
def test_an_admittance_that_grows_without_bounds_fails(tmp_path, distro) -> None:
    pushed = Pushed(tmp_path, distro, **STIFF)
    pushed.feel(0.0, wrench=(0.0, 0.0, 1.0, 0.0, 0.0, 0.0))

    ticks = [pushed.run() for _ in range(300)]

    failed = next(tick for tick in ticks if not tick.is_ok)
    assert failed.fault == f"{UNBOUNDED}0.01 s"
    assert np.isnan(failed.command).all()


def test_the_manager_ends_a_controller_that_fails_and_says_why(tmp_path) -> None:
    simulation = simulate(tmp_path, slide(), {"admittance": STIFF}, preset="kinematic")

    simulation.advance_to(1.0)

    (failure,) = simulation.failures
    assert failure.controller == "admittance"
    assert failure.reason == f"{UNBOUNDED}0.005 s"
    assert [c.state for c in simulation.list_controllers()] == ["inactive"]


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        pytest.param(
            {"command_joints": ["a", "b"]},
            ": c: command_joints must be empty or as many as joints, 1, got 2: "
            "['a', 'b']",
            id="AD6",
        ),
        pytest.param(
            {"command_interfaces": ["effort"]},
            "expected one of ['position', 'velocity', 'acceleration'], got 'effort'",
            id="AD7-command",
        ),
        pytest.param(
            {"state_interfaces": ["position", "effort"]},
            "expected one of ['position', 'velocity', 'acceleration'], got 'effort'",
            id="AD7-state",
        ),
        pytest.param(
            {"chainable_command_interfaces": ["acceleration"]},
            "expected one of ['position', 'velocity'], got 'acceleration'",
            id="AD7-chainable",
        ),
        *(
            pytest.param(
                {f"admittance__{name}": values},
                f"admittance: {name} must have 6 elements, got 5: {values}",
                id=f"AD8-{name}",
            )
            for name, values in (
                ("selected_axes", [True] * 5),
                ("mass", [1.0] * 5),
                ("damping_ratio", [1.0] * 5),
                ("stiffness", [1.0] * 5),
            )
        ),
        pytest.param(
            {"kinematics__alpha": -1.0},
            ": c.kinematics: alpha must be at least 0, got -1.0",
            id="alpha",
        ),
    ],
)
def test_parameters_that_upstream_refuses_are_refused(parameters, message) -> None:
    with pytest.raises(ParameterError) as caught:
        make_parameters(**parameters)

    assert str(caught.value).endswith(message)


@pytest.mark.parametrize(
    "name", ["selected_axes", "mass", "damping_ratio", "stiffness"]
)
def test_what_makes_an_admittance_is_required(name) -> None:  # AD8
    with pytest.raises(ParameterError, match=f"admittance.{name}: is required but"):
        load(ADMITTANCE, without=(f"admittance.{name}",))


KNOWN = "known: base, tool"


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (
            {"kinematics__base": "bas"},
            "kinematics.base: the robot has no link 'bas'; did you mean 'base'? "
            f"{KNOWN}",
        ),
        (
            {"kinematics__tip": "flange"},
            f"kinematics.tip: the robot has no link 'flange'; {KNOWN}",
        ),
        (
            {"ft_sensor__frame__id": "flange"},
            f"ft_sensor.frame.id: the robot has no link 'flange'; {KNOWN}",
        ),
        (
            {"control__frame__id": "flange"},
            f"control.frame.id: the robot has no link 'flange'; {KNOWN}",
        ),
        (
            {"fixed_world_frame__frame__id": "flange"},
            f"fixed_world_frame.frame.id: the robot has no link 'flange'; {KNOWN}",
        ),
        (
            {"gravity_compensation__frame__id": "flange"},
            f"gravity_compensation.frame.id: the robot has no link 'flange'; {KNOWN}",
        ),
        (
            {"joints": ["slid"]},
            "joints: the robot has no joint 'slid'; did you mean 'slide'? known: slide",
        ),
        (
            {"kinematics__tip": "base"},
            "joints: expected those from kinematics.base 'base' to kinematics.tip "
            "'base', [], got ['slide']",
        ),
        (
            {"ft_sensor__frame__id": "base"},
            "ft_sensor.frame.id: none of joints moves link 'base' against "
            "kinematics.base 'base'",
        ),
    ],
)
def test_what_the_robot_does_not_have_is_an_error(
    tmp_path, parameters, message
) -> None:
    params = make_params(models.load(tmp_path, slide()))

    with pytest.raises(ParameterError) as caught:
        AdmittanceController(make_parameters(**parameters), params)

    assert str(caught.value) == message


def test_a_joint_of_the_chain_that_is_left_out_is_an_error(tmp_path) -> None:
    params = make_params(models.load(tmp_path, arm((0.0,) * 6)))

    with pytest.raises(ParameterError) as caught:
        AdmittanceController(make_parameters(SIX[1:], "flange"), params)

    assert str(caught.value) == (
        "joints: expected those from kinematics.base 'base' to kinematics.tip "
        f"'flange', {list(SIX)}, got {list(SIX[1:])}"
    )


def test_without_a_push_it_does_what_it_is_told(tmp_path) -> None:  # AD9
    pushed = Pushed(tmp_path, command_interfaces=["velocity", "position"])
    pushed.feel(0.25, 0.5)

    commands = [pushed.run().command.tolist()]
    pushed.feel(0.3)
    commands.append(
        pushed.run({"joint_references": point(0.3, velocities=[0.1])}).command.tolist()
    )

    # At first it goes on with what it measures.
    assert commands == [[0.0, 0.25], [0.1, 0.3]]


def test_a_velocity_that_is_measured_is_its_first_reference(tmp_path) -> None:
    names = ["position", "velocity"]
    pushed = Pushed(tmp_path, state_interfaces=names, command_interfaces=names)
    pushed.feel(0.25, 0.5)

    assert pushed.run().command.tolist() == [0.25, 0.5]


def test_a_wrench_of_another_frame_is_rejected(pushed) -> None:  # AD10
    pushed.run({"wrench_reference": push(5.0, "base")})

    assert pushed.reasons() == [
        "header.frame_id must be 'tool', the sensor's, got 'base'"
    ]
    assert pushed.command_values.tolist() == [0.0]


@pytest.mark.parametrize("frame", ["tool", ""])
def test_a_wrench_is_added_to_what_is_measured_until_the_next_one(
    pushed, frame
) -> None:
    pushed.feel(0.0, wrench=(0.0, 0.0, 2.0, 0.0, 0.0, 0.0))
    pushed.run({"wrench_reference": push(3.0, frame)})
    pushed.run()

    force = pushed.output("status").wrench_base.wrench.force

    assert pushed.reasons() == []
    assert (force.x, force.y, force.z) == (0.0, 0.0, 5.0)


def test_a_wrench_of_nothing_is_rejected(pushed) -> None:
    pushed.run({"wrench_reference": push(np.nan)})

    assert pushed.reasons() == ["wrench must be finite"]
    assert pushed.command_values.tolist() == [0.0]


def test_a_sensor_that_can_not_be_read_feels_nothing(pushed) -> None:
    pushed.feel(0.0, wrench=(0.0, np.nan, 10.0, 0.0, 0.0, 0.0))

    pushed.run()

    assert pushed.command_values.tolist() == [0.0]


def test_the_first_tick_of_a_push_is_that_of_the_law(tmp_path) -> None:
    kinds = ["velocity", "acceleration", "position"]
    pushed = Pushed(tmp_path, command_interfaces=kinds)
    pushed.feel(0.0, wrench=(0.0, 0.0, -FORCE, 0.0, 0.0, 0.0))

    pushed.run()

    a, h = -FORCE / MASS, 0.01
    status = pushed.output("status")
    joint, twist = status.joint_state, status.admittance_velocity.twist
    assert pushed.command_values == pytest.approx([a * h, a, a * h * h], rel=1e-12)
    assert (*joint.velocity, *joint.effort, *joint.position) == tuple(
        pushed.command_values
    )
    assert twist.linear.z == pytest.approx(a * h, rel=1e-12)
    assert status.admittance_acceleration.twist.linear.z == pytest.approx(a)


# The slide's axis, z of the base, is along x of the control frame, backwards.
@pytest.mark.parametrize(
    ("distro", "mass"),
    [("humble", 4.0), ("jazzy", 4.0), ("kilted", 4.0), ("rolling", 1.0)],
)
def test_the_mass_is_that_of_the_control_frame_since_rolling(
    tmp_path, distro, mass
) -> None:
    turned = """
  <link name="turned"/>
  <joint name="turned" type="fixed">
    <parent link="tool"/><child link="turned"/><origin rpy="0 1.5707963267948966 0"/>
  </joint>
</robot>"""
    pushed = Pushed(
        tmp_path,
        distro,
        slide().replace("</robot>", turned),
        control__frame__id="turned",
        admittance__mass=[1.0, 2.0, 4.0, 1.0, 1.0, 1.0],
        command_interfaces=["acceleration"],
    )
    pushed.feel(0.0, wrench=(0.0, 0.0, 8.0, 0.0, 0.0, 0.0))

    pushed.run()

    assert pushed.command_values == pytest.approx([8.0 / mass], rel=1e-12)


def test_the_status_names_the_frames_of_its_poses(pushed) -> None:
    pushed.run()

    status = pushed.output("status")
    poses = (status.ref_trans_base_ft, status.admittance_position)
    assert [(pose.header.frame_id, pose.child_frame_id) for pose in poses] == [
        ("base", "tool"),
        ("base", "admittance_offset"),
    ]


def test_a_wrench_of_the_topic_stays_over_a_deactivation(pushed) -> None:
    pushed.run({"wrench_reference": push(3.0)})
    pushed.run(activation=None)

    pushed.run(activation=2)

    assert pushed.output("status").wrench_base.wrench.force.z == 3.0


def test_a_joint_of_the_chain_that_follows_another_needs_no_command(tmp_path) -> None:
    urdf = arm((0.0,) * 6).replace(
        '<parent link="two_link"/>',
        '<mimic joint="two"/><parent link="two_link"/>',
    )
    params = make_params(models.load(tmp_path, urdf))
    joints = tuple(name for name in SIX if name != "three")

    system = AdmittanceController(make_parameters(joints, "flange"), params)

    assert system.command_interfaces == tuple(f"{name}/position" for name in joints)


def test_gravity_points_down_in_the_fixed_world_frame(tmp_path) -> None:
    # A base that leans against the world by 0.5 rad about y, and a link that is turned
    # against the tool by a right angle about z.
    lean = """
  <link name="palm"/>
  <joint name="palm_joint" type="fixed">
    <origin rpy="0 0 1.5707963267948966"/>
    <parent link="tool"/><child link="palm"/>
  </joint>
  <link name="world"/>
  <joint name="mount" type="fixed">
    <origin rpy="0 0.5 0"/><parent link="world"/><child link="base"/>
  </joint>"""
    urdf = slide().replace('<link name="base"/>', f'<link name="base"/>{lean}')
    parameters = make_parameters(
        fixed_world_frame__frame__id="world",
        gravity_compensation__frame__id="palm",
        gravity_compensation__CoG__pos=[0.2, 0.0, 0.0],
        gravity_compensation__CoG__force=FORCE,
    )
    params = make_params(models.load(tmp_path, urdf))
    driven = Driven(AdmittanceController(parameters, params))
    # The weight in the frame of the load, R_y(0.5)^T (0, 0, -F), 0.2 m along its y.
    x, z = FORCE * np.sin(0.5), -FORCE * np.cos(0.5)
    weight = {
        "ft/force.x": x,
        "ft/force.z": z,
        "ft/torque.x": 0.2 * z,
        "ft/torque.z": -0.2 * x,
    }
    driven.measure([weight.get(name, 0.0) for name in params.measured])

    driven.run()

    wrench = driven.output("status").wrench_base.wrench
    for part in (wrench.force, wrench.torque):
        assert [part.x, part.y, part.z] == pytest.approx([0.0] * 3, abs=1e-14)


def test_positions_that_get_lost_are_those_commanded_last(pushed) -> None:
    pushed.feel(0.25)
    pushed.run()
    pushed.feel(np.nan)

    tick = pushed.run({"joint_references": point(0.5)})

    # The spring pulls from the last command to the reference, by 0.25 m.
    moved = STIFFNESS / MASS * 0.25 * 0.01**2
    assert tick.is_ok
    assert tick.command == pytest.approx([0.5 + moved], rel=1e-12)


def test_a_reference_that_is_no_number_is_the_last_one(pushed) -> None:
    pushed.run({"joint_references": point(0.5)})

    pushed.feel(0.5)
    pushed.run({"joint_references": point(np.nan)})

    pose = pushed.output("status").ref_trans_base_ft.transform
    assert pose.translation.z == 0.5


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (point(1.0, 2.0), "positions must have 1 elements (slide) or none, got 2"),
        (
            point(velocities=[1.0, 2.0]),
            "velocities must have 1 elements (slide) or none, got 2",
        ),
    ],
)
def test_references_of_another_size_are_rejected(pushed, message, reason) -> None:
    pushed.run({"joint_references": message})

    assert pushed.reasons() == [reason]
    assert pushed.command_values.tolist() == [0.0]


def test_in_a_chain_the_topic_is_rejected(pushed) -> None:
    pushed.feel(0.25)

    pushed.run({"joint_references": point(0.9)}, references=[0.25, 0.1])

    assert pushed.command_values == pytest.approx([0.25])
    assert pushed.reasons() == ["another controller commands the references"]


def test_what_nobody_commands_of_a_chain_stays(tmp_path) -> None:
    names = ["position", "velocity"]
    pushed = Pushed(tmp_path, command_interfaces=names)
    pushed.feel(0.25)
    pushed.run(references=[0.25, 0.1])

    pushed.run(references=[0.25, np.nan])

    assert pushed.command_values.tolist() == [0.25, 0.1]


def test_references_are_those_that_are_listed(tmp_path) -> None:
    pushed = Pushed(tmp_path, chainable_command_interfaces=["velocity", "position"])
    alone = Pushed(tmp_path, chainable_command_interfaces=["velocity"])

    assert pushed.system.reference_interfaces == (
        f"{NAME}/slide/position",
        f"{NAME}/slide/velocity",
    )
    assert alone.system.reference_interfaces == (f"{NAME}/slide/velocity",)


def test_a_deactivation_ends_all_that_was(pushed) -> None:
    pushed.feel(0.0, wrench=(0.0, 0.0, -FORCE, 0.0, 0.0, 0.0))
    pushed.run({"joint_references": point(0.5)})
    pushed.run()
    pushed.feel(0.1)
    ended = pushed.run({"joint_references": point(0.7)}, activation=None)

    pushed.run(activation=2)

    assert np.isnan(ended.command).all()
    assert pushed.command_values.tolist() == [0.1]
    assert pushed.offset() == 0.0
    assert pushed.reasons() == ["the controller is not active"]


def test_parameters_change_while_it_runs(pushed) -> None:
    pushed.feel(0.0, wrench=(0.0, 0.0, -FORCE, 0.0, 0.0, 0.0))
    lighter = make_parameters(admittance__mass=[1.0] * 6)

    pushed.run({"parameters": lighter})

    assert pushed.offset() == pytest.approx(-FORCE * 0.01**2)
    assert pushed.output("status").mass.data == (1.0,) * 6


def test_parameters_may_have_to_wait_for_an_activation(tmp_path) -> None:
    waits = {"enable_parameter_update_without_reactivation": False}
    pushed = Pushed(tmp_path, **waits)
    lighter = make_parameters(admittance__mass=[1.0] * 6, **waits)
    masses = []

    for activation, topics in (
        (1, {}),
        (1, {"parameters": lighter}),
        (1, {}),
        (2, {}),
    ):
        pushed.run(topics, activation=activation)
        masses.append(pushed.output("status").mass.data[0])

    assert masses == [MASS, MASS, MASS, 1.0]


@pytest.mark.parametrize(
    ("received", "reason"),
    [
        ("heavy", "expected AdmittanceControllerParameters, got 'heavy'"),
        (
            make_parameters(command_interfaces=["velocity"]),
            "command_interfaces can't change while the controller runs",
        ),
        (
            make_parameters(kinematics__alpha=0.5),
            "kinematics can't change while the controller runs",
        ),
        (
            make_parameters(control__frame__id="flange"),
            f"control.frame.id: the robot has no link 'flange'; {KNOWN}",
        ),
    ],
)
def test_parameters_that_can_not_change_are_refused(pushed, received, reason) -> None:
    pushed.run({"parameters": received})

    assert pushed.reasons() == [reason]
    assert pushed.output("status").mass.data == (MASS,) * 6


def test_a_copy_of_the_context_goes_on_in_the_same_way(pushed) -> None:
    pushed.feel(0.0, wrench=(0.0, 0.0, -FORCE, 0.0, 0.0, 0.0))
    pushed.run({"wrench_reference": push(3.0, "base")})
    saved, cycle = pushed.context.Clone(), pushed.cycle
    first = pushed.run().command

    pushed.context, pushed.cycle = saved, cycle
    pushed.simulator.reset_context(saved)
    second = pushed.run().command

    assert first == pytest.approx(second, abs=0.0)
    assert first[0] < 0.0
    assert len(pushed.reasons()) == 1


def nested(flat: dict[str, Any]) -> dict[str, Any]:
    """Return parameters of dotted names as a YAML has them."""
    groups: dict[str, Any] = {}
    for name, value in flat.items():
        *path, last = name.split(".")
        group = groups
        for part in path:
            group = group.setdefault(part, {})
        group[last] = value
    return groups


def simulate(
    folder: Path,
    urdf: str,
    controllers: dict[str, dict[str, Any]],
    *,
    joints: tuple[str, ...] = ("slide",),
    tip: str = "tool",
    preset: str = "accurate",
    **options: Any,
) -> ad.Simulation:
    """Return a simulation of an AdmittanceController "admittance" and others."""
    controllers = {name: dict(parameters) for name, parameters in controllers.items()}
    types = {n: {"type": c.pop("type", ADMITTANCE)} for n, c in controllers.items()}
    own = parameters_of(joints, tip, **controllers["admittance"])
    controllers["admittance"] = nested({**MINIMAL[ADMITTANCE], **own})
    text = yaml.safe_dump(
        {
            "controller_manager": {"ros__parameters": {"update_rate": RATE, **types}},
            **{n: {"ros__parameters": section} for n, section in controllers.items()},
        }
    )
    robot = models.load(folder, urdf, text, **options)
    assert [e for e in robot.report if e.severity == "error"] == []
    return ad.Simulation(
        ad.build_diagram(robot, options=ad.SimulationOptions(preset=preset))
    )


def give_way(t: np.ndarray, mass: float, damping: float) -> np.ndarray:
    """Return x of M x'' + D x' + K x = -F from rest."""
    s, r = np.roots([mass, damping, STIFFNESS]).astype(complex)
    motion = 1.0 + (r * np.exp(s * t) - s * np.exp(r * t)) / (s - r)
    return -FORCE / STIFFNESS * motion.real


DAMPING = 2.0 * 0.7 * np.sqrt(MASS * STIFFNESS)
UNDER = {"admittance__damping_ratio": [0.7] * 6}


@pytest.mark.slow
def test_a_stored_force_moves_the_tool_as_mass_damper_and_spring(tmp_path) -> None:
    simulation = simulate(tmp_path, slide(), {"admittance": UNDER}, preset="kinematic")

    simulation.advance_to(4.0)

    rollout = simulation.rollout()
    found = rollout.position[:, rollout.joint_names.index("slide")]
    expected = give_way(rollout.time, MASS, DAMPING)
    # Within 5 % of the way, of which the integration, of first order in the period h,
    # makes less than w h = 1.6 %.
    assert found == pytest.approx(expected, abs=0.05 * FORCE / STIFFNESS)
    assert found[-1] == pytest.approx(-FORCE / STIFFNESS, rel=1e-3)


@pytest.mark.slow
def test_a_weight_moves_the_tool_as_mass_damper_and_spring(tmp_path) -> None:
    simulation = simulate(tmp_path, slide(), {"admittance": UNDER})

    simulation.advance_to(4.0)

    rollout = simulation.rollout()
    found = rollout.position[:, rollout.joint_names.index("slide")]
    # The sensor feels the inertia of what hangs on it, too. Of the 5 %, delays of
    # cycle and servo take 3 %, for they lessen the damping; in cycles of 1 ms, 1 %.
    expected = give_way(rollout.time, MASS + LOAD, DAMPING)
    assert found == pytest.approx(expected, abs=0.05 * FORCE / STIFFNESS)
    assert found[-1] == pytest.approx(-FORCE / STIFFNESS, rel=1e-3)


@pytest.mark.slow
def test_an_arm_that_is_pushed_moves_as_mass_damper_and_spring(tmp_path) -> None:
    simulation = simulate(
        tmp_path,
        arm((0.0,) * 6),
        {"admittance": UNDER},
        joints=SIX,
        tip="flange",
        initial_positions=BENT,
    )
    plant = simulation.diagram.GetSubsystemByName("plant")
    flange = plant.GetBodyByName("flange")
    root = simulation.simulator.get_mutable_context()
    direction = np.array([2.0, -1.0, 2.0]) / 3.0

    def place() -> np.ndarray:
        context = plant.GetMyContextFromRoot(root)
        return plant.EvalBodyPoseInWorld(context, flange).translation()

    start = place()
    push = ExternallyAppliedSpatialForce()
    push.body_index = flange.index()
    push.F_Bq_W = SpatialForce(np.zeros(3), FORCE * direction)
    port = simulation.diagram.GetInputPort("applied_spatial_force")
    port.FixValue(root, Value([push]))
    times, moved = np.arange(1, 41) * 0.1, []
    for time in times:
        simulation.advance_to(time)
        moved.append(place() - start)

    # Within 5 % of the way, along the push and across it. The flange has no mass.
    expected = np.outer(-give_way(times, MASS, DAMPING), direction)
    np.testing.assert_allclose(moved, expected, atol=0.05 * FORCE / STIFFNESS)


@pytest.mark.slow
def test_the_weight_of_the_tool_itself_can_be_taken_away(tmp_path) -> None:
    parameters = {"gravity_compensation__CoG__force": FORCE}
    simulation = simulate(tmp_path, slide(), {"admittance": parameters})

    simulation.advance_to(1.0)

    assert simulation.rollout().position[-1] == pytest.approx([0.0], abs=1e-5)


@pytest.mark.slow
def test_an_arm_rests_where_its_springs_bear_the_wrench(tmp_path) -> None:
    wrench = (10.0, -5.0, 3.0, 0.5, 1.0, -0.8)
    stiffness = [200.0, 400.0, 300.0, 20.0, 30.0, 40.0]
    parameters = {
        "admittance__mass": [5.0] * 3 + [0.5] * 3,
        "admittance__stiffness": stiffness,
    }
    simulation = simulate(
        tmp_path,
        arm(wrench),
        {"admittance": parameters},
        joints=SIX,
        tip="flange",
        preset="kinematic",
        initial_positions=BENT,
    )

    simulation.advance_to(6.0)

    status = simulation.topic("/admittance/status").value()
    moved, control = status.admittance_position.transform, status.rot_base_control
    v = moved.translation
    X = np.array([v.x, v.y, v.z, *turn_of(moved.rotation).as_rotvec()])
    R = np.kron(np.eye(2), turn_of(control).as_matrix())
    # In the control frame, which is the sensor's, as it is turned in the end.
    assert pytest.approx(np.array(wrench) / stiffness, rel=1e-3) == R.T @ X
    force = status.wrench_base.wrench.force
    assert [force.x, force.y, force.z] == pytest.approx(R[:3, :3] @ wrench[:3])


@pytest.mark.slow
def test_an_arm_in_the_physics_gives_way_to_a_push(tmp_path) -> None:
    parameters = {
        "admittance__mass": [20.0] * 3 + [2.0] * 3,
        "admittance__stiffness": [STIFFNESS] * 3 + [50.0] * 3,
        "admittance__joint_damping": 5.0,
        "kinematics__alpha": 0.01,
        "ft_sensor__filter_coefficient": 0.2,
    }
    simulation = simulate(
        tmp_path,
        arm((0.0,) * 6),
        {"admittance": parameters},
        joints=SIX,
        tip="flange",
        initial_positions=BENT,
    )

    topic = simulation.topic("/admittance/wrench_reference")
    topic.publish({"wrench": {"force": {"x": FORCE}}})
    simulation.advance_to(6.0)

    status = simulation.topic("/admittance/status").value()
    v = status.admittance_position.transform.translation
    force = status.wrench_base.wrench.force
    moved, pull = np.array([v.x, v.y, v.z]), np.array([force.x, force.y, force.z])
    assert np.linalg.norm(pull) == pytest.approx(FORCE)
    # What is left of the way falls to a fifth every 2 s; after 6 s it is 0.5 %.
    assert moved == pytest.approx(pull / STIFFNESS, abs=0.01 * FORCE / STIFFNESS)


def turn_of(q: Quaternion) -> Rotation:
    return Rotation.from_quat([q.x, q.y, q.z, q.w])


CHAIN = {
    "trajectory": {
        "type": "joint_trajectory_controller/JointTrajectoryController",
        "joints": ["slide"],
        "command_joints": ["admittance/slide"],
        "command_interfaces": ["position", "velocity"],
        "state_interfaces": ["position", "velocity"],
    },
    "admittance": UNDER,
}


@pytest.mark.slow
def test_a_trajectory_is_followed_and_gives_way(tmp_path) -> None:
    simulation = simulate(tmp_path, slide(), CHAIN, preset="kinematic")
    trajectory = JointTrajectory(
        joint_names=["slide"], points=[point(0.2, velocities=[0.0], time_from_start=1)]
    )

    goal = simulation.controller("trajectory").send_goal(trajectory)
    simulation.advance_to(5.0)

    rollout = simulation.rollout()
    found = rollout.position[:, rollout.joint_names.index("slide")]
    assert [c.state for c in simulation.list_controllers()] == ["active", "active"]
    assert goal.status == ad.GoalStatus.SUCCEEDED
    # The spring's other end moves along, and its damper is that of what gives way.
    s = np.clip(rollout.time, 0.0, 1.0)
    planned = 0.2 * (3.0 * s**2 - 2.0 * s**3)
    expected = planned + give_way(rollout.time, MASS, DAMPING)
    assert found == pytest.approx(expected, abs=0.05 * FORCE / STIFFNESS)
    assert found[-1] == pytest.approx(0.2 - FORCE / STIFFNESS, rel=1e-3)


@pytest.mark.slow
def test_without_a_push_the_chain_is_exact(tmp_path) -> None:  # AD9
    simulation = simulate(tmp_path, slide((0.0,) * 6), CHAIN, preset="kinematic")

    simulation.advance_to(0.5)

    assert simulation.rollout().position == pytest.approx(0.0, abs=0.0)


@pytest.mark.slow
def test_a_simulation_is_the_same_again(tmp_path) -> None:
    runs = []
    for _ in range(2):
        simulation = simulate(tmp_path, slide(), {"admittance": UNDER})
        simulation.advance_to(0.5)
        runs.append(simulation.rollout().position)

    assert np.array_equal(*runs)
