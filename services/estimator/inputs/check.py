"""Check of the inputs: ranges, clocks, frozen sensors, and units by gravity and by the feet.

The gyro is compared with the legs. Points that stand turn in IMU axes by -theta, theta the integral of the gyro between
two samples of the joints: with c the points from their mean,

    predicted p = -theta x c,   seen s = change of c,   slope = sum p.s / sum p.p

over the last seconds. The slope is 1; 1/57.3 if the gyro measures in deg/s, -1 if it has the other sign.
"""

import math
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Ints
from surefoot.kernels.jit import kernel

from ..feet.contact import points_of
from .clock import CLOCK, KNOWN, LARGEST_NS, NEWEST, check_clock
from .results import AHEAD, GAP, NONFINITE, OK, RESTART, RESULTS, SATURATED, STEPPED, UNIT

IMU, KINEMATICS = 0, 1
"""Index of each source of samples: inertial unit (`IMU`), and joints or feet (`KINEMATICS`)."""
SOURCES = ("imu", "kinematics")
"""Names of the sources of samples, by their index `IMU` or `KINEMATICS`."""
ROWS, WRONG_SIDE, EQUAL_ROWS, EQUAL_FEET, UNITS, BAD_NS, SATURATED_NS, TURN_NS, BAD_SOURCE = range(9)
BAD_CODE, REFUSED, LIGHT_NS, BACK, LATE_FEET_NS, SHOWN_LATE_NS = range(9, 15)
"""Indices in `CheckState.marks`. `ROWS`: samples in the mean of the accelerometer; `WRONG_SIDE`: samples of the feet
with that mean on the wrong side; `EQUAL_ROWS`, `EQUAL_FEET`: equal samples in a row; `UNITS`: code of a wrong unit;
`BAD_NS`, `SATURATED_NS`, `TURN_NS`: stamps, ns, of the last refusal or gap, the last saturation, and the last gyro
sample in the turn; `BAD_SOURCE`, `BAD_CODE`: source and code of the last refusal or gap; `REFUSED`: number of refusals;
`LIGHT_NS`: stamp since which no weight shows; `BACK`: samples in a row by which the inertial clock stepped back;
`LATE_FEET_NS`: time, ns, subtracted from stamps of the feet; `SHOWN_LATE_NS`: stamp since which their motion shows them
late, 0 = it does not."""
LAST_W, LAST_Q, MEAN_Q, TURN, SHARED, PREDICTED, SEEN, PATH = 0, 3, 6, 9, 12, 13, 14, 15
"""First indices in `CheckState.numbers`. `LAST_W`, `LAST_Q`: last gyro (3) rad/s and accelerometer (3) m/s^2; `MEAN_Q`:
mean of the accelerometer (3) m/s^2; `TURN`: turn by the gyro since the last sample of the feet (3) rad; `SHARED`,
`PREDICTED`, `SEEN`: sums p.s, p.p and s.s of the comparison with the feet, rad^2; `PATH`: path of turning by the gyro,
rad."""

NEVER, FOR_EVER = -(2**62), 2**62  # ns
BAD_MEMORY_NS = 100_000_000  # time for which a refused input spoils `inputs_ok`
LIGHT_FOR_NS = 300_000_000  # time without weight that shows a fall, or another unit; a leap lasts 0.2 s
STEADY_ROWS = 30  # equal joint angles in a row, 1 s, that are a fault while the robot moves by the gyro
NO_WEIGHT = 3.0  # m/s^2, a shorter specific force is that of a fall, or in another unit
MEAN_NS = 500_000_000  # in which the mean of the accelerometer follows: longer than a hop
MEAN_WEIGHT = 0.02  # at most, of a sample in that mean
UNIT_ROWS = 100  # samples before it is checked
GRAVITIES = (0.5, 2.0)  # m/s^2, a mean between these is gravity in g: no robot falls for so long
FORGET = 0.995  # of the comparison with the feet, per sample
WHOLE_TURN = 2.0 * math.pi  # rad of turning by the gyro, without the feet turning: no robot that falls does so
SOME_TURN = 0.4  # rad of turning by the gyro, and the feet turn the other way
TIMELY_NS = 25_000_000  # by which the feet may be older than the gyro
LONGEST_TURN_NS = 200_000_000  # between two samples of the feet that are compared
NO_SLOPE, OTHER_SLOPE = 0.1, -0.25  # slopes below which the gyro is in deg/s, has the other sign
OTHER_WAY = -0.4  # correlation below which the feet turn against the gyro
ABOVE = 0.5  # cosine between up (down) and the way to the feet beyond which they are above (below): else it may lie
SMALLEST = 1e-4  # m^2, spread of points that are compared

