"""Frames of the live view of a running system, made from the newest messages at 30 Hz while a page is open."""

import json
import math
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, cast

from surefoot.bus.interface import Delivery
from surefoot.client import Client
from surefoot.errors import SurefootError
from surefoot.geometry.constants import GRAVITY
from surefoot.robot.description import Robot
from surefoot.schemas.sim import SIZED_FAULTS
from surefoot.schemas.status import SimStatus
from surefoot.schemas.system import Health
from surefoot.schemas.topics import HEALTH, LOG, SIM_STATUS
from surefoot.services.supervisor.processes.status import health_row, time_row

from ..scene.film import frame, header, mark
from .newest import ASK_S, FRAME_S, NewestScene
from .sight import LiveSight

STATUS_S, STALE_S, IDLE_S = 0.5, 3.0, 5.0
"""`STATUS_S`: wall time between two health reports on the page, s; `STALE_S`: time without a health message after which
a service counts as silent, s; `IDLE_S`: time without an open page after which the view drops its images, s."""
LOG_LINES = 12
PUSH_SHARE = 0.3
"""Default force of the push buttons, as a share of the robot's weight."""
QUERIES = {
    "pause": "sim/pause", "resume": "sim/step", "step": "sim/step", "speed": "sim/speed", "push": "sim/push",
    "fault": "sim/fault", "reset": "sim/reset",
}  # fmt: skip
"""Key of the query that each button of the page sends; `stop`, the emergency stop, is sent in another way."""
Stop = Callable[[str], tuple[bool, str]]
"""Function that sends an emergency stop with a reason; returns (True if a driver confirmed it, explanation)."""


@dataclass(frozen=True)
class Shown:
    """State of the live view at one time, as JSON texts that all open pages share.

    Attributes:
        number: index of the state, which counts up.
        epoch: number of runs seen so far.
        marks: number of footprints and landmarks of the present run, which stay in all later frames.
        world: counter of changes of the ground and of the running services; a page then requests `head` again.
        frame: JSON of the frame; "null" before the first joint angles.
        report: index of the health report, and its JSON.
        sight: index of the last image that vision read, and its JSON.
        at_ms: wall time of the state, ms since 1970.
    """

    number: int = 0
    epoch: int = -1
    marks: int = 0
    world: int = 0
    frame: str = "null"
    report: tuple[int, str] = (0, "null")
    sight: tuple[int, str] = (0, "null")
    at_ms: float = 0.0


