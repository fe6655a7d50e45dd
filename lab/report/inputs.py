"""Evidence of faulty inputs in a recording: sensors that are absent, thin or late, stale topics, cameras, rangers."""

from collections.abc import Iterator

import numpy as np

from surefoot.arrays import Array
from surefoot.lockstep.ages import limit_ns
from surefoot.schemas.topics import (
    CMD_JOINTS,
    HW_CONTACTS,
    HW_IMAGE,
    HW_IMU,
    HW_JOINTS,
    HW_LANDMARKS,
    HW_RANGE,
    STATE_GAIT,
    STATE_LANDMARKS,
    STATE_POSE,
    STATE_STABILITY,
    STATE_VELOCITY,
    TICK_S,
)

from .clue import Clue
from .signals import Signals, spans

BODY = ((HW_IMU, "imu"), (HW_JOINTS, "joints"), (HW_CONTACTS, "contacts"))
"""Topics of the sensors with which a robot walks, each with the code of its absence."""
EYES = ((HW_LANDMARKS, "camera"), (HW_IMAGE, "camera"), (HW_RANGE, "ranger"))
"""Topics of the sensors with which a robot finds its way, each with the code of its faults."""
ANSWERS = (STATE_VELOCITY, STATE_GAIT, CMD_JOINTS, STATE_STABILITY, STATE_LANDMARKS, STATE_POSE)
"""Topics of services that others wait for."""
GAP_PERIODS = 5.0
"""Gap between two samples of a sensor, in periods of its topic, above which the sensor counts as absent."""
THIN, THIN_S = 0.6, 1.0
"""`THIN`: share of the usual number of samples below which a sensor counts as thin; `THIN_S`: window, s."""
LATE_PERIODS, LATE_S, LATE_FOR_S = 2.0, 0.03, 0.2
"""A sample is late if it is older than usual at its arrival by `LATE_PERIODS` periods of its topic, and by `LATE_S`, s;
`LATE_FOR_S`: time of this, s, from which on the sensor counts as late."""
PUNCTUAL = 0.1
"""Share of a recording in which a sensor is as usual, at least: quantile of the ages of its samples that is their usual
age, and share of the seconds with more samples than the usual number."""
BLIND_S = 2.0
"""Time, s, from which on a camera that sees no landmark, none of the map or one view, or that vision remarks on, counts
as faulty, and a ranger that repeats one echo."""
MOVES_M = 0.05
"""Way, m, of a robot while echoes are equal from which on they are no sign of a halt: one step of a small robot, as a
robot halts soon before an obstacle that its stuck ranger shows."""


def gaps(s: Signals, times: Array, least_s: float) -> Iterator[tuple[float, float]]:
    """Yield begin and end, s, of each gap of more than `least_s` s between times (n,) s, and to the end of the run.

    A hole in the file is none: control ticks must have been recorded in the gap.
    """
    if not len(times):
        return
    times, ticks = np.append(times, s.end), s.times("hw/tick")
    for i in np.flatnonzero(np.diff(times) > least_s):
        a, b = float(times[i]), float(times[i + 1])
        if not len(ticks) or TICK_S * np.count_nonzero((ticks > a) & (ticks <= b)) > least_s:
            yield a, b


def absent(s: Signals) -> list[Clue]:
    """Find gaps of more than `GAP_PERIODS` periods in the samples of the sensors.

    The period of a camera or ranger is that of its recording, as robots state their own.
    """
    found: list[Clue] = []
    for topic, code in (*BODY, *EYES):
        times, period = s.times(topic.key), 1e-9 * topic.period_ns
        if len(times) > 1 and topic.own_rate:
            period = max(period, float(np.median(np.diff(times))))
        for a, b in gaps(s, times, GAP_PERIODS * period):
            found.append(Clue(code, a, b, f"no {topic.key} for {b - a:.2f} s"))
    return found


def thin(s: Signals) -> list[Clue]:
    """Find sensors that lose many single samples: a second has fewer than `THIN` of their usual number, but some."""
    found: list[Clue] = []
    for topic, code in BODY:
        times, ticks = s.times(topic.key), s.times("hw/tick")
        ticks = ticks[ticks > times[0] + THIN_S] if len(times) else ticks[:0]
        if not len(ticks):
            continue
        count = np.searchsorted(times, ticks, "right") - np.searchsorted(times, ticks - THIN_S, "right")
        usual = float(np.quantile(count, 1.0 - PUNCTUAL))
        for a, b in spans(ticks, (count > 0) & (count < THIN * usual), THIN_S):
            least = int(count[(ticks >= a) & (ticks <= b)].min())
            text = f"{topic.key} has {least} samples a second, {usual:.0f} are usual"
            found.append(Clue(code, a - (1.0 - THIN) * THIN_S, b, text))
    return found


