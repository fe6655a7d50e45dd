"""Early detection of an endpoint at which nothing listens: Zenoh tries for 8 s, even if each try is refused."""

import socket
import time
from typing import Any

REFUSED_S = 1.5
"""Time for which an endpoint must refuse all connections until nothing is taken to listen there, s."""
PAUSE_S = 0.1  # between two connections


def nothing_listens(endpoint: str, patience_s: float = REFUSED_S) -> bool:
    """Return True if a TCP or TLS endpoint refuses every connection for `patience_s`; False once one is not refused.

    False also for other kinds of endpoints, and if no answer comes, as from a host that is switched off or starting.

    Args:
        endpoint: Zenoh endpoint, e.g. ``tcp/127.0.0.1:7447``.
        patience_s: time for which all connections must be refused, s.
    """
    kind, _, place = endpoint.partition("/")
    host, _, port = place.rpartition(":")
    if kind not in ("tcp", "tls") or not port.isdigit():
        return False
    address: Any = host.strip("[]").encode()  # bytes: no codec for international names is imported
    end = time.monotonic() + patience_s
    while True:
        try:
            socket.create_connection((address, int(port)), timeout=patience_s).close()
            return False
        except ConnectionRefusedError:
            if time.monotonic() + PAUSE_S > end:
                return True
        except OSError:
            return False
        time.sleep(PAUSE_S)
