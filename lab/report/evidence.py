"""Evidence of faults in a recording: each function looks for one kind of fault and returns when and what it found.

The truth of a simulation is used where a recording has it; injected faults are not read anywhere.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.schemas.topics import TICK_S

from .clue import Clue
from .inputs import absent, camera, late, ranger, stale, thin
from .readings import UNLOADED_N, biased, followed, frozen, switches, wild
from .signals import Signals, spans

SLIDES_M, SLIDES_S = 0.003, 0.3
"""`SLIDES_M`: slide of a contact point within the window `SLIDES_S`, m, above which a foot counts as sliding;
`SLIDES_S`: length of that window, s."""
BEARS = 0.5
"""Share of the mean load of the standing feet from which a foot that slides counts: a lighter one is dragged."""
APART_S = 4.0
"""Time without sliding, s, after which feet that slide again are another event."""
KEEPS = 0.02
"""Share of the time with a planned margin below zero up to which a gait counts as one that keeps its support."""
IN_TURN, IN_TURN_S = 3, 2.0
"""`IN_TURN`: least number of feet that slide one after another within `IN_TURN_S` from which the ground counts as of
low friction; `IN_TURN_S`: length of that window, s."""
PUSH, PUSH_S = 5.0, 0.08
"""`PUSH`: mean acceleration of the trunk, m/s^2, above which it counts as a push, as no step causes it; `PUSH_S`:
window of this mean, s."""
FLAT = 0.02
"""Determinant of the horizontal scatter of standing feet, as a share of its squared trace, below which they stand on
one line."""
STOOD = "footholds", "stance"
"""Names of the fields of `state/gait` with the planned places of the feet, m, and with the feet that stand."""
CONE_S, CONE_ROWS = 1.0, 5
"""`CONE_S`: window, s, whose mean force counts: longer than a step sways the trunk, and than a fall takes; `CONE_ROWS`:
messages of the truth on each side from which the acceleration of the CoM is computed."""


def services(s: Signals) -> list[Clue]:
    """Find services that disappear from the roster of active services in `hw/tick` during the run."""
    found: list[Clue] = []
    times, before = s.times("hw/tick"), set[str]()
    gone: dict[str, float] = {}
    for time, row in zip(times.tolist(), s.rows["hw/tick"], strict=True):
        now = set(row.get("roster", ()))
        for name in sorted(before - now):
            gone[name] = time
        for name in sorted(now & set(gone)):
            left = gone.pop(name)
            found.append(Clue("service", left, time, f"{name} was off the roster for {time - left:.2f} s"))
        before = now
    lost = [Clue("service", t, s.end, f"{name} left the roster and did not return") for name, t in gone.items()]
    return found + lost


def stops(s: Signals) -> list[Clue]:
    """Find the first emergency stop that `sim/status` reports."""
    for row in s.rows["sim/status"]:
        if row.get("stopped"):
            return [Clue("stop", 0.01 * row.get("tick", 0), s.end, f"emergency stop: {row['stopped']}")]
    return []


def pushes(s: Signals) -> list[Clue]:
    """Find the first acceleration of the trunk above `PUSH`, which no step causes."""
    if s.rows["sim/truth"]:
        times, v = s.times("sim/truth"), s.column("sim/truth", "velocity")[:, :2]
        n = max(1, round(PUSH_S / 0.01))
        a = np.linalg.norm(v[n:] - v[:-n], axis=1) / (n * 0.01) if len(v) > n else np.empty(0)
        times = times[: len(a)]
    elif s.rows["hw/imu"]:
        times, acc = s.times("hw/imu"), s.column("hw/imu", "acc")
        n = max(1, round(PUSH_S / 0.01))
        mean = np.stack([np.convolve(acc[:, i], np.ones(n) / n, "same") for i in range(3)], axis=1)
        a = np.abs(np.linalg.norm(mean, axis=1) - GRAVITY)
    else:
        return []
    found = spans(times, (a > PUSH) & (times > 1.0), 0.02)
    return [
        Clue("push", b, e + PUSH_S, f"the trunk is accelerated by {a[(times >= b) & (times <= e)].max():.1f} m/s2")
        for b, e in found[:1]
    ]


def sliding(s: Signals) -> list[Clue]:
    """Find feet that slide under load: several are a sign of low friction, one alone is an effect of another fault.

    Several are two at once or, where the recording has truth, `IN_TURN` of them one after another.
    """
    if s.rows["sim/truth"]:
        times, way = s.times("sim/truth"), s.column("sim/truth", "contact_sliding")
        n = round(SLIDES_S / 0.01)
        if len(way) <= n:
            return []
        slid = (way[n:] - way[:-n] > SLIDES_M) & (way[:-n] >= 0.0) & _bears(s.column("sim/truth", "foot_force_n"), n)
        times = times[: len(slid)]
    elif s.rows["state/velocity"]:
        times, slid = s.times("state/velocity"), s.column("state/velocity", "slipping") > 0.5
    else:
        return []
    slid &= (times > 1.0)[:, None]
    found = _in_turn(times, slid) if s.rows["sim/truth"] else []
    for least, code in ((2, "friction"), (1, "slip")):
        for a, b in _events(spans(times, slid.sum(axis=1) >= least, 0.05)):
            feet = int(slid[(times >= a) & (times <= b)].any(axis=0).sum())
            text = f"{feet} feet slide at once, a sign of low friction" if least > 1 else "a foot slides"
            found.append(Clue(code, a, b, text))
    return found


def _bears(force: Array, n: int) -> NDArray[np.bool_]:
    """Return which feet carry `BEARS` of the mean load or more, in the mean over n rows: (rows - n, L) of (rows, L) N.

    A foot that carries less is dragged by a robot that tips over, or by its leg, on any ground.
    """
    mean = sliding_window_view(force, n, axis=0)[: len(force) - n].mean(axis=-1)
    standing = (mean > UNLOADED_N).sum(axis=1)
    return mean >= BEARS * (mean.sum(axis=1) / np.maximum(standing, 1))[:, None]


def _events(found: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return stretches, s, joined where less than `APART_S` is between them."""
    joined: list[tuple[float, float]] = []
    for a, b in found:
        if joined and a - joined[-1][1] < APART_S:
            joined[-1] = joined[-1][0], b
        else:
            joined.append((a, b))
    return joined


