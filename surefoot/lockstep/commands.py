"""Joint commands received by the driver: check of their age, and choice of the command for a tick."""

from collections.abc import Callable

from surefoot.errors import Refusal
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.topics import TICK_NS

STALE_TICKS = 10
"""Age of a joint command, control ticks of 10 ms, above which the driver refuses it as stale."""
KEEP_TICKS = 80
"""Number of newest ticks whose joint commands are remembered, so that a repeated command is recognised."""


class Commands:
    """Joint commands of one run by their tick, as received and accepted by a driver."""

    def __init__(self) -> None:
        self._by_tick: dict[int, JointCommand | None] = {}
        self._obeyed = -1
        self._offered = False
        self._accepted_at = -1
        self._sender = ""

    def known(self, tick: int) -> bool:
        """Return whether a joint command of a tick was accepted."""
        return self._by_tick.get(tick) is not None

    def answered(self, tick: int) -> bool:
        """Return whether a joint command of a tick was received, accepted or refused."""
        return tick in self._by_tick

    def offer(self, command: JointCommand, tick: int, check: Callable[[JointCommand], None], sender: str = "") -> None:
        """Accept a command while the driver is at ``tick``; ignore it if a command of the same tick was accepted.

        Raises:
            Refusal: conflict (the same process, ``sender``, commanded something else in that tick), stale (older than
                100 ms, or of a later tick), stamp (the stamp does not fit the tick), or the error of ``check``.
        """
        if self.known(command.tick):
            if sender == self._sender and self._by_tick[command.tick] != command:
                text = f"a second command of tick {command.tick} by process {sender!r}, with other content"
                raise Refusal("conflict", text)
            return
        self._offered = True
        while len(self._by_tick) >= KEEP_TICKS:  # by number: a tick without a command takes no earlier one with it
            del self._by_tick[next(iter(self._by_tick))]
        if command.tick > tick or command.tick < tick - STALE_TICKS:
            raise Refusal("stale", f"command of tick {command.tick} at tick {tick}", "tick")
        if not (command.tick - STALE_TICKS) * TICK_NS <= command.stamp_ns <= (command.tick + 1) * TICK_NS:
            self._by_tick.setdefault(command.tick)
            text = f"command of tick {command.tick} has stamp {command.stamp_ns} ns, expected {command.tick * TICK_NS}"
            raise Refusal("stamp", text, "stamp_ns")
        self._by_tick[command.tick] = None
        check(command)
        self._by_tick[command.tick] = command
        self._accepted_at, self._sender = tick, sender

    def take(self, wanted: int, *, exact: bool) -> JointCommand | None:
        """Return the command of tick ``wanted``; None if there is none.

        Unless ``exact``, the newest command up to that tick that is later than the last one taken and not stale.
        """
        oldest = wanted if exact else max(self._obeyed, wanted - STALE_TICKS) + 1
        for tick in range(wanted, oldest - 1, -1):
            command = self._by_tick.get(tick)
            if command is not None:
                self._obeyed = tick
                return command
        return None

    def lost(self, tick: int) -> bool:
        """Return whether commands came earlier, but none was accepted in the 100 ms before ``tick``."""
        return self._offered and self._accepted_at < tick - STALE_TICKS
