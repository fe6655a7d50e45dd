"""Monitor of the sensors of the legs: which switch or encoder contradicts the inertial unit and the other feet.

A foot f that stands shows the velocity u_f of the trunk, and a foot that stands all the time shows its changes as the
inertial unit does. What it shows beside them, forgotten in T, does not depend on the velocity of the filter, which a
wrong foot may have spoilt:

    u_f = -R (y_k - E y_(k-1))/d,   e_f = exp(-d/T) e_f + u_f,k - u_f,k-1 - R (q - b_q) d + G d

y seen from the IMU, E its turn by the gyro. l_f = log |e_f| (level parts count less, for feet slide; the noise of the
encoders is added) against the mean of the other feet shows whether f moves more than they do. A switch is wrong whose
foot moves more while it is closed, or less while it is open: with c = 1 closed, -1 open, the mean of c (l_f - l_others)
over some tenths of a second. One such foot has a switch that hangs, and so has not changed meanwhile, or contradicts it
twice as much; two have switches that are swapped. While the robot shows no weight, no open switch is wrong. A foot
whose encoders always jump as its switch changes, and then without it, has a wrong switch, too.

The contact of a foot whose switch is wrong is decided by its height. A foot whose encoders stand still is left out,
samples of swapped feet are exchanged. Jumps are outliers, which the filter leaves out one by one; of more than two feet
the one that jumps is left out. All results depend on the samples and their stamps only, not on their order of arrival.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear_kernels import turned
from surefoot.kernels.jit import kernel

from ..inputs.check import ABOVE
from .delay import learn_delay, lift_delay
from .encoders import exchanged, jumped, learn_repeats, unknown
from .hypotheses import likeliest, mode
from .layout import HEIGHTS, L, M, P, S, X
from .noise import FIXED
from .samples import ROW_Q, ROW_W, SampleStore, after
from .state import BestState, rotation, turn_matrix
from .switches import judge_heights, judge_switches, rewired

Feet = NDArray[np.int64]

STILL_SHARE = 0.25
"""Share of the square of the way of a standing foot, as the gyro predicts it, below which the legs are still."""
FALL_S = 0.7
"""Least time, s, in which `CARRIED_TURN` is reached: a fall with still legs is over by then."""
LEAST_TURN = 0.03
"""Rate of turning, rad/s, below which no legs count as still: the gyro's bias may show it."""
CARRIED_TURN = 0.1
"""Angle turned with still legs and open switches, rad, from which on a robot counts as carried."""


@kernel
def _swung(rot: Array, turn: Array, y: Array, dt: float) -> Array:
    """Return the velocity R (w x y), (3,) m/s, of a place y that turns at the rate w = -turn/dt.

    Args:
        rot: R, rot_odom_from_imu, (3, 3).
        turn: rotation against that of the IMU over the step, IMU axes, (3,) rad.
        y: place from the IMU, IMU axes, (3,) m.
        dt: length of the step, s.
    """
    out = np.empty(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] = (turn[k] * y[j] - turn[j] * y[k]) / dt
    return turned(rot, out)


@kernel
def _below(rot: Array, feet: Array) -> bool:
    """Return True if the feet (L, 3), m, IMU axes, are below the IMU on average; `rot`: rot_odom_from_imu (3, 3).

    The feet of a robot that lies move freely while switches or heights take some of them for standing.
    """
    mean = np.zeros(3)
    for f in range(feet.shape[0]):
        if not math.isnan(feet[f, 0] + feet[f, 1] + feet[f, 2]):
            for i in range(3):
                mean[i] += feet[f, i]
    return bool(turned(rot, mean)[2] < -ABOVE * math.sqrt(mean[0] ** 2 + mean[1] ** 2 + mean[2] ** 2))


