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
        secret: secret of the system, by which the driver's status is known from one of another process; empty = none.

    Raises:
        zenoh.ZError: no endpoint answers.
        ConfigError: a secure endpoint, and no certificate of an operator.
    """

    def __init__(self, ways: Sequence[str], namespace: str, secret: str = "") -> None:
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
        self._secret = "" if secure else secret  # there a status passes from the driver only
        self._heard: SimpleQueue[Any] = SimpleQueue()
        self._session = zenoh.open(config)
        put, place = self._heard.put, len(namespace) + 1
        self._listening: list[Any] = []

        def on_status(sample: Any) -> None:
            sealed = sample.attachment
            attachment = None if sealed is None else sealed.to_bytes()
            put((str(sample.key_expr)[place:], sample.payload.to_bytes(), attachment))

        def on_token(sample: Any) -> None:
            put((str(sample.key_expr)[place:], sample.kind == zenoh.SampleKind.PUT))

        for key in (STATUS, f"@{STATUS}") if self._secret else (STATUS,):
            self._listening.append(self._session.declare_subscriber(f"{namespace}/{key}", on_status))
        if self._secret:
            tokens, alive = f"{namespace}/alive/*/*", self._session.liveliness()
            self._listening.append(alive.declare_subscriber(tokens, on_token, history=True))
        self._stopping = self._session.declare_publisher(
            f"{namespace}/{STOP}", encoding="application/json", priority=zenoh.Priority.REAL_TIME, express=True
        )

    def stop(self, reason: str, timeout_s: float) -> Confirmed | None:
        """Send a stop repeatedly until the driver confirms that it is in force; None: not within ``timeout_s``."""
        payload = json.dumps({"source": "operator", "reason": reason})
        began, began_ns = time.monotonic(), time.monotonic_ns()
        self._stopping.put(payload)
        from surefoot.bus.witness import Witness  # here: the first message does not wait for its imports

        witness = Witness(self._secret, began_ns)
        wait = FIRST_S
        while (left := began + timeout_s - time.monotonic()) > 0.0:
            until = time.monotonic() + min(wait, left)
            while (found := self._next(until)) is not None:
                if len(found) == 2:
                    witness.on_token(*found)
                elif (status := witness.status(*found)) is not None:
                    return Confirmed(*status, time.monotonic() - began)
            self._stopping.put(payload)
            wait = min(2.0 * wait, MOST_S)
        return None

    def _next(self, until: float) -> tuple[Any, ...] | None:
        """Return the next status or token that came; None if none comes before ``until``, monotonic time, s."""
        try:
            return self._heard.get(timeout=max(0.0, until - time.monotonic()))
        except Empty:
            return None

    def close(self) -> None:
        """Close the connection to the robot's network."""
        self._session.close()
