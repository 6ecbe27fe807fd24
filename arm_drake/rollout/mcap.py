"""MCAP files that are complete after every flush, and ROS 2's messages as their bytes.

Source of the format: mcap.dev, "MCAP Format Specification", version 0. Each flush puts
one more chunk where the end was and an end behind it, in a single write. The end has a
summary, which readers find things by, if as much came since the last one as that took:
it grows with the file, and in every flush it would be most of what is written. Without
one, which the format permits, readers go through the chunks.
"""

import errno
import functools
import os
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from arm_drake import messages
from arm_drake.errors import MissingExtraError
from arm_drake.messages.base import ros_type

# How a file begins, and ends.
MAGIC = b"\x89MCAP0\r\n"

# Opcodes of records.
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = range(1, 7)
_MESSAGE_INDEX, _CHUNK_INDEX = 7, 8
_STATISTICS, _SUMMARY_OFFSET, _DATA_END = 0x0B, 0x0E, 0x0F

_PROFILE, _LIBRARY = "ros2", "arm_drake"

# Size at which a chunk is written in any case [bytes].
_CHUNK_SIZE = 1 << 20

_MESSAGE_HEAD = struct.Struct("<BQHIQQ")


class McapFile:
    """Writes messages of ROS 2, in chunks."""

    def __init__(
        self,
        path: Path,
        *,
        compress: Callable[[bytes], bytes] = lambda data: data,
        compression: str = "",
    ) -> None:
        """Create the file, replacing an existing one.

        `compress` does so to the records of a chunk, `compression` is its MCAP name.
        """
        self._compress, self._compression = compress, compression
        self._schemas: dict[str, tuple[int, bytes]] = {}
        # Records of the channels, and how many messages each one has.
        self._channels: list[bytes] = []
        self._counts: list[int] = []
        # Records of the next chunk, and where in them the messages of channels are.
        self._records = bytearray()
        self._index: dict[int, list[tuple[int, int]]] = {}
        self._chunk_indexes: list[bytes] = []
        self._first, self._last = 2**64 - 1, 0
        self._file = path.open("wb", buffering=0)
        head = MAGIC + _record(_HEADER, _text(_PROFILE) + _text(_LIBRARY))
        self._end = len(head)
        # Size of the last summary, and where it stood.
        self._summary_size, self._summary_place = 0, 0
        self._put(0, head + self._make_end())

    def add_channel(
        self,
        topic: str,
        type_: str,
        schema: str,
        metadata: Mapping[str, str],
    ) -> int:
        """Return the number of a new channel, of a type such as "std_msgs/msg/String".

        The schema is the definition of the type and of those that it contains.
        """
        if type_ not in self._schemas:
            number = len(self._schemas) + 1
            content = _text(type_) + _text("ros2msg") + _text(schema)
            schema_record = _record(_SCHEMA, struct.pack("<H", number) + content)
            self._schemas[type_] = (number, schema_record)
            self._records += schema_record
        number, channel = self._schemas[type_][0], len(self._channels)
        pairs = b"".join(_text(key) + _text(value) for key, value in metadata.items())
        content = struct.pack("<HH", channel, number) + _text(topic) + _text("cdr")
        record = _record(_CHANNEL, content + _sized(pairs))
        self._channels.append(record)
        self._counts.append(0)
        self._records += record
        return channel

    def write(self, channel: int, time_ns: int, data: bytes) -> None:
        """Write a message, at the next flush or when there are enough of them."""
        sequence = self._counts[channel]
        self._counts[channel] += 1
        place = (time_ns, len(self._records))
        self._index.setdefault(channel, []).append(place)
        self._records += _MESSAGE_HEAD.pack(
            _MESSAGE, len(data) + 22, channel, sequence, time_ns, time_ns
        )
        self._records += data
        if len(self._records) >= _CHUNK_SIZE:
            self.flush()

    def flush(self) -> None:
        """Write the pending messages; the file is complete then."""
        if self._records:
            chunk, start = self._take_chunk(), self._end
            self._end += len(chunk)
            self._put(start, chunk + self._make_end())

    def close(self) -> None:
        """Write the pending messages with their summary, and close the file."""
        if not self._file.closed:
            self.flush()
            if self._summary_place < self._end:
                self._put(self._end, self._summary(self._end))
            self._file.close()

    def _make_end(self) -> bytes:
        """Return the end of the file, with a summary if it is time for one."""
        if self._end - self._summary_place < self._summary_size:
            foot = struct.pack("<QQI", 0, 0, 0)
            return _data_end() + _record(_FOOTER, foot) + MAGIC
        end = self._summary(self._end)
        self._summary_size, self._summary_place = len(end), self._end
        return end

    def _put(self, start: int, data: bytes) -> None:
        """Write the end of the file."""
        self._reserve(start, len(data))
        self._file.seek(start)
        rest = memoryview(data)
        while rest:
            rest = rest[self._file.write(rest) :]
        self._file.truncate()

    def _reserve(self, start: int, size: int) -> None:
        """Make sure that the disk has room, before the old end is written over."""
        before = self._file.seek(0, os.SEEK_END)
        try:
            os.posix_fallocate(self._file.fileno(), start, size)
        except AttributeError:  # Not on this system.
            return
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
                self._file.truncate(before)
                raise

    def _take_chunk(self) -> bytes:
        """Return the next chunk with its indexes, and take note of it."""
        records, self._records = bytes(self._records), bytearray()
        index, self._index = self._index, {}
        times = [time for places in index.values() for time, _ in places]
        first, last = (min(times), max(times)) if times else (0, 0)
        if times:
            self._first, self._last = min(first, self._first), max(last, self._last)
        packed = self._compress(records)
        chunk = _record(
            _CHUNK,
            struct.pack("<QQQI", first, last, len(records), zlib.crc32(records)),
            _text(self._compression),
            struct.pack("<Q", len(packed)),
            packed,
        )
        indexes, offsets = bytearray(), bytearray()
        for channel, places in index.items():
            offset = self._end + len(chunk) + len(indexes)
            offsets += struct.pack("<HQ", channel, offset)
            places.sort()
            numbers = [number for place in places for number in place]
            array = _sized(struct.pack(f"<{len(numbers)}Q", *numbers))
            indexes += _record(_MESSAGE_INDEX, struct.pack("<H", channel), array)
        self._chunk_indexes.append(
            _record(
                _CHUNK_INDEX,
                struct.pack("<QQQQ", first, last, self._end, len(chunk)),
                _sized(bytes(offsets)),
                struct.pack("<Q", len(indexes)),
                _text(self._compression),
                struct.pack("<QQ", len(packed), len(records)),
            )
        )
        return chunk + bytes(indexes)

    def _summary(self, start: int) -> bytes:
        """Return an end of the file, to stand at `start`, that says what is where."""
        end = _data_end()
        pairs = enumerate(self._counts)
        statistics = struct.pack(
            "<QHIIIIQQ",
            sum(self._counts),
            len(self._schemas),
            len(self._channels),
            0,
            0,
            len(self._chunk_indexes),
            min(self._first, self._last),
            self._last,
        ) + _sized(b"".join(struct.pack("<HQ", *pair) for pair in pairs))
        groups = {
            _SCHEMA: b"".join(record for _, record in self._schemas.values()),
            _CHANNEL: b"".join(self._channels),
            _CHUNK_INDEX: b"".join(self._chunk_indexes),
            _STATISTICS: _record(_STATISTICS, statistics),
        }
        summary = start + len(end)
        body, offsets = bytearray(), bytearray()
        for opcode, group in groups.items():
            if group:
                place = struct.pack("<BQQ", opcode, summary + len(body), len(group))
                offsets += _record(_SUMMARY_OFFSET, place)
                body += group
        foot = struct.pack("<QQI", summary, summary + len(body), 0)
        return bytes(end + body + offsets) + _record(_FOOTER, foot) + MAGIC


