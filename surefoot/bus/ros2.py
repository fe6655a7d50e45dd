"""ROS 2 over Zenoh without ROS: topics as rmw_zenoh publishes them.

Data: key `<domain>/<topic>/<DDS type>/<type hash>`, payload CDR, attachment sequence number, time and identity.
Graph: a liveliness token below `@ros2_lv` for the node and each publisher and subscriber, so that `ros2 topic list`
shows them. Types, CDR and type hashes (RIHS01, REP-2016) are those of `rosbags`. Format: the design page of rmw_zenoh.
"""
# pyright: reportUnknownMemberType=false
# (the stubs of zenoh leave return types out)

import json
import re
import struct
import time
from collections.abc import Callable
from functools import cache
from typing import Any

import zenoh
from zenoh.handlers import Callback

from surefoot.bus.endpoint import checked, without_source
from surefoot.errors import BusError, SurefootError
from surefoot.schemas.topics import TICK_NS

INSTALL = "pip install 'surefoot[ros2]'"
"""Command that installs the ROS 2 message types, for error messages."""
QOS = "::,10:,:,:,,"
"""Quality of service in every liveliness token: reliable, volatile, history of the newest 10 messages."""
LEAK_NS = TICK_NS // 10_000
"""Growth per tick of the estimated offset between wall time and the robot's time, ns: 100 ppm, the largest drift of
clocks."""
JUMP_NS, FIRM_TICKS = 100_000_000, 100
"""`JUMP_NS`: growth of the offset between wall time and the robot's time that no busy machine causes for long, ns;
`FIRM_TICKS`: number of ticks after which it is taken over."""
GRID_MAP = {
    "grid_map_msgs/msg/GridMapInfo": (
        "float64 resolution\nfloat64 length_x\nfloat64 length_y\ngeometry_msgs/Pose pose\n"
    ),
    "grid_map_msgs/msg/GridMap": (
        "std_msgs/Header header\nGridMapInfo info\nstring[] layers\nstring[] basic_layers\n"
        "std_msgs/Float32MultiArray[] data\nuint16 outer_start_index\nuint16 inner_start_index\n"
    ),
}
BASE_STATE = {
    "dls2_interface/msg/Pose": "float64[3] position\nfloat64[4] orientation\n",
    "dls2_interface/msg/Screw": "float64[3] linear\nfloat64[3] angular\n",
    "dls2_interface/msg/BaseState": (
        "string frame_id\nuint32 sequence_id\nfloat64 timestamp\nstring robot_name\nPose pose\nScrew velocity\n"
        "Screw acceleration\nbool[] stance_status\n"
    ),
    "dls2_msgs/msg/BaseStateMsg": (
        "string frame_id\nuint32 sequence_id\nfloat64 timestamp\nstring robot_name\nfloat64[3] position\n"
        "float64[4] orientation\nfloat64[3] linear_velocity\nfloat64[3] angular_velocity\n"
        "float64[3] linear_acceleration\nfloat64[3] angular_acceleration\nfloat64[4] stance_status\n"
    ),
}
"""Definitions of the message types of Quadruped-PyMPC for the state of the base, which `rosbags` lacks."""
_TOPIC = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")


@cache
def types() -> Any:
    """Return the `rosbags` store of ROS 2 message types (raises SurefootError: the extra `ros2` is not installed)."""
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise SurefootError("not_installed", f"ROS 2 messages need their types: {INSTALL}", "ros2") from None
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in {**GRID_MAP, **BASE_STATE}.items():
        store.register(get_types_from_msg(text, name))
    return store


def type_hash(kind: str) -> str:
    """Return the RIHS01 hash of a ROS 2 message type, e.g. of `nav_msgs/msg/Odometry` (raises SurefootError)."""
    store = types()
    if kind not in store.fielddefs:
        raise SurefootError("invalid", f"got type {kind!r}, wanted is package/msg/Name of ROS 2's own", "type")
    return store.hash_rihs01(kind)


def data_key(domain: int, topic: str, kind: str) -> str:
    """Return the Zenoh key under which a topic is published (raises SurefootError: no topic name or type).

    `domain`: ROS_DOMAIN_ID; `kind`: type of its messages, such as `nav_msgs/msg/Odometry`.
    """
    if not _TOPIC.fullmatch(topic):
        raise SurefootError("invalid", f"got topic {topic!r}, wanted are words of letters, digits, _ and /", "topic")
    return f"{domain}/{topic.strip('/')}/{_dds(kind)}/{type_hash(kind)}"


def _dds(kind: str) -> str:
    package, group, name = kind.split("/")
    return f"{package}::{group}::dds_::{name}_"


def publisher_gid(token: str) -> bytes:
    """Return the identity (16 bytes) of the publisher with a liveliness token (raises SurefootError: not installed).

    As rmw_zenoh has it: XXH3 of the token, 128 bits, little-endian. ROS compares it with that of the graph.
    """
    try:
        from xxhash import xxh3_128_intdigest
    except ImportError:
        raise SurefootError("not_installed", f"ROS 2 publishers need xxhash: {INSTALL}", "ros2") from None
    return xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


