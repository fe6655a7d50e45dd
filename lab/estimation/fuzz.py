"""Random corruptions of the inputs of a walk: an estimator must survive them, and flag those that matter."""

from collections import Counter
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.geometry.constants import GRAVITY
from surefoot.services.estimator.filter.noise import FIXED
from surefoot.services.estimator.stream import BEST

from .log import Log
from .track import LogRunner

FASTEST = 2.0  # m/s
WRONG = 0.15  # m/s, an error of the velocity that matters
WRONG_ROWS = 20  # rows in a row with such an error and no flag: a silent failure
LENGTH = (1, 60)  # inertial rows of a corruption
AFTER = 40  # rows that follow it
CHECKED = 7  # rows from one look at the eigenvalues to the next
LIMIT_W, LIMIT_Q = 8.7, 170.0  # rad/s and m/s^2, ends of the range of a usual unit
NOTHING = np.zeros(0, dtype=np.bool_)


@dataclass
class Inputs:
    """Inputs of an estimator that arrive with one inertial row; corruptions change them.

    They are the gyro w (3,) rad/s and the accelerometer q (3,) m/s^2 up to `stamp_ns`, IMU axes, and for each sample of
    `feet` its stamp, ns, positions (F, 3) m, IMU axes, rotations from foot to IMU (F, 3, 3), and contacts (F,).
    """

    stamp_ns: int
    w: Array
    q: Array
    feet: list[tuple[int, Array, Array, Flags]]
    imu: bool = True  # the inertial sample arrives at all
    held: dict[str, Any] = field(default_factory=dict)  # what a corruption remembers between rows


Corruption = Callable[[Inputs, np.random.Generator, dict[str, Any]], None]


def _axis(rng: np.random.Generator) -> int:
    return int(rng.integers(3))


def _imu_value(value: float, which: str) -> Corruption:
    def change(x: Inputs, rng: np.random.Generator, memory: dict[str, Any]) -> None:
        getattr(x, which)[memory.setdefault("axis", _axis(rng))] = value

    return change


def _imu_scaled(which: str, factor: float) -> Corruption:
    def change(x: Inputs, rng: np.random.Generator, memory: dict[str, Any]) -> None:
        setattr(x, which, getattr(x, which) * factor)

    return change


def _imu_held(x: Inputs, rng: np.random.Generator, memory: dict[str, Any]) -> None:
    x.w, x.q = memory.setdefault("row", (x.w, x.q))


def _imu_spike(x: Inputs, rng: np.random.Generator, memory: dict[str, Any]) -> None:
    x.q = x.q + rng.normal(size=3) * 60.0
    x.w = x.w + rng.normal(size=3) * 5.0


def _imu_clipped(x: Inputs, rng: np.random.Generator, memory: dict[str, Any]) -> None:
    x.w, x.q = np.sign(x.w) * LIMIT_W, np.sign(x.q) * LIMIT_Q


def _imu_lost(x: Inputs, rng: np.random.Generator, memory: dict[str, Any]) -> None:
    x.imu = False


def _stamp(change_by: Callable[[int, np.random.Generator], int]) -> Corruption:
    def change(x: Inputs, rng: np.random.Generator, memory: dict[str, Any]) -> None:
        x.stamp_ns = change_by(x.stamp_ns, rng)

    return change


def _stamp_equal(x: Inputs, rng: np.random.Generator, memory: dict[str, Any]) -> None:
    x.stamp_ns = memory.setdefault("stamp", x.stamp_ns)


def _feet(change_one: Callable[..., tuple[int, Array, Array, Flags]]) -> Corruption:
    def change(x: Inputs, rng: np.random.Generator, memory: dict[str, Any]) -> None:
        x.feet = [change_one(*sample, rng=rng, memory=memory) for sample in x.feet]

    return change


def _one(rng: np.random.Generator, memory: dict[str, Any], count: int) -> int:
    return int(memory.setdefault("foot", rng.integers(count)))


def _feet_value(value: float, everywhere: bool, in_rot: bool = False) -> Corruption:
    def change(stamp, position, rot, contact, *, rng, memory):  # type: ignore[no-untyped-def]
        position, rot = position.copy(), rot.copy()
        which = slice(None) if everywhere else _one(rng, memory, len(contact))
        (rot if in_rot else position)[which] = value
        return stamp, position, rot, contact

    return _feet(change)


def _foot_off(stamp, position, rot, contact, *, rng, memory):  # type: ignore[no-untyped-def]
    position = position.copy()
    off = memory.setdefault("off", 0.3 * rng.normal(size=3) / np.sqrt(3.0))
    position[_one(rng, memory, len(contact))] += off
    return stamp, position, rot, contact


