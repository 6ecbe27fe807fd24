"""Files of results: each run's as it ends, and what is in them is not run again.

A file begins with a line, and has a record for each run that ended well: length and
checksum, then index, fingerprint of the input, wall time and value in a pickle. A
record that was cut short, by a kill or a full disk, is dropped when it is opened again.
"""

import dataclasses as dc
import fcntl
import hashlib
import os
import pickle
import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cloudpickle
import numpy as np

from arm_drake.batch.processes import Done
from arm_drake.description.robot import Robot
from arm_drake.errors import InputError, OutputError

_FIRST = b"arm_drake runs 1\n"

# Length and CRC-32 of what follows.
_HEAD = struct.Struct("<QI")


class RunStore:
    """The file of a study, open for this program alone."""

    def __init__(self, path: str | Path, items: Sequence[Any]) -> None:
        """Open or make it.

        Raises:
            InputError: If it is no such file, of other runs, or another program's now.
            OutputError: If it can't be written.
        """
        self.path = Path(path)
        self._prints = [fingerprint(item) for item in items]
        # What was there: the runs that ended well, by index.
        self.done: dict[int, Done] = {}
        try:
            self._file = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise OutputError(f"it can't be opened: {error}", file=path) from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._file)
            raise InputError("another program writes it", file=path) from None
        try:
            self._end = self._read()
        except BaseException:
            self.close()
            raise

    def _read(self) -> int:
        """Read what is there; return where the last whole record ends."""
        with os.fdopen(os.dup(self._file), "rb") as file:
            first = file.read(len(_FIRST))
            if first and not _FIRST.startswith(first):
                text = "expected a file of results, or none"
                raise InputError(text, file=self.path)
            if first != _FIRST:
                return self._begin()
            end = file.tell()
            while len(head := file.read(_HEAD.size)) == _HEAD.size:
                size, checksum = _HEAD.unpack(head)
                data = file.read(min(size, os.fstat(self._file).st_size))
                if len(data) < size or zlib.crc32(data) != checksum:
                    break
                self._take(data)
                end = file.tell()
        return end

    def _begin(self) -> int:
        self._end = 0
        self._write(_FIRST)
        return len(_FIRST)

    def _take(self, data: bytes) -> None:
        index, mark, wall_time, value = pickle.loads(data)  # noqa: S301  A user's own.
        if not (index < len(self._prints) and self._prints[index] == mark):
            text = f"it has results of other runs: run {index} is another one now"
            raise InputError(f"{text}; name another file", file=self.path)
        self.done[index] = Done(index, value, None, wall_time)

    def add(self, done: Done) -> None:
        """Write a run that has ended; one that failed is left for the next time.

        Raises:
            OutputError: If the disk is full; what is written already stays.
        """
        if done.error is not None:
            return
        mark = self._prints[done.index]
        data = cloudpickle.dumps((done.index, mark, done.wall_time, done.value))
        self._write(_HEAD.pack(len(data), zlib.crc32(data)) + data)

    def _write(self, data: bytes) -> None:
        try:
            written = 0
            while written < len(data):
                at = self._end + written
                written += os.pwrite(self._file, data[written:], at)
        except OSError as error:
            os.ftruncate(self._file, self._end)
            text = f"it can't be written: {error}; what it has is kept"
            raise OutputError(text, file=self.path) from None
        self._end += written

    def close(self) -> None:
        """Close it."""
        os.close(self._file)


def fingerprint(item: Any) -> str:
    """Return what is the same for the same input in every process."""
    return hashlib.sha256(repr(_plain(item)).encode()).hexdigest()[:32]


def _plain(value: Any) -> Any:
    """Return something that tells inputs apart by its repr."""
    if isinstance(value, Robot):
        # What it was made of; its files' content is in the description.
        files = hashlib.sha256(value.description.source.encode()).hexdigest()
        return ("Robot", value.name, files, _plain(value.load_options))
    if isinstance(value, np.ndarray):
        return (str(value.dtype), value.shape, value.tobytes())
    if isinstance(value, np.generic):
        return value.item()
    if dc.is_dataclass(value) and not isinstance(value, type):
        fields = [(f.name, _plain(getattr(value, f.name))) for f in dc.fields(value)]
        return (type(value).__qualname__, fields)
    if isinstance(value, Mapping):
        return [(_plain(key), _plain(each)) for key, each in value.items()]
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, set | frozenset):
        return sorted(map(repr, map(_plain, value)))
    if callable(value):
        return (value.__module__, getattr(value, "__qualname__", type(value).__name__))
    if isinstance(value, str | bytes | int | float | complex | Path) or value is None:
        return str(value) if isinstance(value, Path) else value
    return hashlib.sha256(cloudpickle.dumps(value)).hexdigest()