GOOD, IN_G, ACC_SIGN, IN_DEG, GYRO_SIGN = range(5)
"""Codes of a sensor's unit: `GOOD`: right; `IN_G`, `ACC_SIGN`: accelerometer in g, or of wrong sign; `IN_DEG`,
`GYRO_SIGN`: gyro in deg/s, or of wrong sign."""
UNIT_WORDS = (
    "", "the accelerometer measures in g: factor 9.81", "the accelerometer has the other sign: factor -1",
    "the gyro measures in deg/s: factor 0.0174533", "the gyro has the other sign: factor -1",
)  # fmt: skip
"""Text about a wrong unit or sign of a sensor, by its code from `GOOD` to `GYRO_SIGN`."""


class CheckState(NamedTuple):
    """Memory of the check of inputs for L feet and K contact points, by which it finds samples to refuse.

    clocks: of inertial unit and feet, (2, 6); counts: refusals and gaps by source and code, (2, results); marks:
    counters and stamps, (15,); numbers: averages, (16,); feet: last positions, IMU axes, (L, 3) m; points: last contact
    points from the IMU, IMU axes, m, and 1 for those that stood, (K, 4).
    """

    clocks: Ints  # (2, 6) of IMU and kinematics, see `clock`
    counts: Ints  # (2, results) refusals and gaps
    marks: Ints  # (14,) see `ROWS` and the names beside it
    numbers: Array  # (16,) see `LAST_W` and the names beside it
    feet: Array  # (L, 3) m, last sample, IMU axes
    points: Array  # (K, 4) last contact points from the IMU, m, and 1 for those that stood


class CheckLimits(NamedTuple):
    """Limits from which an input is refused, or counted as a gap or fault.

    max_gyro: rad/s; max_acc: m/s^2; gap_ns: step between inertial samples that is a gap, ns; period_ns: usual step, ns.
    `frozen_rows`: number of equal inertial samples in a row that show a frozen sensor.
    """

    max_gyro: float  # rad/s
    max_acc: float  # m/s^2
    gap_ns: float  # ns between inertial samples that is a gap
    period_ns: float  # ns between inertial samples
    frozen_rows: int  # equal inertial samples in a row that show a frozen sensor


class Faults(NamedTuple):
    """Faults of the inputs at a moment.

    refused: True if an input of the last 100 ms was refused, or there was a gap; saturated: the inertial unit was at
    the end of its range in the last 100 ms; weightless: the accelerometer has shown no weight for 0.3 s; imu_frozen:
    the inertial unit repeats one sample; feet_repeat: the encoders have repeated themselves for a second, a fault only
    where the robot moves.
    """

    refused: bool  # an input of the last 100 ms, or there was a gap
    saturated: bool  # the inertial unit was at the end of its range in the last 100 ms
    weightless: bool  # the accelerometer has shown no weight for 0.3 s
    imu_frozen: bool  # the inertial unit repeats one sample
    feet_repeat: bool  # the encoders have repeated themselves for a second: a fault only where the robot moves


def new_check(feet: int, points: int) -> CheckState:
    """Return the state of a check of inputs before the first sample, for `feet` feet and `points` contact points."""
    marks, numbers = np.zeros(SHOWN_LATE_NS + 1, dtype=np.int64), np.zeros(PATH + 1)
    marks[BAD_NS] = marks[SATURATED_NS] = marks[TURN_NS] = NEVER
    marks[LIGHT_NS] = FOR_EVER
    numbers[LAST_W : LAST_Q + 3] = np.nan
    clocks, counts = np.zeros((2, CLOCK), dtype=np.int64), np.zeros((2, len(RESULTS)), dtype=np.int64)
    return CheckState(clocks, counts, marks, numbers, np.full((feet, 3), np.nan), np.zeros((points, 4)))