def _leg_frozen(stamp, position, rot, contact, *, rng, memory):  # type: ignore[no-untyped-def]
    f = _one(rng, memory, len(contact))
    position, rot = position.copy(), rot.copy()
    position[f], rot[f] = memory.setdefault("pose", (position[f].copy(), rot[f].copy()))
    return stamp, position, rot, contact


def _feet_swapped(stamp, position, rot, contact, *, rng, memory):  # type: ignore[no-untyped-def]
    return stamp, position[::-1].copy(), rot[::-1].copy(), contact


def _feet_noisy(stamp, position, rot, contact, *, rng, memory):  # type: ignore[no-untyped-def]
    return stamp, position + 0.02 * rng.normal(size=position.shape), rot, contact


def _contact(value: bool, one: bool) -> Corruption:
    def change(stamp, position, rot, contact, *, rng, memory):  # type: ignore[no-untyped-def]
        contact = contact.copy()
        contact[_one(rng, memory, len(contact)) if one else slice(None)] = value
        return stamp, position, rot, contact

    return _feet(change)


def _contact_random(stamp, position, rot, contact, *, rng, memory):  # type: ignore[no-untyped-def]
    return stamp, position, rot, rng.random(len(contact)) < 0.5


def _foot_stamp(change_by: Callable[[int, np.random.Generator], int]) -> Corruption:
    def change(stamp, position, rot, contact, *, rng, memory):  # type: ignore[no-untyped-def]
        return change_by(stamp, rng), position, rot, contact

    return _feet(change)


def _feet_lost(x: Inputs, rng: np.random.Generator, memory: dict[str, Any]) -> None:
    x.feet = []


def _feet_twice(x: Inputs, rng: np.random.Generator, memory: dict[str, Any]) -> None:
    x.feet = [sample for sample in x.feet for _ in range(2)]


def _robot_wrong(stamp, position, rot, contact, *, rng, memory):  # type: ignore[no-untyped-def]
    return stamp, 1.6 * position, rot, contact