@kernel
def _learn_noise(memory: Array, seen: Array, dt: float) -> None:
    """Learn the noise of contact points from a foot that stands, in place.

    Three places at equal steps dt that err by sigma change the velocity by sqrt(6) sigma/dt; slides and landings are
    large and few, so that the logarithm is averaged: log |s| of a level s has the mean log sigma - 0.289.

    Args:
        memory: `BestState.memory`, (124,); the sums of the logarithm and of the time are changed.
        seen: change of the trunk's velocity by the foot beyond that by the inertial unit, odom axes, (3,) m/s.
        dt: length of each step, s.
    """
    square = (seen[0] ** 2 + seen[1] ** 2) * dt * dt / 12.0 + FIXED.least_way**2
    memory[M.legs] += dt * (0.5 * math.log(square) + 0.289)
    memory[M.legs + 1] += dt


@kernel
def judge_noise(state: BestState, stated: float) -> None:
    """Lower the noise of a contact point to what standing feet show, in place.

    Args:
        state: state of the filter; the factor of the noise in its memory, and in that of its hypotheses, is changed.
        stated: stated noise of a contact point, standard deviation, m.
    """
    memory = state.memory
    if memory[M.legs + 1] < FIXED.least_legs_s:
        return
    shown = math.exp(memory[M.legs] / memory[M.legs + 1])
    memory[M.shown + 2] = min(max(FIXED.sure_point, FIXED.more_point * shown) / stated, 1.0)
    for h in range(state.weight.size):
        state.mode_memory[h, M.shown + 2] = memory[M.shown + 2]


@kernel
def carried(memory: Array) -> bool:
    """Return True if the robot has turned with still legs and open switches: it is carried, its switches are right.

    Feet that stand move, seen from a trunk that turns. `memory`: `BestState.memory`, (124,).
    """
    return bool(memory[M.carried] > CARRIED_TURN)


@kernel
def _held_turn(sensors: Array, samples: SampleStore, row: int, before: int, turn: Array, dt: float) -> float:
    """Return the angle, rad, by which a robot turned with still legs between two rows of the feet.

    It is limited to the rate of `CARRIED_TURN` in `FALL_S`. Below 0: with legs that moved; 0: it hardly turned.

    Args:
        sensors: numbers of the sensors of each foot, (L, 38), columns as in `SensorLayout`.
        samples: stored samples.
        row: index of the later row.
        before: index of the earlier row.
        turn: rotation against that of the IMU between them, IMU axes, (3,) rad.
        dt: time between the rows, s.
    """
    angle, back = math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2), turn_matrix(turn)
    if angle < LEAST_TURN * dt:
        return 0.0
    moved, swung, along, count = 0.0, 0.0, 0.0, samples.feet.shape[1]
    for f in range(count):
        was = samples.feet[before, int(sensors[f, S.compared])]
        old = turned(back, was)
        for i in range(3):
            now, then = samples.feet[row, int(sensors[f, S.source]), i] - was[i], old[i] - was[i]
            moved, swung, along = moved + now * now, swung + then * then, along + now * then
    still = along < 0.5 * swung and moved < STILL_SHARE * swung + count * (FIXED.unsure_speed * dt) ** 2
    return min(angle, CARRIED_TURN / FALL_S * dt) if still else -angle


@kernel
def _size(motion: Array) -> float:
    """Return the logarithm of the size, m/s, of a foot's motion (3,) m/s beside the inertial unit, odom axes.

    Level motion counts less, and to a limit: feet slide, and a fast swing is felt until after they have landed.
    """
    level = FIXED.level_share * (motion[0] ** 2 + motion[1] ** 2)
    return 0.5 * math.log(FIXED.unsure_speed**2 + min(level, FIXED.most_level**2) + motion[2] ** 2)


