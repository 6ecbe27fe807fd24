import dataclasses as dc
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.controllers.gpio_controllers import (
    GpioCommandController,
    GpioCommandControllerParameters,
    GpioInterfaces,
    InterfacesByGpio,
)
from arm_drake.errors import ParameterError
from arm_drake.messages import InterfaceValue, TopicRejected
from arm_drake.messages.control import DynamicInterfaceGroupValues
from tests import models
from tests.controllers.driving import Driven, make_params

TYPE = "gpio_controllers/GpioCommandController"
# As in upstream's tests: GPIO 1 has two digital interfaces, GPIO 2 an analog one.
CLAIMS = {"gpio1": ("dig.1", "dig.2"), "gpio2": ("ana.1",)}
MEASURED = ("gpio1/dig.1", "gpio1/dig.2", "gpio2/ana.1", "gpio3/dig.1")
# Physics knows it, but the hardware doesn't report it.
UNREPORTED = "gpio1/effort"
HELD = (1.0, 0.0, 3.1)
EVERY = {"gpio1": {"dig.1": 0.0, "dig.2": 1.0}, "gpio2": {"ana.1": 30.0}}


def by_gpio(names: dict[str, tuple[str, ...]]) -> InterfacesByGpio:
    return InterfacesByGpio({gpio: GpioInterfaces(n) for gpio, n in names.items()})


def drive(
    commands: dict[str, tuple[str, ...]] = CLAIMS,
    states: dict[str, tuple[str, ...]] | None = None,
    *,
    gpios: tuple[str, ...] = ("gpio1", "gpio2"),
    distro: str = "jazzy",
) -> Driven:
    """Return a driven controller; what its GPIOs report are 1, 0, 3.1."""
    params = dc.replace(
        make_params((), distro=distro),
        state_interfaces=frozenset(MEASURED),
        measured=(*MEASURED, UNREPORTED),
    )
    parameters = GpioCommandControllerParameters(
        gpios, by_gpio(commands), by_gpio(states or {})
    )
    system = GpioCommandController(parameters, params)
    driven = Driven(system, HELD[: len(system.command_interfaces)])
    driven.measure([1.0, 0.0, 3.1, 7.0])
    return driven


def message(groups: dict[str, dict[str, float]]) -> DynamicInterfaceGroupValues:
    values = [InterfaceValue(tuple(g), tuple(g.values())) for g in groups.values()]
    return DynamicInterfaceGroupValues(
        interface_groups=tuple(groups), interface_values=tuple(values)
    )


def send(driven: Driven, groups: dict[str, dict[str, float]], **how: Any) -> bool:
    """Run a cycle with a message on the topic; return whether the tick went well."""
    return driven.run({"commands": message(groups)}, **how).is_ok


def shown(driven: Driven) -> dict[str, dict[str, float]]:
    """Return what gpio_states shows."""
    return as_dict(driven.output("gpio_states"))


def as_dict(states: DynamicInterfaceGroupValues) -> dict[str, dict[str, float]]:
    return {
        gpio: dict(zip(value.interface_names, value.values, strict=True))
        for gpio, value in zip(
            states.interface_groups, states.interface_values, strict=True
        )
    }


def test_a_message_is_written_and_holds() -> None:  # GP1
    driven = drive()

    assert send(driven, EVERY)

    assert driven.system.command_interfaces == MEASURED[:3]
    assert driven.command_values.tolist() == [0.0, 1.0, 30.0]
    assert driven.run().command.tolist() == [0.0, 1.0, 30.0]
    assert driven.reasons() == []


def test_the_order_in_a_message_does_not_count() -> None:  # GP2
    driven = drive()

    assert send(driven, {"gpio2": {"ana.1": 30.0}, "gpio1": {"dig.2": 1, "dig.1": 0}})

    assert driven.command_values.tolist() == [0.0, 1.0, 30.0]


