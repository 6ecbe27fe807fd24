"""The web server of a page: its files, its panel, and Meshcat behind it.

It runs in a thread of its own, so that a page answers while a simulation steps, and
no browser makes the simulation wait. Meshcat listens to this machine alone; all that a
browser sees of it comes through here, on one port.
"""

import asyncio
import contextlib
import errno
import ipaddress
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream
from tornado.web import Application

from arm_drake.errors import InputError
from arm_drake.visualization.page.handlers import (
    PATIENCE,
    Files,
    Message,
    PanelSocket,
    Tunnel,
    is_local,
    join,
)

_STATIC = Path(__file__).parent / "static"

# Ports that a page may have, and the first that is tried, and how many after it.
_PORTS = range(1024, 65536)
_FIRST_PORT = 7000
_TRIED_PORTS = 100

# Names of all addresses of this machine.
_ANYWHERE = ("*", "0.0.0.0", "::")  # noqa: S104

# A sentence of a browser is short.
_LONGEST_MESSAGE = 1 << 16


class PageServer:
    """Serves a page until it is closed."""

    def __init__(
        self,
        *,
        host: str,
        port: int | None,
        meshcat_port: int,
        on_event: Callable[[str, Any], None],
    ) -> None:
        """Start to serve.

        Args:
            host: Address to listen on: "localhost", "*" for all, or one of this
                machine's.
            port: Port to listen on; if it is taken, the first free one after it. By
                default the first free one from 7000 on.
            meshcat_port: Where Meshcat listens on this machine.
            on_event: Called with the name of a widget and its new value, in the
                server's thread.

        Raises:
            InputError: If it can't listen there.
        """
        self.is_public = not is_local(host)
        self._sockets = _listen(host, port)
        self.port = int(self._sockets[0].getsockname()[1])
        self.has_moved = port is not None and port != self.port
        name = host if host not in _ANYWHERE else socket.gethostname()
        self.url = f"http://{f'[{name}]' if ':' in name else name}:{self.port}/"
        self._clients: set[PanelSocket] = set()
        self._streams: set[IOStream] = set()
        self._messages: dict[str, Message] = {}
        self._application = self._make_application(meshcat_port, on_event)
        self._loop = asyncio.new_event_loop()
        self._is_up, self._is_closing = threading.Event(), asyncio.Event()
        self._thread = threading.Thread(
            target=self._serve, name="arm_drake page", daemon=True
        )
        self._thread.start()
        self._is_up.wait()

    @property
    def num_clients(self) -> int:
        """How many browsers are connected."""
        return len(self._clients)

    def send(self, message: Message) -> None:
        """Send a message to all browsers, and to those that come later.

        Of messages of the same `type` the last one counts; but those of type "patch"
        have changes by widget, and are joined.
        """
        with contextlib.suppress(RuntimeError):  # It is closed.
            self._loop.call_soon_threadsafe(self._send, message)

    def close(self) -> None:
        """End all connections, and the thread."""
        if not self._thread.is_alive():
            return
        self._loop.call_soon_threadsafe(self._is_closing.set)
        self._thread.join()

    def _make_application(
        self, meshcat_port: int, on_event: Callable[[str, Any], None]
    ) -> Application:
        meshcat = {"port": meshcat_port, "streams": self._streams}
        panel = {
            "clients": self._clients,
            "messages": self._messages,
            "on_event": on_event,
        }
        files = {"path": str(_STATIC), "default_filename": "index.html"}
        return Application(
            [
                (r"/meshcat/(.*)", Tunnel, meshcat),
                (r"/panel", PanelSocket, panel),
                (r"/(.*)", Files, files),
            ],
            log_function=lambda handler: None,
            websocket_max_message_size=_LONGEST_MESSAGE,
            websocket_ping_interval=PATIENCE,
            is_public=self.is_public,
        )

    def _serve(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._run())
        finally:
            self._loop.close()

    async def _run(self) -> None:
        server = HTTPServer(self._application)
        server.add_sockets(self._sockets)
        self._is_up.set()
        await self._is_closing.wait()
        server.stop()
        for stream in list(self._streams):
            stream.close()
        for client in list(self._clients):
            client.close()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(server.close_all_connections(), 0.2)
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _send(self, message: Message) -> None:
        if message["type"] == "panel":
            self._messages.pop("patch", None)
        join(self._messages, message)
        for client in self._clients:
            client.send(message)


def _listen(host: str, port: int | None) -> list[socket.socket]:
    """Return sockets on the first free port."""
    if port is not None and port not in _PORTS:
        raise InputError(f"port {port}: expected {_PORTS[0]} to {_PORTS[-1]}")
    first = _FIRST_PORT if port is None else port
    for tried in range(first, min(first + _TRIED_PORTS, _PORTS.stop)):
        try:
            return _bind(host, tried)
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                continue
            if error.errno == errno.EACCES:
                raise InputError(f"port {tried}: not allowed") from None
            break
        except ValueError:
            break
    else:
        raise InputError(f"no port from {first} to {tried} is free")
    raise InputError(
        f"host {host!r}: expected localhost, * (all addresses) or an address of this "
        "machine"
    )


def _bind(host: str, port: int) -> list[socket.socket]:
    """Return sockets on a port.

    Raises:
        OSError: If that can't be.
        ValueError: If the host is no address.
    """
    if host == "localhost":
        addresses = ["127.0.0.1", "::1"]
    elif host in _ANYWHERE:
        if socket.has_dualstack_ipv6():
            server = socket.create_server(
                ("::", port), family=socket.AF_INET6, dualstack_ipv6=True
            )
            server.setblocking(False)
            return [server]
        addresses = ["0.0.0.0"]  # noqa: S104  so it was asked for.
    else:
        addresses = [str(ipaddress.ip_address(host))]
    with contextlib.ExitStack() as stack:
        sockets: list[socket.socket] = []
        for address in addresses:
            family = socket.AF_INET6 if ":" in address else socket.AF_INET
            try:
                made = socket.create_server((address, port), family=family)
            except OSError as error:
                # Many machines have no IPv6.
                if sockets and error.errno != errno.EADDRINUSE:
                    continue
                raise
            made.setblocking(False)
            sockets.append(stack.enter_context(made))
        stack.pop_all()
        return sockets
