"""Results of the simulated Nao for Osswald et al., section VI-C, read from those of `python -m benchmarks goals`."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.errors import SurefootError
from surefoot.lab.report.findings import Finding, fact
from surefoot.lab.statistics import welch

COMMAND = "python -m benchmarks goals --seeds 100:120 --arms hand,sarsa --results FILE"
ARMS = {"hand": "93.16 +- 10.14", "sarsa": "86.53 +- 8.60"}
"""Time to the goal of the real robot as Osswald et al. print it, mean and standard deviation, s, by controller."""


def read(path: Path) -> dict[str, list[dict[str, Any]]]:
    """Return the benchmark runs of each controller in the world `hard`; lines that cannot be read are left out.

    Raises:
        SurefootError: there is no file, or fewer than two runs of `hand` or `sarsa` in it.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "is no text"
        raise SurefootError("not_found", f"{path}: {why}; `{COMMAND}` makes such a file", "live") from None
    runs: dict[str, list[dict[str, Any]]] = {arm: [] for arm in ARMS}
    for line in text.splitlines():
        try:
            run = json.loads(line)
        except ValueError:
            continue
        if isinstance(run, dict) and run.get("world") == "hard" and run.get("arm") in ARMS:
            runs[run["arm"]].append(run)
    few = {arm: len(found) for arm, found in runs.items() if len(found) < 2}
    if few:
        raise SurefootError(
            "invalid", f"{path}: got {few} runs in the hard world, at least 2 are needed of each", "live"
        )
    return runs


def findings(path: Path) -> list[Finding]:
    """Return findings: times to the goal beside those of Osswald et al., and the gain of learning with its t-test."""
    runs = read(path)
    times = {arm: _times(found) for arm, found in runs.items()}
    where, rows = "VI-C, live", list[Finding]()
    for arm, printed in ARMS.items():
        reached, of = len(times[arm]), len(runs[arm])
        shown = f"{_shown(times[arm])} ({reached} of {of})"
        rows.append(fact(where, f"simulated Nao, {arm}, s (arrived)", printed, shown, reached == of, "all arrive"))
    hand, learned = np.array(times["hand"]), np.array(times["sarsa"])
    if hand.size < 2 or learned.size < 2:
        return rows
    gain = 100.0 * (1.0 - learned.mean() / hand.mean())
    p = welch(hand, learned)
    rows.append(fact(where, "gain of the learned policy, % (p of the t-test)", "7.1 (< 0.05)", f"{gain:.1f} ({p:.1e})",
                     bool(gain > 0.0 and p < 0.05), "faster, p < 0.05"))  # fmt: skip
    return rows


def _times(runs: list[dict[str, Any]]) -> list[float]:
    """Return the times to the goal, s, of those runs that arrived and had no problem."""
    times = [run["values"]["goal_time_s"] for run in runs if not run.get("problems")]
    return [float(time) for time in times if time is not None]


def _shown(times: list[float]) -> str:
    return f"{np.mean(times):.2f} +- {np.std(times, ddof=1):.2f}" if len(times) > 1 else "-"
