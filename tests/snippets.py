"""The code blocks of the pages, and what follows a page as a reader would."""

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import markdown_it

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]

# Stands for the command line: a page in a viewer's hands ends at once.
_COMMAND_LINE = """#!{python}
import sys
from arm_drake.cli import main
from arm_drake.visualization.page.robot_viewer import RobotViewer
RobotViewer.run = lambda *_, **__: None
sys.exit(main())
"""

# Programs that a block of shell commands may call.
PROGRAMS = ("arm-drake", "make", "pip", "python", "ssh")


class Block(NamedTuple):
    """A code block: its language ("" if it is only indented), its text, its file."""

    language: str
    text: str

    # What the step before it says to write, and whether to its end.
    file: str = ""
    appends: bool = False

    # Why no test runs it.
    not_run: str = ""

    def commands(self) -> list[list[str]]:
        """Return the words of each command of a block of shell commands."""
        lines = self.text.replace("\\\n", " ").splitlines()
        return [words for line in lines if (words := shlex.split(line, comments=True))]


def read_blocks(page: Path) -> Iterator[Block]:
    """Yield the code blocks of a page in their order."""
    file, note = "", ""
    for token in markdown_it.MarkdownIt("commonmark").parse(
        page.read_text(encoding="utf-8")
    ):
        if token.type == "inline":
            written = re.findall(r"[Ww]rite(?: [\w ]+,)? `([^`]+)`", token.content)
            file, note = (written or [""])[0], ""
        elif token.type == "html_block":
            note = token.content.strip().strip("<!->").strip()
        elif token.type in ("fence", "code_block"):
            kind, _, rest = note.partition(" to " if "append to" in note else ": ")
            yield Block(
                token.info.strip(),
                token.content,
                rest if kind == "append" else file,
                appends=kind == "append",
                not_run=rest if kind == "not run" else "",
            )
            file, note = "", ""


def make_programs(folder: Path) -> None:
    """Write programs as an installation has them: python and arm-drake."""
    folder.mkdir()
    (folder / "arm-drake").write_text(_COMMAND_LINE.format(python=sys.executable))
    (folder / "python").write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    for program in folder.iterdir():
        program.chmod(0o755)


def follow(page: Path, folder: Path, package: Path = ROOT) -> str:
    """Write the files of a page and run its commands, in their order.

    Args:
        page: A page whose steps say which files to write.
        folder: Where to do it.
        package: Folder that has the arm_drake that is used.

    Returns:
        What the commands printed.
    """
    programs = folder / ".programs"
    make_programs(programs)
    path = f"{programs}:{os.environ['PATH']}"
    python_path = f"{package}:{folder}"
    environment = {**os.environ, "PATH": path, "PYTHONPATH": python_path}
    printed = ""
    for block in read_blocks(page):
        if block.not_run:
            continue
        if block.file:
            file = folder / block.file
            file.parent.mkdir(parents=True, exist_ok=True)
            with file.open("a" if block.appends else "w", encoding="utf-8") as target:
                target.write(block.text)
        else:
            assert block.language == "sh", block
            done = subprocess.run(
                ["sh", "-ec", block.text],
                cwd=folder,
                env=environment,
                capture_output=True,
                text=True,
                check=False,
            )
            printed += done.stdout
            assert done.returncode == 0, done.stdout + done.stderr
    return printed
