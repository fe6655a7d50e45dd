"""Two learned models made one: their bins are added, and terms are fitted to the sum."""

from ..models.files import encode
from ..models.lattice import merged
from ..models.learned import LearnedModel
from .fit import (
    FAMILIES,
    SEARCHES,
    Candidate,
    LearnError,
    LearnOptions,
    built,
)


def merge(a: LearnedModel, b: LearnedModel, weight: float = 1.0) -> LearnedModel:
    """Return the model of both sample sets, with the size of fit, k and landing error of `a`.

    With weight 1 the bins are those of all samples, to the byte; less lets the second set count for less.

    Args:
        a: the first, or old, model.
        b: the second, or new, one: of the same lattice, cell, filter, foot and robot.
        weight: c of the counted form, 0 to 1.

    Raises:
        LearnError: the models do not go together, or are one and the same.
    """
    if not 0.0 <= weight <= 1.0:
        raise LearnError("invalid", f"weight must be between 0 and 1, got {weight!r}", "weight")
    if a.lattice != b.lattice:
        raise LearnError("other_lattice", f"lattices differ: {a.lattice} and {b.lattice}", "lattice")
    if a.conditions != b.conditions:
        raise LearnError("mixed_conditions", f"models of different conditions: {a.conditions} and {b.conditions}")
    if encode(a) == encode(b):
        raise LearnError("same_model", f"{a.name} is merged with itself: its samples would count twice")
    candidate = candidate_of(a)
    options = LearnOptions(
        title=a.title, seed=a.seed, distance_weight=a.distance_weight, landing_error=a.landing_error,
        support=a.support, lattice=a.lattice,
    )  # fmt: skip
    low = [min(x[0], y[0]) for x, y in zip(a.ranges, b.ranges, strict=True)]
    high = [max(x[1], y[1]) for x, y in zip(a.ranges, b.ranges, strict=True)]
    sources = sorted({*a.provenance, *b.provenance})
    bins = merged(a.bins, b.bins, weight)
    return built(options, a.conditions, bins, low, high, candidate, a.choice.get("error", 0.0), sources)


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
        raise LearnError("invalid", f"{model.name} does not say how it was fitted: {error}", "choice") from None
