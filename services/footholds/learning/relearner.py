"""Re-learning while the robot walks: every so many stances (a round) a new slip model is fitted on a thread.

The fit begins at the choice of footholds whose outcomes complete the round. Its model is used from the `LAG`-th choice
after that, however long the fit took: a choice that comes before the fit has ended waits for it. So equal requests get
equal replies at any speed of the machine.
"""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from surefoot.errors import SurefootError

from ..models.files import save
from ..models.learned import LearnedModel
from .relearn import Form, relearned
from .samples import StanceSample

MOST = 100_000
"""Largest number of outcomes that wait for a round of learning, and of recent outcomes remembered so that none counts
twice."""
LAG = 4
"""Number of choices of footholds from the start of a round of learning to the first by its model: 2 s of a tripod
gait."""


@dataclass(frozen=True, slots=True)
class RelearnParams:
    """Settings of re-learning a slip model from the stances of a walk: form, weight, length of a round, file."""

    form: Form = "counted"
    weight: float = 1.0
    """Weight c of new outcomes against those already learned, 0 to 1; 1 = equal."""
    every: int = 60
    """Number of outcomes that complete a round, after which a new model is fitted."""
    path: str = ""
    """Path of the file that keeps the re-learned model; empty = it is not kept."""


@dataclass(eq=False)
class Relearner:
    """Collector of outcomes of steps that learns the slip model again from them, round by round."""

    params: RelearnParams
    log: Callable[[str], None]
    taken: int = 0
    """Number of outcomes that re-learning has accepted."""
    refused: dict[str, int] = field(default_factory=dict)
    """Number of outcomes rejected and of rounds that failed, by reason."""
    _waiting: list[StanceSample] = field(default_factory=list)
    _known: dict[str, None] = field(default_factory=dict)
    """Names of the outcomes accepted last, at most 100 000, oldest first; an outcome of a name in it is refused as
    `twice`."""
    _due: int = 0
    _thread: threading.Thread | None = None
    _made: LearnedModel | None = None
    _problems: list[tuple[str, str]] = field(default_factory=list)

    def take(self, samples: Sequence[StanceSample]) -> None:
        """Add outcomes of steps to the next round; those that cannot be learned from are only counted."""
        for each in samples:
            problem = each.problem or ("too_many" if len(self._waiting) >= MOST else "")
            problem = problem or ("twice" if each.trial in self._known else "")
            if problem:
                self.refuse(problem)
            else:
                self._waiting.append(each)
                self._known[each.trial] = None
                if len(self._known) > MOST:
                    del self._known[next(iter(self._known))]
                self.taken += 1

    def refuse(self, reason: str) -> None:
        """Count one more outcome that re-learning leaves out for this reason, a key of `refused`."""
        self.refused[reason] = self.refused.get(reason, 0) + 1

    def chosen(self, model: LearnedModel | None) -> LearnedModel | None:
        """Count a choice of footholds; return the model to use from this choice on, None if it does not change.

        Args:
            model: model in use; None: it cannot be learned again.
        """
        if self._thread is not None:
            self._due -= 1
            return self._finish() if self._due <= 0 else None
        if model is not None and len(self._waiting) >= self.params.every:
            batch, self._waiting = self._waiting, []
            self._due = LAG
            self._thread = threading.Thread(target=self._run, args=(model, batch), name="relearn", daemon=True)
            self._thread.start()
        return None

    def close(self) -> LearnedModel | None:
        """Wait for a running fit and drop waiting outcomes; return the model of the fit, or None."""
        self._waiting.clear()
        return None if self._thread is None else self._finish()

    def _finish(self) -> LearnedModel | None:
        assert self._thread is not None
        self._thread.join()
        self._thread, made, self._made = None, self._made, None
        for code, text in self._problems:
            self.refuse(code)
            self.log(text)
        self._problems.clear()
        return made

    def _run(self, model: LearnedModel, batch: Sequence[StanceSample]) -> None:
        p = self.params
        try:
            made = relearned(model, batch, p.form, p.weight)
            _ = made.table  # computed on this thread, not in the first choice
            self._made = made
            if p.path:
                save(made, p.path)
        except SurefootError as error:
            self._problems.append((error.code, f"re-learning: {error.message}"))
        except Exception as error:  # after any other error the old model stays
            self._problems.append(("internal", f"re-learning: {error!r}"))
