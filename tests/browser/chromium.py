"""A headless Chromium for tests, driven over its debugging pipe: no package, no port, no network.

And the rules of axe-core for pages that everybody can read, as a package from PyPI brings them.
"""

import contextlib
import fcntl
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

import pytest

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
_PATIENCE = 60.0


def find_chromium():
    """Return the path of Chromium, None where there is none."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


class Browser:
    """One page. `messages` holds what the console said, `requests` the addresses that were asked for."""

    def __init__(self):
        self.folder = tempfile.TemporaryDirectory(prefix="symid-chromium-")
        # Chromium reads commands from 3 and writes answers to 4.
        read, self._out = os.pipe()
        self._in, write = os.pipe()
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 50) for end in (read, write)]
        options = ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage")
        options += ("--hide-scrollbars", "--remote-debugging-pipe", f"--user-data-dir={self.folder.name}")
        start = (
            "import os, sys; os.dup2(int(sys.argv[1]), 3); os.dup2(int(sys.argv[2]), 4); "
            "os.execv(sys.argv[3], sys.argv[3:])"
        )
        quiet = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
        command = [sys.executable, "-c", start, *map(str, ends), find_chromium(), *options, "about:blank"]
        self.process = subprocess.Popen(command, pass_fds=ends, **quiet)
        for end in (read, write, *ends):
            os.close(end)
        self._number, self._buffer, self._session = 0, b"", None
        self.messages, self.requests, self._loaded = [], [], False
        target = self.call("Target.getTargets")["targetInfos"]
        page = next(one for one in target if one["type"] == "page")
        attached = self.call("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method, **parameters):
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]

    def _read(self):
        end = time.monotonic() + _PATIENCE
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._in], [], [], max(0.0, end - time.monotonic()))
            assert ready, "Chromium does not answer"
            data = os.read(self._in, 1 << 20)
            assert data, "Chromium has ended"
            self._buffer += data
        line, self._buffer = self._buffer.split(b"\0", 1)
        answer = json.loads(line)
        self._note(answer)
        return answer

    def _note(self, answer):
        given = answer.get("params", {})
        match answer.get("method"):
            case "Runtime.consoleAPICalled":
                self.messages.append(str(given["args"]))
            case "Runtime.exceptionThrown":
                self.messages.append(str(given["exceptionDetails"].get("exception", given)))
            case "Log.entryAdded":
                self.messages.append(given["entry"]["text"])
            case "Network.requestWillBeSent":
                self.requests.append(given["request"]["url"])
            case "Page.loadEventFired":
                self._loaded = True

    def size(self, width, height, *, dark=False):
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.call("Emulation.setEmulatedMedia", features=scheme)

    def open(self, path):
        self._loaded = False
        self.messages.clear()
        self.requests.clear()
        self.call("Page.navigate", url=Path(path).resolve().as_uri())
        while not self._loaded:
            self._read()

    def run(self, script):
        found = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def drag(self, points):
        kinds = ["mousePressed", *["mouseMoved"] * (len(points) - 2), "mouseReleased"]
        for kind, (x, y) in zip(kinds, points, strict=True):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def close(self):
        self.process.terminate()
        self.process.wait(timeout=20)
        os.close(self._in)
        os.close(self._out)
        with contextlib.suppress(OSError):
            self.folder.cleanup()


PLAIN = (
    "for (const node of document.querySelectorAll('.katex')) "
    "node.replaceWith(node.querySelector('annotation').textContent)"
)
"""Formulas as their LaTeX: the rules look at every box of a formula otherwise, for a minute a page."""


def list_findings(browser):
    """Return the rules that the open page breaks, each with the first element that does."""
    package = find_spec("axe_playwright_python")
    if package is None:
        pytest.skip("axe-core is not here: make test-browser installs it")
    browser.run(PLAIN)
    rules = Path(package.origin).with_name("axe.min.js").read_text(encoding="utf-8")
    browser.run(f"{rules};1")
    return browser.run(
        "axe.run(document, { resultTypes: ['violations'] }).then((found) => "
        "found.violations.map((one) => [one.id, one.nodes[0].html.slice(0, 200)]))"
    )
