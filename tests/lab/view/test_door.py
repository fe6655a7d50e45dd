"""The port before the bridge lets in whoever names this host and has the token, and carries bytes both ways."""

import http.client
import socket
import threading
from collections.abc import Iterator

import pytest

from surefoot.errors import BusError
from surefoot.lab.view.door import Door
from surefoot.lab.view.server import HOST

WAIT_S = 5.0


@pytest.fixture
def door() -> Iterator[Door]:
    """A door before a server that answers its first request with 204 and then sends back what it gets."""
    with socket.create_server((HOST, 0)) as behind:

        def serve() -> None:
            while True:
                try:
                    inside, _ = behind.accept()
                except OSError:
                    return
                with inside:
                    head = b""
                    while b"\r\n\r\n" not in head:
                        head += inside.recv(4096)
                    inside.sendall(b"HTTP/1.1 204 No Content\r\n\r\n")
                    while data := inside.recv(4096):
                        inside.sendall(data)

        threading.Thread(target=serve, daemon=True).start()
        made = Door(0, behind.getsockname()[:2])
        yield made
        made.close()


def ask(door: Door, token: str, **headers: str) -> http.client.HTTPConnection:
    connection = http.client.HTTPConnection(HOST, door.port, timeout=WAIT_S)
    connection.request("GET", f"/?token={token}" if token else "/", headers=headers)
    return connection


def test_a_client_with_the_token_reaches_the_server_behind(door: Door) -> None:
    connection = ask(door, door.token)
    assert connection.sock is not None
    found = connection.sock.recv(4096)
    assert found.startswith(b"HTTP/1.1 204")
    connection.sock.sendall(b"frame")
    assert connection.sock.recv(5) == b"frame"
    connection.close()


@pytest.mark.parametrize(
    ("right", "headers"),
    [(False, {}), (True, {"Host": "evil.example"}), (True, {"Host": HOST}), (False, {"Host": "localhost:1"})],
)
def test_a_foreign_host_or_a_wrong_token_is_refused(door: Door, right: bool, headers: dict[str, str]) -> None:
    for token in [door.token] if right else ["", "wrong", door.token[:-1]]:
        connection = ask(door, token, **headers)
        reply = connection.getresponse()
        assert reply.status == 403
        assert door.token not in reply.read().decode()
        connection.close()


def test_a_taken_port_is_named(door: Door) -> None:
    with pytest.raises(BusError, match=str(door.port)) as refused:
        Door(door.port, (HOST, 1))
    assert refused.value.code == "busy"