class WallOffset:
    """Estimate of wall time minus the time of a run: the least difference so far, which grows by 100 ppm for drift.

    A difference that is larger by `JUMP_NS` in all ticks of one of its periods of `FIRM_TICKS` is taken over: the wall
    clock was set forward, or the run was paused. A clock that was set back counts at once.
    """

    def __init__(self) -> None:
        self._offset_ns: int | None = None
        self._least_ns, self._ticks = 0, 0

    def measure(self, stamp_ns: int) -> int:
        """Update the offset with the wall clock in a tick of stamp `stamp_ns`, and return it, ns; call once a tick."""
        now = time.time_ns() - stamp_ns
        self._offset_ns = now if self._offset_ns is None else min(now, self._offset_ns + LEAK_NS)
        self._least_ns = min(now, self._least_ns) if self._ticks else now
        self._ticks += 1
        if self._ticks == FIRM_TICKS:
            self._ticks = 0
            if self._least_ns > self._offset_ns + JUMP_NS:
                self._offset_ns = self._least_ns
        return self._offset_ns


class Ros2Publisher:
    """Publisher of one ROS 2 topic over Zenoh.

    Args:
        session: Zenoh session of the node.
        key: Zenoh key of the messages.
        token: liveliness token that shows the publisher in the ROS graph; also its identity.
        kind: type of the messages, such as `nav_msgs/msg/Odometry`.

    Raises:
        SurefootError: `xxhash` is not installed.
    """

    def __init__(self, session: zenoh.Session, key: str, token: str, kind: str) -> None:
        self._kind, self._sequence = kind, 0
        self._identity = publisher_gid(token)
        self._token = session.liveliness().declare_token(token)
        self._publisher = session.declare_publisher(key, encoding=zenoh.Encoding.APPLICATION_CDR)

    def put(self, message: Any) -> None:
        """Publish a ROS 2 message, which must be of the type of this publisher."""
        self._sequence += 1
        attachment = struct.pack("<qqB", self._sequence, time.time_ns(), len(self._identity)) + self._identity
        self._publisher.put(bytes(types().serialize_cdr(message, self._kind)), attachment=attachment)


class Ros2Node:
    """A ROS 2 node over Zenoh, for which ROS need not be installed.

    Args:
        name: name of the node.
        router: endpoint of rmw_zenohd, or of a router of surefoot.
        domain: ROS_DOMAIN_ID.

    Raises:
        BusError: no router answers.
        ConfigError: the router is no endpoint.
        SurefootError: the types are not installed.
    """

    def __init__(self, name: str, router: str, domain: int = 0) -> None:
        types()
        config = zenoh.Config()
        settings = {"mode": "client", "connect/endpoints": [checked("router", router)]}
        for key, value in {**settings, "scouting/multicast/enabled": False}.items():
            config.insert_json5(key, json.dumps(value))
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            text = without_source(str(error))[:160]
            raise BusError(
                "unreachable", f"no router answers at {router} for ROS 2 topics ({text})", "router"
            ) from None
        self.name, self.domain, self._entities = name, domain, 0
        self._held: list[Any] = [self._session.liveliness().declare_token(self._token("NN"))]

    def _token(self, entity: str, topic: str = "", kind: str = "") -> str:
        number, self._entities = self._entities, self._entities + 1
        head = f"@ros2_lv/{self.domain}/{self._session.zid()}/0/{number}/{entity}/%/%/{self.name}"
        if not topic:
            return head
        return f"{head}/%{topic.strip('/').replace('/', '%')}/{_dds(kind)}/{type_hash(kind)}/{QOS}"

    def publisher(self, topic: str, kind: str) -> Ros2Publisher:
        """Return a publisher of a topic (raises SurefootError: no topic name or type, `xxhash` is not installed)."""
        key = data_key(self.domain, topic, kind)
        made = Ros2Publisher(self._session, key, self._token("MP", topic, kind), kind)
        self._held.append(made)
        return made

    def subscribe(self, topic: str, kind: str, sink: Callable[[Any], None], failed: Callable[[str], None]) -> None:
        """Pass the messages of a topic to `sink`; `failed` gets a text on each one that cannot be decoded.

        Both are called on Zenoh's thread, in the order in which messages of all topics came, and must not wait.
        """
        key = data_key(self.domain, topic, kind)
        store = types()

        def take(sample: zenoh.Sample) -> None:
            try:
                message = store.deserialize_cdr(sample.payload.to_bytes(), kind)
            except Exception as error:  # whatever a stranger published
                failed(f"{topic}: {sample.payload.__len__()} bytes are no {kind} ({type(error).__name__})")
                return
            sink(message)

        self._held += [
            self._session.liveliness().declare_token(self._token("MS", topic, kind)),
            # a thread for each topic would mix the order: contacts without a stamp take that of the sample before
            self._session.declare_subscriber(key, Callback(take, indirect=False)),
        ]

    def close(self) -> None:
        """Close the node and its connection to the network."""
        self._session.close()  # pyright: ignore[reportUnusedCoroutine, reportUnusedCallResult]
