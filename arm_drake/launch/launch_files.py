"""Launch files, read without ROS: what `ros2 launch` would start, as a plan.

`load_launch` runs a launch file in a process of its own (`launch_process`), which notes
the nodes and processes that it would start; `roles` says what they are for.
"""

import contextlib
import json
import os
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from arm_drake.description.entry import Source
from arm_drake.description.packages import PackageFinder
from arm_drake.description.report import LoadReport
from arm_drake.errors import ArmDrakeError, InputError, PackageError, suggest
from arm_drake.launch.launch_description_sources import is_launch_file
from arm_drake.launch.nodes import PACKAGES
from arm_drake.launch.plan import LaunchArgument, LaunchPlan, name_files
from arm_drake.launch.robot import PlanFolder
from arm_drake.launch.roles import STOOD_FOR, Roles
from arm_drake.launch.written_files import name_written

# What a launch file may take: processor time and time [s], memory and file size
# [bytes]. Real ones take below a second and 200 MB.
CPU_TIME = 20
TIME = 30.0
MEMORY = 2**31
_SIZE = 2**24
_LARGEST_ANSWER = 2**27


def find_launch_file(
    source: Source,
    name: str | None = None,
    package_paths: Sequence[Path] = (),
    report: LoadReport | None = None,
) -> Path:
    """Return a launch file: by its path, or by a package and its name.

    Of several folders of the package the nearest is taken, and the report says so.

    Raises:
        InputError: If there is none, or the package has several of that name.
    """
    path = Path(source).expanduser()
    if name is None:
        if path.is_dir():
            names = sorted({f.name for f in path.rglob("*") if is_launch_file(f)})
            text = "is a folder without launch files; expected a launch file"
            if names:
                text = "is a folder; name one of its launch files, too: "
                text += ", ".join(names)
            raise InputError(text, file=path)
        if not path.is_file():
            text = "no such launch file; expected a file, or a package and a file"
            raise InputError(text, file=path)
        return path
    if path.is_file():
        raise InputError(f"{name!r}: expected an argument as NAME:=VALUE", file=path)
    if path.is_dir():
        folder = path
    else:
        finder = PackageFinder(Path.cwd() / "launch", package_paths)
        try:
            # Links of the finder to what is installed elsewhere end with it.
            folder = finder.source(str(source))
        except PackageError as error:
            raise InputError(error.problem) from None
        if report is not None:
            _report_copies(str(source), finder, report)
    files = sorted(filter(is_launch_file, folder.rglob("*")))
    found = [file for file in files if file.name == name]
    if not found:
        known = {file.name for file in files}
        hint = suggest(name, known)
        raise InputError(f"package {str(source)!r} has no {name!r}; {hint}")
    if len(found) > 1:
        text = f"package {str(source)!r} has several {name!r}; name one by its path: "
        raise InputError(text + ", ".join(map(str, found)))
    return found[0]


def _report_copies(name: str, finder: PackageFinder, report: LoadReport) -> None:
    """Report which folder of a package is taken, if there are several."""
    others = ", ".join(map(str, finder.copies(name)))
    if others:
        what = f"package {name!r} is there several times, also as {others}"
        taken = finder.source(name)
        done = f"taken: {taken}; another one's folder can be named instead"
        report.add("warning", "repair", what, done)


def load_launch(
    source: Source,
    name: str | None = None,
    *,
    arguments: Mapping[str, str] | None = None,
    package_paths: Source | Sequence[Source] = (),
) -> LaunchPlan:
    """Return what a launch file would start, without ROS.

    A launch file in Python is a program, which is run; so is every one that it
    includes. It can't start programs, open connections, or write outside of a
    temporary folder, by what Python can refuse; don't run files that you don't trust.

    Args:
        source: A launch file, or with `name` a package: its name or its folder.
        name: Name of the file in the package.
        arguments: Values of its arguments.
        package_paths: Folders to search for packages, besides the file's surroundings.

    Raises:
        InputError: If it can't be run, with the file and the line.
        PackageError: If a package isn't found.
    """
    if isinstance(package_paths, str | os.PathLike):
        package_paths = [package_paths]
    folders = tuple(Path(each) for each in package_paths)
    for folder in folders:
        if not folder.is_dir():
            raise InputError("no such folder; expected one to search", file=folder)
    report = LoadReport()
    path = Path(os.path.abspath(find_launch_file(source, name, folders, report)))
    texts = {key: str(value) for key, value in (arguments or {}).items()}
    return _read(path, folders, texts, report)


