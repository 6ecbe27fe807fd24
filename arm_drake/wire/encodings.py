"""Messages as rosbridge sends them: JSON, CBOR, pictures, fragments, frames."""

import base64
import io
import json
import math
import struct
import time
import uuid
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from arm_drake.errors import InputError
from arm_drake.wire.server import RosServer


class Encoded(NamedTuple):
    """A message, and how a websocket sends it: the same bytes to all clients."""

    data: str | bytes
    frame: bytes


def make_frame(data: str | bytes) -> bytes:
    """Return a message of a server's as websockets send it (RFC 6455, 5.2)."""
    payload = data.encode() if isinstance(data, str) else data
    kind, size = 0x82 if isinstance(data, bytes) else 0x81, len(payload)
    if size < 126:
        return struct.pack("!BB", kind, size) + payload
    if size < 2**16:
        return struct.pack("!BBH", kind, 126, size) + payload
    return struct.pack("!BBQ", kind, 127, size) + payload


class Encoder:
    """Makes what is sent of a topic, once for all clients."""

    def __init__(self, server: RosServer) -> None:
        """Create it."""
        self._server = server
        self._made: dict[tuple[int, str], Encoded] = {}

    def publish(
        self, topic: str, type_: str, fields: dict[str, Any], compression: str
    ) -> Encoded:
        """Return the message of a topic."""
        key = (id(fields), compression if compression.startswith("cbor") else "none")
        if key not in self._made:
            data = self._encode(topic, type_, fields, key[1])
            self._made[key] = Encoded(data, make_frame(data))
        return self._made[key]

    def _encode(
        self, topic: str, type_: str, fields: dict[str, Any], compression: str
    ) -> str | bytes:
        content: dict[str, Any] = {"op": "publish", "topic": topic, "msg": fields}
        if compression == "cbor-raw":
            seconds, nanoseconds = divmod(self._server.now_ns, 10**9)
            content["msg"] = {
                "secs": seconds,
                "nsecs": nanoseconds,
                "bytes": self._server.types.encode(type_, fields),
            }
        return encode(content, compression)


def encode(content: dict[str, Any], compression: str = "none") -> str | bytes:
    """Return a message as text, or as CBOR."""
    if compression.startswith("cbor"):
        return encode_cbor(content)
    return to_json(content)


# Bytes that are encoded at a time: no call holds the interpreter for long.
_PIECE = 3 * 2**15

# What stands for more of them until the text is made; nobody can guess it.
_MARK = uuid.uuid4().hex


def to_json(value: Any) -> str:
    """Return plain data as JSON: bytes in base64, and null for what is no number."""
    large: list[bytes | bytearray] = []

    def to_text(item: Any) -> str:
        if not isinstance(item, bytes | bytearray):
            raise TypeError(f"a {type(item).__name__} has no form in JSON")
        if len(item) <= _PIECE:
            return base64.b64encode(item).decode()
        large.append(item)
        return _MARK

    encoder = json.JSONEncoder(allow_nan=False, default=to_text)
    try:
        text = encoder.encode(value)
    except ValueError:
        large.clear()
        text = encoder.encode(without_nan(value))
    return "".join(_fill(text, large)) if large else text


def from_json(data: str | bytes) -> Any:
    """Return what JSON says, or raise InputError."""
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise InputError(f"no JSON: {error}") from None


def _fill(text: str, large: list[bytes | bytearray]) -> Iterator[str]:
    """Yield parts of a text with bytes in base64 where the marks are."""
    first, *others = text.split(_MARK)
    yield first
    for data, after in zip(large, others, strict=True):
        for start in range(0, len(data), _PIECE):
            yield base64.b64encode(data[start : start + _PIECE]).decode()
        yield after


