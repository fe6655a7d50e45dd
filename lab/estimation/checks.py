"""Consistency checks of feet, contacts and forces of a log: contradictions are refused, oddities reported as notes.

A foot that stands has a fixed place and orientation in the world. So the turn of the IMU between two foot samples, by
the gyro, predicts its orientation, and its place relative to another standing foot, in IMU axes.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from surefoot.arrays import Array, Flags, Ints
from surefoot.errors import SurefootError
from surefoot.geometry.constants import GRAVITY

from .feet import up_at
from .log import Log

STEP_S = 0.15
"""Time between two foot samples whose difference is compared with the rotation of the IMU between them, s."""
ENOUGH = 10  # pairs of samples that a statement needs
FARTHEST_M = 3.0
"""Median distance from IMU to foot, m, above which a log is refused, since its foot positions are not in metres."""
TURNED_DEG, TURNED_SHARE = 0.8, 1.4
"""`TURNED_DEG`: rotation of standing feet, deg rms, and `TURNED_SHARE`: its ratio to that with transposed
orientations; above both, a log is refused, since its foot orientations are transposed."""
SWAPPED = 0.3
"""Excess of a foot's speed over the mean of all feet, share of that mean, summed over two feet; their contacts are
swapped if it is below -`SWAPPED` while their own contact is open and above `SWAPPED` while the other's is."""
CONTRADICTING, FAST = 0.75, 0.03
"""`CONTRADICTING`: speed between standing feet over their speed relative to the IMU, ratio; `FAST`: speed between
standing feet, m/s; above both, a note reports that legs contradict each other."""
MASSES_KG, MASS_FACTOR = (0.1, 500.0), 2.0
"""`MASSES_KG`: range of the mass by the foot forces, kg, of a robot without description; `MASS_FACTOR`: largest ratio
of the mass by the foot forces to the described mass, or its inverse; a mass outside is reported as a note."""
LYING_DEG, LASTING_S = 60.0, 1.0
"""`LYING_DEG`: angle between the vertical and the line from feet to IMU, deg, above which a robot lies; `LASTING_S`:
time of lying, or without any contact, above which a note reports it, s."""


class FootSteps(NamedTuple):
    """Pairs of foot samples that are 0.15 s (`STEP_S`) apart, by which foot motion is compared with the IMU."""

    first: Ints  # (k,)
    last: Ints  # (k,)
    turn: Array  # (k, 3, 3) rotation of the IMU between them, rot_first_from_last
    stands: Flags  # (k, F) throughout
    swings: Flags  # (k, F) throughout


def check_kinematics(log: Log) -> tuple[str, ...]:
    """Check feet, contacts and forces of a log.

    Returns:
        Notes on oddities, a sentence each.

    Raises:
        SurefootError: feet, contacts or forces contradict each other; the text has the numbers.
    """
    if len(log.foot_ns) < 2 * ENOUGH or not np.isfinite(log.foot_position).any():
        return ()
    log = replace(log, foot_position=np.where(np.isfinite(log.foot_position), log.foot_position, np.nan))
    _check_size(log)
    notes = _forces(log)
    steps = steps_of(log)
    _check_rotations(log, steps)
    _check_order(log, steps)
    return (*notes, *_contradictions(log, steps), *_lying(log))


def _check_size(log: Log) -> None:
    far = float(np.nanmedian(np.linalg.norm(log.foot_position, axis=2)))
    if far > FARTHEST_M:
        unit, factor = ("mm", 0.001) if far > 10.0 * FARTHEST_M else ("cm", 0.01)
        text = f"{log.name}: feet are {far:.3g} m from the IMU (median), {FARTHEST_M:g} m are allowed"
        raise SurefootError("invalid", f"{text}: in {unit}, multiply by {factor:g}", "foot_position")


def _forces(log: Log) -> tuple[str, ...]:
    """Return a note on the scale of the forces, or none; raise SurefootError if they have the wrong sign."""
    if log.force is None or not np.isfinite(log.force).any():
        return ()
    force = np.nan_to_num(log.force)
    usual = float(np.median(force.sum(axis=1)))
    if usual < 0.0:
        text = f"{log.name}: forces add up to {usual:.3g} N (median), a foot that stands has more than 0"
        raise SurefootError("invalid", f"{text}: multiply by -1", "force")
    on, off = log.contact, ~log.contact
    if on.sum() > ENOUGH and off.sum() > ENOUGH and np.median(force[on]) < np.median(force[off]):
        text = (
            f"{log.name}: forces are {np.median(force[on]):.3g} N in contact and {np.median(force[off]):.3g} N without"
        )
        raise SurefootError("invalid", f"{text}: other feet, another sign, or inverted contacts?", "force")
    mass = usual / GRAVITY
    seen = f"forces add up to {usual:.3g} N (median), the weight of {mass:.3g} kg"
    if log.robot is not None:
        known = log.robot.mass
        if not known / MASS_FACTOR < mass < known * MASS_FACTOR:
            return (f"{seen}; {log.robot.name} has {known:.3g} kg: another unit, or another robot?",)
    elif not MASSES_KG[0] < mass < MASSES_KG[1]:
        return (f"{seen}: counts, or another unit than N?",)
    return ()


