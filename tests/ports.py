"""A port of its own for every test that needs a router."""

import socket


def free_port() -> int:
    """Return a port on which no process listens."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def free_address() -> str:
    """Return an endpoint on which no process listens."""
    return f"tcp/127.0.0.1:{free_port()}"