def late(s: Signals) -> list[Clue]:
    """Find sensors whose samples arrive later than usual: tick of arrival against stamp."""
    found: list[Clue] = []
    for topic, _ in BODY:
        times = s.times(topic.key)
        age = times - 1e-9 * s.column(topic.key, "stamp_ns") if len(times) else times
        if not np.isfinite(age).any():
            continue
        over = age - float(np.nanquantile(age, PUNCTUAL))
        limit = max(LATE_S, LATE_PERIODS * 1e-9 * topic.period_ns)
        for a, b in spans(times, over > limit, LATE_FOR_S):
            before = times[times < a]
            most = float(np.nanmax(over[(times >= a) & (times <= b)]))
            text = f"{topic.key} comes up to {most:.2f} s later than usual for {b - a:.2f} s"
            found.append(Clue("late", float(before[-1]) if len(before) else a, b, text))
    return found


def stale(s: Signals) -> list[Clue]:
    """Find topics that bring nothing new although their service is on the roster: no message, or with an old stamp."""
    found: list[Clue] = []
    ticks, rosters = s.times("hw/tick"), [row.get("roster", ()) for row in s.rows["hw/tick"]]
    for topic in ANSWERS:
        times, stamps = s.times(topic.key), s.column(topic.key, "stamp_ns")
        if len(times) and np.isfinite(stamps).all():
            times = times[np.append(True, np.diff(np.maximum.accumulate(stamps)) > 0.0)]
        for a, b in gaps(s, times, 1e-9 * limit_ns(topic)):
            within = [topic.owner in r for t, r in zip(ticks, rosters, strict=True) if a <= t <= b]
            if all(within):
                text = f"{topic.key} is stale: nothing new for {b - a:.2f} s, while {topic.owner} is on the roster"
                found.append(Clue("stale", a, b, text))
    return found


def camera(s: Signals) -> list[Clue]:
    """Find cameras that see nothing, one view all the time, or nothing of the map, and those that vision remarks on."""
    found: list[Clue] = []
    rows, times = s.rows["hw/landmarks"], s.times("hw/landmarks")
    seen = np.array([len(row.get("landmarks", ())) for row in rows])
    if seen.any():
        first = int(seen.argmax())
        for a, b in spans(times[first:], seen[first:] == 0, BLIND_S):
            found.append(Clue("camera", a, b, f"the camera sees no landmark for {b - a:.2f} s"))
    same = [i > 0 and bool(n) and rows[i]["landmarks"] == rows[i - 1].get("landmarks") for i, n in enumerate(seen)]
    for a, b in spans(times, np.array(same, dtype=np.bool_), BLIND_S):
        found.append(Clue("camera", a, b, f"the camera repeats one view for {b - a:.2f} s"))
    pose, matched = s.times("state/pose"), s.column("state/pose", "matched")
    if len(times) and len(pose) and (matched > 0).any():
        sees = seen[np.clip(np.searchsorted(times, pose, "right") - 1, 0, len(seen) - 1)] > 0
        for a, b in spans(pose, sees & (matched == 0) & (pose > pose[int((matched > 0).argmax())]), BLIND_S):
            found.append(Clue("camera", a, b, f"no landmark that the camera sees is in the map for {b - a:.2f} s"))
    flags = [tuple(row.get("flags", ())) for row in s.rows["state/landmarks"]]
    seen_at = s.times("state/landmarks")
    for a, b in spans(seen_at, np.array([bool(each) for each in flags], dtype=np.bool_), BLIND_S):
        words = dict.fromkeys(w for t, each in zip(seen_at, flags, strict=True) if a <= t <= b for w in each)
        found.append(Clue("camera", a, b, f"images are {', '.join(words)} for {b - a:.2f} s"))
    return found


def ranger(s: Signals) -> list[Clue]:
    """Find rangers that repeat one echo while the robot moves, by the truth or else the estimated pose."""
    times, distance = s.times("hw/range"), s.column("hw/range", "distance")
    found: list[Clue] = []
    if not len(times):
        return found
    place = _places(s, times)
    for a, b in spans(times, np.append(False, np.diff(distance) == 0.0), BLIND_S):
        rows = (times >= a) & (times <= b)
        way = float(np.linalg.norm(place[rows] - place[rows][0], axis=1).max())
        if way > MOVES_M:
            echo = distance[rows][0]
            found.append(Clue("ranger", a, b, f"the ranger reads {echo:.2f} m all along {way:.2f} m of way"))
    return found


def _places(s: Signals, times: Array) -> Array:
    """Return where the robot is at times (n,) s, (n, 2) m, by the truth or else the navigator; zero: not recorded."""
    for key, name in (("sim/truth", "position"), ("state/pose", "pose")):
        here = s.column(key, name)
        if here.ndim == 2:
            return here[np.clip(np.searchsorted(s.times(key), times), 0, len(here) - 1), :2]
    return np.zeros((len(times), 2))