@kernel
def peak(x: Array) -> float:
    """Return the largest absolute value of x (n,), in its unit; infinity if a value is not finite."""
    most = 0.0
    for i in range(x.size):
        if not math.isfinite(x[i]):
            return np.inf
        most = max(most, abs(x[i]))
    return most


@kernel
def faults_at(check: CheckState, limits: CheckLimits, noisy: bool, now_ns: int) -> Faults:
    """Return the faults of the inputs at `now_ns`, stamp of the newest inertial sample, ns.

    Args:
        check: what the check of inputs remembers.
        limits: limits from which an input is refused.
        noisy: True: equal inertial samples are a fault; False: they may be chance.
        now_ns: time of the faults, ns.
    """
    marks = check.marks
    return Faults(
        0 <= now_ns - marks[BAD_NS] < BAD_MEMORY_NS,
        0 <= now_ns - marks[SATURATED_NS] < BAD_MEMORY_NS,
        now_ns - marks[LIGHT_NS] >= LIGHT_FOR_NS,
        noisy and marks[EQUAL_ROWS] >= limits.frozen_rows,
        marks[EQUAL_FEET] >= STEADY_ROWS,
    )


@kernel
def count_result(check: CheckState, source: int, code: int, stamp_ns: int) -> int:
    """Count the result of a sample of a source, in place, and return its code.

    Args:
        check: what the check of inputs remembers; changed.
        source: 0 = inertial unit, 1 = joints or feet.
        code: index of the result in `RESULTS`, the tuple of all `InputResult`.
        stamp_ns: stamp of the sample, ns.
    """
    marks = check.marks
    check.counts[source, code] += 1
    marks[BAD_SOURCE], marks[BAD_CODE] = source, code
    if code > STEPPED:
        marks[REFUSED] += 1
    marks[BAD_NS] = check.clocks[IMU, NEWEST] if check.clocks[IMU, KNOWN] > 0 else stamp_ns
    if code == SATURATED:
        marks[SATURATED_NS] = marks[BAD_NS]
    return code


@kernel
def _order(check: CheckState, source: int, stamp_ns: int) -> int:
    """Check the stamp, ns, of a sample against the clock of its source in `check`, in place; return the result's code.

    `source`: 0 = inertial unit, 1 = feet. A clock that begins anew makes that of the other source unknown.
    """
    if abs(stamp_ns) > LARGEST_NS:
        return count_result(check, source, AHEAD, stamp_ns)
    clocks, newest, known = check.clocks, stamp_ns, False
    for i in range(2):
        if clocks[i, KNOWN] > 0:
            newest = max(newest, clocks[i, NEWEST]) if known else clocks[i, NEWEST]
            known = True
    code = check_clock(clocks[source], stamp_ns, newest)
    if code == RESTART:
        clocks[1 - source, KNOWN] = 0
    return code if code == OK else count_result(check, source, code, stamp_ns)


@kernel
def _wrong_unit(check: CheckState, limits: CheckLimits, stamp_ns: int, w: Array, q: Array) -> bool:
    """Update the means by a sample, in place; return True if the unit or the sign of a sensor is wrong.

    Args:
        check: the means, and what they have shown; changed.
        limits: of the inputs, with the usual step of the inertial samples.
        stamp_ns: stamp of the sample, ns.
        w: gyro, IMU axes, (3,) rad/s if its unit is right.
        q: accelerometer, IMU axes, (3,) m/s^2 if its unit is right.
    """
    marks, numbers = check.marks, check.numbers
    d = stamp_ns - marks[TURN_NS]
    if 0 < d < LONGEST_TURN_NS:
        for i in range(3):
            numbers[TURN + i] += 1e-9 * d * w[i]
    if d > 0 or d < -LONGEST_TURN_NS:  # samples that are a little late leave the turn as it is
        marks[TURN_NS] = stamp_ns
    marks[ROWS] += 1
    weight, square = max(min(MEAN_WEIGHT, limits.period_ns / MEAN_NS), 1.0 / marks[ROWS]), 0.0
    for i in range(3):
        numbers[MEAN_Q + i] += weight * (q[i] - numbers[MEAN_Q + i])
        square += numbers[MEAN_Q + i] ** 2
    if marks[ROWS] < UNIT_ROWS:
        return False
    marks[UNITS] = GOOD
    if GRAVITIES[0] < math.sqrt(square) < GRAVITIES[1]:
        marks[UNITS] = IN_G
    elif marks[WRONG_SIDE] >= UNIT_ROWS:
        marks[UNITS] = ACC_SIGN
    elif numbers[PATH] > SOME_TURN:
        slope = numbers[SHARED] / max(numbers[PREDICTED], 1e-300)
        alike = numbers[SHARED] / math.sqrt(max(numbers[PREDICTED] * numbers[SEEN], 1e-300))
        if numbers[PATH] > WHOLE_TURN and abs(slope) < NO_SLOPE:
            marks[UNITS] = IN_DEG
        elif slope < OTHER_SLOPE and alike < OTHER_WAY:
            marks[UNITS] = GYRO_SIGN
    return bool(marks[UNITS] != GOOD)


