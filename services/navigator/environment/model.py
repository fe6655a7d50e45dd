"""Arrays of one simulated episode, as the kernels of training, evaluation and reproduction take them."""

import math
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Ints, Record, record
from surefoot.kernels.jit import row_kernel

from ..belief.ukf import NUISANCE
from ..policy.arrays import STATUS, Arrays
from .draws import Stream

CELL = 0.25  # m, edge of the squares by which landmarks are found
IN_VIEW = 128  # landmarks of one frame that are considered before `most` are drawn of them
ROLL, PITCH = 4, 5  # elements of the truth behind X, Y, THETA, DRIFT of `ukf`
BEGAN = 6
TRUTH = 7


class EpisodeState(NamedTuple):
    """State of one simulated episode; a batch of episodes has one more axis in front of every array."""

    rng: Stream
    """State of the random stream, (4,) uint64."""
    marks: Array
    """Positions of the landmarks on the floor, (M, 2) m, frame map, sorted by squares of 0.25 m."""
    first: Ints
    """Index in `marks` of the first landmark of each square of 0.25 m, and the number of landmarks last, (squares +
    1,)."""
    truth: Array
    """True state of the robot, (7,).

    x, y (m), heading (rad), frame map, drift now (rad per m), roll and pitch error of the camera (rad), drift at the
    start (rad per m)."""
    mean: Array
    """Mean of the belief after the last camera frame, (n,).

    x, y (m), heading (rad), frame map, from n = 4 on drift (rad per m), then roll and pitch error of the camera (rad).
    """
    cov: Array
    """Covariance of the belief after the last camera frame, (n, n)."""
    ahead_mean: Array
    """Mean of the belief at the next decision, which may come before the last frames of an action, (n,)."""
    ahead_cov: Array
    """Covariance of the belief at the next decision, (n, n)."""
    status: Record
    """Counters of the episode: time (s), last action, stands and turns in a row, blocked, outcome, number of actions,
    distance walked (m)."""


class EpisodeRoom(NamedTuple):
    """Scratch arrays of an episode's kernels; their contents do not outlive a call."""

    noise: Array
    """Variances that a motion adds along and across the heading (m^2), to heading (rad^2) and drift (rad^2 per m^2),
    (4,)."""
    gain: Array
    """Effect of the camera's roll and pitch error on range (row 0) and bearing (row 1) of a sighting, (2, n - 4)."""
    work: Array
    """Scratch array of the filter; its last column holds the landmarks in view, (max(3 n, 128), max(n, 4) + 1)."""


@row_kernel
def squares(scene: Record) -> tuple[int, int]:
    """Return the numbers of squares of 0.25 m along x and y that cover the floor of a scene.

    `scene`: record with the walls x_min, x_max, y_min, y_max, m.
    """
    return math.ceil((scene.x_max - scene.x_min) / CELL), math.ceil((scene.y_max - scene.y_min) / CELL)


def most_landmarks(scene: Record) -> int:
    """Return the number of landmarks that an episode has room for: the mean number and ten standard deviations.

    `scene`: record with the walls, m, and landmarks per m^2.
    """
    nx, ny = squares(scene)
    mean = nx * ny * CELL * CELL * scene.density
    return int(mean + 10.0 * math.sqrt(mean)) + 16


def episode_state(world: Arrays, *count: int) -> EpisodeState:
    """Return the arrays of one episode, zeros, or of a batch of `count` episodes, which is their first axis.

    `world`: arrays of the model, which give number of states, walls and density of landmarks.
    """
    n, (nx, ny) = world.states, squares(world.tables.scene[0])
    return EpisodeState(
        np.zeros((*count, 4), dtype=np.uint64),
        np.zeros((*count, most_landmarks(world.tables.scene[0]), 2)),
        np.zeros((*count, nx * ny + 1), dtype=np.int64),
        np.zeros((*count, TRUTH)),
        np.zeros((*count, n)),
        np.zeros((*count, n, n)),
        np.zeros((*count, n)),
        np.zeros((*count, n, n)),
        np.zeros(count, STATUS) if count else record(STATUS),
    )


def episode_room(states: int) -> EpisodeRoom:
    """Return the scratch arrays of a simulated episode for a filter of `states` states."""
    work = np.zeros((max(3 * states, IN_VIEW), max(states, 4) + 1))
    return EpisodeRoom(np.zeros(4), np.zeros((2, max(0, states - NUISANCE))), work)
