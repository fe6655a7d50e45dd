"""Reading of ROS 1 and ROS 2 bags, and MCAP files of either, as raw logs, by the library `rosbags`."""

import sqlite3
import struct
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.bus.ros_messages import stamp_of
from surefoot.errors import SurefootError
from surefoot.nearest import did_you_mean
from surefoot.record.fields import USUAL, FieldPath

from .raw import RawLog, Stream, Transform, in_order

INSTALL = "pip install 'surefoot[bags]'"
"""Shell command that installs the optional reader of ROS bags."""
IMU, JOINTS, TRANSFORMS = "sensor_msgs/msg/Imu", "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage"
"""ROS message types: `IMU`: of inertial samples; `JOINTS`: of joint states; `TRANSFORMS`: of frame transforms."""
UNREADABLE = (
    ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError, OSError, TypeError, ValueError,
    sqlite3.Error, struct.error,
)  # fmt: skip
"""Exceptions that the library `rosbags` raises on a damaged file, in addition to its own class."""


@dataclass(frozen=True)
class BagTopics:
    """Settings for reading a bag: names of its topics, order of joints and feet, kind of stamps."""

    imu: str
    joints: str
    contacts: FieldPath | None = None
    joint_names: tuple[str, ...] = ()  # of the positions; empty = the names in the messages
    feet: tuple[str, ...] = ()  # legs in the order of the contacts
    arrival: bool = False  # stamps are the times of arrival, not those of the headers
    sort: bool = False


