"""Robot of a recorded run: as it is known here, or the copy that the recording carries."""

from pathlib import Path

from surefoot.errors import SurefootError
from surefoot.record.recording import ReadableRecording
from surefoot.robot.description import RobotError
from surefoot.robot.reader import ROBOT_FILE, load_robot


def attached_robot(recording: ReadableRecording, robot: str, robot_hash: str, folder: Path) -> str:
    """Return the robot of a run: its name, or the path of a folder with the recorded copy if it has changed since.

    Args:
        recording: recording of the run.
        robot: name or folder of the robot in the run.
        robot_hash: hash of its description; empty = not recorded.
        folder: folder to which the recorded copy is written.

    Raises:
        SurefootError: the robot is not known here or has changed since, and the recording has no copy of it.
    """
    attached = recording.found.attachments.get(ROBOT_FILE)
    try:
        if robot_hash in ("", load_robot(robot).hash):
            return robot
    except RobotError:
        if attached is None:
            raise
    own = folder / ROBOT_FILE
    own.write_bytes(attached or b"")
    if attached is None or load_robot(own).hash != robot_hash:
        raise SurefootError("invalid", f"{recording.path}: robot {robot!r} has changed since", "robot_hash")
    return str(folder)
