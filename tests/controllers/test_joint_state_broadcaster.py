from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, ZeroOrderHold

import arm_drake as ad
from arm_drake import interfaces
from arm_drake.controllers.controller_interface import ControllerInterfaceParams
from arm_drake.controllers.cycles import Cycle
from arm_drake.controllers.joint_state_broadcaster import (
    InterfaceMap,
    JointStateBroadcaster,
    JointStateBroadcasterParameters,
)
from arm_drake.errors import ParameterError
from arm_drake.messages import DynamicJointState, Header, JointState, Time
from tests import models

# In the order of the robot's description.
ROBOT = ("joint3", "joint1", "joint2")
MEASURED = interfaces.interface_names(ROBOT, interfaces.STATE_INTERFACES)
POSITIONS = {"joint1": 1.1, "joint2": 2.1, "joint3": 3.1}
ALL = ("joint1", "joint2", "joint3")


def make_broadcaster(
    available: tuple[str, ...] = MEASURED,
    *,
    distro: str = "jazzy",
    joint_type: str = "revolute",
    **parameters: Any,
) -> JointStateBroadcaster:
    """Return a broadcaster below a manager of 100 Hz."""
    params = ControllerInterfaceParams(
        controller_name="broadcaster",
        update_rate=100,
        period=0.01,
        joint_types=dict.fromkeys(ROBOT, joint_type),
        command_interfaces=frozenset(),
        state_interfaces=frozenset(available),
        measured=(*MEASURED, *(name for name in available if name not in MEASURED)),
        distro=distro,
    )
    return JointStateBroadcaster(JointStateBroadcasterParameters(**parameters), params)


def make_diagram(broadcaster: JointStateBroadcaster) -> Diagram:
    """Return the broadcaster with its sampling of constant measurements.

    Velocities and efforts are 10 and 20 more than positions, all else 50.
    """
    offsets = {"position": 0.0, "velocity": 10.0, "effort": 20.0}
    values = [
        POSITIONS[joint] + offsets[interface]
        if joint in ROBOT and interface in offsets
        else 50.0
        for joint, interface in (
            name.split("/") for name in broadcaster.params.measured
        )
    ]
    builder = DiagramBuilder()
    builder.AddSystem(broadcaster)
    source = builder.AddSystem(ConstantVectorSource(values))
    sample = builder.AddSystem(ZeroOrderHold(0.01, len(values)))
    builder.Connect(source.get_output_port(), sample.get_input_port())
    measured = broadcaster.GetInputPort("state_interfaces")
    builder.Connect(sample.get_output_port(), measured)
    manager = broadcaster.GetInputPort("controller_manager")
    builder.ExportInput(manager, "controller_manager")
    for index in range(broadcaster.num_output_ports()):
        port = broadcaster.get_output_port(index)
        builder.ExportOutput(port, port.get_name())
    return builder.Build()


def publish(
    broadcaster: JointStateBroadcaster,
    until: float = 0.005,
    *,
    topic: str = "joint_states",
    cycle: Cycle | None = None,
) -> Any:
    """Return the message at a time [s], with or without a manager."""
    diagram = make_diagram(broadcaster)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    if cycle is not None:
        diagram.GetInputPort("controller_manager").FixValue(context, cycle)
    simulator.AdvanceTo(until)
    return diagram.GetOutputPort(topic).Eval(context)


def publish_dynamic(broadcaster: JointStateBroadcaster) -> dict[str, dict[str, float]]:
    """Return the values of dynamic_joint_states by component and interface."""
    message: DynamicJointState = publish(broadcaster, topic="dynamic_joint_states")
    described = zip(message.joint_names, message.interface_values, strict=True)
    return {
        name: dict(zip(values.interface_names, values.values, strict=True))
        for name, values in described
    }


def fields(message: JointState) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return (
        np.array(message.position),
        np.array(message.velocity),
        np.array(message.effort),
    )