def test_what_a_message_does_not_name_stays() -> None:  # GP3
    driven = drive()

    assert send(driven, {"gpio1": {"dig.1": 0.0, "dig.2": 1.0}})
    assert send(driven, {"gpio1": {"dig.1": 5.0, "dig.2": math.nan}})

    assert driven.command_values.tolist() == [5.0, 1.0, 3.1]


@pytest.mark.parametrize(
    ("groups", "names", "values", "reason"),
    [
        (
            ["gpio1"],
            [["dig.1", "dig.2"]],
            [[0.0]],
            "interface_values[0].values (gpio1) must be as many as interface_names, "
            "2, got 1; the update fails",
        ),
        (
            ["gpio2", "gpio1"],
            [["ana.1"], ["dig.1"]],
            [[30.0], [0.0, 1.0]],
            "interface_values[1].values (gpio1) must be as many as interface_names, "
            "1, got 2; the update fails",
        ),
        (
            ["gpio1", "gpio2"],
            [["dig.1"]],
            [[0.0]],
            "interface_values must be as many as interface_groups, 2, got 1; "
            "the update fails",
        ),
    ],
)
def test_sizes_that_do_not_match_fail_and_write_nothing(  # GP4
    groups: Any, names: Any, values: Any, reason: str
) -> None:
    driven = drive()
    sent = DynamicInterfaceGroupValues(
        interface_groups=groups,
        interface_values=[
            InterfaceValue(n, v) for n, v in zip(names, values, strict=True)
        ],
    )

    tick = driven.run({"commands": sent})

    assert not tick.is_ok
    assert tick.fault == reason.removesuffix("; the update fails")
    assert driven.command_values.tolist() == list(HELD)
    assert driven.output("events") == ((0, TopicRejected(sent, reason)),)


@pytest.mark.parametrize(("groups", "num_values"), [(["gpio1"], 0), ([], 1), ([], 0)])
def test_without_groups_or_values_a_message_takes_the_last_one_back(
    groups: list[str], num_values: int
) -> None:
    driven = drive()
    send(driven, EVERY)
    driven.command_values = np.array(HELD)
    sent = DynamicInterfaceGroupValues(
        interface_groups=groups,
        interface_values=[InterfaceValue(["dig.1"], [5.0])] * num_values,
    )

    is_ok = driven.run({"commands": sent}).is_ok

    assert is_ok
    assert driven.command_values.tolist() == list(HELD)


def test_values_beyond_the_groups_are_skipped() -> None:
    driven = drive()
    sent = DynamicInterfaceGroupValues(
        interface_groups=["gpio1"],
        interface_values=[InterfaceValue(["dig.1"], [5.0]), InterfaceValue(["x"], [])],
    )

    is_ok = driven.run({"commands": sent}).is_ok

    assert is_ok
    assert driven.command_values.tolist() == [5.0, *HELD[1:]]
    reason = (
        "interface_values must be as many as interface_groups, 1, got 2; the rest is "
        "skipped"
    )
    assert driven.output("events") == ((0, TopicRejected(sent, reason)),)


# Its update fails.
UNEQUAL = DynamicInterfaceGroupValues(
    interface_groups=["gpio1"], interface_values=[InterfaceValue(["dig.1"], [])]
)


def test_a_failure_lasts_where_the_manager_goes_on() -> None:
    driven = drive(distro="humble")
    send(driven, EVERY)
    driven.command_values = np.array(HELD)

    driven.run({"commands": UNEQUAL})
    tick = driven.run()

    assert not tick.is_ok
    assert driven.command_values.tolist() == list(HELD)
    assert send(driven, EVERY)


def test_after_a_failure_an_activation_starts_anew() -> None:
    driven = drive()
    driven.run({"commands": UNEQUAL})
    driven.run(activation=None)

    tick = driven.run(activation=2)

    assert tick.is_ok
    assert np.isnan(tick.command).all()


def test_names_that_are_not_claimed_are_skipped() -> None:  # GP5
    driven = drive()

    assert send(driven, {"gpio9": {"dig.1": 4.0}, "gpio1": {"dig.2": 1.0, "dig.7": 2}})

    assert driven.command_values.tolist() == [1.0, 1.0, 3.1]
    assert driven.reasons() == [
        "no command interface 'gpio9/dig.1', 'gpio1/dig.7' here, skipped; did you "
        "mean 'gpio1/dig.1'? known: gpio1/dig.1, gpio1/dig.2, gpio2/ana.1"
    ]


