"""Merging of two learned models: their bins are added, and terms are fitted to the sum."""

from collections.abc import Sequence

from ..models.files import encode
from ..models.lattice import Bins, merged
from ..models.learned import LearnedModel
from .fit import Candidate, LearnError, LearnOptions, built


def merge(a: LearnedModel, b: LearnedModel, weight: float = 1.0) -> LearnedModel:
    """Return the model of both sample sets; fit settings, weight k of the distance and landing error are `a`'s.

    With weight 1 the bins are those of all samples, to the byte; with a smaller weight the second set counts for less.

    Args:
        a: the first, or old, model.
        b: the second, or new, model, of one lattice, cell, filter, foot and robot.
        weight: what a sample of the second set counts, 0 to 1.

    Raises:
        LearnError: the weight is out of range, the models do not go together, are equal, or share trials.
    """
    check_weight(weight)
    if a.lattice != b.lattice:
        raise LearnError("other_lattice", f"lattices differ: {a.lattice} and {b.lattice}", "lattice")
    if a.conditions != b.conditions:
        raise LearnError("mixed_conditions", f"models of different conditions: {a.conditions} and {b.conditions}")
    if a.relief != b.relief:
        raise LearnError("mixed_conditions", f"{a.name} and {b.name} have other inputs: planes and 3 x 3 cells")
    twice = len({*a.trials} & {*b.trials})
    if twice or encode(a) == encode(b):
        raise LearnError(
            "twice", f"{b.name} shares {twice} of its {len(b.trials)} trials with {a.name}: they count twice"
        )
    trials = tuple(sorted({*a.trials, *b.trials}))
    return refitted(a, merged(a.bins, b.bins, weight), b.ranges, sorted({*a.provenance, *b.provenance}), trials)


def check_weight(weight: float) -> None:
    """Raise LearnError unless a weight c lies between 0 and 1."""
    if not 0.0 <= weight <= 1.0:
        raise LearnError("invalid", f"weight must be between 0 and 1, got {weight!r}", "weight")


def refitted(
    model: LearnedModel, bins: Bins, ranges: Sequence[tuple[float, float]], sources: Sequence[str],
    trials: tuple[str, ...],
) -> LearnedModel:  # fmt: skip
    """Return a model with terms fitted to other bins; its fit settings, distance weight and landing error stay.

    Args:
        model: the old model.
        bins: outcomes, on the lattice of the model.
        ranges: smallest and largest inputs of the outcomes that were added; the model then holds for these as well.
        sources: provenance of all outcomes, one line each.
        trials: identities of the trials of all outcomes, sorted.

    Raises:
        LearnError: the model does not record its fit settings.
    """
    options = LearnOptions(
        title=model.title, seed=model.seed, distance_weight=model.distance_weight, landing_error=model.landing_error,
        support=model.support, lattice=model.lattice, relief=model.relief, trials=trials,
    )  # fmt: skip
    joined = tuple((min(x[0], y[0]), max(x[1], y[1])) for x, y in zip(model.ranges, ranges, strict=True))
    kept = {name: value for name, value in model.choice.items() if name not in ("terms", "width", "ridge", "asinh")}
    return built(options, model.conditions, bins, joined, candidate_of(model), kept, sources)


def candidate_of(model: LearnedModel) -> Candidate:
    """Return the fit settings (number of terms, width, ridge, warp) that a model was made with.

    Raises:
        LearnError: the model does not record them.
    """
    c = model.choice
    try:
        return Candidate(int(c["terms"]), c["width"], c["ridge"], "asinh" if c["asinh"] else "identity", model.enough)
    except KeyError as error:
        raise LearnError("invalid", f"{model.name} does not record how it was fitted: {error}", "choice") from None