@kernel
def _compare(state: BestState, likely: BestState, samples: SampleStore, row: int, before: int, contact: Array) -> None:
    """Compare each switch with the motion of its foot from row `before` of the feet to `row`, in place.

    `state`: sensors and memory are changed; `likely`: its likeliest hypothesis, or itself; `samples`: filled rows;
    `contact`: probability that each foot touches the ground, (L,).
    """
    x, sensors, stamps = likely.x, state.sensors, samples.imu_stamps
    first, last = after(stamps, samples.feet_stamps[before]), after(stamps, samples.feet_stamps[row] - 1)
    end, dt = min(last + 1, stamps.size), 1e-9 * (samples.feet_stamps[row] - samples.feet_stamps[before])
    if first >= end or dt > FIXED.longest_compared:
        sensors[:, S.trunk : S.trunk + 3] = math.nan
        sensors[:, S.firm] = sensors[:, S.delay + L.stood] = 0.0
        return
    w, q, half = np.zeros(3), np.zeros(3), np.zeros(3)
    for i in range(3):
        for at in range(first, end):
            w[i] += samples.imu[at, ROW_W + i] / (end - first)
            q[i] += samples.imu[at, ROW_Q + i] / (end - first)
        w[i], q[i] = -dt * (w[i] - x[X.gyro_bias + i]), q[i] - x[X.acc_bias + i]
        half[i] = 0.5 * w[i]
    rot, back = rotation(x), turn_matrix(w)
    push, count = turned(rot, turned(turn_matrix(half), q)), samples.feet.shape[1]
    flies = push[0] ** 2 + push[1] ** 2 + push[2] ** 2 < (0.5 * GRAVITY) ** 2
    push[2] -= GRAVITY
    gained, share = push * dt, math.exp(-dt / FIXED.delay_s)
    steady = 1e-9 * (stamps[end - 1] - stamps[max(end - 2, 0)]) < FIXED.delay_period and _below(rot, samples.feet[row])
    size, seen, fade = np.zeros(count), np.empty(3), math.exp(-dt / FIXED.strange_s)
    state.memory[M.legs : M.legs + 2] *= math.exp(-dt / FIXED.legs_s)
    for f in range(count):
        source = int(sensors[f, S.source])
        old = turned(back, samples.feet[before, int(sensors[f, S.compared])])
        for i in range(3):
            seen[i] = (old[i] - samples.feet[row, source, i]) / dt
        trunk, length = turned(rot, seen), 0.0
        for i in range(3):
            seen[i] = trunk[i] - sensors[f, S.trunk + i] - gained[i]
            length += seen[i] ** 2
            sensors[f, S.trunk + i] = trunk[i]
        for i in range(3):
            sensors[f, S.strange + i] = fade * sensors[f, S.strange + i] + (
                seen[i] if length < FIXED.most_strange**2 else 0.0
            )
        size[f] = _size(sensors[f, S.strange : S.strange + 3])
        if unknown(samples.feet, row, source):
            sensors[f, S.trunk] = math.nan
        sensors[f, S.firm] = sensors[f, S.firm] + 1.0 if contact[f] >= 0.5 else 0.0
        if sensors[f, S.firm] >= 3.0 and not math.isnan(length) and not math.isnan(sensors[f, S.trunk]):
            _learn_noise(state.memory, seen, dt)
        if steady and contact[f] >= 0.5 and not math.isnan(sensors[f, S.trunk]):
            learn_delay(sensors[f], trunk, gained, _swung(rot, w, samples.feet[row, source], dt), dt, share)
        else:
            lift_delay(sensors[f], share)
        if max(sensors[f, S.jump], sensors[f, S.still]) > FIXED.most_mistrust or math.isnan(sensors[f, S.trunk]):
            size[f] = math.nan
    hangs = bool(np.max(contact) < 0.5) and not flies and _below(rot, samples.feet[row])  # NaN: not known
    held = _held_turn(sensors, samples, row, before, w, dt) if hangs else -math.inf
    state.memory[M.carried] = max(0.0, state.memory[M.carried] + held)
    judge_switches(sensors, size, contact, dt, flies, state.memory[M.aloft] > 0.5 * FIXED.longest_aloft)


