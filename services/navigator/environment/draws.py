"""Seeded random numbers inside kernels: the same bits on every processor, one stream per purpose.

xoshiro256+ (Blackman and Vigna), its state filled by splitmix64 from three integers: seed, episode, purpose.
Streams for the floor, the start and each step are separate, so episodes of one seed differ by the actions alone.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import row_kernel

Stream = NDArray[np.uint64]

UNIT = 2.0**-53


def stream() -> Stream:
    """Return an array for the state of one random stream, (4,) uint64, no unit."""
    return np.zeros(4, dtype=np.uint64)


@row_kernel
def _mixed(z: np.uint64) -> np.uint64:
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@row_kernel
def seed(state: Stream, a: int, b: int, c: int) -> None:
    """Initialise the random stream of three integers: `state` (4,) uint64 is overwritten."""
    z = _mixed(np.uint64(a) + np.uint64(0x9E3779B97F4A7C15))
    z = _mixed((z ^ np.uint64(b)) + np.uint64(0x9E3779B97F4A7C15))
    z = _mixed((z ^ np.uint64(c)) + np.uint64(0x9E3779B97F4A7C15))
    for i in range(4):
        z += np.uint64(0x9E3779B97F4A7C15)
        state[i] = _mixed(z)


@row_kernel
def uniform(state: Stream) -> float:
    """Return a number uniformly distributed in [0, 1), and advance the random stream `state`, (4,) uint64, in place."""
    s0, s1, s2, s3 = state[0], state[1], state[2], state[3]
    out = s0 + s3
    t = s1 << np.uint64(17)
    s2 ^= s0
    s3 ^= s1
    s1 ^= s2
    s0 ^= s3
    s2 ^= t
    s3 = (s3 << np.uint64(45)) | (s3 >> np.uint64(19))
    state[0], state[1], state[2], state[3] = s0, s1, s2, s3
    return (out >> np.uint64(11)) * UNIT


@row_kernel
def normal_pair(state: Stream) -> tuple[float, float]:
    """Return two independent standard normal numbers (polar method), and advance the stream `state`, (4,) uint64."""
    while True:
        u, v = 2.0 * uniform(state) - 1.0, 2.0 * uniform(state) - 1.0
        s = u * u + v * v
        if 0.0 < s < 1.0:
            f = math.sqrt(-2.0 * math.log(s) / s)
            return u * f, v * f


@row_kernel
def below(state: Stream, n: int) -> int:
    """Return an integer uniformly distributed in 0 .. n - 1, and advance the random stream `state`, (4,) uint64."""
    return int(uniform(state) * n)