def assert_fields(message: JointState, *expected: list[float]) -> None:
    for actual, values in zip(fields(message), expected, strict=True):
        np.testing.assert_array_equal(actual, values)


@pytest.mark.parametrize(
    "parameters",
    [
        pytest.param({}, id="J1"),
        pytest.param({"joints": ("joint1",)}, id="J2"),
        pytest.param({"interfaces": ("position",)}, id="J3"),
    ],
)
def test_unless_both_are_given_all_joints_and_interfaces_are_published_by_name(
    parameters: dict[str, Any],
) -> None:
    broadcaster = make_broadcaster(**parameters)

    message = publish(broadcaster)

    assert message.name == ALL
    assert_fields(message, [1.1, 2.1, 3.1], [11.1, 12.1, 13.1], [21.1, 22.1, 23.1])
    assert sorted(broadcaster.state_interfaces) == sorted(MEASURED)
    assert broadcaster.command_interfaces == ()


NAN2 = [np.nan, np.nan]


@pytest.mark.parametrize(
    ("names", "velocity"),
    [
        pytest.param(("position",), NAN2, id="J4"),
        pytest.param(("position", "velocity"), [12.1, 11.1], id="J5"),
    ],
)
def test_joints_and_interfaces_together_are_exactly_what_is_published(
    names: tuple[str, ...], velocity: list[float]
) -> None:
    broadcaster = make_broadcaster(joints=("joint2", "joint1"), interfaces=names)

    message = publish(broadcaster)

    assert message.name == ("joint2", "joint1")
    assert_fields(message, [2.1, 1.1], velocity, NAN2)
    assert broadcaster.state_interfaces == interfaces.interface_names(
        ("joint2", "joint1"), names
    )


def test_interfaces_that_a_joint_lacks_are_nan() -> None:
    available = ("joint2/position", "joint1/position", "joint1/effort")

    message = publish(make_broadcaster(available))

    assert message.name == ("joint1", "joint2")
    assert_fields(message, [1.1, 2.1], NAN2, [21.1, np.nan])


@pytest.mark.parametrize(
    ("joints", "missing"),
    [
        pytest.param(("no_joint",), "no_joint/position", id="J6"),
        pytest.param(("joint1", "joint3"), "joint3/position", id="J7"),
    ],
)
def test_an_interface_that_is_asked_for_must_be_there(
    joints: tuple[str, ...], missing: str
) -> None:
    available = ("joint2/position", "joint1/position")

    with pytest.raises(ParameterError) as error:
        make_broadcaster(available, joints=joints, interfaces=("position",))

    assert str(error.value) == (
        f"no state interface {missing}; it has ['joint1/position', 'joint2/position']"
    )


def test_without_any_interface_there_is_nothing_to_publish() -> None:
    with pytest.raises(ParameterError) as error:
        make_broadcaster(())

    assert str(error.value) == "no state interface to publish; the hardware has none"


def test_rolling_needs_joints_that_it_knows() -> None:  # J14
    with pytest.raises(ParameterError, match="no state interface to publish"):
        make_broadcaster(distro="rolling", joint_type="floating")


@pytest.mark.parametrize("is_local", [False, True])
def test_local_topics_change_no_port_and_no_message(is_local: bool) -> None:  # J13
    broadcaster = make_broadcaster(use_local_topics=is_local)

    outputs = [
        broadcaster.get_output_port(i).get_name()
        for i in range(broadcaster.num_output_ports())
    ]

    # A port stands below the broadcaster's name: "<broadcaster>.joint_states".
    assert outputs == ["joint_states", "dynamic_joint_states"]
    assert publish(broadcaster).name == ALL


def test_what_can_t_be_measured_is_nan_and_nothing_else() -> None:  # J18
    broadcaster = make_broadcaster()
    context = broadcaster.CreateDefaultContext()
    context.SetTime(0.005)
    values = np.arange(1.0, 10.0)
    values[MEASURED.index("joint2/velocity")] = np.nan
    broadcaster.GetInputPort("state_interfaces").FixValue(context, values)

    message = broadcaster.GetOutputPort("joint_states").Eval(context)

    # The robot has joint3, joint1 and joint2 in this order.
    assert_fields(message, [2.0, 3.0, 1.0], [5.0, np.nan, 4.0], [8.0, 9.0, 7.0])


