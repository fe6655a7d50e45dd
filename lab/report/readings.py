"""Evidence of wrong readings in a recording: values that repeat, jump or contradict what else is known of them.

The truth of a simulation is used where a recording has it.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.schemas.topics import TICK_S

from .clue import Clue
from .signals import Signals, spans

FROZEN_S = 0.08
"""Least duration, s, of identical inertial samples in a row from which the inertial unit counts as frozen."""
STUCK_S, MOVED = 0.4, 0.12
"""`STUCK_S`: time, s, from which an encoder with a constant angle counts as stuck, if its joint's command moves by more
than `MOVED`, rad, and another joint by more than half of that, meanwhile."""
STILL_S, STILL_RAD = 1.0, 0.02
"""`STILL_S`: window, s; `STILL_RAD`: change of a joint angle in it, rad, below which the joint does not move; commands
count as lost if no joint moves while a command changes by more than `OFF_RAD`."""
OFF_RAD, OFF_S = 0.25, 0.25
"""`OFF_RAD`: difference of joint angle and command, rad, above which the joint does not follow; `OFF_S`: time of this,
s, from which it counts as a servo fault."""
UNLOADED_N, LOADED = 0.02, 0.12
"""`UNLOADED_N`: contact force, N, below which a foot counts as in the air; `LOADED`: share of the robot's weight on one
foot above which the foot counts as standing."""
WRONG_SWITCH_S = 0.2
"""Time, s, from which a foot switch that contradicts the contact force, or without truth the gait, counts as faulty."""
WILD_S, WILD = 0.3, 0.5
"""`WILD_S`: window, s; `WILD`: share of its samples that no robot can cause from which on a sensor gives garbage."""
WILD_ACC, WILD_GYRO, WILD_RATE = 60.0, 20.0, 30.0
"""Acceleration, m/s^2, and rate, rad/s, of the inertial unit, and rate, rad/s, of a joint from one sample to the next,
which a robot reaches for a moment at most, as in an impact."""

BIAS, BIAS_S = 0.2, 1.0
"""`BIAS`: difference of measured and true rate, rad/s, from which on the inertial unit counts as biased; `BIAS_S`:
window of both means, and least time of it, s."""


def frozen(s: Signals) -> list[Clue]:
    """Find repeated inertial samples, and encoders that stand still while their command and other joints move."""
    imu = np.hstack([s.column("hw/imu", "gyro"), s.column("hw/imu", "acc")]) if s.rows["hw/imu"] else np.empty((0, 6))
    same = np.append(False, (np.diff(imu, axis=0) == 0.0).all(axis=1)) if len(imu) else np.empty(0, dtype=np.bool_)
    found = [
        Clue("imu", a, b, f"hw/imu repeats one sample for {b - a:.2f} s")
        for a, b in spans(s.times("hw/imu"), same, FROZEN_S)
    ]
    times, q, command = _joints(s)
    if not len(times):
        return found
    for j in range(q.shape[1]):
        still = np.append(False, np.diff(q[:, j]) == 0.0)
        for a, b in spans(times, still, STUCK_S):
            rows = (times >= a) & (times <= b)
            way, others = np.ptp(command[rows, j]), np.ptp(q[rows], axis=0) > 0.5 * MOVED
            if way > MOVED and others.any():
                text = (
                    f"{s.joint(j)} reads {q[rows, j][0]:.3f} rad for {b - a:.2f} s, its command moves by {way:.2f} rad"
                )
                found.append(Clue("encoder", a, b, text))
    return found


def wild(s: Signals) -> list[Clue]:
    """Find inertial samples and joint angles that jump about as those of no moving robot."""
    found: list[Clue] = []
    if s.rows["hw/imu"]:
        times, acc, gyro = s.times("hw/imu"), s.column("hw/imu", "acc"), s.column("hw/imu", "gyro")
        size = np.abs(acc).max(axis=1), np.abs(gyro).max(axis=1)
        for a, b in _mostly(times, (size[0] > WILD_ACC) | (size[1] > WILD_GYRO)):
            here = (times >= a) & (times <= b)
            text = f"hw/imu reads up to {size[0][here].max():.0f} m/s2 and {size[1][here].max():.0f} rad/s"
            found.append(Clue("imu", a, b, f"{text} for {b - a:.2f} s"))
    times, q = s.times("hw/joints"), s.column("hw/joints", "position")
    if q.ndim == 2 and len(q) > 1:
        rate = np.abs(np.diff(q, axis=0)).max(axis=1) / np.maximum(np.diff(times), 1e-3)
        for a, b in _mostly(times[1:], rate > WILD_RATE):
            most = rate[(times[1:] >= a) & (times[1:] <= b)].max()
            found.append(Clue("joints", a, b, f"hw/joints jumps by up to {most:.0f} rad/s for {b - a:.2f} s"))
    return found


def biased(s: Signals) -> list[Clue]:
    """Find an inertial unit that turns otherwise than the robot, by truth: means over `BIAS_S`, as a step sways it."""
    times, gyro, at = s.times("hw/imu"), s.column("hw/imu", "gyro"), s.times("sim/truth")
    true = s.column("sim/truth", "angular_velocity")
    n = round(BIAS_S / TICK_S)
    if gyro.ndim != 2 or true.ndim != 2 or len(gyro) < n or len(true) < n:
        return []
    here = true[np.clip(np.searchsorted(at, times), 0, len(at) - 1)]
    turns = [np.linalg.norm(sliding_window_view(each, n, axis=0).mean(axis=-1), axis=1) for each in (gyro, here)]
    beside = np.abs(turns[0] - turns[1])
    for a, b in spans(times[: len(beside)], beside > BIAS, BIAS_S)[:1]:
        most = beside[(times[: len(beside)] >= a) & (times[: len(beside)] <= b)].max()
        return [Clue("imu", a + BIAS_S, b + BIAS_S, f"hw/imu turns by up to {most:.2f} rad/s beside the robot")]
    return []


def _mostly(times: Array, flags: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return begin and end, s, of stretches in which `WILD` of the flags (n,) are true in each window of `WILD_S`."""
    if len(times) < 2:
        return []
    n = max(3, round(WILD_S / float(np.median(np.diff(times)))))
    if len(times) < n:
        return []
    share = sliding_window_view(flags, n).mean(axis=1)
    return [(a, b + WILD_S) for a, b in spans(times[: len(share)], share > WILD, 0.0)]


