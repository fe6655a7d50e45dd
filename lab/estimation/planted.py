"""Faults of one sensor that are added to a log from a time on: switches, encoders, stamps, inertial unit.

The truth of the log is not changed: row i of the estimate belongs to row i of the clean log.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from surefoot.arrays import Array, Flags, Ints
from surefoot.services.estimator.inputs.results import BACKWARD, STEPPED

from .log import Log

Plant = Callable[[Log, float, int], Log]
"""Function of a log, the time since its start, s, and the foot at fault, which returns the log with the fault."""

SWITCHES, ENCODERS = ("contact", "touch", "chance"), ("foot_position", "foot_rot")
"""`SWITCHES`: names of the fields of a log that come from foot switches; `ENCODERS`: of those from joint encoders."""
JUMP, JUMP_SHARE = 0.03, 0.1  # m, size; share of the samples
SHIFT = 0.02  # m
SCALE = 1.1
LATE_NS = 50_000_000
STEP_NS = 100_000_000
STILL_S = 0.5


def _since(log: Log, seconds: float) -> Ints:
    """Return the indices (k,) of the foot samples of a log from `seconds` s after its first inertial row on."""
    return np.flatnonzero(log.foot_ns >= log.stamp_ns[0] + round(1e9 * seconds)).astype(np.int64)


def _copies(log: Log, names: tuple[str, ...]) -> dict[str, Any]:
    return {name: getattr(log, name).copy() for name in names if getattr(log, name) is not None}


def stuck(log: Log, at_s: float, foot: int, closed: bool) -> Log:
    """Return the log with all switches of a foot stuck closed or open from `at_s` s on."""
    parts = _copies(log, SWITCHES)
    for part in parts.values():
        part[_since(log, at_s), foot] = closed
    return replace(log, **parts)


def swapped(log: Log, at_s: float, foot: int, names: tuple[str, ...]) -> Log:
    """Return the log with the fields `names` of a foot and the other foot of its pair swapped from `at_s` s on."""
    parts, rows, pair = _copies(log, names), _since(log, at_s), np.array([foot, foot ^ 1])
    for part in parts.values():
        part[np.ix_(rows, pair)] = part[np.ix_(rows, pair[::-1])]
    return replace(log, **parts)


def frozen(log: Log, at_s: float, feet: list[int]) -> Log:
    """Return the log with positions and rotations of some feet constant from `at_s` s on, as by frozen encoders."""
    parts, rows = _copies(log, ENCODERS), _since(log, at_s)
    for part in parts.values():
        part[np.ix_(rows, np.array(feet))] = part[rows[0], feet]
    return replace(log, **parts)


def misplaced(log: Log, at_s: float, foot: int, change: Callable[[Array, np.random.Generator], Array]) -> Log:
    """Return the log with another position of a foot from `at_s` s on; `change` maps (k, 3) m to (k, 3) m, IMU axes."""
    position, rows = log.foot_position.copy(), _since(log, at_s)
    position[rows, foot] = change(position[rows, foot], np.random.default_rng(foot))
    return replace(log, foot_position=position)


def _jumping(x: Array, rng: np.random.Generator) -> Array:
    off = rng.normal(size=x.shape)
    off *= JUMP / np.linalg.norm(off, axis=1, keepdims=True)
    return x + np.where(rng.random((len(x), 1)) < JUMP_SHARE, off, 0.0)


def _shifted(x: Array, rng: np.random.Generator) -> Array:
    off = rng.normal(size=3)
    return x + SHIFT * off / np.linalg.norm(off)


def late(log: Log, at_s: float, foot: int) -> Log:
    """Return the log whose feet carry stamps 50 ms too late from `at_s` s on; `foot` is not used."""
    stamp = log.foot_ns.copy()
    stamp[_since(log, at_s)] += LATE_NS
    return replace(log, foot_ns=stamp, order=None).with_feet(np.flatnonzero(stamp <= log.stamp_ns[-1]).astype(np.int64))


def stepped_back(log: Log, at_s: float, foot: int) -> Log:
    """Return the log whose clock steps back by 0.1 s at `at_s` s, in the same order of arrival; `foot` is not used."""
    stamps, feet, order = log.stamp_ns.copy(), log.foot_ns.copy(), log.arrival()
    at = log.stamp_ns[0] + round(1e9 * at_s)
    stamps[stamps >= at] -= STEP_NS
    feet[feet >= at] -= STEP_NS
    return replace(log, stamp_ns=stamps, foot_ns=feet, order=order)


def still_imu(log: Log, at_s: float, foot: int) -> Log:
    """Return the log whose inertial unit repeats one row for half a second from `at_s` s on; `foot` is not used."""
    rows = np.flatnonzero((log.seconds >= at_s) & (log.seconds < at_s + STILL_S))
    w, q = log.w.copy(), log.q.copy()
    w[rows], q[rows] = w[rows[0]], q[rows[0]]
    return replace(log, w=w, q=q)


PLANTED: dict[str, Plant] = {
    "switch stuck on": lambda log, at, foot: stuck(log, at, foot, True),
    "switch stuck off": lambda log, at, foot: stuck(log, at, foot, False),
    "switches swapped": lambda log, at, foot: swapped(log, at, foot, SWITCHES),
    "legs swapped": lambda log, at, foot: swapped(log, at, foot, ENCODERS),
    "encoders of a leg frozen": lambda log, at, foot: frozen(log, at, [foot]),
    "all encoders frozen": lambda log, at, foot: frozen(log, at, list(range(log.feet_count))),
    "encoder jumps 3 cm": lambda log, at, foot: misplaced(log, at, foot, _jumping),
    "encoder off by 2 cm": lambda log, at, foot: misplaced(log, at, foot, _shifted),
    "leg scaled by 1.1": lambda log, at, foot: misplaced(log, at, foot, lambda x, _: SCALE * x),
    "feet late 50 ms": late,
    "clock back 0.1 s": stepped_back,
    "inertial unit still 0.5 s": still_imu,
}
"""Functions (log, time, s, foot) -> log with a sensor fault from that time on, by name of the fault."""


def altered(log: Log, bad: Log, at_s: float) -> Flags:
    """Return flags of the rows, (n,), from `at_s` on in which a sample is in use that a fault has altered.

    A sample of the feet is in use until the next one. In other rows nothing can show the fault: a switch that is stuck
    on while its foot stands is right.

    Args:
        log: log without the fault.
        bad: log with the fault, with as many inertial rows; its end may lack samples of the feet.
        at_s: time since the start at which the fault begins, s.
    """
    feet = min(len(log.foot_ns), len(bad.foot_ns))
    wrong = np.zeros(feet + 1, dtype=np.bool_)  # the last one: no sample of the feet yet
    for name in ("foot_ns", *SWITCHES, *ENCODERS):
        one, other = getattr(log, name), getattr(bad, name)
        if one is not None:
            wrong[:feet] |= (one[:feet] != other[:feet]).reshape(feet, -1).any(axis=1)
    in_use = np.searchsorted(log.foot_ns[:feet], log.stamp_ns, side="right") - 1
    rows = wrong[in_use] | (log.stamp_ns != bad.stamp_ns) | (log.w != bad.w).any(axis=1)
    return rows & (log.seconds >= at_s)


def named(fault: str, foot: int, feet: int, found: Mapping[str, Ints]) -> tuple[Flags, Flags]:
    """Return two flags per row, (n,) each: the estimator names the fault, and it names a sensor that is sound.

    Args:
        fault: name in `PLANTED`.
        foot: index of the foot at fault.
        feet: number of feet.
        found: what the estimator names as faulty at each row, (n,) each, by kind: bits of feet (bit f for foot f), or
            for the stamps and the inertial unit a number, 0 = sound.
    """
    own, pair, every = 1 << foot, (1 << foot) | (1 << (foot ^ 1)), (1 << feet) - 1
    legs = {
        "switch stuck on": ("switches", own), "switch stuck off": ("switches", own),
        "switches swapped": ("switches", pair),
        "legs swapped": ("swapped", pair), "encoders of a leg frozen": ("still", own),
        "all encoders frozen": ("still", every), "encoder jumps 3 cm": ("jumping", own),
        "encoder off by 2 cm": ("jumping", own), "leg scaled by 1.1": ("jumping", own),
    }  # fmt: skip
    sensor, bits = legs.get(fault, ("", 0))
    wrong = np.zeros(len(found["switches"]), dtype=np.bool_)
    for name in ("switches", "jumping", "still", "swapped"):
        wrong |= (found[name] & ~(bits if name == sensor else 0)) != 0
    if sensor:
        return (found[sensor] & bits) == bits if sensor != "switches" else (found[sensor] & bits) != 0, wrong
    if fault == "feet late 50 ms":
        return found["late_ns"] > 0, wrong
    if fault == "clock back 0.1 s":
        return np.isin(found["refused"], (BACKWARD, STEPPED)), wrong
    return found["imu_frozen"] != 0, wrong