def show_arguments(plan: Sequence[LaunchArgument]) -> str:
    """Return the arguments of a launch file, as `ros2 launch --show-args` has them."""
    lines = ["Arguments (pass arguments as '<name>:=<value>'):"]
    for argument in plan:
        text = argument.description or "no description given"
        lines += ["", f"    '{argument.name}':", f"        {text}"]
        if argument.choices is not None:
            choices = ", ".join(f"'{choice}'" for choice in argument.choices)
            lines[-1] += f" Valid choices are: [{choices}]"
        if argument.default is not None:
            lines.append(f"        (default: {argument.default!r})")
    return "\n".join(lines if plan else ["Arguments (none)"])


def load_arguments(
    source: Source,
    name: str | None = None,
    *,
    arguments: Mapping[str, str] | None = None,
    package_paths: Sequence[Path] = (),
) -> tuple[LaunchArgument, ...]:
    """Return the arguments that a launch file declares; none is required.

    What can't be read for want of others is left out, as by `ros2 launch`.

    Raises:
        InputError: As of `load_launch`.
    """
    path = Path(os.path.abspath(find_launch_file(source, name, package_paths)))
    values, folders = dict(arguments or {}), tuple(package_paths)
    answer = _ask(path, folders, values, only_shows_arguments=True)[0]
    return _arguments_of(answer)


def _arguments_of(answer: Mapping[str, Any]) -> tuple[LaunchArgument, ...]:
    return tuple(
        LaunchArgument(
            each["name"],
            each["default"],
            each["description"],
            None if each["choices"] is None else tuple(each["choices"]),
        )
        for each in answer["arguments"]
    )


def _read(
    path: Path,
    folders: tuple[Path, ...],
    values: Mapping[str, str],
    report: LoadReport,
) -> LaunchPlan:
    answer, finder, folder = _ask(path, folders, values)
    arguments = _arguments_of(answer)
    known = {argument.name for argument in arguments} | set(answer["values"])
    declared = {argument.name for argument in arguments}
    for name in values:
        # What isn't declared, but asked for, has its effect in ROS, too.
        if name not in declared and name not in answer["asked"]:
            hint = suggest(name, declared or known - set(values))
            what = f"no launch argument {name!r}; {hint}"
            report.add("warning", "ignored", what, "it may have no effect", file=path)
    for text in dict.fromkeys(answer["refused"]):
        done = "which a launch file here may not do"
        report.add("warning", "ignored", f"it {text}", done, file=path)
    for name, place in answer["kept"].items():
        if os.path.isfile(place):
            answer["rewritten"][place] = (name, True)
            what = f"it writes {name}"
            done = "it is kept for this launch alone, and used by what it starts"
            report.add("info", "repair", what, done, file=path)
    found = Roles(answer, finder, report, folder).find()
    return LaunchPlan(
        file=path,
        arguments=arguments,
        report=name_files(report),
        folder=folder,
        package_paths=(*folders, *finder.sources()),
        **found,
    )


def _ask(
    path: Path,
    folders: tuple[Path, ...],
    arguments: Mapping[str, str],
    *,
    only_shows_arguments: bool = False,
) -> tuple[Any, PackageFinder, PlanFolder]:
    """Return the answer of the process that reads a launch file."""
    finder = PackageFinder(path, folders)
    folder = PlanFolder()
    request = {
        "file": str(path),
        "arguments": dict(arguments),
        "folder": str(folder.path),
        "stood_for": str(folder.path / STOOD_FOR),
        "cpu_time": CPU_TIME,
        "memory": MEMORY,
        "size": _SIZE,
        "only_shows_arguments": only_shows_arguments,
    }
    answer = _run_process(request, finder, folder, path)
    if answer["error"] is not None:
        raise _explain(answer["error"], finder, path)
    return answer, finder, folder


