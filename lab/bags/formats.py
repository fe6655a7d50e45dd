"""Names of the export formats, and checks before a recording is read."""

from pathlib import Path

from surefoot.errors import SurefootError
from surefoot.nearest import did_you_mean

ENDINGS = {"rosbag2": "-bag", "csv": ".csv", "parquet": ".parquet", "tum": ".tum", "foxglove": "-foxglove.mcap"}
"""End of the name that an exported file or folder gets after the recording's own, by the name of its format."""


def check_format(kind: str) -> None:
    """Raise SurefootError if a format `kind` is no key of `ENDINGS`."""
    if kind not in ENDINGS:
        hint = did_you_mean(kind, ENDINGS)
        raise SurefootError("invalid", f"got {kind!r}{hint}, allowed are {', '.join(ENDINGS)}", "to")


def check_out(kind: str, out: Path) -> None:
    """Raise SurefootError if a format `kind` is no key of `ENDINGS`, or if the file or folder `out` exists."""
    check_format(kind)
    if out.exists():
        raise SurefootError("invalid", f"{out} exists; allowed is a new path (--out)", "out")