@kernel
def _weigh(memory: Array, sensors: Array, contact: Array, foot: Feet, dt: float) -> None:
    """Learn for how long no contact point has touched the ground though the robot shows its weight, in place.

    A robot that flies shows no weight. One that stands or is carried does. A switch that is known to hang explains it.

    Args:
        memory: `BestState.memory`, (124,); changed.
        sensors: numbers of the sensors of each foot, (K, 38), columns as in `SensorLayout`.
        contact: probability that each contact point touches the ground, (K,); NaN counts as touching.
        foot: index of the foot of each point, (K,).
        dt: time since the last sample of the feet, s.
    """
    force, stands = 0.0, False
    for i in range(3):
        force += memory[M.last_acc + i] ** 2
    memory[M.weight] += min(dt / FIXED.weight_s, 1.0) * (math.sqrt(force) - memory[M.weight])
    for k in range(contact.size):
        stands = stands or not contact[k] < 0.5 or sensors[foot[k], S.switch] > FIXED.most_mistrust
    memory[M.aloft] = 0.0 if stands or memory[M.weight] < 0.5 * GRAVITY else memory[M.aloft] + dt


@kernel
def _learn_jump(own: Array, samples: SampleStore, row: int, point: int) -> None:
    """Learn from a row of the feet whether a foot's encoders jumped, in place.

    Feet of a generated walk jump to where they land. One that does so again and again, as its switch changes, and then
    jumps half as far without it, has a wrong switch.

    Args:
        own: numbers of the sensors of the foot, (38,), columns as in `SensorLayout`; changed.
        samples: stored samples, filled rows only.
        row: index of the sample of the feet.
        point: a contact point whose switch, in the samples, is that of the foot.
    """
    way, leap = jumped(samples, row, int(own[S.source]), point, own[S.leap]), own[S.leap]
    if way < 0.0:
        own[S.leap] -= 0.5 * (way + leap)
    elif way > 0.0 and leap > 2.0 * FIXED.jump and way > 0.5 * leap:
        own[S.switch] = 1.0
    elif way > 0.0:
        own[S.jump] = 1.0
        own[S.strange : S.against + 1] = 0.0


@kernel
def _over(rot: Array, sensors: Array, feet: Array, row: int) -> float:
    """Return the height of foot 0 over foot 1, m, in one sample; NaN: encoders are suspected or unknown.

    Args:
        rot: rot_odom_from_imu, (3, 3).
        sensors: numbers of the sensors of each foot, (K, 38), columns as in `SensorLayout`.
        feet: positions of two feet, (N, 2, 3) m, IMU axes.
        row: index of the sample.
    """
    over = 0.0
    for f in range(2):
        source = int(sensors[f, S.source])
        if unknown(feet, row, source) or max(sensors[f, S.jump], sensors[f, S.still]) > FIXED.suspected:
            return math.nan
        for i in range(3):
            over += (1.0 - 2.0 * f) * rot[2, i] * feet[row, source, i]
    return over


