"""Switches of the feet: which of them contradict motion or height of their feet, and which are swapped."""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel

from .layout import H, S
from .noise import FIXED

Feet = NDArray[np.int64]


@kernel
def rewired(contact: Array, sensors: Array, foot: Feet) -> Array:
    """Return the contact of all points with the switches of two swapped feet exchanged.

    Args:
        contact: probability of contact of each point, (K,); equal for all points of a foot.
        sensors: numbers of the sensors of each foot, (K, 38), columns as in `SensorLayout`; `wired` is the foot whose
            switch the foot gets.
        foot: index of the foot of each point, (K,).

    Returns:
        Probability of contact of each point, (K,).
    """
    out = contact.copy()
    for k in range(foot.size):
        if int(sensors[foot[k], S.wired]) != foot[k]:
            for m in range(foot.size):
                if foot[m] == int(sensors[foot[k], S.wired]):
                    out[k] = contact[m]
    return out


@kernel
def swap_switches(sensors: Array) -> None:
    """Exchange the switches of the two feet of a biped, in place, and forget what contradicted them.

    Args:
        sensors: numbers of the sensors of each foot, (K, 38), columns as in `SensorLayout`; changed.
    """
    sensors[0, S.wired], sensors[1, S.wired] = sensors[1, S.wired], sensors[0, S.wired]
    sensors[:2, S.against] = sensors[:2, S.switch] = sensors[:2, S.same] = 0.0


@kernel
def judge_switches(sensors: Array, size: Array, contact: Array, dt: float, flies: bool, aloft: bool) -> None:
    """Learn which switches contradict the motion of their feet beside that of the others, in place.

    Args:
        sensors: numbers of the sensors of each foot, (K, 38), columns as in `SensorLayout`; mistrust in switches, and
            which two are swapped, are changed.
        size: logarithm of the motion, m/s, that each foot shows beside the inertial unit, (L,); NaN: not known.
        contact: probability that each foot touches the ground, (L,).
        dt: time since the last sample of the feet that was compared, s.
        flies: True if the robot shows no weight, so that no foot stands whose switch is open.
        aloft: True if the robot shows its weight while no switch is closed: one is wrong, half the contradiction
            suffices.
    """
    for f in range(size.size):
        # one that stands is compared with the middle of two means: of all others, and of those of them that stand
        stands, others, closed, total, firm = contact[f] >= 0.5, 0, 0, 0.0, 0.0
        for g in range(size.size):
            if g != f and not math.isnan(size[g]):
                others, total = others + 1, total + size[g]
                if contact[g] >= 0.5:
                    closed, firm = closed + 1, firm + size[g]
        more = 0.0
        if others > 0 and not (math.isnan(contact[f]) or math.isnan(size[f])):
            usual = total / others
            more = size[f] - (0.5 * (usual + firm / closed) if stands and closed > 0 else usual)
            more = min(more if stands else -more, 0.0 if flies and not stands else FIXED.most_more)
        against = sensors[f, S.against] + min(dt / FIXED.against_s, 1.0) * (more - sensors[f, S.against])
        sensors[f, S.against] = max(against, -FIXED.most_right) if size.size == 2 else against
        same = sensors[f, S.same]
        sensors[f, S.same] = max(same, 0.0) + dt if stands else min(same, 0.0) - dt
    wrong = 0
    for f in range(size.size):
        wrong += sensors[f, S.against] > FIXED.most_against
    sound = np.max(sensors[:, S.jump : S.still + 1]) <= FIXED.suspected and np.max(sensors[:, S.held]) == 0.0
    leaps = np.max(sensors[:, S.leap]) > 2.0 * FIXED.jump  # then jumps are taken for wrong switches
    if size.size == 2 and wrong == 2 and sound and not leaps:
        swap_switches(sensors)
    for f in range(size.size):  # one alone hangs, and has not changed meanwhile, or is inverted
        against, alone = sensors[f, S.against], wrong == 1 and abs(sensors[f, S.same]) < FIXED.against_s
        share = 0.5 if aloft and contact[f] < 0.5 else 2.0 if alone else 1.0
        if against > share * FIXED.most_against:
            sensors[f, S.switch] = 1.0


