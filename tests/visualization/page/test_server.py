"""The server of a page: who can reach it, what it hands on, and what it leaves."""

import gc
import ipaddress
import itertools
import logging
import operator
import re
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import psutil
import pytest
from pydrake.geometry import Box, Rgba

from arm_drake.errors import InputError, SimulationError
from arm_drake.visualization.page import Page, WidgetEvent
from arm_drake.visualization.page import page as module
from arm_drake.visualization.page.scene import meshcat_address
from tests.test_memory import resident_memory
from tests.visualization.page.clients import (
    BINARY,
    PING,
    PONG,
    TEXT,
    Panel,
    WebSocket,
    end_meshcat,
    get,
)
from tests.visualization.scene import unpack
from tests.waiting import PATIENCE, wait_until

MIB = 1 << 20

# MessagePack for {"type": "button", "name": "go"}.
CLICK = b"\x82\xa4type\xa6button\xa4name\xa2go"


@pytest.fixture
def page() -> Iterator[Page]:
    with Page() as page:
        yield page


def listening(port: int) -> set[str]:
    """Return the addresses on which this process listens to a port."""
    return {
        connection.laddr.ip
        for connection in psutil.Process().net_connections("tcp")
        if connection.status == psutil.CONN_LISTEN and connection.laddr.port == port
    }


def free_ports(count: int) -> int:
    """Return the first of so many free ports in a row."""
    for first in itertools.count(20000, count):
        try:
            for port in range(first, first + count):
                socket.create_server(("127.0.0.1", port)).close()
        except OSError:
            continue
        return first
    raise AssertionError


def test_only_this_machine_is_listened_to(page: Page) -> None:
    found = listening(page.port)
    assert "127.0.0.1" in found
    assert found <= {"127.0.0.1", "::1"}
    # 127.0.0.2 is this machine too, but not where the server listens.
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", page.port), timeout=5.0).close()
    assert not page.is_public
    assert page.url == f"http://localhost:{page.port}/"


@pytest.mark.parametrize("host", ["*", "0.0.0.0"])  # noqa: S104
def test_all_addresses_are_listened_to_when_asked_for(host: str) -> None:
    with Page(host=host) as page:
        assert listening(page.port) in ({"::"}, {"0.0.0.0"})  # noqa: S104
        assert page.is_public
        for name in ("192.0.2.7", "[2001:db8::1]", socket.gethostname()):
            assert get(page.port, "/", name).status == 200
        # A web site's name may lead here, too.
        refused = get(page.port, "/", "robot.example.org")
        assert refused.status == 403
        assert b"by its address, or by its own name" in refused.body
        # Meshcat itself still listens to this machine alone.
        (host,) = listening(page.meshcat.port())
        assert ipaddress.ip_address(host).is_loopback


@pytest.mark.skipif(sys.platform != "linux", reason="others have one such address")
def test_nobody_can_guess_where_meshcat_listens(page: Page) -> None:
    host, port = meshcat_address(page.meshcat)

    assert listening(port) == {host}
    assert ipaddress.ip_address(host) in ipaddress.ip_network("127.0.0.0/8")
    # What a web site tries.
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), timeout=5.0).close()


def test_an_address_of_this_machine_is_served_by_its_own_name() -> None:
    # A port that is free elsewhere, too: other tests keep their Meshcats.
    with socket.create_server(("", 0)) as taken:
        port = taken.getsockname()[1]
    with Page(host="127.0.0.2", port=port) as page:
        assert listening(page.port) == {"127.0.0.2"}
        assert not page.is_public
        assert page.url == f"http://127.0.0.2:{page.port}/"
        with socket.create_connection(("127.0.0.2", page.port)) as connection:
            text = f"GET / HTTP/1.0\r\nHost: 127.0.0.2:{page.port}\r\n\r\n"
            connection.sendall(text.encode())
            assert connection.recv(12) == b"HTTP/1.1 200"


@pytest.mark.parametrize("name", ["localhost", "LOCALHOST", "127.0.0.1", "[::1]"])
def test_names_of_this_machine_are_answered(page: Page, name: str) -> None:
    for path in ("/", "/panel.js", "/panel.css", "/meshcat/"):
        assert get(page.port, path, f"{name}:{page.port}").status == 200


