"""Rows of the tables that compare the numbers of a paper with the results of this project."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

CONFIRMED, NOT_CONFIRMED, DEVIATION = "confirmed", "not confirmed", "known deviation"
"""Verdicts on a number that a paper states: `CONFIRMED`: our result is within the limit; `NOT_CONFIRMED`: it is
outside; `DEVIATION`: it is outside for a known reason."""
MET, MISSED = "ok", "FAILED"
"""Verdicts on a limit that this project sets where the paper states no number: `MET`: our result is within the limit;
`MISSED`: it is outside."""


@dataclass(frozen=True)
class Finding:
    """Row of a table that compares one number of a paper with the result of this project.

    Attributes:
        where: section, equation or figure of the paper.
        what: the quantity, with its unit.
        paper: what is printed there; empty when the paper prints no number (a figure without scale, a reference of
            our own).
        ours: result of this project.
        ok: True if our result is within the limit, False if not; None without a limit.
        limit: limit of our result or of its difference to the paper, in words.
        known: reason why this project is known to get another result; empty if it should get the paper's.
    """

    where: str
    what: str
    paper: str
    ours: str
    ok: bool | None = None
    limit: str = ""
    known: str = ""

    @property
    def verdict(self) -> str:
        """Verdict on a number of the paper (`confirmed` ...) or a limit of this project (`ok` ...); empty: no limit."""
        if self.ok is None:
            return ""
        if not self.paper:
            return MET if self.ok else MISSED
        if self.ok:
            return CONFIRMED
        return DEVIATION if self.known else NOT_CONFIRMED


@dataclass(frozen=True)
class Reproduction:
    """Result of reproducing a paper: a finding for each of its numbers, figures and notes.

    Attributes:
        title: what was reproduced.
        findings: rows in the order of the paper.
        figures: files that were written.
        notes: where the paper and this code differ, and why.
    """

    title: str
    findings: tuple[Finding, ...]
    figures: tuple[Path, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @property
    def as_recorded(self) -> bool:
        """True if every number with a limit is within it, apart from known deviations from the paper."""
        return not any(finding.verdict in (NOT_CONFIRMED, MISSED) for finding in self.findings)

    @property
    def ok(self) -> bool:
        """True if every number with a limit is within it."""
        return all(finding.ok is not False for finding in self.findings)


def with_known(findings: Iterable[Finding], known: Mapping[str, str]) -> tuple[Finding, ...]:
    """Return the findings, with `known` set in the rows that are known to deviate from the paper.

    Args:
        findings: rows of a paper.
        known: reason by the beginning of "where: what" of a row.
    """
    rows = tuple(findings)
    keys = [next((key for key in known if f"{row.where}: {row.what}".startswith(key)), None) for row in rows]
    return tuple(row if key is None else replace(row, known=known[key]) for row, key in zip(rows, keys, strict=True))


def near(where: str, what: str, paper: float, ours: float, within: float, digits: int = 2) -> Finding:
    """Return the finding of a number `ours` that may differ from the paper's by at most `within`, all in one unit.

    `where`: section of the paper; `what`: the quantity; `digits`: decimals shown.
    """
    ok = abs(ours - paper) <= within
    return Finding(where, what, f"{paper:.{digits}f}", f"{ours:.{digits}f}", ok, f"within {within:g}")


def at_most(where: str, what: str, ours: float, limit: float, paper: str = "", form: str = ".3g") -> Finding:
    """Return the finding of a number `ours` whose absolute value must not exceed a limit.

    `where`: section of the paper; `what`: the quantity; `paper`: what the paper prints; `form`: format of the number.
    """
    return Finding(where, what, paper, f"{ours:{form}}", abs(ours) <= limit, f"<= {limit:g}")


def fact(where: str, what: str, paper: str, ours: str, ok: bool | None = None, limit: str = "") -> Finding:
    """Return a row that states a fact of the paper and whether it holds, without arithmetic.

    Args:
        where: section of the paper.
        what: the quantity.
        paper: what the paper states.
        ours: what this project finds.
        ok: True if it holds, False if not; None = nothing is required.
        limit: requirement in words.
    """
    return Finding(where, what, paper, ours, ok, limit)