@kernel
def _learn_height(own: Array, over: float, closed: int, dt: float) -> float:
    """Learn the height of foot 0 over foot 1 while both stand, in place; return the present height less it, m.

    Another height counts once they have shown it for a while: one of them may be in the air, and its switch hang.

    Args:
        own: what is known of that height, (8,), laid out as in `HeightLayout`; changed.
        over: the height now, m; NaN: not known.
        closed: closed switches, bit f for foot f.
        dt: time since the last sample, s.
    """
    last, rise = own[H.closed], over - own[H.over]
    if math.isnan(over) or (0 < closed < 3 and last != 3.0 and last != closed):  # it may have leapt to other ground
        own[H.known] = 0.0
    if closed > 0:
        own[H.closed] = -1.0 if math.isnan(over) else closed
    if closed < 3:
        return rise
    own[H.opened] = 0.0
    if last != 3.0:
        own[H.known], own[H.other], own[H.steady] = 0.0, over, 0.0
    if abs(rise) <= 0.5 * FIXED.risen:
        own[H.over] += min(dt / FIXED.against_s, 1.0) * rise
        own[H.known] = 1.0
    elif own[H.known] == 0.0:
        same = abs(over - own[H.other]) < 0.5 * FIXED.risen
        own[H.other], own[H.steady] = (own[H.other], own[H.steady] + dt) if same else (over, 0.0)
        if own[H.steady] >= FIXED.against_s:
            own[H.over], own[H.known], rise = over, 1.0, 0.0
    return rise


@kernel
def judge_heights(own: Array, sensors: Array, over: float, contact: Array, dt: float, shows: bool) -> None:
    """Learn which switches of two feet contradict the height of one over the other, in place.

    While both stand, that height does not change, whatever the ground. A foot that rises over the other does not stand:
    its switch hangs if both are closed, that of the other if both are open while the robot shows its weight. If only
    the upper foot has its switch closed, and the other has not been above since it opened, they are swapped.

    Args:
        own: what is known of that height, (8,), mixed units, laid out as in `HeightLayout`; changed.
        sensors: numbers of the sensors of each foot, (K, 38), columns as in `SensorLayout`; mistrust in switches, and a
            swap of both, are changed.
        over: height of foot 0 over foot 1, m; NaN: not known.
        contact: probability that each foot touches the ground, (2,).
        dt: time since the last sample, s.
        shows: True if the robot shows its weight.
    """
    closed = (1 if contact[0] >= 0.5 else 0) + (2 if contact[1] >= 0.5 else 0)
    rise, swapped = _learn_height(own, over, closed, dt), 0 < closed < 3
    if swapped:
        rise = rise if closed == 1 else -rise
        own[H.opened] = max(own[H.opened], -rise)
    unsure = (swapped and (rise < 0.0 or own[H.opened] >= FIXED.lifted)) or (closed == 0 and not shows)
    if unsure or not own[H.known] > 0.0 or not abs(rise) > FIXED.risen:
        own[H.alike] = own[H.lasts] = 0.0
        return
    own[H.lasts] += dt if own[H.alike] > 0.0 else 0.0
    own[H.alike] = 1.0
    f = 0 if (rise > 0.0) == (closed == 3) else 1
    wrong, other = sensors[f, S.switch] > FIXED.most_mistrust, sensors[1 - f, S.switch] > FIXED.most_mistrust
    if own[H.lasts] < FIXED.rises_s or (wrong != other and (swapped or other)):
        return
    if swapped:
        swap_switches(sensors)
        own[H.known] = own[H.closed] = own[H.alike] = own[H.lasts] = 0.0
    elif not other:
        sensors[f, S.switch] = 1.0