@pytest.mark.parametrize(
    "name",
    [
        "evil.example",
        "localhost.evil.example",
        "127.0.0.1.evil.example",
        "192.168.1.2",
        "0.0.0.0",  # noqa: S104
        "",
    ],
)
def test_another_name_is_refused(page: Page, name: str) -> None:
    host = f"{name}:{page.port}" if name else ""
    for path in ("/", "/index.html", "/panel.js", "/meshcat/", "/meshcat/meshcat.js"):
        assert get(page.port, path, host).status in (400, 403)
    for path in ("/panel", "/meshcat/"):
        with WebSocket(page.port, path, host=host or "x") as client:
            assert client.status == 403
    assert page.num_browsers == 0


@pytest.mark.parametrize("path", ["/panel", "/meshcat/"])
def test_websockets_of_other_web_sites_are_refused(page: Page, path: str) -> None:
    foreign = (
        "http://evil.example",
        f"http://evil.example:{page.port}",
        f"http://localhost.evil.example:{page.port}",
        # Another program of this machine.
        f"http://localhost:{page.port + 1}",
        "null",
    )

    for origin in foreign:
        with WebSocket(page.port, path, origin=origin) as client:
            assert client.status == 403, origin

    with WebSocket(page.port, path) as client:
        assert client.status == 101
    assert page.meshcat.GetNumActiveConnections() <= 1


def test_nothing_is_kept_by_the_browser(page: Page) -> None:
    # After an update of the package the page's old script would not fit.
    for path in ("/", "/panel.js", "/meshcat/"):
        assert get(page.port, path).headers["cache-control"] == "no-store"


def test_only_the_pages_own_files_are_served(page: Page) -> None:
    assert b"panel.js" in get(page.port, "/").body
    for path in ("/../page.py", "/%2e%2e/page.py", "//etc/passwd", "/none.js"):
        assert get(page.port, path).status in (403, 404)


def test_a_taken_port_gives_the_next_one() -> None:
    first = free_ports(3)

    with (
        Page(port=first) as one,
        socket.create_server(("127.0.0.1", first + 1)),
        Page(port=first) as two,
    ):
        assert (one.port, one.has_moved) == (first, False)
        assert (two.port, two.has_moved) == (first + 2, True)
        assert two.url == f"http://localhost:{first + 2}/"
        assert get(two.port, "/").status == 200


