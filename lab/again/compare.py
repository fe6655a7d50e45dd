"""Comparison of stability margin, slip and outcome of two recorded runs from a simulated time on."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from surefoot.record.recording import ReadableRecording, Recorded, open_readable

from ..report.judge import METRICS, Row, distance, since_ready
from ..report.traces import KEYS, Traces, read_traces

READ = (*KEYS, "terrain/map")


class ComparedRow(NamedTuple):
    """Row of a comparison of two runs: name of a quantity, and its value in each run as text with unit."""

    title: str
    before: str
    after: str


def compare(a: Path | ReadableRecording, b: Path, at_s: float) -> list[ComparedRow]:
    """Return the results of two runs from simulated time `at_s`, s, on, one row per quantity.

    If recording `a` is cut off or damaged, both are read only up to its first loss.
    """
    opened, ends = open_readable(a), dict[str, int]()
    one = _numbers(read_traces(_ended(opened, ends)), at_s)
    kept = open_readable(b).messages(READ)
    if opened.damage:
        kept = (item for item in kept if item.stamp_ns <= ends.get(item.key, -1))
    other = _numbers(read_traces(kept), at_s)
    rows: list[ComparedRow] = []
    for name in one:
        rows.append(ComparedRow(METRICS[name].title, *(Row(name, numbers[name]).text for numbers in (one, other))))
    return rows


def _ended(recording: ReadableRecording, ends: dict[str, int]) -> Iterator[Recorded]:
    """Yield the messages before the first loss, and write the stamp, ns, of the last one of each key into `ends`."""
    for item in recording.messages(READ, gapless=True):
        ends[item.key] = item.stamp_ns
        yield item


def _numbers(traces: Traces, at_s: float) -> dict[str, float | None]:
    truth = traces.series("sim/truth")
    stability = since_ready(traces.series("state/stability"), traces.series("state/gait"))
    slips = [1e3 * stance.sliding for stance in traces.stances if stance.time >= at_s]
    later = stability[stability[:, 0] >= at_s] if len(stability) else stability
    margins = {
        name: float(np.nanmin(later[:, column])) if len(later) and np.isfinite(later[:, column]).any() else None
        for name, column in (("min_margin_m", 1), ("min_margin_measured_m", 2))
    }
    return {
        "fell": float(traces.fallen_at is not None),
        **margins,
        "mean_slip_mm": float(np.mean(slips)) if slips else None,
        "max_slip_mm": max(slips, default=None),
        "max_tilt_deg": float(np.degrees(truth[truth[:, 0] >= at_s, 8].max(initial=0.0))) if len(truth) else None,
        "distance_m": distance(truth) if len(truth) else None,
    }