class LiveFrames:
    """Producer of live-view frames from the newest messages, in a thread that is idle while no page is open.

    Args:
        stop: function that sends the emergency stop.
    """

    def __init__(self, client: Client, robot: Robot, stop: Stop) -> None:
        self.client, self._stop, self._sight = client, stop, LiveSight(client)
        self._newest = NewestScene(client, robot, self._sight.take, self._sight.forget)
        self._news = threading.Condition()
        self._health: dict[str, tuple[float, Delivery]] = {}
        lacking = [("warning", note) for note in self._newest.scene.body.notes]
        self._log: deque[tuple[str, str]] = deque(lacking, maxlen=LOG_LINES)
        self._shown, self._readers, self._heading = Shown(), 0, 0.0
        self._marks: list[str] = []
        self._lives = 0
        self._reported_s, self._status, self._alive = 0.0, None, set[str]()
        self._closed = threading.Event()
        self._newest_status = client.bus.newest(SIM_STATUS)
        for topic, sink in ((HEALTH, self._take_health), (LOG, self._take_log)):
            client.bus.subscribe(topic, sink)
        self._thread = threading.Thread(target=self._run, name="view", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread that makes frames; readers get no further frames."""
        self._closed.set()
        with self._news:
            self._news.notify_all()
        self._thread.join(timeout=2.0)

    @property
    def closed(self) -> bool:
        """True: the view was closed and makes no further frames; False: it is open."""
        return self._closed.is_set()

    def head(self) -> dict[str, Any]:
        """Return the constant parts of all frames as a JSON object: robot, ground, actions that the driver offers."""
        self._newest.ask_for_maps()
        offered = self._offered()
        with self._newest.lock:
            self._newest.look()
            return {"head": header(self._newest.scene), "world": self._world(), **offered}

    def _world(self) -> int:
        """Return a counter that changes when the ground or the set of running services changes."""
        return self._newest.grounds + self._lives

    def _offered(self) -> dict[str, Any]:
        """Return as a JSON object: actions and faults that the driver offers, fault targets, default push force, N."""
        robot = self._newest.scene.robot
        content: dict[str, Any] = {
            "actions": [], "faults": [], "sized": SIZED_FAULTS, "push_n": round(PUSH_SHARE * robot.mass * GRAVITY, 1),
            "targets": [*robot.joint_names, *robot.leg_names],
        }  # fmt: skip
        with suppress(SurefootError):  # the driver of a real robot has no features
            features = self.client.call("sim/features", ASK_S)
            content["actions"] = [action for action, key in QUERIES.items() if key in features.queries]
            content["faults"] = features.faults
        return content

    def reader(self) -> "Reader":
        """Return a reader of frames for a newly opened page."""
        return Reader(self)

    def unseen(self) -> Shown:
        """Return an empty state with the present number, for a page that waits for the next state."""
        return Shown(self._shown.number)

    def wait_newer(self, number: int, timeout_s: float) -> Shown:
        """Wait for a state newer than index `number`, at most `timeout_s` s of wall time; return the present state."""
        with self._news:
            self._readers += 1
            try:
                self._news.wait_for(lambda: self._shown.number > number or self.closed, timeout_s)
                return self._shown
            finally:
                self._readers -= 1

    def marks(self, begin: int, end: int) -> list[str]:
        """Return footprints and landmarks of this run with indices `begin` to `end` - 1, a JSON text each."""
        return self._marks[begin:end]

    def _take_health(self, delivery: Delivery) -> None:
        if not delivery.prime:
            with suppress(SurefootError):
                self._health[delivery.header().source] = time.monotonic(), delivery

    def _take_log(self, delivery: Delivery) -> None:
        if not delivery.prime:
            with suppress(SurefootError):
                line: Any = delivery.message()
                self._log.append((line.level, f"{line.source}: {line.text}"))

    def _run(self) -> None:
        due = watched = time.monotonic()
        while not self._closed.wait(max(0.0, due - time.monotonic())):
            due = max(due + FRAME_S, time.monotonic())
            if not self._readers:
                if due - watched > IDLE_S:
                    with self._newest.lock:
                        self._sight.forget()
            else:
                shown, watched = self._next(), due
                if shown is not self._shown:
                    with self._news:
                        self._shown = shown
                        self._news.notify_all()

    def _next(self) -> Shown:
        """Return the current state of the view; the previous object if no new message came."""
        now, before = time.monotonic(), self._shown
        reported = before.report
        if now - self._reported_s >= STATUS_S:
            self._reported_s = now
            reported = reported[0] + 1, _json(self._report(now))
        self._sight.images()
        with self._newest.lock:
            came, snapshot = self._newest.look()
            if not came and reported is before.report:
                return before
            epoch, marks = self._newest.runs, self._newest.scene.marks
            if epoch != before.epoch or len(marks) < len(self._marks):
                self._marks = []
            self._marks += [_json(mark(each)) for each in marks[len(self._marks) :]]
        if snapshot is not None:
            self._heading = math.atan2(snapshot.rot[1, 0], snapshot.rot[0, 0])
        content = "null" if snapshot is None else _json(frame(snapshot))
        return Shown(
            before.number + 1, epoch, len(self._marks), self._world(), content, reported, self._sight.look(),
            1000.0 * time.time(),
        )  # fmt: skip

    def _report(self, now: float) -> dict[str, Any]:
        """Return health of services, simulated time and latest log lines as a JSON object; `now`: monotonic time, s."""
        services: list[dict[str, Any]] = []
        for name, (came, delivery) in sorted(self._health.items()):
            with suppress(SurefootError):
                health = cast("Health", delivery.message())
                services.append({**health_row(health), "service": name, "silent": now - came > STALE_S})
        alive = {row["service"] for row in services if not row["silent"]}
        if alive != self._alive:  # another driver offers other actions
            self._alive, self._lives = alive, self._lives + 1
        delivery = self._newest_status()
        if delivery is not None and not delivery.prime:
            with suppress(SurefootError):
                self._status = time_row(cast("SimStatus", delivery.message()))
        return {"services": services, "time": self._status, "log": list(self._log)}

    def act(self, action: str, fields: dict[str, Any]) -> dict[str, Any]:
        """Execute the action of a button of the page; return `accepted` (True or False) and `reason` by name.

        Args:
            action: `stop`, or a key of `QUERIES`.
            fields: fields of the request. The force of `push` is (forward along the heading, left, up), N.

        Raises:
            SurefootError: there is no such action or field, or the service refuses it.
        """
        if action == "stop":
            accepted, reason = self._stop("the live view")
            return {"accepted": accepted, "reason": reason}
        query = QUERIES.get(action)
        if query is None:
            raise SurefootError("invalid", f"got {action!r}, allowed are {', '.join(QUERIES)}, stop", "action")
        if action == "push":
            fields = {**fields, "force": self._turned(fields.get("force"))}
        reply = self.client.call(query, None, **fields)
        return {"accepted": getattr(reply, "accepted", True), "reason": getattr(reply, "reason", "")}

    def _turned(self, force: Any) -> Any:
        """Return a force (forward, left, up), N, in world axes; any other value unchanged (the service refuses it)."""
        match force:
            case [int() | float() as ahead, int() | float() as left, int() | float() as up]:
                cos, sin = math.cos(self._heading), math.sin(self._heading)
                return [cos * ahead - sin * left, sin * ahead + cos * left, up]
            case _:
                return force


class Reader:
    """Reader of frames for one open page: `next` returns what the page has not received yet."""

    def __init__(self, live: LiveFrames) -> None:
        self._live, self._seen = live, live.unseen()

    def next(self, timeout_s: float) -> str | None:
        """Return the next message for the page as JSON; None if nothing is new within `timeout_s` s of wall time."""
        shown, seen = self._live.wait_newer(self._seen.number, timeout_s), self._seen
        if shown.number == seen.number:
            return None
        self._seen = shown
        same = shown.epoch == seen.epoch and shown.marks >= seen.marks
        fresh = ",".join(self._live.marks(seen.marks if same else 0, shown.marks))
        report = shown.report[1] if shown.report[0] != seen.report[0] else "null"
        sight = shown.sight[1] if shown.sight[0] != seen.sight[0] else "null"
        return (
            f'{{"epoch":{shown.epoch},"world":{shown.world},"at":{shown.at_ms:.1f},"new":[{fresh}],'
            f'"status":{report},"sight":{sight},"frame":{shown.frame}}}'
        )


def _json(content: Any) -> str:
    return json.dumps(content, separators=(",", ":"), allow_nan=False)
