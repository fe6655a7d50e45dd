"""Check that a status which confirms an emergency stop comes from the driver and from no other process.

The module imports neither numpy nor the schemas, as it runs in `surefoot stop`.
"""

import json
from hmac import compare_digest
from typing import Any, NamedTuple, cast

from surefoot.bus.seals import DRIVER, born_ms, seal_of, without_seal

MOST_BYTES = 1 << 16
"""Largest status that is read, bytes."""
MOST_TOKENS = 4096
"""Largest number of liveliness tokens that are kept; where there are more, no unsealed status counts."""


class Stop(NamedTuple):
    """Emergency stop that is in force.

    Attributes:
        driver: service that drives the robot.
        stopped: reason of the stop.
        tick: control tick of the status.
    """

    driver: str
    stopped: str
    tick: int


class Witness:
    """Reader of the statuses of a robot that finds the one by which its driver confirms a stop.

    With a secret, only a status counts that was sealed after the stop began. An unsealed one counts while the driver is
    visible and its name is not sealed, as that of a driver which the supervisor did not start.

    Args:
        secret: secret of the system; empty = every status counts.
        began_ns: monotonic time from which on a status confirms the stop, ns.
    """

    def __init__(self, secret: str, began_ns: int) -> None:
        self._secret, self._began_ns = secret, began_ns
        self._shown, self._crowded = set[tuple[str, str]](), False

    def on_token(self, key: str, shown: bool) -> None:
        """Record that a liveliness token appeared or vanished; its key is ``alive/<service>/<process>``."""
        _, service, process = key.rsplit("/", 2)
        if not shown:
            self._shown.discard((service, process))
        elif len(self._shown) < MOST_TOKENS:
            self._shown.add((service, process))
        else:
            self._crowded = True

    def status(self, key: str, payload: bytes, attachment: bytes | None) -> Stop | None:
        """Return the stop that a status confirms; None if it confirms none, or is not the driver's.

        Args:
            key: key of the status in the robot's namespace.
            payload: its content.
            attachment: raw bytes that came with it; None = none.
        """
        found = _stop_in(payload)
        return found if found is not None and self._counts(key, payload, attachment) else None

    def _counts(self, key: str, payload: bytes, attachment: bytes | None) -> bool:
        if not self._secret:
            return True
        head, number, seal = without_seal(attachment)
        if int(number or b"0") > self._began_ns:
            name = key.encode() + b" " + number
            if compare_digest(seal, seal_of(self._secret, name, head or b"", payload)):
                return True
        drivers = {process for service, process in self._shown if service == DRIVER}
        sealed = any(born_ms(self._secret, service, process) for service, process in self._shown if process in drivers)
        return bool(drivers) and not sealed and not self._crowded


def _stop_in(payload: bytes) -> Stop | None:
    """Return the stop in a status; None if it has none, or if it has another form."""
    if len(payload) > MOST_BYTES:
        return None
    try:
        found: Any = json.loads(payload)
    except (ValueError, RecursionError):
        return None
    if not isinstance(found, dict):
        return None
    fields = cast("dict[str, Any]", found)
    driver, stopped, tick = fields.get("source"), fields.get("stopped"), fields.get("tick")
    if not (isinstance(driver, str) and isinstance(stopped, str) and type(tick) is int):
        return None
    return Stop(driver or DRIVER, stopped, tick) if stopped else None
