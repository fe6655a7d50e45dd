"""Random numbers of kernels: distributions, streams, the reference of xoshiro256+."""

import numpy as np
from scipy import stats

from surefoot.services.navigator.environment.draws import below, normal_pair, seed, stream, uniform

MASK = (1 << 64) - 1


def reference(words):
    """xoshiro256+ in Python's integers."""
    s = list(words)
    while True:
        out = (s[0] + s[3]) & MASK
        t = (s[1] << 17) & MASK
        s[2] ^= s[0]
        s[3] ^= s[1]
        s[1] ^= s[2]
        s[0] ^= s[3]
        s[2] ^= t
        s[3] = ((s[3] << 45) | (s[3] >> 19)) & MASK
        yield (out >> 11) * 2.0**-53


def test_equals_the_algorithm_in_exact_integers():
    rng = stream()
    seed(rng, 1, 2, 3)
    want = reference([int(word) for word in rng])
    assert all(uniform(rng) == next(want) for _ in range(1000))


def test_streams_of_different_integers_differ_and_equal_ones_are_equal():
    seen = set()
    for a in range(6):
        for b in range(6):
            for c in range(6):
                rng = stream()
                seed(rng, a, b, c)
                seen.add(uniform(rng))
    assert len(seen) == 216
    one, two = stream(), stream()
    seed(one, 5, 6, 7)
    seed(two, 5, 6, 7)
    assert [uniform(one) for _ in range(5)] == [uniform(two) for _ in range(5)]


def test_distributions():
    rng = stream()
    seed(rng, 4, 4, 4)
    assert stats.kstest([uniform(rng) for _ in range(5000)], "uniform").pvalue > 1e-3
    normals = np.array([normal_pair(rng) for _ in range(5000)])
    assert stats.kstest(normals.ravel(), "norm").pvalue > 1e-3
    assert abs(np.corrcoef(normals.T)[0, 1]) < 0.06
    assert {below(rng, 5) for _ in range(200)} == {0, 1, 2, 3, 4}
