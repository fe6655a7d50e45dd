"""Repetition of a recording without a scenario, imported or of a robot: estimates again from its sensor messages."""

import hashlib
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from surefoot.errors import SurefootError
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import Driver, DueSample
from surefoot.record.recording import HASHES, SUMMARY, ReadableRecording, Recorded, recording_info, topic_of
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.topics import (
    HW_CONTACTS,
    HW_EXTERNAL,
    HW_IMU,
    HW_JOINTS,
    SIM_JOIN,
    STATE_VELOCITY,
    TICK_NS,
    Topic,
)
from surefoot.services.estimator.service import EstimatorService
from surefoot.services.recorder.config import RecorderConfig
from surefoot.services.supervisor.scenarios.recorded import RUN, SCENARIO

from ..bags.importing import IMPORTED, SERVICES, play
from .robots import attached_robot
from .versions import recorded_versions

SENSED: tuple[Topic[Any], ...] = (HW_IMU, HW_JOINTS, HW_CONTACTS, HW_EXTERNAL)
SENSORS = tuple(topic.key for topic in SENSED)
"""`SENSED`: topics of the sensor messages from which estimates are computed again; `SENSORS`: their keys."""


def without_scenario(recording: ReadableRecording) -> bool:
    """Return True if a run was no scenario: an imported log, or a system that was started and stopped; else False."""
    return SCENARIO not in recording.metadata and "scenario" not in recording.metadata.get(RUN, {})


class RecordedSensors(Driver[ServiceConfig]):
    """Driver that publishes the sensor messages of a recording again, each in its tick, and ignores commands."""

    serves = (SIM_JOIN,)

    def __init__(self, config: ServiceConfig, recording: ReadableRecording) -> None:
        super().__init__(config)
        self._items = recording.messages(SENSORS, gapless=True)
        self._next = next(self._items, None)
        if self._next is None:
            raise SurefootError(
                "invalid", f"{recording.path} has no sensor messages: {', '.join(SENSORS)}", "recording"
            )
        first: Any = self._next.message()
        self.name = first.source  # pyright: ignore[reportAttributeAccessIssue] - of the driver that is played again
        self.epoch = first.epoch
        present = tuple(topic for topic in SENSED if topic.key in recording.found.messages)
        self.outputs = present  # pyright: ignore[reportAttributeAccessIssue] - those that the recording has
        self._waiting: defaultdict[int, list[DueSample]] = defaultdict(list)

    def on_begin(self) -> None:
        """Count runs from the recorded one on, so that messages carry its number (epoch)."""
        self.node.leader.epoch = self.epoch - 1

    def release(self, tick: int) -> list[DueSample]:
        """Return the recorded samples of a tick."""
        for item in self._until(tick * TICK_NS):
            topic, message = topic_of(item.key), item.message()
            assert topic is not None
            head: Any = message
            self._waiting[head.tick].append(DueSample(topic, message, head.stamp_ns, head.seq))
        return self._waiting.pop(tick, [])

    def actuate(self, tick: int, command: JointCommand | None) -> None:
        """Ignore a joint command, since a recording has no actuators."""

    def _until(self, stamp_ns: int) -> Iterator[Recorded]:
        while self._next is not None and self._next.stamp_ns <= stamp_ns:
            yield self._next
            self._next = next(self._items, None)


@dataclass(frozen=True)
class RecordedLog:
    """Recording whose estimates can be computed again from its sensor messages, without a scenario.

    Attributes:
        recording: readable part of the file.
        hashes: recorded digest of the messages of each topic, by key.
        versions: versions of the software that computed the run, by name.
    """

    recording: ReadableRecording
    hashes: dict[str, str]
    versions: dict[str, str]

    @classmethod
    def of(cls, recording: ReadableRecording) -> "RecordedLog":
        """Return the metadata of a recording without a scenario (raises SurefootError: it has no estimates)."""
        if STATE_VELOCITY.key not in recording.found.messages:
            text = f"{recording.path} carries no scenario and no {STATE_VELOCITY.key}: nothing can be repeated"
            raise SurefootError("invalid", text, "recording")
        return cls(recording, recording.metadata.get(HASHES, {}), recorded_versions(recording.metadata))

    @property
    def imported(self) -> bool:
        """True if all messages were computed in lockstep from the sensor messages of a log; else False."""
        return self.recording.metadata.get(RUN, {}).get("mode") == IMPORTED

    @property
    def services(self) -> tuple[str, ...]:
        """Names of the services whose messages follow from the sensor messages alone."""
        return tuple(one.name for one in SERVICES) if self.imported else (EstimatorService.name,)

    @property
    def compared(self) -> tuple[str, ...]:
        """Keys of the recorded sensor messages, and of what follows from them."""
        outputs = (topic.key for one in SERVICES if one.name in self.services for topic in one.outputs)
        return tuple(key for key in (*SENSORS, *outputs) if key in self.recording.found.messages)

    @property
    def run_hash(self) -> str:
        """Hash of the recorded messages that are compared; empty = the file was cut off before their digests."""
        return self.hash_of(self.hashes)

    def hash_of(self, digests: dict[str, str]) -> str:
        """Return the hash of the messages that are compared, as that of a run, from the digests by key."""
        if not all(key in digests for key in self.compared):
            return ""
        lines = "".join(f"{key}={digests[key]}\n" for key in sorted(self.compared))
        return hashlib.sha256(lines.encode()).hexdigest()

    def again(self, to: Path, progress: Callable[[float], None] = lambda share: None) -> str:
        """Compute the estimates again, write them with the sensor messages to another recording; return their hash.

        Args:
            to: recording to write.
            progress: called with the share that is done, 0 to 1.

        Raises:
            SurefootError: the robot is not known here or has changed since, and the recording has no copy of it.
        """
        recording = self.recording
        run = recording.metadata.get(RUN, {})
        last = int(recording.metadata.get(SUMMARY, {}).get("last_tick", recording.end_ns // TICK_NS))
        with tempfile.TemporaryDirectory() as folder:
            robot = attached_robot(recording, run.get("robot", ""), run.get("robot_hash", ""), Path(folder))
            player = RecordedSensors(ServiceConfig(robot=robot), recording)
            play(player, RecorderConfig(robot=robot, path=str(to)), self.services, last, progress)
        return self.hash_of(recording_info(to)["metadata"].get(HASHES, {}))
