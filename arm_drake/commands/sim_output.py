"""What `arm-drake sim` says: how it goes, what failed, and how it ended."""

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from arm_drake.description.robot import Robot
from arm_drake.manager.state import CommandLimited
from arm_drake.messages import (
    FollowJointTrajectoryResult,
    GoalStatus,
    SwitchControllerResult,
)
from arm_drake.simulation.mailbox import GoalHandle, News
from arm_drake.simulation.simulation import Simulation


class Speaker:
    """Says how it goes: lines on standard output, progress on standard error."""

    def __init__(self, *, is_quiet: bool) -> None:
        """Create it.

        Args:
            is_quiet: Whether nothing else than JSON is to be on standard output.
        """
        self._is_quiet = is_quiet
        self._is_terminal = sys.stderr.isatty()
        self._next_report = 0.0
        self._news = ""
        self._controllers = ""
        # What ended the simulation before its end.
        self.failures: list[str] = []

    def line(self, text: str) -> None:
        """Say something, if it isn't empty."""
        if text and not self._is_quiet:
            if self._is_terminal:
                sys.stderr.write("\r\033[K")
            print(text, flush=True)

    def controllers(self, simulation: Simulation) -> None:
        """List the controllers, unless they are as they were last."""
        text = str(simulation.list_controllers())
        if text != self._controllers:
            self.line(text)
        self._controllers = text

    def page(self, text: str) -> None:
        """Say something about the page: also beside JSON, on standard error."""
        if self._is_quiet:
            print(text, file=sys.stderr, flush=True)
        else:
            self.line(text)

    def progress(self, simulated: float) -> None:
        """Show the simulated time: in place on a terminal, else once a second."""
        text = f"{simulated:7.2f} s  {self._news}"
        if self._is_terminal:
            sys.stderr.write(f"\r\033[K{text}")
            sys.stderr.flush()
        elif simulated >= self._next_report and not self._is_quiet:
            print(text, file=sys.stderr, flush=True)
            self._next_report = simulated + 1.0 - 1e-6

    def event(self, news: News) -> None:
        """Tell news of goals and switches; what fails is told at the end."""
        if isinstance(news, SwitchControllerResult) and news.ok:
            self._switched(news)
        elif isinstance(news, CommandLimited):
            text = f"commands of joint {news.joint!r} go beyond its limits"
            print(f"warning: {text}; they are held to them", file=sys.stderr)
        elif isinstance(news, GoalHandle):
            self._goal(news)

    def _switched(self, news: SwitchControllerResult) -> None:
        lists = {
            "activate": news.request.activate_controllers,
            "deactivate": news.request.deactivate_controllers,
        }
        asked = "; ".join(f"{k} {', '.join(v)}" for k, v in lists.items() if v)
        self.line(f"switch of controllers: {asked}")
        if news.message:
            print(f"warning: left out: {news.message}", file=sys.stderr)

    def _goal(self, news: GoalHandle) -> None:
        if news.status is GoalStatus.EXECUTING:
            if news.feedback:
                errors = news.feedback[-1].error.positions
                largest = max((abs(error) for error in errors), default=0.0)
                self._news = f"{news.controller}: error {1e3 * largest:.1f} mrad"
            else:
                self.line(f"{news.controller}: goal accepted")
                if news.note:
                    print(f"warning: {news.controller}: {news.note}", file=sys.stderr)
        elif news.status.is_terminal:
            self._news = ""
            self.line(f"{news.controller}: {news.describe()}")


def summarize(
    simulation: Simulation,
    robot: Robot,
    saturation: Mapping[str, float],
    wall_time: float,
    failures: Sequence[str],
) -> dict[str, Any]:
    """Return what `--json` prints.

    Args:
        simulation: A simulation that has run.
        robot: Its robot.
        saturation: How long joints were at their effort limit [s], by joint.
        wall_time: How long it took [s].
        failures: What failed, in words.
    """
    final = simulation.joint_states()
    return {
        "robot": robot.name,
        "joints": list(final.name),
        "duration": simulation.time,
        "wall_time": wall_time,
        "real_time_factor": simulation.time / wall_time if wall_time else None,
        "controllers": [row._asdict() for row in simulation.list_controllers()],
        "goals": [
            {
                "controller": goal.controller,
                "status": goal.status.value,
                **_describe_result(goal),
            }
            for goal in simulation.goals
        ],
        "failures": list(failures),
        "effort_saturation": dict(saturation),
        "final": dict(zip(final.name, final.position, strict=True)),
        "report": simulation.report.to_json(),
    }


def print_summary(
    simulation: Simulation,
    saturation: Mapping[str, float],
    wall_time: float,
    say: Speaker,
) -> None:
    """Say how a simulation ended.

    Args:
        simulation: A simulation that has run.
        saturation: How long joints were at their effort limit [s], by joint.
        wall_time: How long it took [s].
        say: What says it.
    """
    factor = simulation.time / wall_time if wall_time else 0.0
    say.line(
        f"simulated {simulation.time:.2f} s in {wall_time:.2f} s "
        f"({factor:.1f} x real time)"
    )
    for goal in simulation.goals:
        if not goal.status.is_terminal:
            say.line(f"{goal.controller}: goal is still {goal.status.value}")
    for name, seconds in saturation.items():
        say.line(f"{name} was at its effort limit for {seconds:.2f} s")


def _describe_result(goal: GoalHandle) -> dict[str, Any]:
    """Return what `--json` says of how a goal ended."""
    result = goal.result
    if isinstance(result, FollowJointTrajectoryResult):
        code, text = int(result.error_code), result.error_string
        return {"error_code": code, "error_string": text}
    said: dict[str, Any] = {"error_code": None, "error_string": goal.note}
    if result is not None:
        said |= {"stalled": result.stalled, "reached_goal": result.reached_goal}
    return said
