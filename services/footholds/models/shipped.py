"""Models that come with robots, found without loading the code that reads them."""

from os.path import isfile
from pathlib import Path


def shipped(robot: str) -> Path | None:
    """Return the path of the slip model file that is shipped for a robot, by its name; None if there is none."""
    path = Path(__file__).parent / "shipped" / f"{robot}.json"
    return path if robot.isidentifier() and isfile(path) else None
