"""Which questions for footholds ask for random cells, and with which seed."""

import numpy as np

DRAWS = 100_003
"""Questions of one walk that have a seed of their own."""


def draw_of(seed: int, question: int, share: float) -> int | None:
    """Return the seed of a question's random footholds, None for a question that asks for the best.

    Args:
        seed: of the walk, >= 0.
        question: number of the question in the walk, from 1.
        share: of the questions that ask for random footholds, 0 to 1; equal seeds and shares choose the same ones.
    """
    if share <= 0.0 or (share < 1.0 and np.random.default_rng((seed, question, 1)).random() >= share):
        return None
    return seed * DRAWS + question
