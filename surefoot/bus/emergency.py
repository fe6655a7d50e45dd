"""Small Zenoh client that requests an emergency stop until the driver confirms it.

The module imports neither numpy nor the schemas, so that a stop does not wait for their import.
"""
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false

import json
import time
from collections.abc import Sequence
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

from surefoot.bus.endpoint import any_port, is_secure, settings_file

STOP, STATUS = "cmd/estop", "sim/status"
FIRST_S, MOST_S = 0.005, 0.1
"""`FIRST_S`: wait before an unconfirmed stop is sent again, s, doubled each time; `MOST_S`: limit of that wait, s."""


class Confirmed(NamedTuple):
    """Confirmation of an emergency stop by the driver.

    Attributes:
        driver: service that controls the robot's joints or its simulation.
        stopped: reason of the stop in force.
        tick: control tick in which it was in force.
        after_s: wall time from the first request to the confirmation, s.
    """

    driver: str
    stopped: str
    tick: int
    after_s: float


class Stopper:
    """Connection to one robot that sends an emergency stop and waits for the driver's confirmation.

    Args:
        ways: endpoint of the robot's router, or the endpoints of all its services, including the driver.
        namespace: prefix of the robot's keys.

    Raises:
        zenoh.ZError: no endpoint answers.
        ConfigError: a secure endpoint, and no certificate of an operator.
    """

    def __init__(self, ways: Sequence[str], namespace: str) -> None:
        import zenoh

        secure, several = is_secure(ways), len(ways) > 1  # a client has one connection, a peer as many as it asks for
        settings: dict[str, Any] = {
            "mode": "peer" if several else "client",
            "connect/endpoints": list(ways),
            "connect/timeout_ms": 1000,
            "listen/endpoints": [any_port(secure)] if several else [],
            "scouting/multicast/enabled": False,
            "scouting/delay": 0,
        }
        config = zenoh.Config.from_file(str(settings_file(namespace, ""))) if secure else zenoh.Config()
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        self._heard: SimpleQueue[Any] = SimpleQueue()
        self._session = zenoh.open(config)
        put = self._heard.put
        self._listening = self._session.declare_subscriber(
            f"{namespace}/{STATUS}", lambda sample: put(sample.payload.to_bytes())
        )
        self._stopping = self._session.declare_publisher(
            f"{namespace}/{STOP}", encoding="application/json", priority=zenoh.Priority.REAL_TIME, express=True
        )

    def stop(self, reason: str, timeout_s: float) -> Confirmed | None:
        """Send a stop repeatedly until the driver confirms that it is in force; None: not within ``timeout_s``."""
        payload = json.dumps({"source": "operator", "reason": reason})
        began = time.monotonic()
        wait = FIRST_S
        while (left := began + timeout_s - time.monotonic()) > 0.0:
            self._stopping.put(payload)
            until = time.monotonic() + min(wait, left)
            while (status := self._next(until)) is not None:
                if status.get("stopped"):
                    spent = time.monotonic() - began
                    return Confirmed(str(status.get("source", "")), status["stopped"], int(status["tick"]), spent)
            wait = min(2.0 * wait, MOST_S)
        return None

    def _next(self, until: float) -> dict[str, Any] | None:
        """Return the next valid status of the driver; None if none comes before ``until``, monotonic time, s."""
        while True:
            try:
                found = json.loads(self._heard.get(timeout=max(0.0, until - time.monotonic())))
            except Empty:
                return None
            except ValueError:
                continue
            if isinstance(found, dict):
                return found

    def close(self) -> None:
        """Close the connection to the robot's network."""
        self._session.close()
