"""Recordings (MCAP): messages, and samples as arrays.

for message in bags.messages("run.mcap", "state/velocity"): ...
bags.arrays("run.mcap")["gyro"]
"""

from collections.abc import Iterator
from os import PathLike
from os.path import isdir, isfile
from typing import Any

from surefoot.arguments import file_path, instance
from surefoot.client import topic_named
from surefoot.errors import SurefootError
from surefoot.lab.report.why import Explanation, explain
from surefoot.record.check import Findings
from surefoot.record.columns import Columns, recorded_columns
from surefoot.record.recording import read_recording, recording_info, verify_recording
from surefoot.schemas.base import Message

__all__ = ["Explanation", "Findings", "Message", "arrays", "check", "info", "messages", "why"]


def messages(path: str | PathLike[str], *keys: str) -> Iterator[Message]:
    """Yield the decoded messages of the topics `keys`, of all topics without `keys`, in the order of their stamps.

    Raises:
        SurefootError: an unknown key, a file that cannot be read, a message that does not fit its topic.
    """
    for key in keys:
        instance(key, "keys", str, "keys of topics, each an argument of its own")
        topic_named(key)
    return (item.message() for item in read_recording(file_path(path, "path"), keys or None) if item.model is not None)


def arrays(path: str | PathLike[str]) -> Columns:
    """Return samples, truth and estimates of a run as named arrays, each with a row per sample, in SI units.

    `gyro` and `acc` (n, 3) in IMU axes with `stamp_ns` (n,); `joints` (m, nj) rad with `joints_stamp_ns`; `touch` and
    `force` of the feet with `contacts_stamp_ns`; truth of base_link as `base_...`, published estimates as
    `published_...`, where they were recorded.

    Raises:
        SurefootError: the file cannot be read, or has no inertial samples.
    """
    return recorded_columns(file_path(path, "path"))[0]


def info(path: str | PathLike[str]) -> dict[str, Any]:
    """Return counts, times (ns) and metadata of a recording (raises SurefootError: it cannot be read)."""
    return recording_info(file_path(path, "path"))


def check(path: str | PathLike[str]) -> Findings:
    """Return which parts of a possibly damaged recording can be read (raises SurefootError: it is no recording)."""
    if not isfile(file_path(path, "path")):
        text = "is a folder" if isdir(path) else "no such file"
        raise SurefootError("unreadable", f"{path}: {text}", "path")
    return verify_recording(file_path(path, "path"))


def why(path: str | PathLike[str]) -> Explanation:
    """Return what went wrong in a run, its first cause and the evidence between (raises SurefootError: unreadable)."""
    return explain(file_path(path, "path"))