def test_all_states_are_shown_if_none_are_configured() -> None:  # GP6
    driven = drive()
    driven.run()

    driven.run()

    states = driven.output("gpio_states")
    # Two cycles at 100 Hz: the second one is at 0.01 s.
    assert states.header.stamp == ad.messages.Time(0, 10_000_000)
    assert as_dict(states) == {
        "gpio1": {"dig.1": 1.0, "dig.2": 0.0},
        "gpio2": {"ana.1": 3.1},
    }


def test_configured_states_alone_are_shown() -> None:
    driven = drive(states={"gpio1": ("dig.2",)})

    driven.run()

    assert driven.system.state_interfaces == ("gpio1/dig.2",)
    assert shown(driven) == {"gpio1": {"dig.2": 0.0}, "gpio2": {}}


def test_states_are_unknown_before_the_first_tick() -> None:
    driven = drive()
    before = shown(driven)

    driven.run()
    driven.run(activation=None)
    after = shown(driven)

    assert before["gpio2"] == pytest.approx({"ana.1": math.nan}, nan_ok=True)
    assert after["gpio2"] == {"ana.1": 3.1}


def test_without_commands_states_are_shown() -> None:
    driven = drive(commands={})

    assert send(driven, {"gpio1": {"dig.1": 0.0}})

    assert driven.system.command_interfaces == ()
    assert shown(driven)["gpio1"] == {"dig.1": 1.0, "dig.2": 0.0}
    assert driven.reasons() == [
        "no command interface 'gpio1/dig.1' here, skipped; known: none"
    ]


def test_with_nothing_to_do_it_is_refused() -> None:  # GP8
    with pytest.raises(ParameterError) as caught:
        drive({}, gpios=("gpio8", "gpio9"))

    assert str(caught.value) == (
        "no command interface and no state interface is configured, and the hardware "
        f"reports none of gpio8, gpio9; it has {', '.join(MEASURED)}"
    )


def test_a_deactivation_forgets_the_message() -> None:
    driven = drive()
    send(driven, EVERY)

    ended = driven.run(activation=None)
    tick = driven.run(activation=2)

    assert np.isnan(ended.command).all()
    assert np.isnan(tick.command).all()
    assert driven.command_values.tolist() == [0.0, 1.0, 30.0]


def test_a_message_for_an_inactive_controller_is_rejected() -> None:
    driven = drive()
    driven.run(activation=None)

    send(driven, EVERY, activation=None)
    driven.run(activation=1)

    assert driven.command_values.tolist() == list(HELD)
    assert driven.reasons() == ["the controller is not active"]


def test_of_several_messages_the_last_one_counts() -> None:
    driven = drive()

    driven.run({"commands": (message(EVERY), message({"gpio2": {"ana.1": 4.0}}))})

    assert driven.command_values.tolist() == [1.0, 0.0, 4.0]


def test_something_else_on_the_port_is_an_error() -> None:
    with pytest.raises(TypeError, match="expected a DynamicInterfaceGroupValues"):
        drive().run({"commands": "no"})


def test_messages_may_be_mappings() -> None:
    made = DynamicInterfaceGroupValues(
        header={"frame_id": "f"},  # type: ignore[arg-type]
        interface_groups=["io"],  # type: ignore[arg-type]
        interface_values=[{"interface_names": ["a"], "values": [1]}],  # type: ignore
    )

    assert made.header.frame_id == "f"
    assert made.interface_groups == ("io",)
    assert made.interface_values == (InterfaceValue(("a",), (1.0,)),)


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        (
            {"interface_groups": "io"},
            "interface_groups: expected names, got 'io'",
        ),
        (
            {"interface_values": {"values": [1]}},
            "interface_values: expected a sequence of InterfaceValue, "
            "got {'values': [1]}",
        ),
        (
            {"interface_values": [{"value": [1]}]},
            "interface_values[0]: a InterfaceValue has no field value; "
            "it has interface_names, values",
        ),
        (
            {"interface_values": [{"values": ["1"]}]},
            "interface_values[0].values: expected numbers, got ['1']",
        ),
    ],
)
def test_a_message_is_checked_where_it_is_made(fields: Any, problem: str) -> None:
    with pytest.raises(ValueError, match="interface") as caught:
        DynamicInterfaceGroupValues(**fields)

    assert str(caught.value) == problem