def _data_end() -> bytes:
    # A checksum of 0 is none.
    return _record(_DATA_END, struct.pack("<I", 0))


def _record(opcode: int, *parts: bytes) -> bytes:
    content = b"".join(parts)
    return struct.pack("<BQ", opcode, len(content)) + content


def _sized(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


def _text(text: str) -> bytes:
    return _sized(text.encode())


# Definitions of types that no type store of rosbags has.
_DEFINITIONS = Path(messages.__file__).with_name("definitions.txt")


class Definition(NamedTuple):
    """A type's definition: of a message one text, of a service two, an action three."""

    name: str
    texts: tuple[str, ...]


def read_definitions(distro: str) -> Iterator[Definition]:
    """Yield the definitions of a distribution."""
    text = _DEFINITIONS.read_text(encoding="utf-8")
    for section in text.split("\n== ")[1:]:
        head, _, body = section.partition("\n")
        name, *distros = head.split()
        if not distros or distro in distros:
            parts = "".join(f"{line}\n" for line in body.splitlines()).split("---\n")
            yield Definition(name, tuple(parts))


def type_of(message: str) -> str | None:
    """Return the type in ROS of a class of messages, None if bags have no topic."""
    kind = getattr(messages, message, None)
    if isinstance(kind, type) and issubclass(kind, messages.Message):
        type_ = ros_type(kind)
        return type_ if type_ in load_types() else None
    return None


@functools.cache
def load_types() -> "RosTypes":
    """Return the types, or raise MissingExtraError if rosbags isn't installed."""
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise MissingExtraError("a log of ROS 2 messages (.mcap)", "bag") from None
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, texts in read_definitions("jazzy"):
        if "/msg/" in name:
            store.register(get_types_from_msg(texts[0], name))
    return RosTypes(store)


class RosTypes:
    """Makes messages of plain data."""

    def __init__(self, store: Any) -> None:
        """Create it with a type store of rosbags."""
        self._store = store
        self._plans: dict[str, tuple[Any, dict[str, Any], dict[str, Any]]] = {}

    def __contains__(self, type_: object) -> bool:
        """Return whether there is a message type."""
        return type_ in self._store.fielddefs

    def schema(self, type_: str) -> str:
        """Return the definition of a type and of those that it contains."""
        text: str = self._store.generate_msgdef(type_, ros_version=2)[0]
        return text

    def hash(self, type_: str) -> str:
        """Return the hash by which ROS 2 knows a type."""
        text: str = self._store.hash_rihs01(type_)
        return text

    def encode(self, type_: str, fields: Mapping[str, Any]) -> bytes:
        """Return plain data as a message in CDR; fields left out are 0 or empty."""
        return bytes(self._store.serialize_cdr(self._make(type_, fields), type_))

    def decode(self, type_: str, data: bytes) -> Any:
        """Return a message of bytes, with its fields as attributes."""
        return self._store.deserialize_cdr(data, type_)

    def _make(self, type_: str, fields: Mapping[str, Any]) -> Any:
        make, kinds, nothing = self._plan(type_)
        values = dict(nothing)
        for name, value in fields.items():
            if name in kinds and value is not None:
                values[name] = self._value(kinds[name], value)
        return make(**values)

    def _plan(self, type_: str) -> tuple[Any, dict[str, Any], dict[str, Any]]:
        """Return the class of a type, the kinds of its fields, and those of nothing."""
        plan = self._plans.get(type_)
        if plan is None:
            kinds = dict(self._store.fielddefs[type_][1])
            # Nobody changes them, so that all messages may share them.
            nothing = {name: self._value(kind, None) for name, kind in kinds.items()}
            plan = self._plans[type_] = (self._store.types[type_], kinds, nothing)
        return plan

    def _value(self, kind: Any, value: Any) -> Any:
        """Return a field's value; None is that of nothing."""
        node, inner = int(kind[0]), kind[1]
        if node == _BASE:
            make = _PYTHON.get(inner[0], int)
            return make() if value is None else make(value)
        if node == _NAME:
            return self._make(inner, value or {})
        element = inner[0]
        items = [] if value is None else value
        if node == _ARRAY and value is None:
            items = [None] * inner[1]
        if int(element[0]) == _BASE and element[1][0] != "string":
            if value is None:
                items = [0] * len(items)
            if isinstance(items, bytes):
                return np.frombuffer(items, dtype=element[1][0])
            return np.ascontiguousarray(items, dtype=element[1][0])
        if int(element[0]) == _BASE and value is not None:
            return list(map(str, items))
        return [self._value(element, item) for item in items]


# Kinds of fields: rosbags.interfaces.Nodetype.
_BASE, _NAME, _ARRAY = 1, 2, 3

_PYTHON: dict[str, Any] = {
    "string": str,
    "float32": float,
    "float64": float,
    "bool": bool,
}