CORRUPTIONS: dict[str, Corruption] = {
    "gyro NaN": _imu_value(np.nan, "w"), "gyro inf": _imu_value(np.inf, "w"), "acc NaN": _imu_value(np.nan, "q"),
    "acc -inf": _imu_value(-np.inf, "q"), "gyro in deg/s": _imu_scaled("w", 57.29578),
    "acc in g": _imu_scaled("q", 1 / GRAVITY),
    "acc sign": _imu_scaled("q", -1.0), "gyro sign": _imu_scaled("w", -1.0), "imu held": _imu_held,
    "imu spike": _imu_spike,
    "imu clipped": _imu_clipped, "imu lost": _imu_lost, "imu zero": _imu_scaled("q", 0.0),
    "stamp back": _stamp(lambda t, rng: t - int(rng.integers(1, 10**9))),
    "stamp ahead": _stamp(lambda t, rng: t + 10**12), "stamp in ms": _stamp(lambda t, rng: t // 10**6),
    "stamp jitter": _stamp(lambda t, rng: t + int(rng.integers(-20_000_000, 20_000_000))), "stamp equal": _stamp_equal,
    "feet NaN": _feet_value(np.nan, True), "foot NaN": _feet_value(np.nan, False),
    "foot inf": _feet_value(np.inf, False),
    "rot NaN": _feet_value(np.nan, False, True), "rot zero": _feet_value(0.0, False, True),
    "foot torn off": _feet(_foot_off), "leg frozen": _feet(_leg_frozen), "feet swapped": _feet(_feet_swapped),
    "feet noisy": _feet(_feet_noisy), "contacts on": _contact(True, False), "contacts off": _contact(False, False),
    "switch on": _contact(True, True), "switch off": _contact(False, True), "contacts random": _feet(_contact_random),
    "feet late": _foot_stamp(lambda t, rng: t - int(rng.integers(0, 300_000_000))),
    "feet ahead": _foot_stamp(lambda t, rng: t + int(rng.integers(0, 10**12))), "feet lost": _feet_lost,
    "feet twice": _feet_twice, "wrong robot": _feet(_robot_wrong),
}  # fmt: skip
"""Functions that corrupt the inputs of an inertial row (NaN, outlier, wrong stamp ...), by name."""


@dataclass
class FuzzCounts:
    """Counts of an estimator's failures and flags under corrupted samples, over many trials."""

    trials: int = 0
    samples: int = 0  # corrupted inputs
    broken: Counter[str] = field(default_factory=Counter)  # kind and what failed: never allowed
    silent: Counter[str] = field(default_factory=Counter)  # kinds with an error that matters and no flag
    flagged: Counter[str] = field(default_factory=Counter)  # kinds that raised any flag or counter
    by_kind: Counter[str] = field(default_factory=Counter)
    fastest: float = 0.0  # m/s


def inputs_of(log: Log, rows: range) -> Iterator[Inputs]:
    """Yield the inputs that arrive with each inertial row of a log, for the rows `rows`."""
    end = np.searchsorted(log.foot_ns, log.stamp_ns, side="right")
    for k in rows:
        first = int(end[k - 1]) if k else 0
        feet = [
            (int(log.foot_ns[i]), log.foot_position[i].copy(), log.foot_rot[i].copy(), log.contact[i].copy())
            for i in range(first, int(end[k]))
        ]
        yield Inputs(int(log.stamp_ns[k]), log.w[k].copy(), log.q[k].copy(), feet)


def feed(running: LogRunner, x: Inputs) -> None:
    """Feed the inputs that arrive with one inertial row to an estimator."""
    if x.imu:
        running.imu(x.stamp_ns, x.w, x.q)
    for sample in x.feet:
        running.feet(*sample)


def fuzz(name: str, log: Log, trials: int, seed: int, starts: int = 8, **options: Any) -> FuzzCounts:
    """Run an estimator over corrupted stretches of a walk, and return counts of its failures and flags.

    Args:
        name: name of the estimator.
        log: the walk, with truth.
        trials: number of stretches; every second one has two kinds of corruption at a time.
        seed: seed of all draws.
        starts: number of states, after uncorrupted inputs, that trials begin from.
        options: changes of the estimator's parameters.
    """
    rng, found = np.random.default_rng(seed), FuzzCounts()
    n = len(log.stamp_ns)
    walks = int(np.searchsorted(log.seconds, log.begin_s))
    rows = np.sort(rng.integers(walks, n - LENGTH[1] - AFTER - 1, size=starts))
    running, good = LogRunner(name, log, options), []
    for k, x in enumerate(inputs_of(log, range(int(rows[-1]) + 1))):
        if k in rows:
            good += [(k, deepcopy(running))] * int(np.sum(rows == k))
        feed(running, x)
    kinds = list(CORRUPTIONS)
    for trial in range(trials):
        first, state = good[trial % len(good)]
        count = 1 + trial % 2
        chosen = [str(kind) for kind in rng.choice(kinds, size=count, replace=False)]
        _trial(found, deepcopy(state), log, first, chosen, rng)
    return found


def _trial(
    found: FuzzCounts, running: LogRunner, log: Log, first: int, kinds: list[str], rng: np.random.Generator
) -> None:
    length = int(rng.integers(*LENGTH))
    label = " + ".join(sorted(kinds))
    memories: list[dict[str, Any]] = [{} for _ in kinds]
    found.trials += 1
    found.by_kind[label] += 1
    inputs = list(inputs_of(log, range(first, first + length + AFTER)))
    for x in inputs[:length]:
        for kind, memory in zip(kinds, memories, strict=True):
            CORRUPTIONS[kind](x, rng, memory)
        found.samples += x.imu + len(x.feet)
    try:
        failed, quiet, speeds, off = (_by_rows if running.name == BEST else _one_by_one)(running, inputs, log.v[first:])
    except Exception as error:
        found.broken[f"{label}: {type(error).__name__}"] += 1
        return
    found.fastest = max(found.fastest, speeds)
    if failed:
        found.broken[f"{label}: {failed}"] += 1
    longest = wrong = 0
    for bad in (off & quiet).tolist():
        wrong = wrong + 1 if bad else 0
        longest = max(longest, wrong)
    found.flagged[label] += not quiet.all()
    found.silent[label] += longest >= WRONG_ROWS


def _one_by_one(running: LogRunner, inputs: list[Inputs], truth: Array) -> tuple[str, Flags, float, Flags]:
    """Return the failure (empty: none), rows without a flag, largest speed, m/s, rows with an error that matters.

    `inputs` are fed one by one; `truth`: true velocity at their rows, (n, 3) m/s, IMU axes; rows are flags (n,).
    """
    before, fastest = sum(running.refused.values()), 0.0
    quiet, off = np.zeros(len(inputs), dtype=np.bool_), np.zeros(len(inputs), dtype=np.bool_)
    for i, x in enumerate(inputs):
        feed(running, x)
        e, pose = running.estimate(), running.pose()
        fastest = max(fastest, float(np.abs(e.velocity_imu).max()) if np.isfinite(e.velocity_imu).all() else np.inf)
        failed = _failure(e, pose.position, pose.covariance, every=i % CHECKED == 0)
        if failed:
            return failed, quiet, fastest, off
        said = not (e.inputs_ok and e.filter_ok and e.sensors_ok) or np.any(e.slipping)
        # without a sample the stamp of the estimate is old: that is its word
        quiet[i] = not said and sum(running.refused.values()) == before and x.imu
        off[i] = np.linalg.norm(e.velocity_imu - truth[i]) > WRONG
    return "", quiet, fastest, off


def _by_rows(running: LogRunner, inputs: list[Inputs], truth: Array) -> tuple[str, Flags, float, Flags]:
    """Return failure (empty: none), rows without a flag, largest speed, m/s, and rows with an error that matters.

    The inputs are fed to the kernel for whole logs, whose estimates are equal to those one by one, to the bit. `truth`:
    true velocity, (n, 3) m/s, IMU axes; rows are flags (k,) of the inertial samples that arrive.
    """
    before, rows = running.refusals, [i for i, x in enumerate(inputs) if x.imu]
    order: list[int] = []
    feet: list[tuple[int, Array, Array, Flags]] = []
    for x in inputs:
        if x.imu:
            order.append(len(order) - len(feet))
        order += [len(rows) + len(feet) + i for i in range(len(x.feet))]
        feet += x.feet
    if not rows:
        return "", NOTHING, 0.0, NOTHING
    count = running.feet_count
    stamps, position, rot, contact = (np.array(part) for part in zip(*feet, strict=True)) if feet else (
        np.zeros(0), np.zeros((0, count, 3)), np.zeros((0, count, 3, 3)), np.zeros((0, count))
    )  # fmt: skip
    part = Log(
        "trial", np.array([inputs[i].stamp_ns for i in rows]), np.array([inputs[i].w for i in rows]),
        np.array([inputs[i].q for i in rows]), stamps.astype(np.int64), position, rot, contact.astype(np.bool_),
    )  # fmt: skip
    out = running.whole(part, np.array(order), 0, len(rows))
    v, covariance = out.vectors[:, 1], out.covariance
    parts = {"velocity": out.vectors[:, 3], "g": out.vectors[:, 0], "P": covariance, "pose": out.vectors[:, 2]}
    lost = [name for name, values in parts.items() if not np.isfinite(values).all()]
    if lost or not np.isfinite(v).all():
        return f"{(*lost, 'velocity')[0]} not finite", NOTHING, np.inf, NOTHING
    speeds, looked = np.linalg.norm(v, axis=1), slice(None, None, CHECKED)
    least = np.linalg.eigvalsh(covariance[looked]).min(axis=1)
    scale = np.maximum(1.0, np.abs(covariance[looked]).max(axis=(1, 2)))
    positive = bool((least >= -1e-12 * scale).all()) and np.linalg.eigvalsh(out.pose[looked]).min() >= -1e-9
    positive = positive and np.diagonal(covariance, axis1=1, axis2=2)[:, 3:].min() > 0.0
    failed = "speed" if speeds.max() > FASTEST else "" if positive else "P not positive"
    said = ~out.flags[:, 2:].all(axis=1) | (out.more[:, 4:] > FIXED.slides).any(axis=1) | (out.refused > before)
    return failed, ~said, float(np.abs(v).max()), np.linalg.norm(v - truth[rows], axis=1) > WRONG


def _failure(e: Any, position: Array, covariance: Array, every: bool) -> str:
    """Return the failure of an estimate, empty: none; eigenvalues of covariances are checked only if `every` is True.

    `position` (3,) m; `covariance`: of the pose, (n, n).
    """
    for name, values in (("velocity", e.velocity), ("g", e.g_up), ("P", e.covariance), ("pose", position)):
        if not np.isfinite(values).all():
            return f"{name} not finite"
    if np.linalg.norm(e.velocity_imu) > FASTEST:
        return "speed"
    if not every:
        return ""
    if np.linalg.eigvalsh(e.covariance).min() < -1e-12 * max(1.0, float(np.abs(e.covariance).max())):
        return "P not positive"
    if np.diagonal(e.covariance)[3:].min() <= 0.0 or np.linalg.eigvalsh(covariance).min() < -1e-9:
        return "P not positive"
    return ""
