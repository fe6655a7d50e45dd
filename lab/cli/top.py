"""Data of `surefoot topic top`: rate, size and latency of topics, and the support polygon as text."""

import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from surefoot.schemas.topics import STATE_STABILITY, TOPICS

if TYPE_CHECKING:
    from surefoot.bus.interface import Delivery
    from surefoot.client import Client
    from surefoot.lockstep.graph import Edge
    from surefoot.schemas.stability import StabilityStatus

KEPT = 4096
"""Largest number of messages per topic kept for statistics; the oldest are dropped."""
TICKS = 512
"""Number of latest control ticks for which the arrival time of the first message is kept."""
COLUMNS, LINES = 41, 13
"""Size of the support polygon picture, characters: `COLUMNS` across, `LINES` down."""
LEAST_M = 0.05
"""Smallest half extent of the area shown by the text picture of the support polygon, along x and y, m."""


class TopicTraffic(NamedTuple):
    """Message rate, size and latency of a topic over the window of wall time that was asked for."""

    key: str
    hz: float
    """Message rate of the topic in wall time, Hz."""
    kb_per_s: float
    bytes: float
    """Mean size of a message of the topic with its attachment, bytes."""
    p50_ms: float
    """Median time from the arrival of a tick's first message on any topic to that of this topic's message, ms."""
    p99_ms: float
    hop_p50_ms: float
    """Median time from the arrival of the last input that the topic's publisher has of the same tick to that of this
    topic's message, ms: both transports and the computation between; without such an input that since the tick's first
    message. Messages carry no time of sending, so that they are equal in every run."""
    hop_p99_ms: float


class Traffic:
    """Arrival times and sizes of recent messages, by topic; `note` may be called from any thread.

    Args:
        clock: returns the wall time, s.
        inputs: keys of the topics that the publisher of a topic reads in the same tick, by key of the topic.
    """

    def __init__(
        self, clock: Callable[[], float] = time.monotonic, inputs: Mapping[str, Iterable[str]] | None = None
    ) -> None:
        self._clock, self._lock, self._inputs = clock, threading.Lock(), inputs or {}
        self._began = clock()
        self._arrivals: dict[str, deque[tuple[float, int, float, float]]] = defaultdict(lambda: deque(maxlen=KEPT))
        self._ticks: dict[tuple[int, int], dict[str, float]] = {}  # arrival by key
        self.stability: StabilityStatus | None = None

    def note(self, delivery: "Delivery") -> None:
        """Record the size of a message and its delay after the first message of its tick."""
        if delivery.prime:
            return
        now, header, raw = self._clock(), delivery.header(), delivery.raw()
        place = header.epoch, header.tick
        with self._lock:
            came = self._ticks.setdefault(place, {})
            began = min(came.values(), default=now)
            last = max((came[key] for key in self._inputs.get(delivery.key, ()) if key in came), default=began)
            came[delivery.key] = now
            while len(self._ticks) > TICKS:
                del self._ticks[next(iter(self._ticks))]
            size = len(raw.payload) + len(raw.attachment or b"")
            self._arrivals[delivery.key].append((now, size, now - began, now - last))
            if delivery.key == STATE_STABILITY.key:
                self.stability = delivery.message()  # pyright: ignore[reportAttributeAccessIssue]

    def rows(self, window_s: float) -> list[TopicTraffic]:
        """Return the traffic of topics over the last `window_s` s of wall time, largest data rate first."""
        now = self._clock()
        span = max(1e-3, min(window_s, now - self._began))
        with self._lock:
            recent = {key: [each for each in kept if now - each[0] <= span] for key, kept in self._arrivals.items()}
        found: list[TopicTraffic] = []
        for key, kept in recent.items():
            if kept:
                size, times = sum(each[1] for each in kept), [sorted(each[n] for each in kept) for n in (2, 3)]
                shares = (_share(ordered, share) for ordered in times for share in (0.5, 0.99))
                found.append(TopicTraffic(key, len(kept) / span, size / span / 1e3, size / len(kept), *shares))
        return sorted(found, key=lambda row: (-row.kb_per_s, row.key))


def _share(ordered: Sequence[float], share: float) -> float:
    return round(1e3 * ordered[min(len(ordered) - 1, int(len(ordered) * share))], 3)


def inputs_of(edges: "Iterable[Edge]") -> dict[str, set[str]]:
    """Return the keys of the topics that the publisher of each topic reads in the same tick, by key of the topic.

    `edges`: edges of the graph of services, as `surefoot graph` prints them.
    """
    read: dict[str, set[str]] = defaultdict(set)
    for edge in edges:
        if edge.kind == "topic" and not edge.delayed:
            read[edge.target].add(edge.key)
    return {topic.key: read[topic.owner] for topic in TOPICS if topic.owner in read}


def watch(robot: "Client", traffic: Traffic) -> None:
    """Subscribe to the topics of a robot, except key families (`*`), and count their messages in `traffic`."""
    for topic in TOPICS:
        if not topic.key.endswith("*"):
            robot.bus.subscribe(topic, traffic.note, bounded=True)


def polygon_lines(status: "StabilityStatus | None") -> list[str]:
    """Return a text picture of the support region from above (x up, y left) and the CoM (o planned, x measured)."""
    if status is None or not status.region:
        return ["no support region" + (f": {status.status}" if status is not None else " yet")]
    points = [tuple(corner) for corner in status.region]
    places = {"o": status.com_planned, "x": status.com_measured}
    known = [*points, *(place for place in places.values() if place is not None)]
    half_x = max(LEAST_M, 1.1 * max(abs(x) for x, _ in known))
    half_y = max(LEAST_M, 1.1 * max(abs(y) for _, y in known))
    grid = [
        ["." if _inside(points, *_place(row, column, half_x, half_y)) else " " for column in range(COLUMNS)]
        for row in range(LINES)
    ]
    for letter, place in places.items():
        if place is not None:
            row = round((1.0 - place[0] / half_x) * (LINES - 1) / 2)
            grid[row][round((1.0 - place[1] / half_y) * (COLUMNS - 1) / 2)] = letter
    margins = {"planned": status.margin_planned, "measured": status.margin_measured}
    words = ", ".join(f"{name} {1e3 * margin:.1f} mm" for name, margin in margins.items() if margin is not None)
    return ["".join(row).rstrip() for row in grid] + [f"margin {words or 'unknown'}; {2 * half_y:.2f} m wide"]


def _place(row: int, column: int, half_x: float, half_y: float) -> tuple[float, float]:
    """Return the point (x, y), m, at a row and column of a picture of half extents `half_x`, `half_y`, m."""
    return half_x * (1.0 - 2.0 * row / (LINES - 1)), half_y * (1.0 - 2.0 * column / (COLUMNS - 1))


def _inside(corners: Sequence[Any], x: float, y: float) -> bool:
    """Return True if (x, y) lies in a convex polygon with counter-clockwise corners, else False."""
    following = [*corners[1:], corners[0]]
    return all(
        (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0.0
        for (ax, ay), (bx, by) in zip(corners, following, strict=True)
    )
