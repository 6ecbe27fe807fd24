"""A page: Meshcat's scene with a panel, and the web server behind it.

The server runs in a thread of its own, so that a page answers while a simulation steps,
and no browser makes the simulation wait. Meshcat listens to this machine alone, at an
address that nobody is told; all that a browser sees of it comes through the server, on
one port, and nothing goes the other way. A page belongs to the thread that made it.
"""

import asyncio
import contextlib
import errno
import ipaddress
import json
import queue
import socket
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote, urlsplit

from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest
from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream, StreamClosedError
from tornado.tcpclient import TCPClient
from tornado.web import Application, HTTPError, RequestHandler, StaticFileHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from arm_drake.errors import ArmDrakeError, InputError, SimulationError
from arm_drake.visualization.page.scene import Scene, WidgetEvent, meshcat_address
from arm_drake.visualization.page.widgets import Section

# A browser that takes nothing for so long is left; when it wakes up it connects again
# and gets all that is there [s].
PATIENCE = 10.0

# Bytes at a time, and of one frame at most.
_CHUNK = 1 << 16

# A websocket's frames: the largest size that is said in its second byte, and the bit
# of the first byte that says that it is about the connection.
_SMALL_FRAME = 125
_IS_CONTROL = 0x08

Message = Mapping[str, Any]


def is_own(name: str) -> bool:
    """Return whether somebody may call this machine so: an address, or its own name.

    A web site's name may lead here, too.
    """
    try:
        ipaddress.ip_address(name)
    except ValueError:
        names = {socket.gethostname(), socket.getfqdn()}
        return name.lower() in {own.lower() for own in names}
    return True


def is_local(name: str) -> bool:
    """Return whether a name or an address is that of this machine, for itself alone."""
    if name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


class _OwnNames(RequestHandler):
    """Answers only requests for this machine by its own name.

    Else a web site could have its name lead here, and read and move the robot.
    """

    def log_exception(self, kind: Any, error: Any, trace: Any) -> None:
        """Say nothing of requests that are refused: anybody may send any number."""
        if not isinstance(error, HTTPError):
            super().log_exception(kind, error, trace)

    def prepare(self) -> None:
        if "\0" in unquote(self.request.path):
            raise HTTPError(400)
        name = self.request.host_name.strip("[]")
        known = self.settings["is_public"] and is_own(name)
        if not (known or is_local(name)):
            self.set_status(403)
            self.finish("Ask for this machine by its address, or by its own name.")
            return
        self.set_header("Cache-Control", "no-store")


class Files(_OwnNames, StaticFileHandler):
    """The page's own files."""


class Tunnel(_OwnNames):
    """Forwards requests to Meshcat."""

    def initialize(self, address: tuple[str, int], streams: set[IOStream]) -> None:
        """Take where Meshcat listens, and where to keep streams that are open."""
        self._address = address
        self._streams = streams

    async def get(self, path: str) -> None:
        """Answer with Meshcat's file, or connect with it."""
        if self.request.headers.get("Upgrade", "").lower() == "websocket":
            await self._join_streams()
            return
        host, port = self._address
        request = HTTPRequest(
            f"http://{host}:{port}/{quote(path)}", decompress_response=False
        )
        try:
            answer = await AsyncHTTPClient().fetch(request)
        except HTTPClientError as error:
            raise HTTPError(error.code) from None
        except OSError:
            raise HTTPError(502) from None
        for name in ("Content-Type", "Content-Encoding"):
            if name in answer.headers:
                self.set_header(name, answer.headers[name])
        self.write(answer.body)

    async def _join_streams(self) -> None:
        """Let the browser and Meshcat speak to each other, byte by byte."""
        headers = self.request.headers
        if urlsplit(headers.get("Origin", "")).netloc != self.request.host:
            raise HTTPError(403)
        try:
            meshcat = await TCPClient().connect(*self._address)
        except OSError:
            raise HTTPError(502) from None
        lines = ["GET / HTTP/1.1\r\nHost: {}:{}".format(*self._address)]
        lines += [
            f"{name}: {value}"
            for name, value in headers.get_all()
            if name == "Upgrade" or name == "Connection" or name.startswith("Sec-")
        ]
        browser = self.detach()
        streams = {meshcat, browser}
        self._streams |= streams
        try:
            await meshcat.write("\r\n".join([*lines, "\r\n"]).encode("latin-1"))
            await asyncio.gather(
                _pump(meshcat, browser), _pump_control_frames(browser, meshcat)
            )
        except StreamClosedError:
            pass
        finally:
            self._streams -= streams
            for stream in streams:
                stream.close()