def reader_of(path: Path, more: Mapping[str, str] = MappingProxyType({})) -> Any:
    """Return the opened reader of a bag (raises SurefootError: unreadable); `more`: definitions of types by name."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise SurefootError("not_installed", f"{path.name} is a bag: {INSTALL}", "bag") from None
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        text = (
            "is a folder without metadata.yaml, wanted is the folder of a ROS 2 bag, or a file .bag, .mcap, .csv, .npz"
        )
        raise SurefootError("malformed", f"{path} {text}", "bag")
    store = get_typestore(Stores.LATEST)
    for name, text in more.items():
        store.register(get_types_from_msg(text, name))
    try:
        reader = AnyReader([path], default_typestore=store)
        reader.open()
    except (AnyReaderError, *UNREADABLE) as error:
        raise _broken(path, error) from None
    return reader


def _broken(path: Path, error: Exception) -> SurefootError:
    text = " ".join(str(error).split())[:160] or type(error).__name__
    if "json" in text.lower() or "profile" in text.lower():
        text += "; a recording of surefoot is read by `surefoot estimate`"
    return SurefootError("malformed", f"{path} is cut off, damaged or of an unknown encoding ({text})", "bag")


def log_of_bag(path: Path, wanted: BagTopics) -> RawLog:
    """Return the raw log of a bag, read from the wanted topics.

    Raises:
        SurefootError: the bag cannot be read, a topic is absent or of another type, or its stamps jump.
    """
    reader = reader_of(path)
    try:
        contacts = (wanted.contacts.topic,) if wanted.contacts else ()
        for topic, kind in ((wanted.imu, IMU), (wanted.joints, JOINTS), *((topic, "") for topic in contacts)):
            _check_topic(reader, path, topic, kind)
        if wanted.contacts is not None:
            _check_contacts(reader, wanted.contacts)
        found = _Collected(wanted)
        for topic, arrival, message in bag_messages(reader, path, {wanted.imu, wanted.joints, *contacts}):
            found.take(topic, arrival, message)
    finally:
        reader.close()
    return found.log()


def _check_topic(reader: Any, path: Path, topic: str, kind: str) -> None:
    own = [c for c in reader.connections if c.topic == topic]
    known = sorted({f"{c.topic}" for c in reader.connections})
    if not own:
        hint = did_you_mean(topic, known) or f"; it has {', '.join(known) or 'none'}"
        raise SurefootError("unknown_topic", f"{path} has no topic {topic!r}{hint}", topic)
    kinds = sorted({c.msgtype for c in own})
    if len(kinds) > 1:
        raise SurefootError("invalid", f"{topic} comes as {' and '.join(kinds)}; one type is allowed", topic)
    if kind and kinds != [kind]:
        fit = sorted({c.topic for c in reader.connections if c.msgtype == kind})
        text = f"{topic} is a {kinds[0]}, wanted is {kind}" + (f": {', '.join(fit)}" if fit else "")
        raise SurefootError("invalid", text, topic)


def _check_contacts(reader: Any, wanted: FieldPath) -> None:
    """Raise SurefootError if the messages of the topic of foot forces or flags are of a type that holds none."""

    def usual(kind: str) -> bool:
        names = {name for name, _ in reader.typestore.fielddefs.get(kind, ((), ()))[1]}
        return kind != TRANSFORMS and (not names or not names.isdisjoint(USUAL))

    kind = next(c.msgtype for c in reader.connections if c.topic == wanted.topic)
    if kind == TRANSFORMS or not (wanted.fields or usual(kind)):
        fit = sorted({c.topic for c in reader.connections if usual(c.msgtype)})
        text = f"{wanted.topic} is a {kind}, allowed are types with a field {', '.join(USUAL[:-1])} or {USUAL[-1]}"
        raise SurefootError("invalid", text + (f": {', '.join(fit)}" if fit else ""), wanted.topic)


def bag_messages(reader: Any, path: Path, topics: set[str]) -> Iterator[tuple[str, int, Any]]:
    """Yield (topic, time of arrival, ns, message) for messages of these topics, and for static transforms."""
    from rosbags.highlevel import AnyReaderError

    connections = [
        c for c in reader.connections
        if c.topic in topics or (c.topic.endswith("tf_static") and c.msgtype == TRANSFORMS)
    ]  # fmt: skip
    try:
        for connection, arrival, data in reader.messages(connections):
            yield connection.topic, arrival, reader.deserialize(data, connection.msgtype)
    except (AnyReaderError, *UNREADABLE) as error:
        raise _broken(path, error) from None


class _Collected:
    """Rows of sensor samples collected from the topics of a bag while it is read."""

    def __init__(self, wanted: BagTopics) -> None:
        self.wanted = wanted
        self.rows: defaultdict[str, list[tuple[int, Any]]] = defaultdict(list)
        self.frames: dict[str, Transform] = {}
        self.frame = ""
        self.names: tuple[str, ...] = ()
        self.feet: tuple[str, ...] = ()
        self.flags = False

    def take(self, topic: str, arrival: int, m: Any) -> None:
        wanted = self.wanted
        if hasattr(m, "transforms"):
            for each in m.transforms:
                t, r = each.transform.translation, each.transform.rotation
                place = Transform(each.header.frame_id, np.array([t.x, t.y, t.z]), np.array([r.w, r.x, r.y, r.z]))
                self.frames[each.child_frame_id.lstrip("/")] = place
            return
        stamp = arrival
        if not wanted.arrival and hasattr(m, "header"):
            stamp = stamp_of(m)
        if topic == wanted.imu:
            w, a = m.angular_velocity, m.linear_acceleration
            self.frame = m.header.frame_id.lstrip("/")
            self.rows["imu"].append((stamp, (w.x, w.y, w.z, a.x, a.y, a.z)))
        if topic == wanted.joints:
            self.rows["joints"].append((stamp, self._joints(len(self.rows["joints"]), m)))
        if wanted.contacts is not None and topic == wanted.contacts.topic:
            values = wanted.contacts.values(m)
            self.flags = values.dtype in (np.bool_, np.uint8)
            if not self.feet and wanted.contacts.named and len(getattr(m, "name", ())) == len(values):
                self.feet = tuple(m.name)
            self.rows["contacts"].append((stamp, values.astype(np.float64)))

    def _joints(self, row: int, m: Any) -> tuple[Any, Any, Any]:
        """Return positions, rad, velocities and efforts of the joints in a JointState message; None = field absent."""
        topic, given = self.wanted.joints, self.wanted.joint_names
        if given and len(m.position) < len(given):
            text = f"{topic} row {row}: {len(m.position)} positions, --joint-names has {len(given)}"
            raise SurefootError("invalid", text, "joint-names")
        names = given or tuple(m.name)
        if not given and len(names) != len(m.position):
            text = f"{topic} row {row}: {len(names)} names for {len(m.position)} positions; name these by --joint-names"
            raise SurefootError("invalid", text, "joint-names")
        if self.names and names != self.names:
            raise SurefootError("invalid", f"{topic} row {row}: other joint names than in row 0", topic)
        self.names, count = names, len(names)
        return m.position[:count], _first(m.velocity, count), _first(m.effort, count)

    def log(self) -> RawLog:
        wanted, rows = self.wanted, self.rows
        joints = self._stream("joints", wanted.joints, [row[0] for _, row in rows["joints"]])
        more = [self._more(i, joints) for i in (1, 2)]
        log = RawLog(
            self._stream("imu", wanted.imu), self.frame, joints, self.names, more[0], more[1], frames=self.frames
        )
        if wanted.contacts is not None:
            log.feet = self._stream("contacts", wanted.contacts.topic)
            log.flags, log.feet_names = self.flags, wanted.feet or self.feet
        return log

    def _stream(self, kind: str, topic: str, values: list[Any] | None = None) -> Stream:
        rows = self.rows[kind]
        values = [row for _, row in rows] if values is None else values
        sizes = sorted({len(row) for row in values})
        if len(sizes) > 1:
            raise SurefootError("invalid", f"{topic}: rows of {sizes[0]} and of {sizes[-1]} numbers", topic)
        stamps: NDArray[np.int64] = np.array([stamp for stamp, _ in rows], dtype=np.int64)
        numbers = np.array(values, dtype=np.float64).reshape(len(rows), sizes[0] if sizes else 0)
        return in_order(topic, Stream(stamps, numbers), self.wanted.sort)

    def _more(self, part: int, joints: Stream) -> NDArray[np.float64] | None:
        """Return joint velocities (`part` 1) or efforts (2) of all rows, (m, J); None if a row lacks them."""
        rows = self.rows["joints"]
        values = [row[part] for _, row in rows]
        if any(value is None for value in values):
            return None
        order = np.argsort(np.array([stamp for stamp, _ in rows]), kind="stable")
        return np.array(values, dtype=np.float64)[order] if self.wanted.sort else np.array(values, dtype=np.float64)


def _first(values: Any, count: int) -> Any:
    return values[:count] if len(values) >= count else None