def support(s: Signals) -> list[Clue]:
    """Find times in which the CoM of a robot is outside of its support.

    Only of gaits that have kept their support until then: a trot leaves it in each step.
    """
    if not s.stands_statically:
        return []
    found: list[Clue] = []
    times, margin = s.times("state/stability"), s.column("state/stability", "margin_planned")
    times, margin = times[times > 1.0], margin[times > 1.0]
    for a, b in spans(times, margin < 0.0, 0.05):
        if float((margin[times < a] < 0.0).sum()) <= KEEPS * float((times < a).sum()):
            least = 1e3 * float(np.nanmin(margin[(times >= a) & (times <= b)]))
            found.append(Clue("support", a, b, f"it leaves its support, margin_planned falls to {least:.0f} mm"))
    return found


def cone(s: Signals) -> list[Clue]:
    """Find times in which the force that carries the robot leaves the friction cone that its walk counts with.

    The contact forces of all feet add up to m (a - g), a of the CoM, whatever the feet hold against each other. Cones
    are convex: if the mean of the sum over `CONE_S` leaves the cone about the normal of the ground, no distribution
    over feet and time is within it. The normal is that of the plane through the places where feet stood last; bipeds
    stand on level ground. Without truth a is 0.
    """
    known = s.column("state/stability", "mu")
    known = known[np.isfinite(known)]
    true, n = bool(s.rows["sim/truth"]), round(CONE_S / TICK_S)
    key, (place, load) = ("sim/truth", ("foot_position", "foot_force_n")) if true else ("state/gait", STOOD)
    times, feet = s.times(key), s.column(key, place)
    if not len(known) or len(times) < n or feet.ndim != 3:
        return []
    mu = float(np.median(known))
    force = np.tile(np.array([0.0, 0.0, GRAVITY]), (len(times), 1))
    if true:
        force += _acceleration(times, s.column(key, "com"))
    normal = _normals(feet, s.column(key, load) > UNLOADED_N)
    mean = sliding_window_view(force, n, axis=0).mean(axis=-1)
    now, ratio = _along(force, normal), _along(mean, normal[n // 2 :][: len(mean)])
    for a, b in spans(times[: len(ratio)], (ratio > mu) & (times[: len(ratio)] > 1.0), 0.0)[:1]:
        outside = times[(times >= a) & (now > mu)]
        most = ratio[(times[: len(ratio)] >= a) & (times[: len(ratio)] <= b)].max()
        text = f"the feet need {most:.2f} of their load along the ground, the friction cone of the walk has {mu:.2f}"
        return [Clue("cone", float(outside[0]) if len(outside) else a, b + CONE_S, text)]
    return []


def _acceleration(times: Array, com: Array) -> Array:
    """Return the acceleration of the CoM `com` (n, 3) m at times (n,) s, (n, 3) m/s^2; NaN where a row is missing."""
    k, found = CONE_ROWS, np.full(com.shape, np.nan)
    if com.ndim == 2 and len(com) > 2 * k:
        even = np.abs(times[2 * k :] - times[: -2 * k] - 2 * k * TICK_S) < 0.5 * TICK_S
        second = com[2 * k :] - 2.0 * com[k:-k] + com[: -2 * k]
        found[k:-k] = np.where(even[:, None], second / (k * TICK_S) ** 2, np.nan)
    return found


def _along(force: Array, normal: Array) -> Array:
    """Return the part of forces (n, 3) along planes as a share of that along their normals (n, 3); NaN if none."""
    up = np.einsum("ij,ij->i", force, normal)
    return np.linalg.norm(force - up[:, None] * normal, axis=1) / np.where(up > 0.0, up, np.nan)


def _normals(feet: Array, stands: NDArray[np.bool_]) -> Array:
    """Return the unit normal, (n, 3), of the plane by least squares through the places where feet stood last.

    `feet` (n, L, 3) m, z up; `stands` (n, L). Vertical where fewer than three feet have stood, or all on one line.
    """
    n, legs = stands.shape
    last = np.maximum.accumulate(np.where(stands, np.arange(n)[:, None], -1), axis=0)
    held = np.where((last >= 0)[:, :, None], feet[np.maximum(last, 0), np.arange(legs)], np.nan)
    stood = (last >= 0).sum(axis=1)
    x, y, z = np.moveaxis(held - (np.nansum(held, axis=1) / np.maximum(stood, 1)[:, None])[:, None], 2, 0)
    xx, xy, yy, xz, yz = (np.nansum(p * q, axis=1) for p, q in ((x, x), (x, y), (y, y), (x, z), (y, z)))
    det = xx * yy - xy**2
    flat = (stood < 3) | (det < FLAT * (xx + yy) ** 2)
    safe = np.where(flat, 1.0, det)
    slope_x, slope_y = (np.where(flat, 0.0, p / safe) for p in (xz * yy - yz * xy, yz * xx - xz * xy))
    normal = np.stack((-slope_x, -slope_y, np.ones(n)), axis=1)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _in_turn(times: Array, slid: NDArray[np.bool_]) -> list[Clue]:
    """Return `IN_TURN` feet that slide within `IN_TURN_S`, one after another, as on ground that is smooth everywhere.

    `times` (n,) s, `slid` (n, L).
    """
    last = np.maximum.accumulate(np.where(slid, times[:, None], -np.inf), axis=0)
    lately = last > times[:, None] - IN_TURN_S
    for a, b in spans(times, lately.sum(axis=1) >= IN_TURN, 0.0)[:1]:
        since = a - float(times[(times > a - IN_TURN_S) & slid.any(axis=1)][0])
        feet = int(lately[times == a].sum())
        text = f"{feet} feet have slid within {since + SLIDES_S:.2f} s, a sign of low friction"
        return [Clue("friction", a, b, text)]
    return []


def consequences(s: Signals) -> list[Clue]:
    """Find effects of faults: negative margins, refused or absent inputs, filter out of bounds, held joints, ..."""
    found: list[Clue] = []
    if s.stands_statically:
        times = s.times("state/stability")
        for name in ("margin_planned", "margin_measured"):
            margin = s.column("state/stability", name)
            for a, b in spans(times, (margin < 0.0) & (times > 1.0), 0.05)[:1]:
                least = 1e3 * float(np.nanmin(margin[(times >= a) & (times <= b)]))
                found.append(Clue("margin", a, b, f"{name} falls to {least:.0f} mm"))
    for name, code, text in (
        ("inputs_ok", "starved", "inputs of the filter were refused or absent"),
        ("filter_ok", "filter", "the filter is beyond its bounds"),
    ):
        times = s.times("state/velocity")
        flags = (s.column("state/velocity", name) < 0.5) & (times > 1.0)  # before, the estimator is not calibrated
        for a, b in spans(times, flags, 0.1)[:1]:
            found.append(Clue(code, a, b, f"{text} for {b - a:.2f} s"))
    last = ""
    for time, row in zip(s.times("state/gait").tolist(), s.rows["state/gait"], strict=True):
        if row.get("reason") and row["reason"] != last:
            found.append(Clue("refused", time, time, f"the walker: {row['reason']}"))
        last = row.get("reason", "")
    held: NDArray[np.bool_] = np.array([bool(row.get("held")) for row in s.rows["hw/tick"]], dtype=np.bool_)
    for a, b in spans(s.times("hw/tick"), held, 0.0)[:1]:
        found.append(Clue("held", a, b, f"the driver holds the joints for {b - a:.2f} s"))
    return found


FINDERS = (
    services, stops, absent, thin, late, stale, camera, ranger, frozen, wild, biased, followed, switches, pushes, cone,
    sliding, support, consequences,
)  # fmt: skip


def gather(s: Signals) -> list[Clue]:
    """Return the clues that all functions of this module find in a recording, sorted by begin."""
    return sorted((each for find in FINDERS for each in find(s)), key=lambda each: each.begin)