def test_the_first_free_port_from_7000_on_is_no_other_than_asked_for() -> None:
    with Page() as page:
        assert page.port >= 7000
        assert not page.has_moved


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"port": 80}, "port 80: expected 1024 to 65535, or 0 for any free one"),
        ({"port": 65536}, "port 65536: expected 1024 to 65535, or 0 for any free one"),
        (
            {"host": "my-robot"},
            "host 'my-robot': expected localhost, * (all addresses) or an address of "
            "this machine",
        ),
        (
            # An address for documentation, which no machine has.
            {"host": "192.0.2.1"},
            "host '192.0.2.1': expected localhost, * (all addresses) or an address of "
            "this machine",
        ),
    ],
)
def test_a_place_that_cannot_be_is_said(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        Page(**options)

    assert str(caught.value) == message


def test_that_no_port_is_free_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_TRIED_PORTS", 2)
    first = free_ports(2)

    with (
        socket.create_server(("127.0.0.1", first)),
        socket.create_server(("127.0.0.1", first + 1)),
        pytest.raises(InputError) as caught,
    ):
        Page(port=first)

    assert str(caught.value) == f"no port from {first} to {first + 1} is free"


def test_a_page_that_cannot_start_leaves_no_meshcat() -> None:
    process = psutil.Process()

    def attempt() -> int:
        with pytest.raises(InputError):
            Page(port=80)
        return len(process.net_connections("tcp"))

    # The first one may make a Meshcat, which stays for the next page.
    first = attempt()

    assert [attempt() for _ in range(3)] == [first] * 3


def test_meshcats_files_come_unchanged(page: Page) -> None:
    host, port = meshcat_address(page.meshcat)
    text = get(port, "/", at=host).body.decode()
    # By what they say, such as cas-v1/db39149...; the script is among them.
    named = re.findall(r'(?:src|href)="([^"]+)"', text)
    names = ("", "index.html", "meshcat.html", "favicon.ico", "none", *named)
    sizes = []
    for name in names:
        through = get(page.port, f"/meshcat/{name}")
        direct = get(port, f"/{name}", at=host)

        assert through.status == direct.status
        if direct.status == 200:
            assert through.body == direct.body
            if "content-type" in direct.headers:
                assert through.headers["content-type"] == direct.headers["content-type"]
        sizes.append(len(direct.body))
    # The page and its script are there indeed.
    assert sizes[0] > 1000
    assert sizes[-1] > 100_000


def scene_of(client: WebSocket, count: int) -> list[bytes]:
    """Return the first messages of a scene, in any order."""
    found = []
    for _ in range(count):
        kind, data = client.read()
        assert kind == BINARY
        found.append(data)
    return sorted(found)


def test_the_scene_comes_unchanged_and_goes_on(page: Page) -> None:
    page.meshcat.SetObject("/drake/old", Box(1.0, 2.0, 3.0), Rgba(1, 0, 0))
    host, port = meshcat_address(page.meshcat)
    with (
        WebSocket(page.port, "/meshcat/") as through,
        WebSocket(port, "/", at=host) as direct,
    ):
        wait_until(lambda: page.meshcat.GetNumActiveConnections() == 2)
        page.meshcat.SetObject("/drake/new", Box(4.0, 5.0, 6.0), Rgba(0, 1, 0))
        page.meshcat.SetProperty("/drake/last", "done", True)

        found = []
        for client in (through, direct):
            messages: list[bytes] = []
            while not messages or b"/drake/last" not in messages[-1]:
                messages += scene_of(client, 1)
            found.append(messages)

    assert sorted(found[0]) == sorted(found[1])
    boxes = {
        message["path"]: message["object"]["geometries"][0]
        for message in map(unpack, found[0])
        if message["type"] == "set_object" and message["path"].startswith("/drake/")
    }
    # three.js has the depth of a box along z.
    sides = ("width", "height", "depth")
    assert sorted(boxes["/drake/new"][side] for side in sides) == [4.0, 5.0, 6.0]
    assert sorted(boxes["/drake/old"][side] for side in sides) == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("host", ["localhost", "*"])
def test_what_a_browser_tells_meshcat_is_kept_from_it(host: str) -> None:
    # The last one is a map that is cut off, which ends Drake's Meshcat.
    for message in (CLICK, b"\xc1garbage", b"\x85"):
        with Page(host=host) as page, WebSocket(page.port, "/meshcat/") as browser:
            page.meshcat.AddButton("go")
            browser.send(message, BINARY)
            browser.send(b"still there?", PING)
            wait_until(lambda: browser.read() == (PONG, b"still there?"))

            assert page.is_alive
            assert page.meshcat.GetButtonClicks("go") == 0


GARBAGE = [
    b"",
    b"{",
    b"\xff\xfe\x00",
    b"null",
    b"1",
    b'"play"',
    b"[]",
    b'["id", "value"]',
    b"{}",
    b'{"value": 1}',
    b'{"id": null, "value": 1}',
    b'{"id": 1}',
    b'{"id": ["play"]}',
    b'{"id": {"id": "play"}}',
    b"[" * 60_000,
    b'{"id":' * 10_000,
    b"9" * 60_000,
]


@pytest.mark.slow
@pytest.mark.parametrize("kind", [TEXT, BINARY])
@pytest.mark.parametrize("garbage", GARBAGE, ids=range(len(GARBAGE)))
def test_garbage_is_no_event_and_harms_nobody(
    page: Page, caplog: pytest.LogCaptureFixture, garbage: bytes, kind: int
) -> None:
    if kind == TEXT and garbage.startswith(b"\xff"):
        garbage = b'\xc3\xa4{"id"'  # Websockets have no other text.

    with caplog.at_level(logging.WARNING), Panel(page.port) as client:
        client.send(garbage, kind)
        client.say("after", 2)
        # In the order of what was said: garbage would be first.
        assert page.events(PATIENCE) == [WidgetEvent("after", 2)]

    assert caplog.records == []


def test_a_message_that_is_too_long_ends_its_own_connection_only(
    page: Page, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING), Panel(page.port) as other:
        with Panel(page.port) as client:
            wait_until(lambda: page.num_browsers == 2)
            client.send(b'{"id": "' + b"x" * MIB + b'"}')
            with pytest.raises(ConnectionError):
                client.hear()
        wait_until(lambda: page.num_browsers == 1)
        other.say("play")
        assert page.events(PATIENCE) == [WidgetEvent("play")]

    assert caplog.records == []


@pytest.mark.parametrize(
    "path",
    [
        "/meshcat/%0d%0aX-Evil:%20yes",
        "/meshcat/a%20b",
        "/meshcat/%00",
        "/index.html%00.js",
        "/%00",
        "/meshcat/%ff",
        "/meshcat/..%2f..%2fetc%2fpasswd",
        "/meshcat/" + "x" * 8000,
        "/meshcat/@example.org/",
        "/meshcat//example.org/",
    ],
)
def test_paths_that_make_no_sense_are_no_files(
    page: Page, caplog: pytest.LogCaptureFixture, path: str
) -> None:
    # Nothing is said of them: anybody may ask for any number.
    with caplog.at_level(logging.WARNING):
        assert get(page.port, path).status in (400, 403, 404, 431)

    assert caplog.records == []
    assert get(page.port, "/meshcat/").status == 200


def test_raw_garbage_harms_nobody(page: Page) -> None:
    with Panel(page.port) as other:
        for garbage in (b"\x16\x03\x01\x02\x00", b"GET\r\n\r\n", b"\x00" * 100_000):
            with socket.create_connection(("127.0.0.1", page.port)) as connection:
                connection.sendall(garbage)
        other.say("play")
        assert page.events(PATIENCE) == [WidgetEvent("play")]

    assert get(page.port, "/meshcat/").status == 200


@pytest.mark.slow
def test_a_panel_that_is_not_read_is_dropped_and_the_others_go_on(
    page: Page, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    # Less than this the other one must take to read, on a busy machine, too.
    monkeypatch.setattr(module, "PATIENCE", 3.0)
    count, size = 300, MIB

    with Panel(page.port, buffer=4096), Panel(page.port) as other:
        wait_until(lambda: page.num_browsers == 2)
        before = resident_memory()
        for number in range(count):
            page.set_labels({str(number): "x" * size})
            # No faster than the server hands on.
            other.hear_until(lambda m, n=number: str(n) in m.get("labels", {}))
            other.heard.clear()
        most = resident_memory() - before
        wait_until(lambda: page.num_browsers == 1)

    assert [r for r in caplog.records if r.levelno >= logging.WARNING] == []
    # A few copies: the text, its JSON, its bytes, for each of the two, and what the
    # server's queue holds, not all that was sent.
    assert most < count * size / 4


@pytest.mark.slow
def test_a_panel_that_does_not_answer_pings_is_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "PATIENCE", 0.3)

    with Page() as page:
        page.set_panel("robot", [])
        with Panel(page.port) as panel:
            # It is known; it may be dropped before anybody looks whether it is.
            panel.hear()
            wait_until(lambda: page.num_browsers == 0)


@pytest.mark.slow
def test_a_scene_that_is_not_read_is_dropped_and_the_others_go_on(
    page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "PATIENCE", 3.0)
    meshcat, rng = page.meshcat, np.random.default_rng(1)
    line = np.asfortranarray(rng.random((3, 200_000)))  # 2.4 MB on the wire.

    with (
        WebSocket(page.port, "/meshcat/", buffer=4096),
        WebSocket(page.port, "/meshcat/") as other,
    ):
        wait_until(lambda: meshcat.GetNumActiveConnections() == 2)

        def send(numbers: range) -> None:
            for number in numbers:
                meshcat.SetLine("/drake/line", line)
                meshcat.SetProperty("/drake/line", "number", float(number))
                data = b""
                while b"number" not in data:
                    _, data = other.read()
                assert unpack(data)["value"] == number

        send(range(10))
        wait_until(lambda: meshcat.GetNumActiveConnections() == 1)
        before = resident_memory()
        send(range(10, 60))
        grown = resident_memory() - before

    # 120 MB were sent, and nothing is kept for who has been left.
    assert grown < 50 * MIB


def read_on(read: Callable[[], object]) -> None:
    while True:
        read()


def test_a_closed_page_leaves_its_port_and_tells_its_browsers() -> None:
    page = Page()
    port, meshcat_port = page.port, page.meshcat.port()
    with Panel(port) as panel, WebSocket(port, "/meshcat/") as scene:
        wait_until(lambda: page.num_browsers == 1)

        page.close()

        for read in (panel.hear, scene.read):
            with pytest.raises(ConnectionError):
                read_on(read)
    assert listening(port) == set()
    # Meshcat stays for the next page.
    assert listening(meshcat_port)
    with Page(port=port) as again:
        assert (again.port, again.has_moved) == (port, False)
        assert again.meshcat is page.meshcat


def test_a_page_that_is_closed_takes_no_harm() -> None:
    page = Page()
    page.close()

    page.close()
    page.set_panel("too late", [])
    page.patch({"a": {"value": 1}})
    page.say("too late")
    page.set_labels({})

    assert page.num_browsers == 0
    assert page.events(0.0) == []


@pytest.mark.slow
def test_pages_one_after_the_other_leave_nothing() -> None:
    process = psutil.Process()

    def use() -> None:
        with Page() as page:
            page.set_panel("robot", [])
            assert get(page.port, "/meshcat/").status == 200
            with Panel(page.port) as panel, WebSocket(page.port, "/meshcat/"):
                panel.hear()
                page.meshcat.SetObject("/drake/box", Box(1.0, 1.0, 1.0))

    def count() -> tuple[int, int, int]:
        # Of their connections the clients' ends may not be gone yet.
        ours = (psutil.CONN_LISTEN, psutil.CONN_ESTABLISHED)
        sockets = [c for c in process.net_connections("tcp") if c.status in ours]
        gc.collect()
        return threading.active_count(), len(sockets), process.num_fds()

    for _ in range(3):
        use()
        first = count()
    before = resident_memory()

    for _ in range(10):
        use()
        # A thread may still be about to end.
        wait_until(lambda: all(map(operator.le, count(), first)), "all have ended")

    # A Meshcat is about 1 MB, with its threads and files; a server some 100 kB.
    assert resident_memory() - before < 4 * MIB


def test_a_meshcat_that_has_ended_is_reported_in_one_sentence() -> None:
    def use() -> None:
        with Page() as page:
            end_meshcat(page)
            page.meshcat.SetObject("/drake/box", Box(1.0, 1.0, 1.0))

    with pytest.raises(SimulationError, match=r"^Meshcat has ended: a program of this"):
        use()

    # The next page has another one.
    with Page() as page:
        assert page.is_alive


def test_requests_with_a_body_are_refused_before_it_comes(page: Page) -> None:
    head = f"POST / HTTP/1.1\r\nHost: localhost:{page.port}\r\n"
    for size in ("Content-Length: 60000000", "Transfer-Encoding: chunked"):
        with socket.create_connection(("127.0.0.1", page.port)) as connection:
            connection.settimeout(PATIENCE)
            connection.sendall(f"{head}{size}\r\n\r\n".encode())
            if "chunked" in size:
                connection.sendall(b"10000\r\n")
            answer = b""
            while data := connection.recv(MIB):
                answer += data
            assert answer[:12] in (b"HTTP/1.1 400", b"HTTP/1.1 405")


def test_a_flood_of_events_leaves_the_newest_of_each_widget(page: Page) -> None:
    with Panel(page.port) as panel:
        for number in range(3000):
            panel.say(f"slider:{number % 3}", number + 1)
        panel.say("after")
        happened: list[WidgetEvent] = []
        while WidgetEvent("after") not in happened:
            happened += page.events(PATIENCE)
            assert len(happened) < 3000
    newest = {event.id: event.value for event in happened}
    assert newest == {
        "slider:0": 2998,
        "slider:1": 2999,
        "slider:2": 3000,
        "after": None,
    }


def test_no_more_events_wait_than_somebody_can_do(page: Page) -> None:
    with Panel(page.port) as panel:
        for _ in range(1000):
            panel.say("play")
        wait_until(lambda: len(page._events) == 100)

    assert page.events(0.0) == [WidgetEvent("play")] * 100
