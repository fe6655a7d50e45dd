"""A headless Chromium that a test or benchmark drives: pages, scripts in them, pictures, addresses they asked for."""

import json
import shutil
import subprocess
import time
import urllib.request
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

from websockets.sync.client import connect

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
MISSING = "no Chromium here: apt-get install chromium"
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--remote-debugging-port=0", "--window-size=1280,1000",
    "--disable-dev-shm-usage",
)  # fmt: skip
START_S, ANSWER_S = 60.0, 60.0


class Browser:
    """One page of a browser of its own.

    Attributes:
        folder: for its profile.
        asked: addresses that the page and its scripts asked for.
        faults: errors of its scripts, and lines that it logged as errors.
        process: the browser, with its children.
    """

    process: subprocess.Popen[bytes]

    def __init__(self, folder: Path) -> None:
        self.folder, self.asked, self.faults = folder, list[str](), list[str]()
        self._number, self._open = 0, ExitStack()

    def __enter__(self) -> Self:
        assert CHROMIUM is not None, MISSING
        command = [CHROMIUM, *FLAGS, f"--user-data-dir={self.folder}", "about:blank"]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._open.callback(self._end)
        try:
            place = self._page(self.folder / "DevToolsActivePort")
            self._socket = self._open.enter_context(
                connect(place, max_size=None, open_timeout=START_S, ping_interval=None)
            )
        except BaseException:
            self._open.close()
            raise
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def _end(self) -> None:
        self.process.terminate()
        self.process.wait(timeout=START_S)

    @staticmethod
    def _page(path: Path) -> str:
        """Return the address under which the page is driven, once the browser has written its port."""
        end = time.monotonic() + START_S
        while time.monotonic() < end:
            if path.exists() and (lines := path.read_text().split()):
                with urllib.request.urlopen(f"http://127.0.0.1:{lines[0]}/json/list") as reply:
                    pages = [each for each in json.load(reply) if each["type"] == "page"]
                if pages:
                    return pages[0]["webSocketDebuggerUrl"]
            time.sleep(0.05)
        raise TimeoutError("the browser did not start")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command of the DevTools protocol and return its result."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            found = json.loads(self._socket.recv(timeout=ANSWER_S))
            if found.get("id") == self._number:
                assert "error" not in found, found["error"]
                return found["result"]
            self._take(found)

    def _take(self, event: dict[str, Any]) -> None:
        what = event.get("params", {})
        if event["method"] == "Network.requestWillBeSent":
            self.asked.append(what["request"]["url"])
        elif event["method"] == "Runtime.exceptionThrown":
            self.faults.append(json.dumps(what["exceptionDetails"])[:2000])
        elif event["method"] == "Log.entryAdded" and what["entry"]["level"] == "error":
            self.faults.append(what["entry"]["text"])

    def go(self, url: str) -> None:
        """Open an address."""
        self.call("Page.navigate", url=url)

    def run(self, script: str) -> Any:
        """Return the value of a script in the page; a promise is awaited."""
        found = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, script: str, timeout_s: float = 20.0) -> Any:
        """Return the value of a script once it is true."""
        end = time.monotonic() + timeout_s
        while not (value := self.run(script)):
            assert time.monotonic() < end, f"{script} is {value!r} after {timeout_s:g} s; faults: {self.faults}"
            time.sleep(0.05)
        return value
