"""HTTP server of the view, which listens on 127.0.0.1 only.

A page of another site can reach a local port as well. Every request must therefore name this machine in `Host`, which
prevents DNS rebinding, and carry the token that was shown to the user who started the view.
"""

import json
import secrets
import socket
from collections.abc import Callable
from contextlib import suppress
from errno import EADDRINUSE
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import BoundedSemaphore, Thread
from typing import Any
from urllib.parse import parse_qs, urlsplit

from pydantic import TypeAdapter, ValidationError

from surefoot.errors import BusError, SurefootError

from ..scene.pages import LAYOUT, asset
from .live import LiveFrames

HOST = "127.0.0.1"
PORT = 7480
READERS = 8
"""Largest number of pages that receive frames at the same time; further ones are refused."""
SEND_S = 5.0
"""Wall time without reading after which the connection of a page is closed, s."""
END_S = 0.1
"""Longest wall time from `close` until the server's loop ends, s."""
IDLE_S = 1.0
"""Wall time without new data after which a page gets a keep-alive message, s."""
BODY_BYTES = 4096
FIELDS = TypeAdapter(dict[str, Any])


class ViewServer:
    """HTTP server of the live view's page, until it is closed.

    Attributes:
        port: TCP port on 127.0.0.1.
        token: random text that every request must carry.
    """

    def __init__(
        self,
        page_text: str,
        live: LiveFrames | None = None,
        port: int | None = None,
        warn: Callable[[str], None] = lambda text: None,
    ) -> None:
        """Start the HTTP server in a thread.

        Args:
            page_text: HTML of the page.
            live: frames of a running system; None = only the page is served.
            port: TCP port, 0 = any; None = `PORT`, or any if that is taken.
            warn: called with a sentence if the connection of a page was closed because it does not read.

        Raises:
            BusError: `port` is taken.
        """
        self.page, self.live, self.warn, self.token = page_text.encode(), live, warn, secrets.token_urlsafe(16)
        self.readers = BoundedSemaphore(READERS)
        self._http = self._listen(PORT, 0) if port is None else self._listen(port)
        self.port = int(self._http.server_address[1])
        self._thread = Thread(target=self._http.serve_forever, args=(END_S,), name="http", daemon=True)
        self._thread.start()

    def _listen(self, port: int, *others: int) -> "_Http":
        """Listen on a TCP port, or, if it is taken, on the first free one of `others` (raises BusError: none free)."""
        try:
            return _Http((HOST, port), self)
        except OSError as error:
            if error.errno == EADDRINUSE and others:
                return self._listen(*others)
            raise unusable(port, error) from None

    @property
    def url(self) -> str:
        """URL of the page, with the token."""
        return f"http://{HOST}:{self.port}/?token={self.token}"

    def close(self) -> None:
        """Stop the server and the frames; open connections end."""
        if self.live is not None:
            self.live.close()
        self._http.shutdown()
        self._http.server_close()


def unusable(port: int, error: OSError) -> BusError:
    """Return the error that states why a TCP port of this machine cannot be listened on."""
    taken = f"port {port} of {HOST} is taken; choose another with --port, 0 = any"
    return BusError("busy", taken if error.errno == EADDRINUSE else f"port {port}: {error.strerror}")


def hosts(port: int) -> set[str]:
    """Return the values of `Host` of requests that name this machine; others come by DNS rebinding."""
    return {f"{name}:{port}" for name in (HOST, "localhost")}


def carries(path: str, token: str) -> bool:
    """Return True if the path of a request carries this token, else False."""
    given = parse_qs(urlsplit(path).query).get("token", [""])[0]
    return secrets.compare_digest(given.encode(), token.encode())


class QuietServer(ThreadingHTTPServer):
    """HTTP server with a thread for each client, which may end at any time."""

    daemon_threads = True
    allow_reuse_address = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore the errors of connections that a client has closed."""


class QuietHandler(BaseHTTPRequestHandler):
    """Handler of the requests of one client, which logs none of them."""

    protocol_version = "HTTP/1.1"
    timeout = SEND_S

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing, since the URL of a request contains the token."""


class _Http(QuietServer):
    def __init__(self, address: tuple[str, int], view: ViewServer) -> None:
        self.view = view
        super().__init__(address, _Handler)


class _Handler(QuietHandler):
    server: _Http  # pyright: ignore[reportIncompatibleVariableOverride] - it has no other

    def do_GET(self) -> None:
        """Answer a GET request: the HTML page, the constant parts of all frames, or the stream of frames."""
        view, path = self.server.view, urlsplit(self.path).path
        if not self._allowed():
            return
        if path == "/":
            self._answer(view.page, "text/html; charset=utf-8")
        elif path == f"/{LAYOUT}":
            self._answer(asset(LAYOUT).encode(), "application/json")
        elif path == "/head" and view.live is not None:
            self._json(view.live.head())
        elif path == "/events" and view.live is not None:
            self._stream(view.live)
        else:
            self._refuse(HTTPStatus.NOT_FOUND, f"there are /, /head, /events, /{LAYOUT} and, by POST, /do")

    def do_POST(self) -> None:
        """Answer a POST request: execute the action of a button on the page."""
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
        """Return True if a request names this host, has no foreign origin and has the token; else refuse it."""
        view = self.server.view
        names, origin = hosts(view.port), self.headers.get("Origin")
        if self.headers.get("Host") not in names or (origin and origin.removeprefix("http://") not in names):
            self._refuse(HTTPStatus.FORBIDDEN, "this view answers to 127.0.0.1 only")
        elif not carries(self.path, view.token):
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
        """Send frames as server-sent events; a page that reads slowly misses frames, but no footprints or landmarks."""
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
            reader = live.reader()
            while not live.closed:
                text = reader.next(IDLE_S)
                self.wfile.write(b": waiting\n\n" if text is None else f"data: {text}\n\n".encode())
                self.wfile.flush()
        except TimeoutError:
            self.server.view.warn(f"a page has not read for {SEND_S:g} s and was given up; it may be opened again")
        except OSError:
            pass  # it was closed
        finally:
            self.server.view.readers.release()