@kernel
def check_imu(check: CheckState, limits: CheckLimits, stamp_ns: int, w: Array, q: Array) -> int:
    """Check an inertial sample, and update the check by it, in place; return the code of the result.

    The code is an index in `RESULTS`, the tuple of all `InputResult`.

    Args:
        check: what the check of inputs remembers; changed.
        limits: limits from which an input is refused.
        stamp_ns: stamp of the sample, ns.
        w: gyro, IMU axes, (3,) rad/s.
        q: accelerometer, IMU axes, (3,) m/s^2.
    """
    peak_w, peak_q, same = peak(w), peak(q), 1
    if peak_w == np.inf or peak_q == np.inf:
        return count_result(check, IMU, NONFINITE, stamp_ns)
    if peak_w >= limits.max_gyro or peak_q >= limits.max_acc:
        return count_result(check, IMU, SATURATED, stamp_ns)
    if _wrong_unit(check, limits, stamp_ns, w, q):
        return count_result(check, IMU, UNIT, stamp_ns)
    known, before = check.clocks[IMU, KNOWN], check.clocks[IMU, NEWEST]
    code = _order(check, IMU, stamp_ns)
    if code > RESTART:
        return code
    numbers, marks, square = check.numbers, check.marks, 0.0
    for i in range(3):
        square += q[i] * q[i]
        if w[i] != numbers[LAST_W + i] or q[i] != numbers[LAST_Q + i]:
            same = 0
        numbers[LAST_W + i], numbers[LAST_Q + i] = w[i], q[i]
    marks[EQUAL_ROWS] = marks[EQUAL_ROWS] + 1 if same else 0
    if square > NO_WEIGHT**2 or code == RESTART:
        marks[LIGHT_NS] = FOR_EVER
    elif marks[LIGHT_NS] == FOR_EVER:
        marks[LIGHT_NS] = stamp_ns
    if code != RESTART and known > 0 and stamp_ns - before > limits.gap_ns:
        return count_result(check, IMU, GAP, stamp_ns)
    return code


@kernel
def check_feet(check: CheckState, stamp_ns: int, feet: Array) -> int:
    """Check foot positions `feet` (L, 3) m, IMU axes, and take them into `check`, in place; return the result's code.

    A foot that is not finite is counted; the sample is refused only if no number of it is finite. The code is an index
    in `RESULTS`, the tuple of all `InputResult`.
    """
    some, every, same = False, True, True
    for i in range(feet.shape[0]):
        for k in range(3):
            finite = math.isfinite(feet[i, k])
            some, every, same = some or finite, every and finite, same and feet[i, k] == check.feet[i, k]
    if not some:
        return count_result(check, KINEMATICS, NONFINITE, stamp_ns)
    code = _order(check, KINEMATICS, stamp_ns)
    if code > RESTART:
        return code
    if not every:
        count_result(check, KINEMATICS, NONFINITE, stamp_ns)
    check.marks[EQUAL_FEET] = check.marks[EQUAL_FEET] + 1 if same else 0
    for i in range(feet.shape[0]):
        for k in range(3):
            check.feet[i, k] = feet[i, k]
    return code