def without_nan(value: Any) -> Any:
    """Return plain data with None for what JSON has no number for, as rosbridge."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {name: without_nan(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    return value


# Tags of CBOR (RFC 8746) for arrays of little-endian numbers.
_FLOAT64_ARRAY = 86


def encode_cbor(content: Mapping[str, Any]) -> bytes:
    """Return a message as CBOR."""
    import cbor2  # Foxglove's extra lacks it.

    return cbor2.dumps(_for_cbor(content, cbor2.CBORTag))


def _for_cbor(value: Any, tag: Any) -> Any:
    """Return plain data with arrays of numbers as they go in CBOR."""
    if isinstance(value, Mapping):
        return {name: _for_cbor(item, tag) for name, item in value.items()}
    if isinstance(value, list | tuple):
        if value and type(value[0]) is float:
            data = np.asarray(value, dtype="<f8").tobytes()
            return tag(_FLOAT64_ARRAY, data)
        return [_for_cbor(item, tag) for item in value]
    return value


# Arrays of CBOR tags: kinds of numpy.
_TYPED_ARRAYS = {
    64: "u1",
    68: "u1",
    69: "<u2",
    70: "<u4",
    71: "<u8",
    72: "i1",
    77: "<i2",
    78: "<i4",
    79: "<i8",
    85: "<f4",
    86: "<f8",
}


def decode_cbor(data: bytes) -> Any:
    """Return what bytes of CBOR say, or raise InputError."""
    import cbor2

    def tag(decoder: Any, tag: Any = None) -> Any:
        found = tag if tag is not None else decoder
        kind = _TYPED_ARRAYS.get(found.tag)
        if kind is None or not isinstance(found.value, bytes):
            return found.value
        return np.frombuffer(found.value, dtype=kind).tolist()

    try:
        found = cbor2.loads(data, tag_hook=tag)
    # Whatever a codec says of bytes that mean nothing to it.
    except Exception as error:
        raise InputError(f"no CBOR: {error}") from None
    _check_plain(found, 0)
    return found


# As deep as messages may be nested; CBOR can refer to what is around it.
_MAX_DEPTH = 100


def _check_plain(value: Any, depth: int) -> None:
    """Raise InputError for what CBOR has and messages don't, such as dates."""
    if depth > _MAX_DEPTH:
        raise InputError(f"no CBOR: it is nested more than {_MAX_DEPTH} deep")
    if isinstance(value, dict):
        for name, item in value.items():
            if not isinstance(name, str):
                kind = type(name).__name__
                raise InputError(f"no CBOR of a message: a {kind} names a field")
            _check_plain(item, depth + 1)
    elif isinstance(value, list | tuple):
        if value and type(value[0]) is float and set(map(type, value)) == {float}:
            return
        for item in value:
            _check_plain(item, depth + 1)
    elif value is not None and not isinstance(value, str | bytes | int | float):
        kind = type(value).__name__
        raise InputError(f"no CBOR of a message: it has a {kind}")


def to_png(text: str) -> str:
    """Return a text as the pixels of a picture, in base64."""
    data = text.encode()
    width = max(math.isqrt(max(len(data) // 3, 1)), 1)
    height = math.ceil(len(data) / 3 / width)
    padded = data.ljust(3 * width * height, b"\n")
    picture = Image.frombytes("RGB", (width, height), padded)
    buffer = io.BytesIO()
    picture.save(buffer, format="PNG")
    return base64.b64encode(buffer.getvalue()).decode()


def from_png(text: Any, max_size: int) -> str:
    """Return the text that the pixels of a picture are, or raise InputError."""
    try:
        picture = Image.open(io.BytesIO(base64.b64decode(text, validate=True)))
        width, height = picture.size
        if width * height * 3 > max_size:
            raise InputError(f"png: more than {max_size} bytes")
        return picture.convert("RGB").tobytes().decode().strip("\n\0")
    except (ValueError, TypeError, OSError, SyntaxError, struct.error) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"png: no picture in base64 ({error})") from None


# Parts of messages: how many there may be, and how long they are kept [s].
_MAX_FRAGMENTS, _LIFE = 4096, 10.0


def split(data: str, size: int) -> Iterator[str]:
    """Yield the fragments of a message, with so many characters of it each."""
    id_ = uuid.uuid4().hex
    parts = [data[start : start + size] for start in range(0, len(data), size)]
    for number, part in enumerate(parts):
        content = {"op": "fragment", "id": id_, "data": part, "num": number}
        yield json.dumps({**content, "total": len(parts)})


class Fragments:
    """Parts of messages of a client."""

    def __init__(self, max_size: int) -> None:
        """Create it for so many characters at once."""
        self._max_size = max_size
        # When the first part came [s], and the parts by number.
        self._found: dict[str, tuple[float, dict[int, str]]] = {}

    def add(self, content: Mapping[str, Any]) -> str | None:
        """Take a part of a message; return the message if it is whole now.

        InputError if it is no such part, or there are too many.
        """
        id_, data = content.get("id"), content.get("data")
        number, total = content.get("num"), content.get("total")
        if not (
            isinstance(id_, str)
            and isinstance(data, str)
            and isinstance(number, int)
            and isinstance(total, int)
            and 0 <= number < total <= _MAX_FRAGMENTS
        ):
            text = f"expected id, data, num and total of at most {_MAX_FRAGMENTS}"
            raise InputError(f"fragment: {text}")
        now = time.monotonic()
        self._found = {k: v for k, v in self._found.items() if now - v[0] < _LIFE}
        _, parts = self._found.setdefault(id_, (now, {}))
        parts[number] = data
        size = sum(len(p) for _, found in self._found.values() for p in found.values())
        if size > self._max_size:
            self._found.clear()
            raise InputError(f"fragments: more than {self._max_size} characters")
        if len(parts) < total:
            return None
        del self._found[id_]
        return "".join(parts[index] for index in sorted(parts))
