"""Re-learning (Walas & Belter 2011, section 3.5): the bins of a model brought up to date by the outcomes of a walk.

Two forms. That of Walas & Belter, without regard to counts, for bins that both sets have:

    r_b <- (r_old + c r_new) / (1 + c),   0 <= c <= 1                                                             (19)

and the counted one, in which a sample weighs the same whenever it came (c = 1: as if all had been learned at once):

    r_b <- (N_old r_old + c N_new r_new) / (N_old + c N_new),   N_b <- N_old + c N_new

The terms are fitted anew to the bins, with the fit settings of the model.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from ..models.lattice import faded, filled, inputs, merged
from ..models.learned import ROUNDS, LearnedModel
from .fit import LearnError, identities, identity
from .merge import check_weight, refitted
from .samples import SampleSet, StanceSample, gather

Form = Literal["counted", "paper"]


def relearned(
    model: LearnedModel, samples: Sequence[StanceSample], form: Form = "counted", weight: float = 1.0
) -> LearnedModel:
    """Return the slip model with its bins updated by new outcomes; the lattice and the number of terms stay.

    Args:
        model: the old model.
        samples: samples of the model's cell, filter, foot and robot; those that cannot be learned from are left out.
        form: `counted` weighs each sample alike whenever it came; `paper` averages a bin's old and new values.
        weight: weight of the new samples, 0 to 1; 1 = as much as the old.

    Raises:
        LearnError: no sample is left, or samples and model do not go together.
    """
    check_weight(weight)
    found = gather(unseen(model, samples), model.relief)
    if not len(found):
        raise LearnError("no_samples", f"there is no outcome to learn from ({found.why_refused})")
    _check(model, found)
    fresh, u = filled(model.lattice, found.x, found.r), inputs(found.x)
    bins = merged(model.bins, fresh, weight) if form == "counted" else faded(model.bins, fresh, weight)
    ranges = tuple(zip(u.min(axis=0).tolist(), u.max(axis=0).tolist(), strict=True))
    sources = _with(model.provenance, f"re-learned ({form}, c = {weight:g})", found)
    out = refitted(model, bins, ranges, sources, tuple(sorted({*model.trials, *identities(found)})))
    return replace(out, choice=out.choice | {ROUNDS: model.choice.get(ROUNDS, 0.0) + 1.0})


def unseen(model: LearnedModel, samples: Sequence[StanceSample]) -> list[StanceSample]:
    """Return the samples of trials (walks) that a model has not learned from."""
    known = {*model.trials}
    return [each for each in samples if identity(each) not in known]


def _check(model: LearnedModel, found: SampleSet) -> None:
    old = model.conditions
    for each in found.kept:
        same = (each.cell, each.smooth, each.foot_radius) == (old.cell, old.smooth, old.foot_radius)
        if not same or (old.robot and each.robot != old.robot):
            got = f"{each.robot}, cell {each.cell:g} m, foot {each.foot_radius:g} m, filter {each.smooth}"
            raise LearnError("mixed_conditions", f"outcomes of {got} do not go into a model of {old}")


def _with(provenance: Sequence[str], how: str, found: SampleSet) -> list[str]:
    """Return the provenance of a model with a line, which begins with `how`, for each source of samples `found`.

    A source that comes round after round keeps its line.
    """
    lines = list(provenance)
    for source in sorted({each.source for each in found.kept}):
        head, count = f"{how}: {source}, samples ", sum(each.source == source for each in found.kept)
        before = [k for k, line in enumerate(lines) if line.startswith(head)]
        if before:
            count += int(lines.pop(before[0]).removeprefix(head))
        lines.append(f"{head}{count}")
    return lines
