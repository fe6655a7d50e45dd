"""One number of a paper beside ours."""

from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Finding:
    """One row of a table.

    Attributes:
        where: section, equation or figure of the paper.
        what: the quantity, with its unit.
        paper: what is printed there; empty when the paper prints no number (a figure without scale, a reference of
            our own).
        ours: what came out here.
        ok: whether ours is within the limit; None without a limit.
        limit: what it was held against, in words.
    """

    where: str
    what: str
    paper: str
    ours: str
    ok: bool | None = None
    limit: str = ""


@dataclass(frozen=True)
class Reproduction:
    """All of a paper.

    Attributes:
        title: what was reproduced.
        findings: in the order of the paper.
        figures: files that were written.
        notes: where the paper and this code differ, and why.
    """

    title: str
    findings: tuple[Finding, ...]
    figures: tuple[Path, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @property
    def ok(self) -> bool:
        """True if every number with a limit is within it."""
        return all(finding.ok is not False for finding in self.findings)


def near(where: str, what: str, paper: float, ours: float, within: float, digits: int = 2) -> Finding:
    """A number that must lie within so much of the paper's."""
    ok = abs(ours - paper) <= within
    return Finding(where, what, f"{paper:.{digits}f}", f"{ours:.{digits}f}", ok, f"within {within:g}")


def at_most(where: str, what: str, ours: float, limit: float, paper: str = "", form: str = ".3g") -> Finding:
    """A number that must not be larger."""
    return Finding(where, what, paper, f"{ours:{form}}", abs(ours) <= limit, f"<= {limit:g}")


def told(where: str, what: str, paper: str, ours: str, ok: bool | None = None, limit: str = "") -> Finding:
    """A row without arithmetic."""
    return Finding(where, what, paper, ours, ok, limit)
