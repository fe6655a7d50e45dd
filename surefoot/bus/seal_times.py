"""Newest seal times of a sender, by which late messages are distinguished from repeated ones.

As the anti-replay window of IPsec (RFC 4303, 3.4.3), for times instead of sequence numbers: these have gaps, so the
window holds the times themselves and not a bit for each number.
"""

from bisect import bisect_left, insort

LATE_MESSAGES, LATE_NS = 64, 1_000_000_000
"""`LATE_MESSAGES`: number of newest messages among which a late one is recognised; `LATE_NS`: largest lead of the
newest message over a late one, ns. An older message may have been recorded, and counts as repeated."""


class SealTimes:
    """Seal times of the newest messages of one key and process, ns of monotonic time."""

    __slots__ = ("_seen", "newest")

    def __init__(self) -> None:
        self.newest = 0
        """Largest time that was added, ns; 0 = none."""
        self._seen: list[int] = []  # in ascending order; twice as many as the window at most

    def fault(self, time_ns: int) -> str:
        """Return `late` for a new time within the window, `replayed` for one that is known or older, "" if newest."""
        if time_ns > self.newest:
            return ""
        seen = self._seen[-LATE_MESSAGES:]
        if not seen or time_ns < max(seen[0], self.newest - LATE_NS):
            return "replayed"
        return "replayed" if seen[bisect_left(seen, time_ns)] == time_ns else "late"

    def add(self, time_ns: int) -> None:
        """Record the time of a message that is the newest or late, ns."""
        if time_ns > self.newest:
            self.newest = time_ns
            self._seen.append(time_ns)
        else:
            insort(self._seen, time_ns)
        if len(self._seen) > 2 * LATE_MESSAGES:
            del self._seen[:LATE_MESSAGES]
