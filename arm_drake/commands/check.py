"""The command `arm-drake check`: a robot's summary and its load report."""

import json
from pathlib import Path
from typing import Any

from arm_drake.description.controllers import MANAGER
from arm_drake.description.report import LoadReport, ReportEntry
from arm_drake.description.robot import Robot
from arm_drake.description.urdf import reach, total_mass
from arm_drake.diagram import build_diagram
from arm_drake.errors import InputError, counted
from arm_drake.hardware.drive_report import SERVO
from arm_drake.planning.groups import planning_groups
from arm_drake.planning.timing import motion_limits
from arm_drake.simulation.simulation import Simulation

# Exit codes.
_CLEAN, _BAD = 0, 1


# What is done about a controller that doesn't start.
_LEFT_OUT = ("the controller", "left out")


def check(robot: Robot, *, strict: bool, as_json: bool) -> int:
    """Print a robot's summary and its load report; return the exit code.

    It is 1 for an error in the report, and if `strict` for a warning, too.
    """
    _read_moveit_files(robot)
    simulation = Simulation(build_diagram(robot))
    controllers = simulation.list_controllers()
    report, servo = _split(simulation.report)
    rows: list[dict[str, Any]] = [
        {"name": c.name, "type": c.type, "state": c.state, "problem": None}
        for c in controllers
    ]
    for row in rows:
        if row["state"] != "active":
            row["problem"] = _problem(row["name"], report)
    description = robot.description
    content = {
        "robot": robot.name,
        "file": str(description.file),
        "links": len(description.links),
        "joints": [joint.name for joint in description.movable_joints],
        "mass": total_mass(description),
        "reach": reach(description),
        "base": "free" if robot.has_free_base else "fixed",
        "controllers": rows,
        "servo": [{"what": entry.what, "done": entry.done} for entry in servo],
        "report": report.to_json(),
    }
    print(json.dumps(content) if as_json else _text(robot.title, content, report))
    bad = report.problems if strict else report.errors
    return _BAD if bad else _CLEAN


def _read_moveit_files(robot: Robot) -> None:
    """Read what plans would, so that the report says what of it counts."""
    try:
        planning_groups(robot)
        motion_limits(robot)
    except InputError as error:
        robot.report.add(
            "error",
            "invalid",
            error.problem,
            "nothing can be planned",
            file=error.file,
            line=error.line,
        )


def _split(report: LoadReport) -> tuple[LoadReport, LoadReport]:
    """Return what a report says of files, and of how joints are driven."""
    return (
        LoadReport(entry for entry in report if entry.where != SERVO),
        LoadReport(entry for entry in report if entry.where == SERVO),
    )


def _problem(controller: str, report: LoadReport) -> str | None:
    """Return why a controller doesn't start."""
    for entry in report:
        where = entry.where.removeprefix(f"{MANAGER}.")
        is_meant = where == controller or where.startswith(f"{controller}.")
        if is_meant and entry.done.startswith(_LEFT_OUT):
            parameter = where.removeprefix(controller).removeprefix(".")
            return f"{parameter}: {entry.what}" if parameter else entry.what
    return None


def _text(title: str, content: dict[str, Any], report: LoadReport) -> str:
    joints = content["joints"]
    far = f"at most {content['reach']:.3g} m from the first joint to the last link, "
    lines = [
        f"{title}: {counted(content['links'], 'link')}, "
        f"{counted(len(joints), 'movable joint')}, {content['mass']:.3g} kg, "
        f"{far if content['reach'] else ''}{content['base']} base",
        f"joints: {', '.join(joints) or 'none'}",
    ]
    for row in content["controllers"]:
        problem = f": {row['problem']}" if row["problem"] else ""
        lines.append(
            f"controller {row['name']} ({row['type']}): {row['state']}{problem}"
        )
    lines += [f"joint servo: {row['what']}; {row['done']}" for row in content["servo"]]
    lines += _report_lines(report) or ["report: nothing"]
    return "\n".join(lines)


def _report_lines(report: LoadReport) -> list[str]:
    """Return the report by severity and file, each file named once."""
    lines = []
    entries = report.grouped()
    for severity, title in (("error", "errors"), ("warning", "warnings"), ("info", "")):
        chosen = [entry for entry in entries if entry.severity == severity]
        if chosen:
            lines.append(f"\n{title or 'for your information'}:")
        files = dict.fromkeys(entry.file for entry in chosen)
        for file in files:
            if file:
                lines.append(f"  {_short(file)}")
            for entry in chosen:
                if entry.file == file:
                    lines.append(f"    {_place(entry)}{entry.what}; {entry.done}")
    return lines


def _place(entry: ReportEntry) -> str:
    line = None if entry.line is None else f"line {entry.line}"
    place = ", ".join(part for part in (line, entry.where) if part)
    return f"{place}: " if place else ""


def _short(file: str) -> str:
    """Return a path as seen from here, if it lies below."""
    path = Path(file)
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)
