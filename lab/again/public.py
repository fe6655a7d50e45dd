"""Public list of runs (`hashes.csv`): scenario, seed, and the hash that the run has on every machine of `NUMBERS`."""

import csv
from pathlib import Path
from typing import NamedTuple

from surefoot.errors import SurefootError
from surefoot.nearest import did_you_mean
from surefoot.services.supervisor.scenarios.scenario import load_scenario

from ..runs.local import run_local

LIST = Path(__file__).with_name("hashes.csv")
NUMBERS = "x86_64, functions da308857"
"""Value of `surefoot.version.numbers` for which the public hashes hold: x86-64 with AVX2 and FMA, GNU C library 2.36 to
2.43."""


class PublicRun(NamedTuple):
    """Row of the public list of runs: a shipped scenario with the hash of its run.

    Attributes:
        scenario: name of the shipped scenario.
        seed: seed of the run.
        ticks: number of control ticks of the run.
        run_hash: hash of the run in lockstep.
    """

    scenario: str
    seed: int
    ticks: int
    run_hash: str

    def again(self) -> "PublicRun":
        """Repeat the listed run on this machine, and return a row with the ticks and hash found here."""
        found = run_local(load_scenario(self.scenario), self.seed)
        return PublicRun(self.scenario, found.seed, found.ticks, found.run_hash)


def public_runs(names: tuple[str, ...] = ()) -> tuple[PublicRun, ...]:
    """Return the public list of runs, or the rows of scenarios `names` (raises SurefootError: a name is not listed)."""
    with LIST.open(encoding="utf-8", newline="") as stream:
        found = [row.values() for row in csv.DictReader(stream)]
    rows = [PublicRun(scenario, int(seed), int(ticks), run_hash) for scenario, seed, ticks, run_hash in found]
    known = [row.scenario for row in rows]
    for name in names:
        if name not in known:
            text = f"scenario: got {name!r}, the list has {', '.join(dict.fromkeys(known))}{did_you_mean(name, known)}"
            raise SurefootError("invalid", text, "scenario")
    return tuple(row for row in rows if not names or row.scenario in names)
