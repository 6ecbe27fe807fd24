"""Files that a launch file writes in places of the user's: kept in its own folder.

Many write a description or parameters beside themselves or into `/tmp`, and start nodes
with the name. They find again what they wrote, and so do the nodes.
"""

import builtins
import errno
import io
import os
import re
import shutil
import tempfile
from collections.abc import Mapping
from typing import Any

_NAMES_A_FILE = (str, bytes, os.PathLike)

# How the folders of plans begin, and where in them written files are kept.
PREFIX = "arm_drake_launch_"
_KEPT = "written"


def name_written(text: str) -> str:
    """Return a text that names written files as the launch file does."""
    temporary = re.escape(os.path.realpath(tempfile.gettempdir()))
    return re.sub(rf"{temporary}/{PREFIX}\w+/{_KEPT}(?=/)", "", text)


class WrittenFiles:
    """What was written elsewhere, and where it is kept below a folder."""

    def __init__(self, folder: str) -> None:
        """Create it, with the folder in which all may be written."""
        self._folder = os.path.realpath(folder)
        # Where a file is kept, by its name.
        self.kept: dict[str, str] = {}
        self._stat, self._mkdir, self._rename = os.stat, os.mkdir, os.rename
        self._open, self._open_descriptor, self._move = open, os.open, shutil.move

    def install(self) -> None:
        """Let functions of Python's that take names of files know them from now on."""
        vars(builtins)["open"] = vars(io)["open"] = self.open
        vars(os).update(stat=self.stat, mkdir=self.mkdir, open=self.open_descriptor)
        vars(os).update(rename=self.rename, replace=self.rename)
        vars(shutil).update(move=self.move, rmtree=self._of_kept(shutil.rmtree))
        for name in ("access", "listdir", "lstat", "scandir"):
            vars(os)[name] = self._of_kept(getattr(os, name))
        for name in ("remove", "rmdir", "unlink"):
            vars(os)[name] = self._of_kept(getattr(os, name), changes=True)
        for name in ("chmod", "truncate", "utime"):
            function = self._of_kept(getattr(os, name), changes=True, keeps=True)
            vars(os)[name] = function

    def open(self, file: Any, mode: Any = "r", *args: Any, **kwargs: Any) -> Any:
        """Open a file; one that is to be written, where it is kept."""
        if isinstance(file, _NAMES_A_FILE) and isinstance(mode, str):
            if (opener := kwargs.pop("opener", None)) is not None:
                # What is opened is what this opens, by its own name.
                kwargs["opener"] = lambda _, flags, name=file: opener(name, flags)
                file = os.devnull
            elif set(mode) & set("wax+"):
                file = self._keep(file, mode)
            else:
                file = self._find(file)
        return self._open(file, mode, *args, **kwargs)

    def open_descriptor(
        self, path: Any, flags: int, *args: Any, dir_fd: Any = None, **kwargs: Any
    ) -> int:
        """Do what `os.open` does, as `open`."""
        if isinstance(path, _NAMES_A_FILE) and dir_fd is None:
            if flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC):
                made = "x" if flags & os.O_EXCL else "a"
                path = self._keep(path, made if flags & os.O_CREAT else "r+")
            else:
                path = self._find(path)
        return self._open_descriptor(path, flags, *args, dir_fd=dir_fd, **kwargs)

    def stat(self, path: Any, **kwargs: Any) -> os.stat_result:
        """Return what `os.stat` does, of a file where it is kept."""
        if isinstance(path, _NAMES_A_FILE) and not kwargs.get("dir_fd"):
            path = self._find(path)
        return self._stat(path, **kwargs)

    def mkdir(self, path: Any, *args: Any, **kwargs: Any) -> None:
        """Make a folder, or what is kept for one."""
        if kwargs.get("dir_fd") is None and not self._is_own(full := _full(path)):
            if os.path.lexists(full):
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), full)
            self._require_folder(full)
            self.kept[full] = path = self._place(full)
            os.makedirs(path, exist_ok=True)
            return
        self._mkdir(path, *args, **kwargs)

    def rename(self, source: Any, target: Any, **kwargs: Any) -> None:
        """Rename a file; one that is kept, where it is."""
        if not kwargs and self._has(source):
            source, target = self._find(source), self._keep(target, "w")
        self._rename(source, target, **kwargs)

    def move(self, source: Any, target: Any, *args: Any, **kwargs: Any) -> Any:
        """Do what `shutil.move` does, with a file that is kept."""
        if not self._has(source):
            return self._move(source, target, *args, **kwargs)
        if os.path.isdir(target):
            target = os.path.join(target, os.path.basename(source))
        self.rename(source, target)
        return target

    def real(self, value: Any) -> Any:
        """Return a value in whose texts names are those of where files are kept."""
        if not self.kept:
            return value
        if isinstance(value, Mapping):
            return {key: self.real(each) for key, each in value.items()}
        if isinstance(value, list | tuple):
            return [self.real(each) for each in value]
        if not isinstance(value, str):
            return value
        names = "|".join(map(re.escape, sorted(self.kept, key=len, reverse=True)))
        pattern = rf"(?<![\w./-])(?:{names})(?![\w-]|\.\w)"
        return re.sub(pattern, lambda match: self.kept[match[0]], value)

    def _of_kept(
        self, function: Any, *, changes: bool = False, keeps: bool = False
    ) -> Any:
        def call(path: Any = ".", *args: Any, **kwargs: Any) -> Any:
            if isinstance(path, _NAMES_A_FILE) and kwargs.get("dir_fd") is None:
                if changes and not os.path.lexists(path):
                    raise _missing(path)
                is_file = keeps and os.path.isfile(path)
                path = self._keep(path, "r+") if is_file else self._find(path)
            return function(path, *args, **kwargs)

        return call

    def _keep(self, file: Any, mode: str) -> Any:
        """Return where a file is written that may be the user's."""
        full = _full(file)
        if self._is_own(full) or full == os.devnull:
            return file
        if full not in self.kept:
            is_there = os.path.isfile(full)
            if os.path.exists(full) and not is_there:
                return file  # What isn't a file can't be kept, and is refused.
            if "x" in mode and is_there:
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), full)
            if "r" in mode and not is_there:
                raise _missing(full)
            self._require_folder(full)
            place = self._place(full)
            os.makedirs(os.path.dirname(place), exist_ok=True)
            if is_there and "w" not in mode:
                shutil.copyfile(full, place)
            self.kept[full] = place
        return self.kept[full]

    def _find(self, file: Any) -> Any:
        return self.kept.get(_full(file), file) if self.kept else file

    def _place(self, full: str) -> str:
        return os.path.join(self._folder, _KEPT, full.lstrip(os.sep))

    def _is_own(self, full: str) -> bool:
        real = os.path.realpath(full)
        return os.path.commonpath([real, self._folder]) == self._folder

    def _has(self, file: Any) -> bool:
        """Return whether a file is one that is kept."""
        full = _full(file)
        return os.path.isfile(full) and (full in self.kept or self._is_own(full))

    def _require_folder(self, full: str) -> None:
        if not os.path.isdir(os.path.dirname(full)):
            raise _missing(full)


def _missing(file: Any) -> FileNotFoundError:
    return FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), os.fspath(file))


def _full(file: Any) -> str:
    return os.path.abspath(os.fsdecode(file))
