"""Explanation of a failed run: from a fall, stop, halt, missed goal or slip back to its first cause."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surefoot.record.recording import ReadableRecording

from .clue import OF_GOALS, ROOTS, Clue
from .evidence import gather
from .signals import Signals, read_signals, spans

TILTED = math.radians(45.0)
SLIPPED_M = 0.008
"""Slide of a contact point within one stance, m, above which the stance counts as a slip."""
LOOKED_FOR = (
    f"no fall, stop, halt, missed goal, slip over {1e3 * SLIPPED_M:.0f} mm, stance without support or abandoned walk"
)
ON_THE_WAY = ("walking", "turning", "stopping", "recovering")
"""Walker states in `state/gait` in which a walk has begun and is not over."""
BEFORE_S = 4.0
"""Longest time, s, between the end of a cause and the failure of the run; events that ended earlier are no causes."""
TOGETHER_S = 0.25
"""Time between the begins of two events, s, up to which they count as simultaneous: a cause and its direct effect."""
SEVERAL = 3
"""Least number of joints that leave their commands within `TOGETHER_S` after a push from which the push is the cause,
not a servo fault."""


@dataclass(frozen=True)
class Explanation:
    """Explanation of a recorded run: what went wrong, its first cause, and the evidence between both.

    Attributes:
        outcome: what went wrong; None: nothing did.
        cause: first cause; None: nothing went wrong, or none was found.
        chain: evidence from cause to outcome, in order of time, without these two.
        damage: reason why a part of the recording cannot be read; empty = all of it can be read.
        jumps: clock jumps of the recording in words; empty = none.
        version: version of surefoot that made the recording, if it differs from the running version; else empty.
    """

    outcome: Clue | None
    cause: Clue | None
    chain: tuple[Clue, ...]
    damage: str = ""
    jumps: str = ""
    version: str = ""

    @property
    def sentence(self) -> str:
        """Return the explanation in one sentence."""
        partly = f"; only a part can be read: {self.damage}" if self.damage else ""
        return self._found + partly + (f"; the clock jumps: {self.jumps}" if self.jumps else "")

    @property
    def _found(self) -> str:
        if self.outcome is None:
            return f"nothing went wrong{' in what can be read' if self.damage else ''}: {LOOKED_FOR}"
        if self.cause is None:
            return f"{self.outcome.text} at {self.outcome.begin:.2f} s; no cause was found in the recording"
        lead = self.outcome.begin - self.cause.begin
        return f"{self.outcome.text} at {self.outcome.begin:.2f} s, because {lead:.2f} s before {self.cause.text}"


def explain(path: Path | ReadableRecording, progress: Callable[[float], None] | None = None) -> Explanation:
    """Return what went wrong in a recorded run, and why; `progress` gets the share that is read.

    Raises:
        SurefootError: nothing of the recording can be read.
    """
    signals = read_signals(path, progress)
    outcome = find_outcome(signals)
    if outcome is None:
        return Explanation(None, None, (), signals.damage, signals.jumps, signals.version)
    seen = [e for e in gather(signals) if e.begin <= outcome.begin and _counts(e, outcome, signals)]
    cause = _first(seen)
    chain = () if cause is None else tuple(e for e in seen if e is not cause and e.begin >= cause.begin)
    if cause is not None and cause.code == "support":  # of which the margin is the evidence
        chain = tuple(e for e in chain if e.code not in ("margin", "support"))
    return Explanation(outcome, cause, _once(chain), signals.damage, signals.jumps, signals.version)


def _counts(clue: Clue, outcome: Clue, s: Signals) -> bool:
    """Return True if a clue may lead to an outcome: it ended at most `BEFORE_S` earlier.

    The refusal with which the walker gives a walk up is that outcome itself, and no cause of it, as is a foot that
    slides of a slip. Support that is left,
    and not regained, leads to falls and slips. A fault of a camera or ranger leads to missed goals only, and to these
    also later: a wrong belief remains.
    """
    if outcome.code == "abandoned" and clue.code == "refused" and clue.text.partition(": ")[2] in outcome.text:
        return False
    if outcome.code == clue.code == "slip":
        return False
    if clue.code == "support":
        return outcome.code in ("fall", "slip") and clue.end >= outcome.begin - TOGETHER_S
    if clue.code not in OF_GOALS:
        return clue.end >= outcome.begin - BEFORE_S
    if outcome.code != "goal":
        return False
    row = next(row for row in s.rows["navigator/feedback"] if row.get("state") == "failed")
    return clue.end >= outcome.begin - (row.get("navigation_time") or 0.0)


def _first(seen: list[Clue]) -> Clue | None:
    """Return the first by `ROOTS` of the causes that begin within `TOGETHER_S` of the earliest, else the first clue."""
    effects = [*_pulled(seen), *_tipping(seen)]
    roots = [e for e in seen if e.code in ROOTS and e not in effects]
    if not roots:
        return seen[0] if seen else None
    together = [e for e in roots if e.begin <= roots[0].begin + TOGETHER_S]
    return min(together, key=lambda e: ROOTS.index(e.code))


def _pulled(seen: list[Clue]) -> list[Clue]:
    """Return the joints that a push moved off their commands: `SEVERAL` or more within `TOGETHER_S` of its begin."""
    pushed = next((e.begin for e in seen if e.code == "push"), None)
    if pushed is None:
        return []
    off = [e for e in seen if e.code == "servo" and pushed <= e.begin <= pushed + TOGETHER_S]
    return off if len(off) >= SEVERAL else []


def _tipping(seen: list[Clue]) -> list[Clue]:
    """Return the slides and accelerations that begin after the support is left: those of a robot that tips over."""
    left = next((e.begin for e in seen if e.code == "support"), math.inf)
    return [e for e in seen if e.code in ("push", "friction") and e.begin > left]


def _once(chain: tuple[Clue, ...]) -> tuple[Clue, ...]:
    """Return a chain of clues with only the first clue of each code."""
    kinds: dict[str, Clue] = {}
    for each in chain:
        kinds.setdefault(each.code, each)
    return tuple(kinds.values())


def find_outcome(s: Signals) -> Clue | None:
    """Return the worst event: the first found of fall, stop, halt, missed goal, slip, lost support, abandoned walk."""
    for find in (_fall, _stop, _halt, _goal, _slip, _unsupported, _abandoned):
        found = find(s)
        if found is not None:
            return found
    return None


def _fall(s: Signals) -> Clue | None:
    times, fallen = s.times("sim/truth"), s.column("sim/truth", "fallen") > 0.5
    if not len(times) and s.rows["state/velocity"]:
        up = s.column("state/velocity", "g_up")
        times, fallen = s.times("state/velocity"), np.arctan2(np.hypot(up[:, 0], up[:, 1]), up[:, 2]) > TILTED
    if not fallen.any():
        return None
    time = float(times[int(fallen.argmax())])
    return Clue("fall", time, s.end, "it fell")


def _stop(s: Signals) -> Clue | None:
    row = next((row for row in s.rows["sim/status"] if row.get("stopped") or row.get("failed")), None)
    if row is None:
        return None
    return Clue("stopped", 0.01 * row.get("tick", 0), s.end, "it was stopped")


def _halt(s: Signals) -> Clue | None:
    """Find a walk that halts: the walker holds, or walks while the joints do not follow."""
    times = s.times("state/gait")
    holds = np.array([row.get("state") == "hold" for row in s.rows["state/gait"]], dtype=np.bool_)
    for a, b in spans(times, holds, 0.1)[:1]:
        return Clue("halt", a, b, f"the walk halted for {b - a:.2f} s")
    walks = [row.get("state") == "walking" for row in s.rows["state/gait"]]
    for lost in (e for e in gather(s) if e.code == "command"):
        if any(w for w, t in zip(walks, times, strict=True) if lost.begin <= t <= lost.end):
            return Clue("halt", lost.begin + 1.0, lost.end, "the joints did not follow the walk")
    return None


def _goal(s: Signals) -> Clue | None:
    for time, row in zip(s.times("navigator/feedback").tolist(), s.rows["navigator/feedback"], strict=True):
        if row.get("state") == "failed":
            return Clue("goal", time, s.end, f"the goal was missed ({row.get('error_code', '')})")
    return None


def _slip(s: Signals) -> Clue | None:
    if s.rows["sim/truth"]:
        way = s.column("sim/truth", "contact_sliding").max(axis=1)
        for a, b in spans(s.times("sim/truth"), way > SLIPPED_M, 0.0)[:1]:
            return Clue("slip", a, b, f"a foot slid by {1e3 * float(way.max()):.0f} mm")
        return None
    slipping = s.column("state/velocity", "slipping")
    many = slipping.sum(axis=1) >= 2 if slipping.ndim == 2 else np.empty(0, dtype=np.bool_)
    for a, b in spans(s.times("state/velocity"), many, 0.5)[:1]:
        return Clue("slip", a, b, f"feet slid for {b - a:.2f} s by the estimator")
    return None


def _unsupported(s: Signals) -> Clue | None:
    """Find a stance of four or more legs whose planned margin is below zero."""
    if not s.stands_statically:
        return None
    times, margin = s.times("state/stability"), s.column("state/stability", "margin_planned")
    for a, b in spans(times, (margin < 0.0) & (times > 1.0), 0.1)[:1]:
        return Clue("unsupported", a, b, f"the support was left for {b - a:.2f} s")
    return None


def _abandoned(s: Signals) -> Clue | None:
    """Find a walk that the walker abandoned (state `refused`), for example because the robot leans too far."""
    before = ""
    for time, row in zip(s.times("state/gait").tolist(), s.rows["state/gait"], strict=True):
        state = row.get("state", "")
        if state == "refused" and before in ON_THE_WAY:
            return Clue("abandoned", time, s.end, f"the walk was abandoned ({row.get('reason', '')})")
        before = state
    return None
