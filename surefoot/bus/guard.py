"""Check of the seals of messages to participants that do not travel in frames, such as maps and reports of ticks."""

import secrets
from typing import Any, NamedTuple, cast

from pydantic_core import from_json

from surefoot.bus.codec import MAX_JSON_BYTES
from surefoot.bus.seal_times import SealTimes
from surefoot.bus.seals import BORN, DRAWN, DRIVER, MOST_KNOWN, SEAL, born_ms, seal_of
from surefoot.bus.unread import MOST_NAMED, LinkTrouble

MOST_SHOWN, OTHERS = 80, "other keys"
"""`MOST_SHOWN`: characters to which the keys of refused messages are cut in a report; `OTHERS`: name under which keys
beyond the first `MOST_NAMED` are counted."""


class Sealed(NamedTuple):
    """Message to participants as it came: key, payload, attachment, seal and its time (ns of monotonic time)."""

    key: str
    payload: bytes
    attachment: bytes | None
    number: bytes
    seal: bytes


class Guard:
    """Check of the seals of messages to participants that do not travel in frames, such as maps and reports of ticks.

    The messages of a service must be sealed once a process with a sealed name has shown its token.

    Args:
        secret: secret of the system; empty = every message passes.
    """

    def __init__(self, secret: str) -> None:
        self._secret = secret
        self._names, self._services = set[str](), set[str]()
        self._drivers: dict[str, None] = {}
        self._crowded = False
        self._windows: dict[str, SealTimes] = {}
        """Times of the newest sealed messages of each key."""
        self._forged: dict[str, int] = {}
        self._late: dict[str, int] = {}

    def on_token(self, service: str, instance: str) -> None:
        """Record a token: messages of a service whose process has a sealed name must be sealed from now on.

        The process of the driver shows two tokens under one name: `driver`, and its own service, whose seal it carries.
        """
        if born_ms(self._secret, service, instance):
            self._names.add(instance)
            self._services.add(service)
        elif service == DRIVER and len(instance) == DRAWN + BORN + SEAL and instance[:1] == "f":
            self._drivers[instance] = None
            if len(self._drivers) > MOST_KNOWN:  # no system has as many: somebody hides the driver among them
                self._drivers.pop(next(iter(self._drivers)), None)
                self._crowded = True
        if not self._names.isdisjoint(self._drivers) or (self._crowded and self._names):
            self._services.add(DRIVER)

    def passes(self, owner: str, message: Sealed) -> bool:
        """Return whether a message of a service may be read; unsealed and repeated messages are refused and counted.

        A message that arrives after a later one of its key is counted as late and not read either, as reports of
        ticks, heartbeats and maps hold only until the next.
        """
        if owner not in self._services:
            return True
        key, number = message.key, int(message.number or b"0")
        name = f"{key} {number}".encode()
        seal = seal_of(self._secret, name, message.attachment or b"", message.payload)
        if not secrets.compare_digest(message.seal, seal):
            return self._refuse(key)
        window = self._windows.setdefault(key, SealTimes())
        code = window.fault(number)
        if code == "replayed":
            return self._refuse(key)
        window.add(number)
        if code:
            _count(self._late, key)
        return not code

    def owns(self, key: str, owner: str, payload: bytes) -> bool:
        """Return whether a message came on the key of the service that it names as its source; True if it names none.

        The last word of a key such as ``@tick/walker`` is that service.
        """
        try:
            named: Any = from_json(payload) if 0 < len(payload) <= MAX_JSON_BYTES else {}
        except ValueError:
            return True  # refused where it is decoded, as one that is too large
        table = cast("dict[str, Any]", named) if isinstance(named, dict) else {}
        sources = [table.get(name, owner) for name in ("source", "service")]
        return all(source in ("", owner) for source in sources) or self._refuse(key.rpartition("/")[0] + "/*")

    def _refuse(self, key: str) -> bool:
        _count(self._forged, key)
        return False

    def forged(self) -> list[tuple[str, int]]:
        """Return key and number of the messages that were refused since the last call."""
        found, self._forged = list(self._forged.items()), {}
        return found

    def late(self) -> list[tuple[str, int]]:
        """Return key and number of the messages that came late, after later ones, since the last call."""
        found, self._late = list(self._late.items()), {}
        return found

    def troubles(self) -> list[LinkTrouble]:
        """Return what was refused or late since the last call, as reports for health and log."""
        forged = [LinkTrouble("forged", f"{n}x {key} without the seal of its service", key) for key, n in self.forged()]
        return [*forged, *(LinkTrouble("late", f"{n}x {key} after later ones", key, n) for key, n in self.late())]


def _count(counts: dict[str, int], key: str) -> None:
    """Count a message under its key, cut to `MOST_SHOWN`, or from `MOST_NAMED` keys on under `OTHERS`."""
    key = key[:MOST_SHOWN]
    if key not in counts and len(counts) >= MOST_NAMED:
        key = OTHERS
    counts[key] = counts.get(key, 0) + 1