@kernel
def watch_sensors(state: BestState, samples: SampleStore, row: int, foot: Feet, settled: bool) -> None:
    """Learn from a row of the feet which sensors of the legs are wrong, in place.

    Args:
        state: state of the filter at the time of the row; numbers of its sensors and memory are changed.
        samples: stored samples, filled rows only.
        row: index of the sample of the feet.
        foot: index of the foot of each contact point, (K,).
        settled: True if the attitude is known, so that switches can be checked.
    """
    sensors, count, memory = state.sensors, samples.feet.shape[1], state.memory
    at = likeliest(state)
    likely = state if at < 0 else mode(state, at)
    memory[M.watched] = min(memory[M.watched] + 1.0, float(row))
    if row < 1:
        memory[M.usual_gyro : M.usual_gyro + 3] = memory[M.last_gyro : M.last_gyro + 3]
        return
    contact, turn, beside, switches = np.zeros(count), 0.0, 0.0, rewired(samples.contact[row], sensors, foot)
    dt = 1e-9 * (samples.feet_stamps[row] - samples.feet_stamps[row - 1])
    _weigh(memory, sensors, samples.contact[row], foot, dt)
    fade = math.exp(-FIXED.forget_fault * dt)
    for f in range(count):
        for i in (S.switch, S.still, S.jump):
            sensors[f, i] *= fade
    for k in range(foot.size):
        contact[foot[k]] = switches[k]
        if k == 0 or foot[k] != foot[k - 1]:
            _learn_jump(sensors[int(sensors[foot[k], S.wired])], samples, row, k)
    for i in range(3):
        turn += (memory[M.last_gyro + i] - likely.x[X.gyro_bias + i]) ** 2
        memory[M.usual_gyro + i] += min(dt / FIXED.usual_s, 1.0) * (memory[M.last_gyro + i] - memory[M.usual_gyro + i])
        beside += (memory[M.last_gyro + i] - memory[M.usual_gyro + i]) ** 2
    learn_repeats(sensors, samples, row, contact, math.sqrt(turn), math.sqrt(beside))
    for f in range(count):
        g = exchanged(samples.feet, row, f)
        if g > f:
            sensors[f, S.source], sensors[g, S.source] = sensors[g, S.source], sensors[f, S.source]
    if count == 2 and settled and np.max(sensors[:2, S.held]) == 0.0:
        over = _over(rotation(likely.x), sensors, samples.feet, row)
        shows = memory[M.weight] >= 0.5 * GRAVITY
        judge_heights(memory[M.heights : M.heights + HEIGHTS], sensors, over, contact, dt, shows)
    before = row - int(memory[M.watched])
    if 1e-9 * (samples.feet_stamps[row] - samples.feet_stamps[before]) >= FIXED.least_step:
        memory[M.watched] = 0.0
        if settled:
            _compare(state, likely, samples, row, before, contact)
            if carried(memory):  # its switches are right
                sensors[:, S.against] = sensors[:, S.switch] = 0.0
        sensors[:, S.compared] = sensors[:, S.source]


@kernel
def believed(state: BestState, samples: SampleStore, row: int, foot: Feet) -> Array:
    """Return the probability of contact of each point (K,) in a row of the feet, as the checks of the sensors leave it.

    NaN (unknown): the switch of the foot is wrong, or all switches have been open for too long while the robot shows
    its weight, and it is not carried. 0 (left out): the encoders of the foot stand still, its samples do not fit, or
    (of more than two feet) they have jumped. A wrong switch explains why samples do not fit.

    Args:
        state: state of the filter; the mistrust in each point, 0 to 1, from which this follows, is changed.
        samples: stored samples.
        row: index of the sample of the feet.
        foot: index of the foot of each point, (K,).
    """
    contact, at = rewired(samples.contact[row], state.sensors, foot), likeliest(state)
    points = state.points if at < 0 else state.mode_points[at]
    if state.memory[M.aloft] > FIXED.longest_aloft:
        contact[:] = math.nan
    worst = np.zeros(samples.feet.shape[1])
    for k in range(foot.size):
        worst[foot[k]] = max(worst[foot[k]], points[k, P.mistrust])
    for k in range(foot.size):
        mistrust = worst[foot[k]]
        if state.sensors[foot[k], S.switch] > FIXED.most_mistrust:
            contact[k], mistrust = math.nan, 0.0
        still, jump = state.sensors[foot[k], S.still], state.sensors[foot[k], S.jump]
        jump = jump if samples.feet.shape[1] > FIXED.most_feet else 0.0
        if max(mistrust, still, jump) > FIXED.most_mistrust:
            contact[k] = 0.0
        if mistrust > FIXED.most_mistrust and points[k, P.down] > 0.0:
            mistrust = 1.0
        state.points[k, P.mistrust] = mistrust
        for h in range(state.weight.size):
            state.mode_points[h, k, P.mistrust] = mistrust
    if carried(state.memory):
        contact[:] = 0.0
    return contact