def test_extra_joints_follow_with_zeros_unless_they_exist() -> None:
    extra = ("extra1", "joint2", "extra2")  # J11, J12

    message = publish(make_broadcaster(extra_joints=extra))

    assert message.name == (*ALL, "extra1", "extra2")
    assert_fields(
        message,
        [1.1, 2.1, 3.1, 0.0, 0.0],
        [11.1, 12.1, 13.1, 0.0, 0.0],
        [21.1, 22.1, 23.1, 0.0, 0.0],
    )


@pytest.mark.parametrize(
    ("until", "stamp_ns"), [(0.005, 0), (0.125, 120_000_000), (0.13, 120_000_000)]
)
def test_the_stamp_is_the_time_of_the_last_tick(until: float, stamp_ns: int) -> None:
    message = publish(make_broadcaster(frame_id="base_link"), until)

    stamp = Time.from_nanoseconds(stamp_ns)
    assert message.header == Header(stamp, "base_link")


def test_by_default_the_frame_has_no_name_as_in_jazzy() -> None:
    assert publish(make_broadcaster()).header.frame_id == ""


def test_before_the_first_tick_the_messages_are_empty() -> None:
    diagram = make_diagram(make_broadcaster())
    context = diagram.CreateDefaultContext()

    dynamic = diagram.GetOutputPort("dynamic_joint_states").Eval(context)
    assert dynamic == DynamicJointState()
    assert diagram.GetOutputPort("joint_states").Eval(context) == JointState()


def test_inactive_it_publishes_nothing() -> None:
    active = Cycle(0, 0, 10_000_000, {"broadcaster": 1})
    inactive = active._replace(active={"another": 1})

    silent = publish(make_broadcaster(), cycle=inactive)
    silent_too = publish(
        make_broadcaster(), cycle=inactive, topic="dynamic_joint_states"
    )

    assert publish(make_broadcaster(), cycle=active).name == ALL
    assert (silent, silent_too) == (JointState(), DynamicJointState())


CUSTOM = ("joint1/measured_position", "joint1/velocity", "joint2/measured_position")
MAPPED = InterfaceMap(position="measured_position")


def test_interfaces_without_a_field_have_no_place_in_the_message() -> None:  # J8
    lists = {"joints": ("joint1", "joint2"), "interfaces": ("measured_position",)}

    message = publish(make_broadcaster(CUSTOM, **lists))
    dynamic = publish_dynamic(make_broadcaster(CUSTOM, **lists))

    assert message.name == ()
    assert_fields(message, [], [], [])
    assert dynamic == {
        "joint1": {"measured_position": 50.0},
        "joint2": {"measured_position": 50.0},
    }


@pytest.mark.parametrize("distro", ["jazzy", "rolling"])
@pytest.mark.parametrize("lists", [{}, {"joints": ("joint1", "joint2")}])
def test_a_mapped_interface_is_published_in_its_field(  # J9
    distro: str, lists: dict[str, Any]
) -> None:
    broadcaster = make_broadcaster(
        CUSTOM, distro=distro, map_interface_to_joint_state=MAPPED, **lists
    )

    message = publish(broadcaster)

    assert message.name == ("joint1", "joint2")
    assert_fields(message, [50.0, 50.0], [11.1, np.nan], NAN2)


@pytest.mark.parametrize(
    ("names", "position"),
    [
        pytest.param(("measured_position", "position"), 1.1, id="J10"),
        pytest.param(("measured_position", "velocity"), 50.0, id="mapped"),
    ],
)
def test_a_mapping_is_ignored_where_the_interface_itself_is_asked_for(
    names: tuple[str, ...], position: float
) -> None:
    broadcaster = make_broadcaster(
        (*MEASURED, *CUSTOM),
        joints=("joint1",),
        interfaces=names,
        map_interface_to_joint_state=MAPPED,
    )

    assert publish(broadcaster).position == (position,)


