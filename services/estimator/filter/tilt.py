"""Correction of the tilt where a rest, the first steps after a rest, or a lost velocity contradict it."""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear_kernels import times, turned
from surefoot.kernels.jit import kernel

from ..params import UNKNOWN_SPEED, UNKNOWN_TURN, UNKNOWN_WAY
from .ground import forget_levels
from .hypotheses import collapse, likeliest
from .layout import DOUBTED, LONG_AGO, STARTED, E, M, P, S, X
from .noise import FIXED, BestSetting
from .point import lift
from .samples import ROW_Q
from .state import BestState, forget_velocity, isolate, rotation, set_rotation, turn_matrix


@kernel
def _turn_up(state: BestState, setting: BestSetting, ahead: float, side: float, up: float, sd: float) -> None:
    """Turn the attitude so that a vector in odom, of any length and unit, points up, in place.

    Tilt and accelerometer bias are unknown again, and the feet are trusted. Heading, position and gyro bias stay, but
    how a robot turned that was knocked over unseen, and where it rolled to, is not known.

    Args:
        state: state of the filter; changed; its start counts as in motion after a wrong tilt.
        setting: geometry, noises and limits of the filter.
        ahead: component of the vector along x of odom.
        side: component along y of odom.
        up: component along z of odom.
        sd: standard deviation of the new tilt, rad.
    """
    memory, level = state.memory, math.sqrt(ahead * ahead + side * side)
    angle = math.atan2(level, up)
    turn = turn_matrix(np.array([side / level * angle, -ahead / level * angle, 0.0]))
    rot = times(turn, rotation(state.x))
    for k in range(state.points.shape[0]):
        lift(state, k)
        state.points[k, P.mistrust] = 0.0  # no foot could fit
    set_rotation(state.x, rot)
    for i in range(3):
        state.x[X.acc_bias + i] = 0.0
    isolate(state.cov, E.acc_bias, 3, setting.limits.acc_bias_sd**2)
    isolate(state.cov, E.rot, 2, sd**2)
    if math.cos(angle) < FIXED.upright:  # it was knocked over unseen
        state.cov[E.rot + 2, E.rot + 2] += UNKNOWN_TURN**2
        for i in range(3):
            state.cov[E.pos + i, E.pos + i] += UNKNOWN_WAY**2
    memory[M.phase], memory[M.age], memory[M.excess] = DOUBTED, 0.0, 1.0
    memory[M.lost_for] = memory[M.woke] = LONG_AGO


@kernel
def _turn_by_change(state: BestState, setting: BestSetting, ahead: float, side: float, up: float, time: float) -> bool:
    """Turn the attitude so that the mean specific force by the inertial unit alone points up, in place.

    Return False if nothing was turned. A robot that falls loses its velocity, too: its specific force is not that of
    one that stands, and its tilt by the gyro is right.

    Args:
        state: state of the filter; changed.
        setting: geometry, noises and limits of the filter.
        ahead: change of the velocity by the inertial unit along x of odom, m/s.
        side: along y of odom, m/s.
        up: along z of odom, m/s, gravity subtracted.
        time: in which it changed, s.
    """
    up += GRAVITY * time
    force, upright = math.sqrt(ahead * ahead + side * side + up * up) / time, 0.0
    for i in range(3):
        upright += state.x[X.rot + 6 + i] * setting.geometry.rot_base_from_imu[2, i]
    if abs(force - GRAVITY) > FIXED.falling * GRAVITY or upright < FIXED.upright:
        return False
    _turn_up(state, setting, ahead, side, up, FIXED.tilted_sd)
    return True


@kernel
def check_rest(state: BestState, rows: Array, setting: BestSetting) -> None:
    """Correct a tilt that the accelerometer of a robot at rest contradicts, in place.

    A robot that was knocked over faster than its gyro can measure lies still, and no foot shows its tilt. The estimated
    bias of the accelerometer is not subtracted: it may contain the error of the tilt.

    Args:
        state: state of the filter; changed.
        rows: samples of the rest, gyro rad/s (3) and accelerometer m/s^2 (3), IMU axes, (n, 6).
        setting: geometry, noises and limits of the filter.
    """
    limits, mean = setting.limits, np.zeros(3)
    for r in range(rows.shape[0]):
        for i in range(3):
            mean[i] += rows[r, ROW_Q + i] / rows.shape[0]
    force = turned(rotation(state.x), mean)
    length = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
    level = math.sqrt(force[0] ** 2 + force[1] ** 2)
    most = math.sqrt(FIXED.tilted**2 + (FIXED.contradiction * limits.acc_bias_sd) ** 2)
    if abs(length - GRAVITY) > FIXED.falling * GRAVITY or (force[2] > 0.0 and level < most):
        return
    if level == 0.0:  # upside down
        force[0] = level = 1e-9
    _turn_up(state, setting, force[0], force[1], force[2], limits.acc_bias_sd / GRAVITY)
    forget_velocity(state, FIXED.good_speed)
    forget_levels(state.memory)
    state.memory[M.phase] = STARTED