class PanelSocket(_OwnNames, WebSocketHandler):
    """A browser's panel."""

    def initialize(
        self,
        clients: set["PanelSocket"],
        messages: dict[str, Message],
        on_event: Callable[[str, Any], None],
    ) -> None:
        """Take who is connected, what they know, and who listens to them."""
        self._clients = clients
        self._messages = messages
        self._on_event = on_event
        self._waiting: dict[str, Message] = {}
        self._is_sending = False

    def open(self, *args: str, **kwargs: str) -> None:
        """Send all present messages."""
        self._clients.add(self)
        for message in self._messages.values():
            self.send(message)

    def on_close(self) -> None:
        """Forget it."""
        self._clients.discard(self)

    def on_message(self, message: str | bytes) -> None:
        """Take an event; what is none is ignored."""
        try:
            said = json.loads(message)
            name, value = said["id"], said.get("value")
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return
        if isinstance(name, str):
            self._on_event(name, value)

    def send(self, message: Message) -> None:
        """Send a message when the browser has taken those before it."""
        join(self._waiting, message)
        if not self._is_sending:
            self._is_sending = True
            asyncio.get_running_loop().create_task(self._send_all())

    async def _send_all(self) -> None:
        try:
            while self._waiting:
                text = json.dumps(self._waiting.pop(next(iter(self._waiting))))
                sent = asyncio.ensure_future(self.write_message(text))
                # Given up, it fails when the connection ends, and nobody asks for it.
                sent.add_done_callback(
                    lambda done: done.cancelled() or done.exception()
                )
                await asyncio.wait_for(asyncio.shield(sent), PATIENCE)
        except WebSocketClosedError:
            pass
        except TimeoutError:
            self.close()
        finally:
            self._is_sending = False


# What begins anew with a message, by its type.
_RENEWED = {"panel": "patch", "plot": "samples"}

# Rows of a plot that a browser gets which comes later.
_MOST_ROWS = 30_000


def join(messages: dict[str, Message], message: Message) -> None:
    """Add a message to those that count."""
    kind = message["type"]
    if kind == "samples":
        rows = [*messages.get(kind, {}).get("rows", ()), *message["rows"]]
        messages[kind] = {"type": kind, "rows": rows[-_MOST_ROWS:]}
        return
    if kind != "patch":
        messages.pop(_RENEWED.get(kind, ""), None)
        messages[kind] = message
        return
    changes = dict(messages.get(kind, {}).get("changes", {}))
    for name, change in message["changes"].items():
        changes[name] = {**changes.get(name, {}), **change}
    messages[kind] = {"type": kind, "changes": changes}


async def _pump(source: IOStream, sink: IOStream) -> None:
    """Hand on all that comes; raise StreamClosedError when one is closed."""
    while True:
        chunk = await source.read_bytes(_CHUNK, partial=True)
        try:
            await asyncio.wait_for(asyncio.shield(sink.write(chunk)), PATIENCE)
        except TimeoutError:
            raise StreamClosedError from None


async def _pump_control_frames(browser: IOStream, meshcat: IOStream) -> None:
    """Forward a browser's control frames, and nothing else that it sends.

    A message that makes no sense ends Drake's Meshcat.
    """
    while True:
        # The frames of RFC 6455, section 5.2.
        head = await browser.read_bytes(2)
        size, extra = head[1] & 0x7F, b""
        if size > _SMALL_FRAME:
            extra = await browser.read_bytes(2 if size == _SMALL_FRAME + 1 else 8)
            size = int.from_bytes(extra)
        if size > _CHUNK:
            raise StreamClosedError
        rest = await browser.read_bytes(size + (4 if head[1] & 0x80 else 0))
        if head[0] & _IS_CONTROL:
            await meshcat.write(head + extra + rest)


_STATIC = Path(__file__).parent / "static"

# What Meshcat serves; of all else it warns on the terminal.
_MESHCATS_FILES = r"|index\.html|meshcat\.html|favicon\.ico|cas-v1/[0-9a-f]+"

# Ports that a page may have, and the first that is tried, and how many after it.
_PORTS = range(1024, 65536)
_FIRST_PORT = 7000
_TRIED_PORTS = 100

# Names of all addresses of this machine.
_ANYWHERE = ("*", "0.0.0.0", "::")  # noqa: S104

# A sentence of a browser is short, and no request has a body [bytes].
_LONGEST_MESSAGE = 1 << 16
_LONGEST_BODY = 1


