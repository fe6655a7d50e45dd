"""Traces from a recording: the same numbers as from the live run."""

from pathlib import Path

from surefoot.errors import Refusal
from surefoot.lab.report.traces import KEYS, Traces
from surefoot.record.recording import read_recording

JUDGED = (*KEYS, "terrain/map")


def traces_of(file: Path) -> Traces:
    """Read what a verdict needs from an MCAP file (raises SurefootError when it cannot be read)."""
    traces = Traces()
    for item in read_recording(file, JUDGED):
        try:
            traces.feed(item.key, item.message())
        except Refusal as refusal:
            traces.note(item.stamp_ns * 1e-9, f"{item.key} could not be read: {refusal.message}")
    return traces
