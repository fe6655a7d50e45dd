"""Landing of the swinging foot, corrected for the estimated tilt of the trunk, so that the sole meets the floor flat.

A trunk that leans by roll r and pitch p puts a sole that is a ahead and l left of the standing one down slanted and l r
- a p too high. It strikes with an edge before its time, the leg goes on stretching and kicks the trunk to the other
side: a robot with weak servos rocks more from step to step until it tips over an outer edge. So the sole is turned back
by the lean w (r, p), its height changed by a part of w (a p - l r), and a foot that touches early is not pressed on.
What was changed fades while both feet bear load, which brings the trunk upright slowly. A strong lean is a push and no
sag: the foot has to come down then, and the weight w falls from 1 to 0 between the tilts at which the next step becomes
shorter.
"""

import math

import numpy as np

from surefoot.arrays import Array

from .params import BipedParams
from .plan import smooth
from .state import BipedState, Mode

HEIGHT = 0.5
"""Part, 0 to 1, of the foot's height error by a leaning trunk that is compensated. The tilt's own error of half a
degree is 1 mm between the feet: with 1.0 two of 24 robots of 1.5 times the usual scatter fall, with 0.3 to 0.7 none."""
TOUCH = 0.6
"""Phase of the swing, 0 to 1, above which a contact counts as a landing; before it the foot may still be leaving the
floor."""


def set_down(s: BipedState, p: BipedParams, soles: Array, double: int) -> tuple[Array, Array]:
    """Return the soles of this tick, the swinging or landed one corrected for trunk tilt, and their turns.

    Args:
        s: state; its landing is updated.
        p: settings.
        soles: planned soles, left and right, (2, 4) x, y (m), yaw (rad), height (m), odom.
        double: ticks of a step in which both feet bear load.

    Returns:
        Soles, (2, 4), and roll and pitch by which the ankles turn each sole back, (2, 2) rad.
    """
    landing, soles, turns = s.landing, soles.copy(), np.zeros((2, 2))
    if s.mode is Mode.STEP and s.step is not None and s.clock > double:
        if s.clock == double + 1:
            landing.height = 0.0
        landing.leg, landing.clock, left = s.step.swing, 0, 1.0
        size = math.hypot(s.tilt[0], s.tilt[1])
        sag = min(1.0, max(0.0, (p.slow_full_rad - size) / (p.slow_full_rad - p.slow_from_rad)))
        landing.turn = smooth(2.0 * s.progress) * sag * s.tilt
    else:
        landing.clock += 1
        left = max(0.0, 1.0 - landing.clock / double)
    leg, (roll, pitch) = landing.leg, left * landing.turn
    away, c, n = soles[leg] - soles[1 - leg], math.cos(s.trunk[2]), math.sin(s.trunk[2])
    soles[leg, 3] += HEIGHT * (pitch * (c * away[0] + n * away[1]) - roll * (c * away[1] - n * away[0]))
    if left == 1.0 and s.progress > TOUCH and landing.height == 0.0 and s.contacts[leg]:
        landing.height = soles[leg, 3]
    soles[leg, 3] = max(soles[leg, 3], left * landing.height)
    turns[leg] = roll, pitch
    return soles, turns