def followed(s: Signals) -> list[Clue]:
    """Find joints that do not follow their commands: a servo fault of one, or no joint moves and commands are lost.

    Where truth shows that joints move otherwise than they read, it is a fault of their encoders instead.
    """
    times, q, command = _joints(s)
    if len(times) < 2:
        return []
    found: list[Clue] = []
    true = _true_joints(s, times, q)
    n = max(2, round(STILL_S / float(np.median(np.diff(times)))))
    if len(times) > n:
        moved, truly, wanted = (
            np.ptp(sliding_window_view(part, n, axis=0), axis=-1).max(axis=1) for part in (q, true, command)
        )
        for a, b in spans(times[: len(moved)], (moved < STILL_RAD) & (wanted > OFF_RAD), 0.1)[:1]:
            lost = (truly < STILL_RAD)[(times[: len(moved)] >= a) & (times[: len(moved)] <= b)].any()
            code, rest = ("command", "no joint moves") if lost else ("joints", "no joint moves by hw/joints")
            text = f"{rest} for {b - a + STILL_S:.2f} s, commands do{'' if lost else ', and so do the joints'}"
            found.append(Clue(code, a, b + STILL_S, text))
    off, wrong = np.abs(true - command), np.abs(true - q)
    for j in range(q.shape[1]):
        found_off = spans(times, off[:, j] > OFF_RAD, OFF_S)
        if found_off:  # one fault, however often the joint comes near its command meanwhile
            a, b = found_off[0][0], found_off[-1][1]
            near, most = times[(times <= a) & (off[:, j] < 0.3 * OFF_RAD)], off[times >= a, j].max()
            text = f"{s.joint(j)} is up to {most:.2f} rad from its command until {b:.2f} s"
            found.append(Clue("servo", float(near[-1]) if len(near) else a, b, text))
        for a, b in spans(times, wrong[:, j] > OFF_RAD, OFF_S)[:1]:
            most = wrong[(times >= a) & (times <= b), j].max()
            found.append(Clue("encoder", a, b, f"{s.joint(j)} reads up to {most:.2f} rad beside its true angle"))
    return found


def _true_joints(s: Signals, times: Array, q: Array) -> Array:
    """Return the true joint angles at times (n,) s, where the recording has them for each joint, else `q`, (n, nj)."""
    true, at = s.column("sim/truth", "joints"), s.times("sim/truth")
    if true.ndim != 2 or not len(true) or true.shape[1] != q.shape[1]:
        return q
    return true[np.clip(np.searchsorted(at, times), 0, len(at) - 1)]


def _joints(s: Signals) -> tuple[Array, Array, Array]:
    """Return times (n,) s from 1 s on, joint angles (n, nj) rad and the commands of 50 ms before, (n, nj) rad."""
    none = np.empty(0), np.empty((0, 0)), np.empty((0, 0))
    if not s.rows["hw/joints"] or not s.rows["cmd/joints"]:
        return none
    times, q = s.times("hw/joints"), s.column("hw/joints", "position")
    sent, command = s.times("cmd/joints"), s.column("cmd/joints", "position")
    if command.ndim != 2 or q.ndim != 2 or command.shape[1] != q.shape[1]:
        return none
    place = np.searchsorted(sent, times - 0.05) - 1
    known = (place >= 0) & (times > 1.0)  # the command of 50 ms before: a servo has a latency
    return times[known], q[known], command[place[known]]


def switches(s: Signals) -> list[Clue]:
    """Find foot switches that contradict the true force, or without truth the plan of the gait."""
    if not s.rows["hw/contacts"]:
        return []
    times = s.times("hw/contacts")
    touch = np.array([[any(foot) for foot in row.get("touch", ())] for row in s.rows["hw/contacts"]])
    if touch.ndim != 2:
        return []
    if s.rows["sim/truth"]:
        force, at = s.column("sim/truth", "foot_force_n"), s.times("sim/truth")
        here = force[np.clip(np.searchsorted(at, times), 0, len(at) - 1)]
        weight = float(np.nanmedian(force.sum(axis=1)))
        up, down, by = here < UNLOADED_N, here > LOADED * weight, "the force"
    elif s.rows["state/gait"]:
        stance, at = s.column("state/gait", "stance") > 0.5, s.times("state/gait")
        here = stance[np.clip(np.searchsorted(at, times), 0, len(at) - 1)]
        up, down, by = ~here, here, "the gait"
    else:
        return []
    found: list[Clue] = []
    for foot in range(min(touch.shape[1], up.shape[1])):
        for wrong, word in ((touch[:, foot] & up[:, foot], "closed"), (~touch[:, foot] & down[:, foot], "open")):
            for a, b in spans(times, wrong & (times > 1.0), WRONG_SWITCH_S):
                text = f"the switch of {s.foot(foot)} is {word} for {b - a:.2f} s against {by}"
                found.append(Clue("switch", a, b, text))
    return found
