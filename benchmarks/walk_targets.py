"""What learned footholds must achieve in walks, and whether the walks of a results file show it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.walk_rules import LEARNED, TAUGHT, Lines, mean_ratio, paired, ratio

MEAN_OVER_HAND = 0.70
EASY_OVER_HAND = 1.05
EASY = ("demo", "flat")
OVER_RANDOM = {"rough": 0.15, "mixed-0.4": 0.33, "elevation": 0.33}
RIVALS = ("nominal", "min-k2", "grid-map")
SEEDS = 20
"""Fewer pairs on a ground are no verdict, only a figure."""


@dataclass(frozen=True)
class Verdict:
    """One target."""

    what: str
    value: float
    goal: str
    met: bool | None
    """None = not on all grounds yet."""
    pairs: int
    """Fewest seeds on a ground."""

    def __str__(self) -> str:
        said = {True: "met", False: "missed", None: "open"}[self.met]
        if self.pairs < SEEDS:
            said += f" with {self.pairs} seeds of {SEEDS}"
        return f"{self.what}: {self.value:.3f} (goal {self.goal}): {said}"


def verdicts(lines: Lines) -> Iterator[Verdict]:
    """Yield every target that at least two paired walks on a ground say something about."""
    rng = np.random.default_rng(0)
    found = {ground: paired(lines, ground, LEARNED, "hand") for ground in TAUGHT}
    found = {ground: pair for ground, pair in found.items() if len(pair[0]) > 1}
    if found:
        least = min(len(pair[0]) for pair in found.values())
        mean = mean_ratio(list(found.values()), rng)[0]
        what = f"learned / hand, mean of {len(found)} of {len(TAUGHT)} grounds"
        met = mean <= MEAN_OVER_HAND if len(found) == len(TAUGHT) else None
        yield Verdict(what, mean, f"<= {MEAN_OVER_HAND}", met, least)
        highs = {ground: ratio(*pair, rng)[2] for ground, pair in found.items()}
        worst = max(highs, key=lambda ground: highs[ground])
        yield Verdict(f"upper end of the worst interval, {worst}", highs[worst], "< 1", highs[worst] < 1.0, least)
    for ground in EASY:
        a, b = paired(lines, ground, LEARNED, "hand")
        if len(a) > 1:
            value = float(a.mean() / b.mean())
            yield Verdict(f"learned / hand on {ground}", value, f"<= {EASY_OVER_HAND}", value <= EASY_OVER_HAND, len(a))
    for ground, goal in OVER_RANDOM.items():
        a, b = paired(lines, ground, LEARNED, "random")
        if len(a) > 1:
            value = float(a.mean() / b.mean())
            yield Verdict(f"learned / random on {ground}", value, f"<= {goal}", value <= goal, len(a))
    for rival in sorted({rule for _, rule, _ in lines if rule.partition(":")[0] in RIVALS}):
        pairs = [pair for ground in TAUGHT if len((pair := paired(lines, ground, LEARNED, rival))[0]) > 1]
        if pairs:
            value, _, high = mean_ratio(pairs, rng)
            what = f"learned / {rival}, mean of {len(pairs)} grounds (to {high:.3f})"
            yield Verdict(what, value, "interval < 1", high < 1.0, min(len(pair[0]) for pair in pairs))
    yield from _falls(lines)


def _falls(lines: Lines) -> Iterator[Verdict]:
    """Falls on the walks that both the learned and the nominal rule have made."""
    both = [
        (line, lines[ground, "nominal", seed])
        for (ground, rule, seed), line in lines.items()
        if rule == LEARNED and (ground, "nominal", seed) in lines
    ]
    if both:
        mine, other = (sum(bool(pair[k].get("fallen")) for pair in both) for k in (0, 1))
        yield Verdict(f"falls in {len(both)} walks", mine, f"<= {other} of nominal", mine <= other, len(both))


def over_flat(lines: Lines) -> Iterator[str]:
    """Yield the sliding of learned footholds on each ground over that on flat ground."""
    flat = [line["sliding_mm"] for (ground, rule, _), line in lines.items()
            if (ground, rule) == ("flat", LEARNED) and "sliding_mm" in line]  # fmt: skip
    for ground in TAUGHT if flat else ():
        mine = [line["sliding_mm"] for (where, rule, _), line in lines.items()
                if (where, rule) == (ground, LEARNED) and "sliding_mm" in line]  # fmt: skip
        if mine:
            yield f"learned on {ground} / learned on flat: {np.mean(mine) / np.mean(flat):.2f}"
