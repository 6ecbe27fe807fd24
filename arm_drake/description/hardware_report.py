"""What of `<ros2_control>` blocks the simulator stands in for or leaves alone."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from arm_drake import interfaces
from arm_drake.description.elements import ElementReader
from arm_drake.description.hardware_info import ComponentInfo, HardwareInfo
from arm_drake.description.report import LoadReport

# The simulator whose blocks give joints PID gains.
CLASSIC = "Gazebo Classic"

# Plugins that are simulators themselves.
SIMULATOR_PLUGINS = {
    "gz_ros2_control/GazeboSimSystem": "Gazebo Sim",
    "ign_ros2_control/IgnitionSystem": "Ignition Gazebo",
    "gazebo_ros2_control/GazeboSystem": CLASSIC,
    "mock_components/GenericSystem": "mock hardware",
    "fake_components/GenericSystem": "mock hardware",
}

_NUMBERS = ("initial_position", "initial_velocity", "initial_effort")
_GAINS = ("kp", "ki", "kd", "max_integral_error", "min_integral_error")

# Parameters of joints that are read.
_READ = {"mimic", "multiplier", *_NUMBERS}
_READ |= {prefix + gain for prefix in ("pos_", "vel_") for gain in _GAINS}

# What a joint can be commanded.
_COMMANDS = (*interfaces.STATE_INTERFACES, interfaces.ACCELERATION)

# What it can report.
_STATES = _COMMANDS


def report_hardware(
    hardware: Sequence[HardwareInfo], report: LoadReport, file: Path
) -> None:
    """Report what the blocks say that has no effect here, a line per sort and block.

    Args:
        hardware: Blocks of the description.
        report: Where the lines are added.
        file: File to name in them.
    """
    for block in hardware:
        reader = ElementReader(f"ros2_control {block.name!r}", report, file)
        _report_plugin(block, reader)
        for what, done in _remarks(block):
            reader.note("info", "unsupported", what, done)


def _report_plugin(block: HardwareInfo, reader: ElementReader) -> None:
    done = "the simulator stands in for it"
    if not block.plugin:
        what = "no hardware plugin is named; expected <hardware><plugin>"
        reader.note("warning", "missing", what, done)
        return
    if block.plugin in SIMULATOR_PLUGINS and not block.parameters:
        return  # Another simulator's: no hardware is replaced.
    what = f"hardware plugin {block.plugin!r}"
    if block.plugin in SIMULATOR_PLUGINS:
        what += f" ({SIMULATOR_PLUGINS[block.plugin]})"
    if block.parameters:
        done += f", without its parameters {_listed(block.parameters)}"
    reader.note("info", "ignored", what, done)


def _remarks(block: HardwareInfo) -> Iterable[tuple[str, str]]:
    kept = "kept as plain values, not simulated"
    custom = {
        interface.name
        for joint in block.joints
        for names, known in (
            (joint.command_interfaces, _COMMANDS),
            (joint.state_interfaces, _STATES),
        )
        for interface in names
        if interface.name not in known
    }
    if custom:
        yield f"interfaces {_listed(sorted(custom))}", kept
    # Of the others `find_sensors` says what becomes of them.
    stored = [s for s in block.sensors if not _is_measured(s)]
    for kind, components in (("sensors", stored), ("gpios", block.gpios)):
        if components:
            yield f"{kind} {_listed(c.name for c in components)}", kept
    if block.transmissions:
        names = _listed(transmission.name for transmission in block.transmissions)
        yield f"transmissions {names}", "joints are driven without them"
    gains = [joint.name for joint in block.joints if _has_gains(joint)]
    # Those of Gazebo Classic drive the joints, see drive_gains.
    if gains and SIMULATOR_PLUGINS.get(block.plugin) != CLASSIC:
        yield f"PID gains of joints {_listed(gains)}", "the joint servo has its own"
    others = {name for joint in block.joints for name in joint.parameters} - _READ
    if others:
        yield f"joint parameters {_listed(sorted(others))}", kept
    timing = [
        name
        for name, is_given in (
            ("rw_rate", block.rw_rate != 0),
            ("is_async", block.is_async),
            ("thread_priority", block.thread_priority != 50),
            ("group", bool(block.group)),
        )
        if is_given
    ]
    if timing:
        done = "the hardware is read and written at every tick of the manager"
        yield ", ".join(timing), done


def _is_measured(sensor: ComponentInfo) -> bool:
    return any(i.name in interfaces.MEASURED for i in sensor.state_interfaces)


def _has_gains(joint: ComponentInfo) -> bool:
    return joint.position_pid is not None or joint.velocity_pid is not None


def _listed(names: Iterable[str]) -> str:
    return ", ".join(map(repr, names))