def test_an_interface_and_what_is_mapped_to_it_are_not_both_published() -> None:
    available = ("joint1/measured_position", "joint1/position")

    message, dynamic = (
        publish_(make_broadcaster(available, map_interface_to_joint_state=MAPPED))
        for publish_ in (publish, publish_dynamic)
    )

    assert message.position == (50.0,)
    assert dynamic == {"joint1": {"position": 50.0}}


SENSOR = ("imu/position", "imu/angle", "joint1/position", "joint1/temperature")


def test_dynamic_joint_states_have_all_interfaces_of_all_components() -> None:  # J16
    extra = ("extra", "imu")

    message = publish(make_broadcaster(SENSOR, extra_joints=extra))
    dynamic = publish_dynamic(make_broadcaster(SENSOR, extra_joints=extra))

    assert message.name == ("joint1", "extra")
    assert dynamic == {
        "joint1": {"position": 1.1, "temperature": 50.0},
        "imu": {"position": 50.0, "angle": 50.0},
        "extra": {"position": 0.0, "velocity": 0.0, "effort": 0.0},
    }


def test_without_the_filter_other_components_are_published_too() -> None:
    broadcaster = make_broadcaster(SENSOR, use_urdf_to_filter=False)

    message = publish(broadcaster)

    assert sorted(message.name) == ["imu", "joint1"]
    assert message.position[message.name.index("imu")] == 50.0


def test_rolling_reads_the_joints_alone() -> None:
    broadcaster = make_broadcaster(
        SENSOR, distro="rolling", use_urdf_to_filter=False, extra_joints=("imu",)
    )

    assert broadcaster.state_interfaces == ("joint1/position",)
    assert publish(broadcaster).name == ("joint1", "imu")


def test_dynamic_joint_states_can_be_switched_off() -> None:
    broadcaster = make_broadcaster(publish_dynamic_joint_states=False)

    assert not broadcaster.HasOutputPort("dynamic_joint_states")
    assert publish(broadcaster).name == ALL


def test_ports_are_named_and_sized_as_documented() -> None:
    broadcaster = make_broadcaster((*MEASURED, *CUSTOM))

    assert broadcaster.GetInputPort("state_interfaces").size() == 9 + 2
    assert broadcaster.HasInputPort("controller_manager")
    assert broadcaster.HasOutputPort("joint_states")
    assert broadcaster.HasOutputPort("dynamic_joint_states")
    assert broadcaster.CreateDefaultContext().is_stateless()


BOOL = """
  <ros2_control name="hardware" type="system">
    <hardware><plugin>mock_components/GenericSystem</plugin></hardware>
    <joint name="swing">
      <command_interface name="position"/>
      <state_interface name="position"/>
    </joint>
    <gpio name="tool">
      <state_interface name="is_on" data_type="bool"/>
      <state_interface name="level"/>
    </gpio>
  </ros2_control>"""


@pytest.mark.parametrize("preset", ["accurate", "kinematic"])
def test_bools_are_left_out(tmp_path: Path, preset: str) -> None:  # J15
    yaml = """
controller_manager:
  ros__parameters:
    jsb: {type: joint_state_broadcaster/JointStateBroadcaster}
"""
    robot = models.load(tmp_path, models.pendulum(control=BOOL), yaml)
    options = ad.SimulationOptions(preset=preset)
    simulation = ad.Simulation(ad.build_diagram(robot, options=options))

    simulation.advance_to(0.05)

    message = simulation.eval_output("jsb.dynamic_joint_states")
    by_name = dict(zip(message.joint_names, message.interface_values, strict=True))
    assert by_name["tool"].interface_names == ("level",)
    assert simulation.eval_output("jsb.joint_states").name == ("swing",)