def _run_process(
    request: Mapping[str, Any], finder: PackageFinder, folder: PlanFolder, path: Path
) -> Any:
    paths = [os.path.abspath(each) for each in sys.path]
    code = f"import sys; sys.path[:] = {paths!r}; "
    code += "from arm_drake.launch.launch_process import main; main()"
    with subprocess.Popen(  # noqa: S603  It is our own program.
        [sys.executable, "-I", "-S", "-X", "utf8", "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        # Without it numpy takes memory for each core of the machine.
        env={"OPENBLAS_NUM_THREADS": "1", **os.environ},
    ) as process:
        try:
            deadline = time.monotonic() + TIME
            message: Any = request
            while True:
                _send(process, message)
                line = _read_line(process, deadline)
                if line is None:
                    text = f"takes more than {TIME:g} s; launch files only say what to"
                    raise InputError(f"{text} start", file=path)
                if not line:
                    break
                answer = _parse(line, path)
                if "error" in answer:
                    return answer
                message = _find(answer, finder, folder)
        finally:
            with contextlib.suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)
    raise InputError(_explain_exit(process.returncode), file=path)


def _explain_exit(code: int) -> str:
    """Return why a process that has not answered is no more."""
    if code == -signal.SIGXCPU:
        return f"takes more than {CPU_TIME} s of processor time"
    if code < 0:
        name = signal.Signals(-code).name
        memory = f"; it may take {MEMORY // 2**20} MB of memory"
        return f"its process was ended by {name}{memory}"
    return f"ended its process with code {code}, before it said what to start"


def _parse(line: bytes, path: Path) -> dict[str, Any]:
    """Return what the process says; a launch file may have spoken in between."""
    try:
        found = json.loads(line)
    except ValueError:
        found = None
    if not isinstance(found, dict):
        text = "wrote into what its process tells; launch files only say what to start"
        raise InputError(text, file=path)
    return found


def _send(process: subprocess.Popen[bytes], value: Any) -> None:
    with contextlib.suppress(BrokenPipeError):
        assert process.stdin is not None
        process.stdin.write(json.dumps(value).encode() + b"\n")
        process.stdin.flush()


def _read_line(process: subprocess.Popen[bytes], deadline: float) -> bytes | None:
    """Return a line of a process, none at its end; None if it comes too late."""
    assert process.stdout is not None
    found = b""
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        while not found.endswith(b"\n"):
            rest = deadline - time.monotonic()
            if rest <= 0.0 or not selector.select(rest):
                return None
            piece = os.read(process.stdout.fileno(), 2**16)
            if not piece:
                return b""
            found += piece
            if len(found) > _LARGEST_ANSWER:
                raise InputError("it says more than fits into a plan")
    return found


def _find(
    question: Mapping[str, Any], finder: PackageFinder, folder: PlanFolder
) -> Any:
    """Return the folder or the text that a launch file needs, None for none."""
    if "expand" in question:
        try:
            file = Path(question["expand"])
            return {"text": folder.expand(file, question["arguments"], finder)}
        except ArmDrakeError as error:
            return {"problem": str(error)}
    name = question.get("find", question.get("find_sources", ""))
    is_source = "find_sources" in question
    if name in PACKAGES and not is_source:
        shown = folder.path / STOOD_FOR / name
        shown.mkdir(parents=True, exist_ok=True)
        return str(shown)
    try:
        found = finder.source(name) if is_source else finder.find(name)
    except PackageError:
        return None
    return str(found)


def _explain(
    error: Mapping[str, Any], finder: PackageFinder, path: Path
) -> ArmDrakeError:
    """Return what is wrong with a launch file, in our words."""
    file, line = error.get("file") or path, error.get("line")
    file = finder.real(Path(name_written(str(file))))
    match error["kind"]:
        case "package":
            try:
                finder.find(error["name"])
            except PackageError as missing:
                return PackageError(missing.problem, file=file, line=line)
            problem = f"package {error['name']!r} not found"
        case "import":
            first = error["name"].partition(".")[0]
            with contextlib.suppress(PackageError):
                text = f"it imports {error['name']!r}, which isn't in its package, "
                text += f"{finder.source(first)}; a build makes it, or files lack"
                return InputError(text, file=file, line=line)
            known = (
                "launch, launch_ros, ament_index_python, xacro, moveit_configs_utils"
            )
            problem = (
                f"it imports {error['name']!r}, which isn't there without ROS; "
                f"known: {known}, what Python finds, and packages' own modules"
            )
        case "memory":
            problem = f"needs more than {MEMORY // 2**20} MB of memory"
        case _:
            problem = error["text"].removeprefix(f"{file}: ")
    return InputError(name_written(problem), file=file, line=line)
