"""Export of a recording as an MCAP file of Foxglove's messages, with metadata and robot description."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from surefoot.errors import SurefootError
from surefoot.record.recording import ReadableRecording, media_type
from surefoot.robot.description import Robot, RobotError
from surefoot.robot.reader import ROBOT_FILE, ROBOTS, load_robot

from ..scene.film import NS, ReadCount, snapshots
from ..scene.foxglove import FoxgloveScene
from ..scene.pages import LAYOUT, asset
from ..scene.primitives import sdk
from ..scene.scene import KEYS, POSTURE, RobotScene

MOST_SNAPSHOTS = 20_000
"""Largest number of snapshots of an export without a stated rate; those of a longer recording are further apart."""
NEXT_S = 2.0 * NS
"""Period of snapshots, s, that is below any between two ticks: there is one for each."""
LINE_KEY = "log/"
LATEST_S = 2.0**32
"""Upper limit of stamps in Foxglove's messages, s; a recording with a pose at or after it is refused."""


def write_foxglove(
    recording: ReadableRecording,
    out: Path,
    robot: Robot,
    progress: Callable[[float], None] = lambda share: None,
    rate_hz: float | None = None,
) -> None:
    """Write a recording as an MCAP file of Foxglove's messages.

    Its metadata are those of the recording; robot description and layout are attached.

    Args:
        recording: recording to convert.
        out: file to write.
        robot: description of the recorded robot.
        progress: called with the share that is done, 0 to 1.
        rate_hz: snapshots a second of recorded time; None = one for each tick, but `MOST_SNAPSHOTS` at most.

    Raises:
        SurefootError: the library is missing, or the recording cannot be read, shows no posture of the robot, or holds
            a message that does not fit the schema of its topic.
    """
    library = sdk()
    scene, context, count = RobotScene(robot, strict=True), library.Context(), 0
    lines, account = _log_lines(recording), ReadCount(robot)
    with library.open_mcap(out, context=context) as file:
        for name, values in recording.metadata.items():
            file.write_metadata(name, values)
        for name, kind, data in _attachments(recording, robot):
            file.attach(
                log_time=recording.start_ns, create_time=recording.start_ns, name=name, media_type=kind, data=data
            )
        to = FoxgloveScene(scene, context)
        period_s, text = _period(recording, rate_hz)
        to.log(recording.start_ns, "info", "export", text)
        messages = ((m.stamp_ns * NS, account.reading(m)) for m in recording.messages(KEYS, progress))
        for shown in snapshots(scene, messages, period_s):
            if not 0.0 <= shown.time < LATEST_S:
                got = f"a pose at {shown.time:g} s, allowed is 0 or more and below {LATEST_S:g}"
                raise SurefootError("malformed", f"{recording.path}: {got}", "stamp_ns")
            to.publish(shown)
            count += 1
            while lines and lines[0][0] <= shown.time / NS:
                to.log(*lines.pop(0))
        for line in lines:
            to.log(*line)
    if not count:
        why = "".join(f"; {note}" for note in account.notes())
        raise SurefootError("invalid", f"{recording.path} shows no posture of the robot {robot.name}{why}", "recording")


def _period(recording: ReadableRecording, rate_hz: float | None) -> tuple[float, str]:
    """Return the time between two snapshots, s, by their rate, else by the ticks and their number; and it in words."""
    if rate_hz is not None:
        return 1.0 / rate_hz, f"{rate_hz:g} snapshots a second"
    count = next((number for key in POSTURE if (number := recording.found.messages[key])), 0)
    if count <= MOST_SNAPSHOTS:
        return NEXT_S, "a snapshot for each tick"
    period_s = (recording.end_ns - recording.start_ns) * NS / MOST_SNAPSHOTS
    return period_s, f"{1.0 / period_s:.4g} snapshots a second, as the recording has {count} ticks; all with --rate"


def _log_lines(recording: ReadableRecording) -> list[tuple[int, str, str, str]]:
    """Return (stamp, ns; level; source; text) of each log line in a recording."""
    found: list[tuple[int, str, str, str]] = []
    for item in recording.messages():
        if item.key.startswith(LINE_KEY):
            with suppress(SurefootError):  # of another version
                line: Any = item.message()
                found.append((item.stamp_ns, line.level, line.source, line.text))
    return found


def _attachments(recording: ReadableRecording, robot: Robot) -> list[tuple[str, str, bytes]]:
    """Return (name, media type, content) of the Foxglove layout and of the files attached to a recording.

    If the robot description is not among them, it is added if it is found on this machine.
    """
    files = dict(recording.found.attachments)
    if ROBOT_FILE not in files:
        for place in (Path(recording.metadata.get("run", {}).get("robot", "")), ROBOTS / robot.name):
            with suppress(RobotError, OSError):
                if load_robot(place / ROBOT_FILE).hash == robot.hash:
                    files[ROBOT_FILE] = (place / ROBOT_FILE).read_bytes()
    found = [(LAYOUT, "application/json", asset(LAYOUT).encode())]
    return found + [(name, media_type(name), data) for name, data in files.items()]
