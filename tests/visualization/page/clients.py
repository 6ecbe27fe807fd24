"""Stand-ins for a browser: HTTP, and a websocket that obeys."""

import base64
import http.client
import json
import os
import socket
import struct
from collections.abc import Callable
from typing import Any, NamedTuple, Self

from arm_drake.visualization.page import Scene
from arm_drake.visualization.page.scene import meshcat_address
from tests.waiting import PATIENCE, wait_until

TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10


class Answer(NamedTuple):
    """What a server says to a request."""

    status: int
    headers: dict[str, str]
    body: bytes


def get(
    port: int, path: str, host: str | None = None, *, at: str = "localhost"
) -> Answer:
    """Ask for a file, by any name of this machine."""
    connection = http.client.HTTPConnection(at, port, timeout=PATIENCE)
    try:
        headers = {} if host is None else {"Host": host}
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        names = {name.lower(): value for name, value in answer.getheaders()}
        return Answer(answer.status, names, answer.read())
    finally:
        connection.close()


class WebSocket:
    """A client that reads when it is told to, and only then answers pings."""

    def __init__(
        self,
        port: int,
        path: str,
        *,
        host: str | None = None,
        origin: str | None = "",
        buffer: int | None = None,
        at: str = "127.0.0.1",
    ) -> None:
        """Connect, and keep the `status` of the answer.

        Args:
            port: Where to, on this machine.
            path: Path of the websocket.
            host: Name of the machine, as the browser's user wrote it.
            origin: Where the page that asks comes from; "" is the same place, None
                leaves it out.
            buffer: Size of the buffer of what comes [bytes].
            at: Address of this machine.
        """
        self._socket = socket.socket()
        self._socket.settimeout(PATIENCE)
        if buffer is not None:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        self._socket.connect((at, port))
        host = f"localhost:{port}" if host is None else host
        lines = [
            f"GET {path} HTTP/1.1",
            f"Host: {host}",
            "Upgrade: websocket",
            "Connection: Upgrade",
            "Sec-WebSocket-Version: 13",
            f"Sec-WebSocket-Key: {base64.b64encode(os.urandom(16)).decode()}",
        ]
        if origin is not None:
            lines.append(f"Origin: {origin or f'http://{host}'}")
        self._socket.sendall("\r\n".join([*lines, "", ""]).encode())
        self._rest = b""
        while b"\r\n\r\n" not in self._rest:
            self._receive()
        head, _, self._rest = self._rest.partition(b"\r\n\r\n")
        self.status = int(head.split()[1])

    def read(self) -> tuple[int, bytes]:
        """Return the next message and its kind; pings are answered."""
        while True:
            kind, data = self._frame()
            if kind != PING:
                return kind, data
            self.send(data, PONG)

    def send(self, data: bytes | str, kind: int = TEXT) -> None:
        """Send a message."""
        data = data.encode() if isinstance(data, str) else data
        size = len(data)
        head = bytes([0x80 | kind])
        if size < 126:
            head += bytes([0x80 | size])
        elif size < 1 << 16:
            head += bytes([0x80 | 126]) + struct.pack(">H", size)
        else:
            head += bytes([0x80 | 127]) + struct.pack(">Q", size)
        # A mask of zeros changes nothing.
        self._socket.sendall(head + bytes(4) + data)

    def close(self) -> None:
        """Be gone, without a word."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _frame(self) -> tuple[int, bytes]:
        first, second = self._take(2)
        size = second & 0x7F
        if size == 126:
            (size,) = struct.unpack(">H", self._take(2))
        elif size == 127:
            (size,) = struct.unpack(">Q", self._take(8))
        return first & 0x0F, self._take(size)

    def _take(self, count: int) -> bytes:
        while len(self._rest) < count:
            self._receive()
        taken, self._rest = self._rest[:count], self._rest[count:]
        return taken

    def _receive(self) -> None:
        data = self._socket.recv(1 << 20)
        if not data:
            raise ConnectionError("the server has closed the connection")
        self._rest += data


def end_meshcat(page: Scene) -> None:
    """Do to a page's Meshcat what any program of this machine can."""
    host, port = meshcat_address(page.meshcat)
    with WebSocket(port, "/", at=host) as program:
        # A map that is cut off.
        program.send(b"\x85", BINARY)
        wait_until(lambda: not page.is_alive)


class Panel(WebSocket):
    """The panel of a browser."""

    def __init__(self, port: int, **options: Any) -> None:
        """Connect; nothing is read yet."""
        super().__init__(port, "/panel", **options)
        self.heard: list[dict[str, Any]] = []

        # Fields of widgets, as patches have told them.
        self.fields: dict[str, dict[str, Any]] = {}

    def hear(self) -> dict[str, Any]:
        """Return the next message."""
        kind, data = self.read()
        if kind == CLOSE:
            raise ConnectionError("the server says good-bye")
        message: dict[str, Any] = json.loads(data)
        self.heard.append(message)
        if message["type"] == "panel":
            self.fields.clear()
        for name, change in message.get("changes", {}).items():
            self.fields.setdefault(name, {}).update(change)
        return message

    def hear_until(self, is_it: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
        """Return the next message that is the right one."""
        while True:
            message = self.hear()
            if is_it(message):
                return message

    def hear_field(self, name: str, field: str, value: Any) -> None:
        """Wait until a field of a widget has a value."""
        while self.fields.get(name, {}).get(field) != value:
            self.hear()

    def say(self, name: str, value: Any = None) -> None:
        """Say what somebody did."""
        said = {"id": name} if value is None else {"id": name, "value": value}
        self.send(json.dumps(said))