class PageServer:
    """Serves a page until it is closed."""

    def __init__(
        self,
        *,
        host: str,
        port: int | None,
        meshcat: tuple[str, int],
        on_event: Callable[[str, Any], None],
    ) -> None:
        """Start to serve, with a Meshcat at an address."""
        self.is_public = not is_local(host)
        self._sockets = _listen(host, port)
        self.port = int(self._sockets[0].getsockname()[1])
        self.has_moved = bool(port) and port != self.port
        name = host if host not in _ANYWHERE else socket.gethostname()
        self.url = f"http://{f'[{name}]' if ':' in name else name}:{self.port}/"
        self._clients: set[PanelSocket] = set()
        self._streams: set[IOStream] = set()
        self._messages: dict[str, Message] = {}
        self._application = self._make_application(meshcat, on_event)
        self._loop = asyncio.new_event_loop()
        self._is_up, self._is_closing = threading.Event(), asyncio.Event()
        self._thread = threading.Thread(
            target=self._serve, name="arm_drake page", daemon=True
        )
        self._thread.start()
        self._is_up.wait()

    @property
    def num_clients(self) -> int:
        """Number of connected browsers."""
        return len(self._clients)

    def send(self, message: Message) -> None:
        """Send a message to all browsers, and to those that come later.

        Of messages of the same `type` the last one counts; but those of type "patch"
        have changes by widget, those of type "samples" rows, and are joined.
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
        self, meshcat: tuple[str, int], on_event: Callable[[str, Any], None]
    ) -> Application:
        tunnel = {"address": meshcat, "streams": self._streams}
        panel = {
            "clients": self._clients,
            "messages": self._messages,
            "on_event": on_event,
        }
        files = {"path": str(_STATIC), "default_filename": "index.html"}
        return Application(
            [
                (rf"/meshcat/({_MESHCATS_FILES})", Tunnel, tunnel),
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
        server = HTTPServer(self._application, max_body_size=_LONGEST_BODY)
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
        join(self._messages, message)
        for client in self._clients:
            client.send(message)


def _listen(host: str, port: int | None) -> list[socket.socket]:
    """Return sockets on the first free port; of port 0 on any free one."""
    if port and port not in _PORTS:
        text = f"expected {_PORTS[0]} to {_PORTS[-1]}, or 0 for any free one"
        raise InputError(f"port {port}: {text}")
    first = _FIRST_PORT if port is None else port
    for tried in range(first, min(first + _TRIED_PORTS, _PORTS.stop)):
        try:
            return _bind(host, tried if port != 0 else 0)
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                continue
            if error.errno == errno.EACCES:
                raise InputError(f"port {tried}: not allowed") from None
            break
        except ValueError:
            break
    else:
        which = f"no port from {first} to {tried}" if port != 0 else "no port"
        raise InputError(f"{which} is free")
    raise InputError(
        f"host {host!r}: expected localhost, * (all addresses) or an address of this "
        "machine"
    )


def _bind(host: str, port: int) -> list[socket.socket]:
    """Return sockets on a port, of all addresses the same one; 0 is any."""
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
            port = int(made.getsockname()[1])
            sockets.append(stack.enter_context(made))
        stack.pop_all()
        return sockets


# Nobody moves so many sliders in a twentieth of a second.
_MOST_EVENTS = 100


class EventQueue:
    """Events of browsers that are still to be handled.

    Of a widget with a value the last one counts, up to the next click on one without:
    a slider sends hundreds. What comes when it is full is lost.
    """

    def __init__(self) -> None:
        """Create an empty one."""
        self._lock = threading.Lock()
        self._events: list[WidgetEvent] = []

    def __len__(self) -> int:
        """Return the number of events."""
        return len(self._events)

    def put(self, event: WidgetEvent) -> bool:
        """Add an event; return whether there was none before."""
        with self._lock:
            was_empty = not self._events
            if event.value is not None:
                for k in reversed(range(len(self._events))):
                    if self._events[k].value is None:
                        break
                    if self._events[k].id == event.id:
                        del self._events[k]
                        break
            if len(self._events) < _MOST_EVENTS:
                self._events.append(event)
            return was_empty

    def take(self) -> list[WidgetEvent]:
        """Return all events in order, and forget them."""
        with self._lock:
            events, self._events = self._events, []
            return events


# Meshcat ends its connections within milliseconds [s].
_LONGEST_GOODBYE = 1.0


class Page(Scene):
    """A page in the browser, with a scene and a panel.

    Drake's Meshcat can be used in the thread alone that made it: `events` brings what
    happens in browsers, and what other threads want done, to this thread.
    """

    def __init__(self, *, host: str = "localhost", port: int | None = None) -> None:
        """Start to serve a page with an empty scene and no controls.

        Args:
            host: Address to listen on; "localhost" is seen from this machine only, "*"
                from everywhere.
            port: Port to listen on, or the first free one after it; 0 is any free one,
                and by default it is the first free one from 7000 on.

        Raises:
            InputError: If it can't listen there.
        """
        # What threads want done; None wakes the page for the events beside it.
        self._calls: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._events = EventQueue()
        super().__init__()
        # What was last sent of each widget.
        self._fields: dict[str, dict[str, Any]] = {}
        try:
            self._server = PageServer(
                host=host,
                port=port,
                meshcat=meshcat_address(self.meshcat),
                on_event=self._take_event,
            )
        except InputError:
            super().close()
            raise

    def __repr__(self) -> str:
        """Return where it is."""
        return f"<Page {self.url}>"

    @property
    def url(self) -> str:
        """Its address."""
        return self._server.url

    @property
    def port(self) -> int:
        """Its port."""
        return self._server.port

    @property
    def has_moved(self) -> bool:
        """Whether the port that it should have was taken."""
        return self._server.has_moved

    @property
    def is_public(self) -> bool:
        """Whether other machines can open it."""
        return self._server.is_public

    @property
    def num_browsers(self) -> int:
        """Number of browsers that show it."""
        return self._server.num_clients

    def set_panel(self, title: str, sections: Sequence[Section]) -> None:
        """Replace the panel.

        Args:
            title: What stands above it, and in the browser's tab.
            sections: What it consists of.
        """
        content = [section.to_json() for section in sections]
        self._fields.clear()
        self._server.send({"type": "panel", "title": title, "sections": content})

    def patch(self, changes: Mapping[str, Mapping[str, Any]]) -> None:
        """Change fields of widgets.

        Args:
            changes: New values of fields, by the widget's name.
        """
        patches: dict[str, dict[str, Any]] = {}
        for name, fields in changes.items():
            known = self._fields.setdefault(name, {})
            for field, value in fields.items():
                if field not in known or known[field] != value:
                    known[field] = value
                    patches.setdefault(name, {})[field] = value
        if patches:
            self._server.send({"type": "patch", "changes": patches})

    def say(self, text: str, severity: str = "info") -> None:
        """Show a message above everything; an empty one removes it.

        Args:
            text: The message.
            severity: "info", "warning" or "error".
        """
        self._server.send({"type": "message", "text": text, "severity": severity})

    def set_plot(
        self, curves: Sequence[str], rows: Sequence[Sequence[float | None]]
    ) -> None:
        """Draw curves over time below the scene; nothing without curves.

        Args:
            curves: Their names.
            rows: A time [s], and a number for each curve, or None.
        """
        message = {"type": "plot", "curves": list(curves), "rows": list(rows)}
        self._server.send(message)

    def add_samples(self, rows: Sequence[Sequence[float | None]]) -> None:
        """Let the curves of the plot go on, with rows as those of `set_plot`."""
        self._server.send({"type": "samples", "rows": list(rows)})

    def set_labels(self, labels: Mapping[str, str]) -> None:
        """Write names beside things of the scene.

        Args:
            labels: Names by Meshcat path.
        """
        self._server.send({"type": "labels", "labels": dict(labels)})

    def call(self, function: Callable[[], None]) -> None:
        """Have something done by the thread of the page; for any thread.

        A signal's handler may ask, too, and has to, if it wants to end a wait: after a
        signal at the end of its time, Python's SimpleQueue may wait for ever.
        """
        self._calls.put(function)

    def events(self, timeout: float) -> list[WidgetEvent]:
        """Return the events of browsers, in order; execute the calls of other threads.

        Args:
            timeout: How long to wait for the first [s].
        """
        deadline = time.monotonic() + timeout
        found: list[WidgetEvent] = []
        was_called = False
        with contextlib.suppress(queue.Empty):
            while not (found or was_called):
                wait = deadline - time.monotonic()
                call = self._calls.get(wait > 0.0, max(wait, 0.0))
                while True:
                    if call is not None:
                        call()
                        was_called = True
                    # Of the same moment.
                    if self._calls.empty():
                        break
                    call = self._calls.get_nowait()
                found = self._events.take()
        for event in found:
            # The browser shows another value than it was told.
            self._fields.get(event.id, {}).pop("value", None)
        return found

    def handle(
        self, events: Iterable[WidgetEvent], act: Callable[[WidgetEvent], None]
    ) -> None:
        """Do what was clicked, and say what can't be done.

        Args:
            events: What happened, in order.
            act: Does what one of them stands for.

        Raises:
            SimulationError: If a simulation can't go on.
        """
        problems = []
        for event in (happened := list(events)):
            try:
                act(event)
            except SimulationError:
                raise
            except ArmDrakeError as error:
                problems.append(str(error))
        if happened:
            self.say("\n".join(problems), "error")

    def _take_event(self, name: str, value: Any) -> None:
        if self._events.put(WidgetEvent(name, value)):
            self._calls.put(None)

    def close(self) -> None:
        """End it: its address is free again. What is in its scene goes."""
        if self._is_closed:
            return
        self._server.close()
        deadline = time.monotonic() + _LONGEST_GOODBYE
        while self.is_alive and time.monotonic() < deadline:
            if not self.meshcat.GetNumActiveConnections():
                break
            time.sleep(0.005)
        super().close()
