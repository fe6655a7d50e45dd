"""Door of the live bridge: a port on 127.0.0.1 that lets clients with the token through to the server behind it.

The server of Foxglove's library asks its clients for nothing, and a page of any site may open a WebSocket to a port of
this machine. That server therefore listens at a loopback address drawn at random, which no page can search for, and
clients come through this door. Their origin does not matter: Foxglove in a browser has that of its maker.
"""

import secrets
import socket
from contextlib import suppress
from http import HTTPStatus
from threading import Thread

from .server import END_S, HOST, SEND_S, QuietHandler, QuietServer, carries, hosts, unusable

CHUNK = 1 << 16


def hidden_address() -> str:
    """Return a loopback address other than 127.0.0.1, one of 16 million, drawn at random."""
    return ".".join(["127", *(str(1 + secrets.randbelow(254)) for _ in range(3))])


class Door:
    """TCP port on 127.0.0.1 through which WebSocket clients that carry a token reach another server.

    Attributes:
        port: the port.
        token: random text that the first request of a client must carry as `?token=`.
    """

    def __init__(self, port: int, behind: tuple[str, int]) -> None:
        """Listen on `port` (0 = any) for clients of the server at address and port `behind`.

        Raises:
            BusError: the port is taken.
        """
        self.token = secrets.token_urlsafe(16)
        try:
            self._http = _DoorServer((HOST, port), self.token, behind)
        except OSError as error:
            raise unusable(port, error) from None
        self.port = int(self._http.server_address[1])
        Thread(target=self._http.serve_forever, args=(END_S,), name="door", daemon=True).start()

    def close(self) -> None:
        """Let no further clients in; those that are inside stay until the server behind ends them."""
        self._http.shutdown()
        self._http.server_close()


class _DoorServer(QuietServer):
    def __init__(self, address: tuple[str, int], token: str, behind: tuple[str, int]) -> None:
        self.token, self.behind = token, behind
        super().__init__(address, _Doorkeeper)


class _Doorkeeper(QuietHandler):
    server: _DoorServer  # pyright: ignore[reportIncompatibleVariableOverride] - it has no other

    def do_GET(self) -> None:
        """Connect a client to the server behind the door, or refuse it, and carry bytes both ways until one ends."""
        self.close_connection = True
        door = self.server
        if self.headers.get("Host") not in hosts(int(door.server_address[1])):
            self.send_error(HTTPStatus.FORBIDDEN, "this bridge answers to 127.0.0.1 only")
            return
        if not carries(self.path, door.token):
            self.send_error(HTTPStatus.FORBIDDEN, "the token is missing or wrong: take the address that was printed")
            return
        with suppress(OSError), socket.create_connection(door.behind, SEND_S) as inside:
            inside.settimeout(None)
            self.connection.settimeout(None)
            head = "".join(f"{name}: {value}\r\n" for name, value in self.headers.items())
            inside.sendall(f"GET / HTTP/1.1\r\n{head}\r\n".encode("latin-1"))
            back = Thread(target=_carry, args=(inside, self.connection), name="door", daemon=True)
            back.start()
            while data := self.rfile.read1(CHUNK):  # pyright: ignore[reportAttributeAccessIssue] - it is buffered
                inside.sendall(data)
            inside.shutdown(socket.SHUT_RDWR)
            back.join(SEND_S)


def _carry(source: socket.socket, target: socket.socket) -> None:
    """Send all that comes from one connection to another, and end the other with it."""
    with suppress(OSError):
        while data := source.recv(CHUNK):
            target.sendall(data)
    with suppress(OSError):
        target.shutdown(socket.SHUT_RDWR)