@kernel
def check_tilt(state: BestState, setting: BestSetting, lost: bool) -> None:
    """Correct the tilt if the velocity is lost repeatedly, or once and feet have been left out since, in place.

    If the tilt is wrong by the angle a, the velocity by the inertial unit leaves that of the feet with 9.81 sin a m/s^2
    until it is lost, repeatedly. If a is small, it is lost once, and then feet are taken to be faulty. The mean
    specific force in odom since the first loss, in the second case less the change of the velocity, points up within
    the accelerations of a walk.

    Args:
        state: state of the filter after a sample of the feet; changed.
        setting: geometry, noises and limits of the filter.
        lost: the velocity is lost by this sample; else `lost_memory` = 1 s has passed since the first loss.
    """
    memory, time = state.memory, state.memory[M.lost_for]
    if time < 0.0:
        memory[M.lost_for], memory[M.woke] = 0.0, LONG_AGO
        for i in range(3):
            memory[M.push + i] = 0.0
        return
    ahead, side, up = memory[M.push], memory[M.push + 1], memory[M.push + 2]
    if time > FIXED.lost_memory:
        memory[M.lost_for] = LONG_AGO
        blamed = np.max(state.points[:, P.mistrust]) > FIXED.most_mistrust
        if lost or not blamed or time > FIXED.lost_memory + FIXED.longest_gap:
            return
        ahead, side = ahead - state.x[X.vel] - memory[M.ran], side - state.x[X.vel + 1] - memory[M.ran + 1]
        up, time = up - state.x[X.vel + 2] - memory[M.ran + 2], time - FIXED.tilted_for
    if time >= FIXED.tilted_for and ahead * ahead + side * side >= (FIXED.tilted * time) ** 2:
        _turn_by_change(state, setting, ahead, side, up, time)


@kernel
def check_start(state: BestState, contact: Array, dt: float, setting: BestSetting) -> None:
    """Correct the tilt of a rest that the first steps after it contradict, in place.

    A wrong tilt adds velocity in one direction, which the feet correct, so that the excess of the inertial noise rises
    before the velocity is lost: in the second after a rest to 2 at most if the tilt is right, above 3 within 0.3 s if
    it is 5 deg wrong. Let d be the velocity that the inertial unit has gained in the time t since the rest, less the
    velocity by the foot that agrees best. A wrong tilt makes it grow as d = a t with a = 9.81 sin of the error, while
    feet that land, or whose samples are late, make it oscillate. By least squares a = S(t d)/S(t^2), and
    a^2 S(t^2)/S(d^2) is the share of d that grows linearly, S the sum over samples. Nothing is corrected while a sensor
    of a leg is suspected: a swinging foot whose switch stays closed looks like a wrong tilt.

    Args:
        state: state of the filter after a sample of the feet; changed.
        contact: probability that each contact point stands, (K,).
        dt: time since the last sample of the feet, s.
        setting: geometry, noises and limits of the filter.
    """
    foot, at, memory = setting.geometry.foot, likeliest(state), state.memory
    likely = memory if at < 0 else state.mode_memory[at]
    push, wrong, time = likely[M.push : M.push + 3], memory[M.wrong : M.wrong + 4], memory[M.age] - memory[M.woke]
    nearest, least, suspected = 0, math.inf, False
    for k in range(foot.size):
        sensors = state.sensors[foot[k]]
        suspected |= sensors[S.against] > 0.5 * FIXED.most_against
        suspected |= np.max(sensors[S.switch : S.still + 1]) > FIXED.suspected
        square = (push[0] - sensors[S.trunk]) ** 2 + (push[1] - sensors[S.trunk + 1]) ** 2
        if contact[k] >= 0.5 and square < least:  # not of a foot that has not been seen yet: NaN
            nearest, least = foot[k], square
    if least == math.inf or time <= 0.0 or dt <= 0.0:
        return
    for i in range(2):
        wrong[i] += dt * time * (push[i] - state.sensors[nearest, S.trunk + i])
    wrong[2] += dt * time * time
    wrong[3] += dt * least
    state.mode_memory[:, M.wrong : M.wrong + 4] = wrong  # the state takes its memory from one of them
    ahead, side, grown = wrong[0] / wrong[2], wrong[1] / wrong[2], wrong[0] ** 2 + wrong[1] ** 2
    if suspected or time < FIXED.woken_least_s or likely[M.excess] < FIXED.woken_excess:
        return
    if grown > max((FIXED.woken_speed * wrong[2] / time) ** 2, FIXED.woken_straight * wrong[2] * wrong[3]):
        collapse(state, foot)
        memory[M.woke] = LONG_AGO
        if _turn_by_change(state, setting, ahead, side, 0.0, 1.0):
            forget_velocity(state, UNKNOWN_SPEED)
