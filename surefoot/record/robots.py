"""Robot description of a recording: the attached file, or the installed one of the recorded name."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from surefoot.errors import SurefootError
from surefoot.record.recording import ReadableRecording
from surefoot.robot.description import Robot, RobotError
from surefoot.robot.reader import ROBOT_FILE, load_robot


def robot_of(recording: ReadableRecording) -> Robot:
    """Return the robot of a recording: by the attached description, else by the name in the metadata.

    Raises:
        SurefootError: the recording names no robot.
        RobotError: no usable description has the recorded name.
    """
    attached = recording.found.attachments.get(ROBOT_FILE)
    if attached is not None:
        with TemporaryDirectory() as folder, suppress(RobotError):  # of another version: the one known here will do
            path = Path(folder) / ROBOT_FILE
            path.write_bytes(attached)
            robot = load_robot(path)
            return replace(robot, folder=_folder(recording, robot))
    run = recording.metadata.get("run", {})
    name = run.get("robot") or run.get("namespace", "").rpartition("/")[2]
    if not name:
        raise SurefootError("malformed", f"{recording.path} names no robot")
    return load_robot(name)


def _folder(recording: ReadableRecording, robot: Robot) -> Path | None:
    """Return the folder that the recording names, if the same robot is there on this machine; it may have meshes."""
    place = Path(recording.metadata.get("run", {}).get("robot", ""))
    with suppress(SurefootError, OSError, ValueError):  # no robot, or no name of a file
        known = load_robot(place / ROBOT_FILE)
        return known.folder if known.hash == robot.hash else None
    return None


def robot_for(recording: ReadableRecording, given: str | None) -> Robot:
    """Return the robot `given` by the user, name or path, after a check against the recording; None: the recording's.

    Raises:
        SurefootError: the recording is of another robot than the one given, or names none and none was given.
        RobotError: there is no usable description of the robot.
    """
    if not given:
        return robot_of(recording)
    robot, own = load_robot(given), ""
    with suppress(SurefootError, RobotError):
        own = robot_of(recording).name
    if own not in ("", robot.name):
        raise SurefootError("invalid", f"got {robot.name!r}, allowed is that of {recording.path}: {own!r}", "robot")
    return robot
