"""Names of the export formats, and checks before a recording is read."""

from pathlib import Path

from surefoot.errors import SurefootError
from surefoot.nearest import did_you_mean

ENDINGS = {"rosbag2": "-bag", "csv": ".csv", "parquet": ".parquet", "tum": ".tum", "foxglove": "-foxglove.mcap"}
"""End of the name that an exported file or folder gets after the recording's own, by the name of its format."""


FASTEST_HZ = 1000.0
"""Largest rate of the snapshots of an export, Hz."""


def check_format(kind: str) -> None:
    """Raise SurefootError if a format `kind` is no key of `ENDINGS`."""
    if kind not in ENDINGS:
        hint = did_you_mean(kind, ENDINGS)
        raise SurefootError("invalid", f"got {kind!r}{hint}, allowed are {', '.join(ENDINGS)}", "to")


def check_rate(kind: str, rate_hz: float | None) -> None:
    """Raise SurefootError if a rate of snapshots, Hz, is given for a format without them, or is not above 0."""
    if rate_hz is not None and kind != "foxglove":
        raise SurefootError("invalid", f"got {rate_hz:g} with {kind}, allowed is --rate with foxglove", "rate")
    if rate_hz is not None and not 0.0 < rate_hz <= FASTEST_HZ:
        raise SurefootError("invalid", f"got {rate_hz:g} Hz, allowed is above 0, at most {FASTEST_HZ:g}", "rate")


def check_out(kind: str, out: Path) -> None:
    """Raise SurefootError if a format `kind` is no key of `ENDINGS`, or if the file or folder `out` exists."""
    check_format(kind)
    if out.exists():
        raise SurefootError("invalid", f"{out} exists; allowed is a new path (--out)", "out")
