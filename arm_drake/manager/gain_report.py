"""What the load report says of gains that are legal and hardly meant."""

from collections.abc import Mapping
from typing import Any

from arm_drake.control.pid_gains import PidGains
from arm_drake.description.controller_manager import ControllerConfig
from arm_drake.description.report import LoadReport
from arm_drake.interfaces import EFFORT, VELOCITY


def report_gains(
    controller: ControllerConfig, parameters: Any, report: LoadReport
) -> None:
    """Report gains that push away from the goal, or not at all.

    Args:
        controller: The controller's configuration.
        parameters: Its parameters, of any class.
        report: Where the lines are added.
    """
    gains = getattr(parameters, "gains", None)
    joints: Mapping[str, PidGains] = getattr(gains, "joint", None) or getattr(
        gains, "dof", {}
    )
    if not joints:
        return
    commands = getattr(parameters, "command_interfaces", (EFFORT,))
    if EFFORT not in commands and tuple(commands) != (VELOCITY,):
        return  # They have no effect, and that is said.
    for joint, pid in joints.items():
        values = {name: getattr(pid, name) for name in ("p", "i", "d")}
        problems = [
            f"{name} is {value}: it pushes away from the goal"
            for name, value in values.items()
            if value < 0.0
        ]
        forward = getattr(pid, "ff_velocity_scale", getattr(pid, "feedforward_gain", 0))
        if not any(values.values()) and not forward:
            problems = ["p, i and d are 0: no error moves the joint"]
        for problem in problems:
            report.add(
                "warning",
                "invalid",
                problem,
                "taken as it is",
                where=f"{controller.name}.gains.{joint}",
                file=controller.file,
                line=controller.line,
            )
