"""Merging of two learned models: their bins are added, and terms are fitted to the sum."""

from collections.abc import Sequence

from ..models.files import encode
from ..models.lattice import Bins, merged
from ..models.learned import LearnedModel
from .fit import FAMILIES, SEARCHES, Candidate, LearnError, LearnOptions, built


def merge(a: LearnedModel, b: LearnedModel, weight: float = 1.0) -> LearnedModel:
    """Return the model of both sample sets, with the size of fit, k and landing error of `a`.

    With weight 1 the bins are those of all samples, to the byte; less lets the second set count for less.

    Args:
        a: the first, or old, model.
        b: the second, or new, model, of the same lattice, cell, filter, foot and robot.
        weight: c of the counted form, 0 to 1.

    Raises:
        LearnError: the models do not go together, or are one and the same.
    """
    check_weight(weight)
    if a.lattice != b.lattice:
        raise LearnError("other_lattice", f"lattices differ: {a.lattice} and {b.lattice}", "lattice")
    if a.conditions != b.conditions:
        raise LearnError("mixed_conditions", f"models of different conditions: {a.conditions} and {b.conditions}")
    if encode(a) == encode(b):
        raise LearnError("same_model", f"{a.name} is merged with itself: its samples would count twice")
    return refitted(a, merged(a.bins, b.bins, weight), b.ranges, sorted({*a.provenance, *b.provenance}))


def check_weight(weight: float) -> None:
    """Raise LearnError unless a weight c lies between 0 and 1."""
    if not 0.0 <= weight <= 1.0:
        raise LearnError("invalid", f"weight must be between 0 and 1, got {weight!r}", "weight")


def refitted(
    model: LearnedModel, bins: Bins, ranges: Sequence[tuple[float, float]], sources: Sequence[str]
) -> LearnedModel:
    """Return a model with terms fitted to other bins; its size of fit, k and landing error stay.

    Args:
        model: the old model.
        bins: outcomes, on the lattice of the model.
        ranges: smallest and largest inputs of the outcomes that were added; the model then holds for these as well.
        sources: provenance of all outcomes, one line each.

    Raises:
        LearnError: the model does not record its size of fit.
    """
    options = LearnOptions(
        title=model.title, seed=model.seed, distance_weight=model.distance_weight, landing_error=model.landing_error,
        support=model.support, lattice=model.lattice,
    )  # fmt: skip
    joined = tuple((min(x[0], y[0]), max(x[1], y[1])) for x, y in zip(model.ranges, ranges, strict=True))
    error = model.choice.get("error", 0.0)
    return built(options, model.conditions, bins, joined, candidate_of(model), error, sources)


def candidate_of(model: LearnedModel) -> Candidate:
    """Return the size of fit that a model was made with."""
    c = model.choice
    try:
        warp = "asinh" if c["asinh"] else "identity"
        family, search = FAMILIES[int(c.get("family", 0.0))], SEARCHES[int(c.get("search", 0.0))]
        return Candidate(
            int(c["terms"]), c["width"], c["ridge"], warp, int(c["refined"]), family, search,
            int(c.get("evaluations", 0.0)), bool(c.get("blind", 0.0)),
        )  # fmt: skip
    except (KeyError, IndexError) as error:
        raise LearnError("invalid", f"{model.name} does not record how it was fitted: {error}", "choice") from None
