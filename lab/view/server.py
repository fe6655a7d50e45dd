"""HTTP server of the view, on this machine only.

A page of another site can reach a port of this machine, too. So every request must name this machine in `Host` (else a
foreign name resolves to it: DNS rebinding) and carry the token that only who started the view has seen.
"""

import json
import secrets
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from errno import EADDRINUSE
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import BoundedSemaphore, Thread
from typing import Any
from urllib.parse import parse_qs, urlsplit

from pydantic import TypeAdapter, ValidationError

from surefoot.errors import BusError, SurefootError

from ..scene.pages import page, stage
from .live import LiveFrames

HOST = "127.0.0.1"
PORT = 7480
READERS = 8
"""Pages that may look at the same time."""
SEND_S = 5.0
"""Wall time after which a page that does not read is given up."""
BODY_BYTES = 4096
FIELDS = TypeAdapter(dict[str, Any])

LIVE_BAR = """<button data-do="pause">pause</button><button data-do="resume">go on</button>
<button data-do="step" data-fields='{"ticks":1}'>1 tick</button>
<button data-do="step" data-fields='{"ticks":20}'>20 ticks</button>
<select id="speed" aria-label="speed"><option value="0.25">0.25x</option><option value="0.5">0.5x</option>
<option value="1" selected>1x</option><option value="2">2x</option>
<option value="0">as fast as it goes</option></select>
<button data-do="push" data-fields='{"force":[0,5,0],"duration":0.2}'>push left, 5 N</button>
<button data-do="push" data-fields='{"force":[0,-5,0],"duration":0.2}'>push right</button>
<select id="fault" aria-label="fault"></select><button id="break">break for 2 s</button>
<button data-do="stop" class="stop">STOP</button><span id="answer"></span>"""


class ViewServer:
    """Serves a page until it is closed.

    Attributes:
        port: where it listens on 127.0.0.1.
        token: what every request must carry.
    """

    def __init__(self, page_text: Callable[[], str], live: LiveFrames | None = None, port: int = PORT) -> None:
        """Begin to serve.

        Raises:
            BusError: the port is taken.
        """
        self.page_text, self.live, self.token = page_text, live, secrets.token_urlsafe(16)
        self.readers = BoundedSemaphore(READERS)
        try:
            self._http = _Http((HOST, port), self)
        except OSError as error:
            taken = f"port {port} of {HOST} is taken; choose another with --port, 0 = any"
            raise BusError("busy", taken if error.errno == EADDRINUSE else f"port {port}: {error.strerror}") from None
        self.port = int(self._http.server_address[1])
        self._thread = Thread(target=self._http.serve_forever, name="http", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Address of the page, with the token."""
        return f"http://{HOST}:{self.port}/?token={self.token}"

    def hints(self, environ: Mapping[str, str]) -> list[str]:
        """Return what to do to see the page: its address, and over SSH the tunnel to it."""
        lines = [f"view: {self.url}"]
        connection = environ.get("SSH_CONNECTION", "").split()
        if len(connection) == 4:
            tunnel = f"ssh -N -L {self.port}:{HOST}:{self.port} {environ.get('USER', 'user')}@{connection[2]}"
            lines.insert(0, f"on your own machine: {tunnel}")
        return lines

    def close(self) -> None:
        """Stop serving."""
        if self.live is not None:
            self.live.close()
        self._http.shutdown()
        self._http.server_close()


class _Http(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, address: tuple[str, int], view: ViewServer) -> None:
        self.view = view
        super().__init__(address, _Handler)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Stay silent about pages that went away."""


class _Handler(BaseHTTPRequestHandler):
    server: _Http
    protocol_version = "HTTP/1.1"
    timeout = SEND_S

    def log_message(self, format: str, *args: Any) -> None:
        """Write no log: the address of a page holds the token."""

    def do_GET(self) -> None:
        """Answer the page, what holds for all frames, or the stream of frames."""
        view, path = self.server.view, urlsplit(self.path).path
        if not self._allowed():
            return
        if path == "/":
            self._answer(view.page_text().encode(), "text/html; charset=utf-8")
        elif path == "/head" and view.live is not None:
            self._json(view.live.head())
        elif path == "/events" and view.live is not None:
            self._stream(view.live)
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "there is /, /head, /events and, by POST, /do")

    def do_POST(self) -> None:
        """Carry out what a button asks for."""
        view = self.server.view
        if not self._allowed():
            return
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > BODY_BYTES:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"a request has at most {BODY_BYTES} bytes")
            return
        body = self.rfile.read(int(length))
        if view.live is None or urlsplit(self.path).path != "/do":
            self._refuse(HTTPStatus.NOT_FOUND, "a recording takes no orders")
            return
        try:
            asked = FIELDS.validate_json(body)
            self._json(view.live.act(str(asked.get("action")), FIELDS.validate_python(asked.get("fields", {}))))
        except ValidationError:
            self._refuse(HTTPStatus.BAD_REQUEST, "a request is a JSON object with action and fields")
        except SurefootError as error:
            self._json({"accepted": False, "reason": error.message})

    def _allowed(self) -> bool:
        """Refuse a request that names another host, comes from the page of another site, or lacks the token."""
        view = self.server.view
        names = {f"{name}:{view.port}" for name in (HOST, "localhost")}
        origin, token = self.headers.get("Origin"), parse_qs(urlsplit(self.path).query).get("token", [""])[0]
        if self.headers.get("Host") not in names or (origin and origin.removeprefix("http://") not in names):
            self._refuse(HTTPStatus.FORBIDDEN, "this view answers to 127.0.0.1 only")
        elif not secrets.compare_digest(token.encode(), view.token.encode()):
            self._refuse(HTTPStatus.FORBIDDEN, "the token is missing or wrong; open the address that was printed")
        else:
            return True
        return False

    def _refuse(self, status: HTTPStatus, why: str) -> None:
        self.close_connection = True
        self._answer((why + "\n").encode(), "text/plain; charset=utf-8", status)

    def _json(self, content: Any) -> None:
        self._answer(json.dumps(content, separators=(",", ":")).encode(), "application/json")

    def _answer(self, body: bytes, kind: str, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        for name, value in {
            "Content-Type": kind, "Content-Length": str(len(body)), "Cache-Control": "no-store",
            "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "X-Frame-Options": "DENY",
        }.items():  # fmt: skip
            self.send_header(name, value)
        self.end_headers()
        with suppress(OSError):
            self.wfile.write(body)

    def _stream(self, live: LiveFrames) -> None:
        """Send frames as they come; one that is overtaken while the page does not read is left out."""
        if not self.server.view.readers.acquire(blocking=False):
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, f"{READERS} pages look already")
            return
        self.close_connection = True
        try:
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 16)  # no queue of old frames
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/event-stream")
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            number = 0
            while not live.closed:
                newer, text = live.next_after(number, 1.0)
                self.wfile.write(f"data: {text}\n\n".encode() if newer > number else b": waiting\n\n")
                self.wfile.flush()
                number = newer
        except OSError:  # gone, or it has not read for SEND_S
            pass
        finally:
            self.server.view.readers.release()


def live_page(title: str) -> str:
    """Return the page that shows a running system."""
    body = (
        f'<main><header><span class="chip" id="state">...</span><h1></h1></header>{stage("live", LIVE_BAR)}'
        '<div id="charts" class="plots"></div><section><h2>Services</h2><table id="services"></table>'
        '<ul class="events" id="log"></ul></section></main>'
    )
    return page(title, body, ("scene.js", "charts.js", "replay.js", "live.js"), "startLive();")
