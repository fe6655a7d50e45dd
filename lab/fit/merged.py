"""Reduction of the events of a recording: motions, and frames, between two landmark sightings are joined."""

import numpy as np

from surefoot.arrays import Array

WHOLE = 1.0 + 1e-9
"""Largest sum of the shares of one action that are joined into one motion (1 = the whole action)."""


def merged(events: Array) -> Array:
    """Return the events of a recording, with motions and frames between two sightings joined.

    Successive motions of one action become one motion, up to the whole action: the filter's prediction uses the heading
    at half of a motion, so that the result differs only by second-order terms of the noise. Camera errors that decay
    with exp(-t / fade) decay over the sum of the frame times.

    Args:
        events: motions (0, action, share), frames (1, s since the last) and sightings (2, ...) of a recording, (n, 6).

    Returns:
        The joined events, (m, 6), m <= n; events after the last sighting are left out.
    """
    out: list[Array] = []
    moves: list[Array] = []
    waited = np.zeros(events.shape[1])
    waited[0] = 1.0
    for row in events:
        if row[0] == 0.0:
            last = moves[-1] if moves else None
            if last is not None and last[1] == row[1] and last[2] + row[2] <= WHOLE:
                last[2] += row[2]
            else:
                moves.append(row.copy())
        elif row[0] == 1.0:
            waited[1] += row[1]
        else:
            out += moves
            if waited[1] > 0.0:
                out.append(waited.copy())
            out.append(row)
            moves, waited[1] = [], 0.0
    return np.array(out).reshape(-1, events.shape[1])