URDF = f"""
<robot name="station">
  <link name="base"/>{models.bob("bob")}{models.joint("swing", "base", "bob")}
  <ros2_control name="hardware" type="system">
    <hardware><plugin>mock_components/GenericSystem</plugin></hardware>
    <joint name="swing">
      <command_interface name="position"/><state_interface name="position"/>
    </joint>
    <gpio name="io">
      <command_interface name="valve"/>
      <state_interface name="valve"><param name="initial_value">0.5</param>
      </state_interface>
      <state_interface name="pressure"><param name="initial_value">2.5</param>
      </state_interface>
    </gpio>
  </ros2_control>
</robot>"""
YAML = f"""
controller_manager:
  ros__parameters:
    update_rate: 100
    station: {{type: {TYPE}}}
station:
  ros__parameters:
    gpios: [io]
    command_interfaces: {{io: {{interfaces: [valve]}}}}
"""
TYPES = {
    TYPE: ad.ControllerType(GpioCommandControllerParameters, GpioCommandController)
}


@pytest.mark.parametrize("preset", ["kinematic", None])
def test_a_robot_s_gpios_are_commanded_and_read(
    tmp_path: Path, preset: str | None
) -> None:
    robot = models.load(tmp_path, URDF, YAML, controller_types=TYPES)
    options = ad.SimulationOptions(**({"preset": preset} if preset else {}))
    simulation = ad.Simulation(ad.build_diagram(robot, options=options))
    simulation.advance_to(0.015)
    before = as_dict(simulation.eval_output("station.gpio_states"))

    simulation.topic("/station/commands").publish(
        {
            "interface_groups": ["io"],
            "interface_values": [
                {"interface_names": ["valve", "lamp"], "values": [3.5, 1]}
            ],
        }
    )
    simulation.advance_to(0.1)

    assert before == {"io": {"valve": 0.5, "pressure": 2.5}}
    after = as_dict(simulation.eval_output("station.gpio_states"))
    assert after == {"io": {"valve": 3.5, "pressure": 2.5}}
    ((_, event),) = simulation.eval_output("station.events")
    assert event.reason == (
        "no command interface 'io/lamp' here, skipped; did you mean 'io/valve'? "
        "known: io/valve"
    )


def test_one_that_only_reads_is_deactivated_when_it_fails(tmp_path: Path) -> None:
    yaml = YAML.replace("command_interfaces", "state_interfaces")
    robot = models.load(tmp_path, URDF, yaml, controller_types=TYPES)
    simulation = ad.Simulation(ad.build_diagram(robot))

    values = InterfaceValue(("valve", "lamp"), (1.0,))
    message = DynamicInterfaceGroupValues(
        interface_groups=("io",), interface_values=(values,)
    )
    simulation.topic("/station/commands").publish(message)
    simulation.advance_to(0.1)

    (controller,) = simulation.list_controllers()
    assert controller.state == "inactive"


def test_a_robot_without_the_gpio_has_an_inactive_controller(tmp_path: Path) -> None:
    yaml = YAML.replace("[valve]", "[lamp]")
    robot = models.load(tmp_path, URDF, yaml, controller_types=TYPES)

    simulation = ad.Simulation(ad.build_diagram(robot))

    (controller,) = simulation.list_controllers()
    assert controller.state == "inactive"
    (line,) = [text for text in str(simulation.report).splitlines() if "lamp" in text]
    assert "has no command interface 'lamp'; it has ['valve']" in line