@kernel
def check_units(
    check: CheckState, stamp_ns: int, position: Array, rot: Array, contact: Array, foot: Ints, place: Array
) -> None:
    """Compare the inertial unit with the feet, in place, to find wrong units and signs.

    Args:
        check: what the check of inputs remembers; changed.
        stamp_ns: stamp of the feet, ns; those that come late are not compared with the gyro, whose turn has gone on.
        position: foot centres from the IMU, IMU axes, (L, 3) m.
        rot: rot_imu_from_foot, (L, 3, 3).
        contact: probability of contact of each foot, (L,); NaN = unknown, not compared.
        foot: index of the foot of each contact point, (K,).
        place: place of each point from the centre of its foot, foot axes, (K, 3) m.
    """
    marks, numbers, last = check.marks, check.numbers, check.points
    along, away, force = 0.0, 0.0, 0.0
    for i in range(3):
        to_feet = 0.0
        for f in range(contact.size):
            if contact[f] >= 0.5:
                to_feet += position[f, i]
        along += to_feet * numbers[MEAN_Q + i]
        away += to_feet**2
        force += numbers[MEAN_Q + i] ** 2
    above = along > ABOVE * math.sqrt(away * force)
    marks[WRONG_SIDE] = min(marks[WRONG_SIDE] + 1, 2 * UNIT_ROWS) if above else max(marks[WRONG_SIDE] - 1, 0)
    y, _ = points_of(foot, place, position, rot)
    timely = abs(marks[TURN_NS] - stamp_ns) < TIMELY_NS
    if timely:
        _compare_turns(marks, numbers, last, y, contact, foot)
    for k in range(foot.size):
        last[k, 3] = 1.0 if timely and contact[foot[k]] >= 0.5 else 0.0
        for i in range(3):
            last[k, i] = y[k, i]
            numbers[TURN + i] = 0.0


@kernel
def _compare_turns(marks: Ints, numbers: Array, last: Array, y: Array, contact: Array, foot: Ints) -> None:
    """Compare the turn by the gyro with that of contact points that stand, in place.

    Points that stand turn in IMU axes by -theta, theta the integral of the gyro since the last sample: with c the
    points from their mean, p = -theta x c is predicted and s, the change of c, is seen. Faded sums of p.s, p.p and s.s
    over the sum of c.c are kept, rad^2.

    Args:
        marks: counters of the check, (15,).
        numbers: averages of the check, (16,); the sums are changed.
        last: contact points at the last sample, IMU axes, m, and 1 for those that stood, (K, 4).
        y: contact points from the IMU now, IMU axes, (K, 3) m.
        contact: probability of contact of each foot, (L,).
        foot: index of the foot of each point, (K,).
    """
    before, now, count = np.zeros(3), np.zeros(3), 0
    for k in range(foot.size):
        if last[k, 3] > 0.0 and contact[foot[k]] >= 0.5:
            count += 1
            for i in range(3):
                before[i] += last[k, i]
                now[i] += y[k, i]
    if count < 2 or marks[EQUAL_FEET] > 0:
        return
    c, seen, spread = np.empty(3), np.empty(3), 0.0
    shared, predicted, moved = 0.0, 0.0, 0.0
    for k in range(foot.size):
        if last[k, 3] > 0.0 and contact[foot[k]] >= 0.5:
            for i in range(3):
                c[i] = last[k, i] - before[i] / count
                seen[i] = y[k, i] - now[i] / count - c[i]
                spread += c[i] * c[i]
            for i in range(3):
                a, b = (i + 1) % 3, (i + 2) % 3
                p = -(numbers[TURN + a] * c[b] - numbers[TURN + b] * c[a])
                shared += p * seen[i]
                predicted += p * p
                moved += seen[i] * seen[i]
    if spread < SMALLEST:
        return
    numbers[SHARED] = FORGET * numbers[SHARED] + shared / spread
    numbers[PREDICTED] = FORGET * numbers[PREDICTED] + predicted / spread
    numbers[SEEN] = FORGET * numbers[SEEN] + moved / spread
    numbers[PATH] = FORGET * numbers[PATH] + math.sqrt(predicted / spread)