def steps_of(log: Log) -> FootSteps:
    """Return the pairs of foot samples of a log that are 0.15 s (`STEP_S`) apart, with the turn of the IMU between."""
    seconds = 1e-9 * (log.foot_ns - log.stamp_ns[0])
    k = max(1, round(STEP_S / max(float(np.median(np.diff(seconds))), 1e-6)))
    first = np.arange(max(len(seconds) - k, 0))
    angle = np.cumsum(np.nan_to_num(log.w) * np.diff(log.seconds, prepend=0.0)[:, None], axis=0)
    at = np.stack([np.interp(seconds, log.seconds, column) for column in angle.T], axis=1)
    turn = Rotation.from_rotvec(at[first + k] - at[first]).as_matrix()
    count = np.cumsum(np.vstack([np.zeros(log.feet_count), log.contact]), axis=0)
    closed = count[first + k + 1] - count[first]
    known = np.isfinite(log.foot_position[first] + log.foot_position[first + k]).all(axis=2)
    return FootSteps(first, first + k, turn, (closed == k + 1) & known, (closed == 0) & known)


def _check_rotations(log: Log, steps: FootSteps) -> None:
    """Raise SurefootError if standing feet turn, and would stand better with their orientations transposed."""
    if steps.stands.sum() < ENOUGH or not np.isfinite(log.foot_rot).all():
        return

    def turned(rot: Array) -> float:
        left = np.einsum("kfji,kjl,kflm->kfim", rot[steps.first], steps.turn, rot[steps.last])
        cosine = np.clip(0.5 * (np.trace(left, axis1=2, axis2=3) - 1.0), -1.0, 1.0)
        return float(np.degrees(np.sqrt(np.mean(np.arccos(cosine)[steps.stands] ** 2))))

    given, other = turned(log.foot_rot), turned(np.swapaxes(log.foot_rot, 2, 3))
    if given > TURNED_DEG and given > TURNED_SHARE * other:
        text = f"{log.name}: standing feet turn by {given:.1f} deg in {STEP_S:g} s, {other:.1f} deg if transposed"
        raise SurefootError("invalid", f"{text}; wanted are rotations from foot to IMU axes", "foot_rotation")


def _moves(log: Log, steps: FootSteps) -> Array:
    """Return the feet's displacements relative to the IMU, (k, F, 3) m, in IMU axes of each pair's first sample."""
    return np.einsum("kij,kfj->kfi", steps.turn, log.foot_position[steps.last]) - log.foot_position[steps.first]


def _check_order(log: Log, steps: FootSteps) -> None:
    """Raise SurefootError if the order of the contacts differs from that of the feet, by the speed of the feet."""
    speed = np.linalg.norm(_moves(log, steps), axis=2)
    usual = np.nanmean(speed, axis=1, keepdims=True)
    feet, excess = log.feet_count, np.zeros((log.feet_count, log.feet_count))
    for c in range(feet):
        rows = steps.swings[:, c] & np.isfinite(speed).all(axis=1)
        if rows.sum() >= ENOUGH:
            excess[:, c] = np.median((speed - usual)[rows], axis=0) / max(float(np.median(usual[rows])), 1e-6)
    for a in range(feet):
        for b in range(a):
            own, crossed = excess[a, a] + excess[b, b], excess[a, b] + excess[b, a]
            if own < -SWAPPED and crossed > SWAPPED:
                raise SurefootError(
                    "invalid", f"{log.name}: foot {b} moves when contact {a} is open and foot {a} when contact {b} is: "
                    "feet or joints and contacts are in another order of legs", "contact",
                )  # fmt: skip


def _contradictions(log: Log, steps: FootSteps) -> tuple[str, ...]:
    """Return a note on standing feet that move relative to each other."""
    apart: list[Array] = []
    position = log.foot_position
    for a in range(log.feet_count):
        for b in range(a):
            arm, rows = position[:, a] - position[:, b], steps.stands[:, a] & steps.stands[:, b]
            moved = np.einsum("kij,kj->ki", steps.turn[rows], arm[steps.last[rows]]) - arm[steps.first[rows]]
            apart.append(np.linalg.norm(moved, axis=1) / STEP_S)
    both = np.concatenate(apart) if apart else np.empty(0)
    if len(both) < ENOUGH:
        return ()
    speed = np.linalg.norm(_moves(log, steps)[steps.stands], axis=1) / STEP_S
    between, usual = (float(np.sqrt(np.mean(x**2))) for x in (both, speed))
    if between < FAST or between < CONTRADICTING * usual:
        return ()
    text = f"feet that stand move at {100 * between:.0f} cm/s relative to each other and {100 * usual:.0f} to the IMU"
    return (f"{text}: another order of legs, another robot, or contacts that are none?",)


def _lying(log: Log) -> tuple[str, ...]:
    """Return notes on times without contact, and on feet that are not below the IMU."""
    columns = {"acc": log.q, "stamp_ns": log.stamp_ns, "foot_stamp_ns": log.foot_ns}
    down = np.nan_to_num(log.foot_position).mean(axis=1)
    up, far = up_at(columns), np.linalg.norm(down, axis=1)
    cosine = -np.einsum("mi,mi->m", up, down) / np.maximum(far, 1e-9)
    known = (far > 0.0) & (np.linalg.norm(up, axis=1) > 0.5)
    seconds = 1e-9 * (log.foot_ns - log.stamp_ns[0])
    notes: list[str] = []
    for mask, what in (
        (~log.contact.any(axis=1), "no foot stands: carried, or fallen?"),
        (
            known & (cosine < np.cos(np.radians(LYING_DEG))),
            "the feet are not below the IMU: the robot lies, or other axes?",
        ),
    ):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
        spans = seconds[np.minimum(edges.reshape(-1, 2), len(seconds) - 1)]
        longest = spans[int(np.argmax(np.diff(spans, axis=1)))] if len(spans) else np.zeros(2)
        if longest[1] - longest[0] > LASTING_S:
            notes.append(f"from {longest[0]:.1f} to {longest[1]:.1f} s {what}")
    return tuple(notes)
