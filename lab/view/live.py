"""Frames of a running system: the latest messages as the page draws them, 30 times a second while somebody looks."""

import json
import threading
import time
from collections import deque
from contextlib import suppress
from typing import Any

from surefoot.bus.emergency import Stopper
from surefoot.bus.interface import Delivery
from surefoot.client import Client
from surefoot.errors import CallError, SurefootError
from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot
from surefoot.schemas.topics import HEALTH, LOG, SIM_STATUS, TOPICS
from surefoot.services.supervisor.processes.status import health_row, time_row

from ..scene.film import frame, header, mark
from ..scene.scene import KEYS, RobotScene

FRAME_S = 1.0 / 30.0
STATUS_S, STALE_S = 0.5, 3.0
"""Wall time between two reports on health, and after which a service that is silent is left out."""
LOG_LINES = 8
STOP_S = 2.0
"""Wall time that the driver gets to confirm a stop."""
QUERIES = {
    "pause": "sim/pause", "resume": "sim/step", "step": "sim/step", "speed": "sim/speed", "push": "sim/push",
    "fault": "sim/fault",
}  # fmt: skip
"""Queries behind the buttons of the page; `stop` is the emergency stop."""


def robot_behind(client: Client, name: str | None = None) -> Robot:
    """Return the robot of a running system: the one named, else its driver's, else that of the keys' prefix.

    Raises:
        RobotError: it is not known here.
    """
    if name is None:
        try:
            name = client.call("hw/description", 2.0).robot
        except CallError:
            name = client.bus.endpoint.namespace.rpartition("/")[2]
    return load_robot(name or "")


class LiveFrames:
    """Collects messages and makes frames of them on a thread of its own, which rests while no page waits."""

    def __init__(self, client: Client, robot: Robot) -> None:
        self.client, self.scene = client, RobotScene(robot)
        self._lock, self._news = threading.Lock(), threading.Condition()
        self._arrived = 0.0
        self._health: dict[str, tuple[float, Delivery]] = {}
        self._status: Delivery | None = None
        self._log: deque[str] = deque(maxlen=LOG_LINES)
        self._text, self._number, self._readers = "", 0, 0
        self._marks, self._epoch, self._told_s = 0, -1, 0.0
        self._closed = threading.Event()
        for topic in TOPICS:
            if topic.key in KEYS:
                client.bus.subscribe(topic, self._take)
        for topic, sink in ((HEALTH, self._take_health), (SIM_STATUS, self._take_status), (LOG, self._take_log)):
            client.bus.subscribe(topic, sink)
        for key in ("terrain/map", "terrain/landmarks"):
            with suppress(SurefootError):  # a driver without a map
                reply = client.call(key, 2.0)
                self.scene.feed(key, lambda reply=reply: reply)
        self._thread = threading.Thread(target=self._run, name="view", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread; readers get no more frames."""
        self._closed.set()
        with self._news:
            self._news.notify_all()
        self._thread.join(timeout=2.0)

    @property
    def closed(self) -> bool:
        """There will be no more frames."""
        return self._closed.is_set()

    def _take(self, delivery: Delivery) -> None:
        if not delivery.prime:
            with self._lock:
                self._arrived = time.monotonic()
                self.scene.feed(delivery.key, delivery.message)

    def _take_health(self, delivery: Delivery) -> None:
        if not delivery.prime:
            with suppress(SurefootError):
                self._health[delivery.header().source] = time.monotonic(), delivery

    def _take_status(self, delivery: Delivery) -> None:
        self._status = delivery

    def _take_log(self, delivery: Delivery) -> None:
        with suppress(SurefootError):
            line: Any = delivery.message()
            self._log.append(f"{line.source} {line.level}: {line.text}")

    def head(self) -> dict[str, Any]:
        """Return what holds for all frames, and the marks so far."""
        with self._lock:
            self.scene.snapshot()
            return {"head": header(self.scene), "marks": [mark(each) for each in self.scene.marks]}

    def next_after(self, number: int, timeout_s: float) -> tuple[int, str]:
        """Return the number and JSON of a frame newer than `number`; the same number when none comes in time."""
        with self._news:
            self._readers += 1
            try:
                self._news.wait_for(lambda: self._number > number or self.closed, timeout_s)
                return self._number, self._text
            finally:
                self._readers -= 1

    def _run(self) -> None:
        seen, due = 0.0, time.monotonic()
        while not self._closed.wait(max(0.0, due - time.monotonic())):
            due = max(due + FRAME_S, time.monotonic())
            now = time.monotonic()
            quiet = self._arrived == seen and now - self._told_s < STATUS_S
            if not self._readers or quiet:
                continue
            seen = self._arrived
            content = self._content(now)
            with self._news:
                self._text, self._number = json.dumps(content, separators=(",", ":"), allow_nan=False), self._number + 1
                self._news.notify_all()

    def _content(self, now: float) -> dict[str, Any]:
        with self._lock:
            shown = self.scene.snapshot()
            if self.scene.epoch != self._epoch:
                self._epoch, self._marks = self.scene.epoch, 0
            fresh, self._marks = self.scene.marks[self._marks :], len(self.scene.marks)
            content: dict[str, Any] = {} if shown is None else frame(shown)
            age_ms = 1000.0 * (now - self._arrived) if self._arrived else None
        content |= {"epoch": self._epoch, "new": [mark(each) for each in fresh], "age_ms": age_ms}
        if now - self._told_s >= STATUS_S:
            self._told_s = now
            content["status"] = self._report(now)
        return content

    def _report(self, now: float) -> dict[str, Any]:
        """Return services and time in words."""
        services: list[dict[str, Any]] = []
        for name, (heard, delivery) in sorted(self._health.items()):
            with suppress(SurefootError):
                row = health_row(delivery.message())
                row["service"], row["silent"] = name, now - heard > STALE_S
                services.append(row)
        words = "no simulated time is reported"
        if self._status is not None:
            with suppress(SurefootError):
                words = time_row(self._status.message())["words"]
        return {"services": services, "time": words, "log": list(self._log)}

    def act(self, action: str, fields: dict[str, Any]) -> dict[str, Any]:
        """Carry out what a button asks for; return `accepted` and a reason.

        Raises:
            SurefootError: no such action, a field it does not have, or the refusal of the service.
        """
        if action == "stop":
            return self._stop()
        query = QUERIES.get(action)
        if query is None:
            raise SurefootError("invalid", f"got {action!r}, allowed are {', '.join(QUERIES)}, stop", "action")
        reply = self.client.call(query, 3.0, **fields)
        return {"accepted": reply.accepted, "reason": reply.reason}

    def _stop(self) -> dict[str, Any]:
        endpoint = self.client.bus.endpoint
        stopper = Stopper(endpoint.connect, endpoint.namespace)
        try:
            done = stopper.stop("the live view", STOP_S)
        finally:
            stopper.close()
        return {"accepted": done is not None, "reason": done.stopped if done else "the driver has not confirmed it"}
