"""The web page of docs/ros.md drives an arm through rosbridge."""

import functools
import http.server
import json
import threading
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Dialog

from tests.waiting import wait_until
from tests.wire.served import port_of, served, simulation

pytestmark = [pytest.mark.browser, pytest.mark.slow]

GUIDE = Path(__file__).parents[2] / "docs" / "ros.md"


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *arguments: Any) -> None:
        """Say nothing."""


def test_the_page_of_the_guide_moves_the_arm(browser: Browser, tmp_path: Path) -> None:
    page_text = GUIDE.read_text(encoding="utf-8").partition("```html\n")[2]
    page_text = page_text.partition("```")[0]
    assert "ws://127.0.0.1:9090" in page_text
    handler = functools.partial(_Quiet, directory=str(tmp_path))
    alerts: list[str] = []
    goal = [0.5, 0.0, 0.5, 0.0, 0.5, 0.0]

    def take(dialog: Dialog) -> None:
        alerts.append(dialog.message)
        dialog.accept()

    with (
        served(simulation()) as server,
        http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as files,
    ):
        own = page_text.replace(":9090", f":{port_of(server)}")
        (tmp_path / "index.html").write_text(own, encoding="utf-8")
        threading.Thread(target=files.serve_forever, daemon=True).start()
        context = browser.new_context()
        page = context.new_page()
        page.on("dialog", take)
        page.goto(f"http://127.0.0.1:{files.server_port}/index.html")

        def is_done() -> bool:
            page.wait_for_timeout(20)
            return bool(alerts)

        wait_until(is_done, "the goal ends")

        def is_there() -> bool:
            page.wait_for_timeout(20)
            lines = page.inner_text("#states").splitlines()
            return [float(line) for line in lines] == pytest.approx(goal, abs=0.01)

        wait_until(is_there, "the page shows the goal")
        context.close()
        files.shutdown()

    assert json.loads(alerts[0])["error_code"] == 0
