"""Keys, tokens, types and bytes on ROS 2 are those that independent implementations make and read."""

import threading
import time
from typing import Any

import numpy as np
import pytest

from surefoot.bus import ros_messages as ros
from surefoot.bus.ros2 import GRID_MAP, Ros2Node, data_key, type_hash, types
from surefoot.errors import BusError, SurefootError
from surefoot.schemas.hw import FootContacts, Imu, JointState
from surefoot.schemas.state import Odometry
from surefoot.schemas.terrain import HeightMapMessage
from tests.surefoot.net import WAIT_S, Net
from tests.surefoot.toys import estimate

PUBLISHED = {
    "nav_msgs/msg/Odometry": "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "sensor_msgs/msg/Imu": "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    "sensor_msgs/msg/JointState": "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    "geometry_msgs/msg/Twist": "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    "tf2_msgs/msg/TFMessage": "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
}
"""Hashes as the descriptions of ROS 2 Jazzy have them."""
FRAMES = ("odom", "base_link")
NAMES = ("a", "b", "c")


def odometry() -> Odometry:
    half = np.sqrt(0.5)
    pose = Odometry(
        position=(1.0, 2.0, 0.3), quat_wxyz=(half, 0.0, 0.0, half), yaw=1.57, velocity=(0.0, 0.0, 0.0),
        covariance=tuple(np.diag([0.1, 0.2, 0.3, 0.4]).ravel().tolist()), initialised=True,
    )  # fmt: skip
    return pose.stamped(1_234_567_890_123, 5, 1, 5, "estimator")


@pytest.mark.parametrize(("kind", "published"), PUBLISHED.items())
def test_type_hashes_are_the_published_ones(kind: str, published: str) -> None:
    assert type_hash(kind) == published


def test_type_hashes_of_an_independent_package() -> None:
    messages = pytest.importorskip("ros2_pyterfaces.cyclone.all_msgs")
    for name in ("Odometry", "Imu", "JointState", "Twist", "UInt8MultiArray", "Float32MultiArray"):
        other = getattr(messages, name)
        assert type_hash(other.get_type_name()) == other.hash_rihs01()


def test_hash_of_the_grid_map_by_another_implementation() -> None:
    utils = pytest.importorskip("zenoh_ros2_sdk.utils")
    store = types()
    needed = ("geometry_msgs/msg/Pose", "geometry_msgs/msg/Point", "geometry_msgs/msg/Quaternion",
              "std_msgs/msg/Header", "builtin_interfaces/msg/Time", "std_msgs/msg/Float32MultiArray",
              "std_msgs/msg/MultiArrayLayout", "std_msgs/msg/MultiArrayDimension")  # fmt: skip
    text = {kind: store.generate_msgdef(kind, ros_version=2)[0].split("=" * 80)[0] for kind in needed} | GRID_MAP
    kind = "grid_map_msgs/msg/GridMap"
    found = utils.compute_type_hash_from_msg(kind, text[kind], {k: v for k, v in text.items() if k != kind})
    assert type_hash(kind) == found


def test_an_independent_client_reads_what_is_published(net: Net) -> None:
    pyzeros, gid = pytest.importorskip("pyzeros.pub"), pytest.importorskip("pyzeros.utils").rmw_zenoh_gid
    messages = pytest.importorskip("ros2_pyterfaces.cyclone.all_msgs")
    kind, came, done = ros.KINDS["odometry"], list[tuple[str, bytes, bytes]](), threading.Event()
    key = pyzeros.publisher_keyexpr("/odom", "nav_msgs::msg::dds_::Odometry_", messages.Odometry.hash_rihs01())
    assert key == data_key(0, "/odom", kind)
    node = Ros2Node("surefoot", net.address)
    with net.plain() as session:

        def take(sample: Any) -> None:
            came.append((str(sample.encoding), sample.payload.to_bytes(), sample.attachment.to_bytes()))
            done.set()

        sink = session.declare_subscriber(key, take)
        publisher = node.publisher("/odom", kind)
        own: list[list[str]] = []
        while not own:  # a token takes its time through the router
            tokens = [str(reply.ok.key_expr) for reply in session.liveliness().get("@ros2_lv/**", timeout=WAIT_S)]
            own = [token.split("/") for token in tokens if "/MP/" in token]
        again = pyzeros.token_keyexpr(
            "/odom", "nav_msgs::msg::dds_::Odometry_", messages.Odometry.hash_rihs01(),
            node_name="surefoot", session=session,
            _zenoh_id=own[0][2], _node_id=own[0][3], _entity_id=own[0][4], domain_id=0,
        )  # fmt: skip
        assert again in tokens
        rot = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        velocity = estimate(0.25).model_copy(
            update={"covariance": tuple(np.diag([0, 0, 0, 1.0, 2.0, 3.0]).ravel().tolist())}
        )
        while not done.wait(0.05):  # the first may be on its way before the subscription
            publisher.put(ros.odometry_message(odometry(), velocity, rot, FRAMES))
        sink.undeclare()
    node.close()
    encoding, payload, attachment = came[0]
    assert encoding == "application/cdr"
    assert len(attachment) == 33
    assert (attachment[16], attachment[17:]) == (16, gid(again))
    m = messages.Odometry.deserialize(payload)
    assert (m.header.stamp.sec, m.header.stamp.nanosec) == (1234, 567_890_123)
    assert (m.header.frame_id, m.child_frame_id) == FRAMES
    assert (m.pose.pose.position.x, m.pose.pose.orientation.z) == (1.0, np.sqrt(0.5))
    assert np.asarray(m.pose.covariance).reshape(6, 6)[5, 5] == 0.4
    np.testing.assert_allclose(np.diag(np.asarray(m.twist.covariance).reshape(6, 6))[:3], [2.0, 1.0, 3.0])
    assert m.twist.twist.linear.x == 0.25


def test_other_messages_are_read_back() -> None:
    messages = pytest.importorskip("ros2_pyterfaces.cyclone.all_msgs")
    store = types()
    joints = JointState(position=(0.1, 0.2), torque=(1.0, 2.0))
    made = ros.joints_message(joints, ("a", "b"))
    seen = messages.JointState.deserialize(bytes(store.serialize_cdr(made, ros.KINDS["joints"])))
    assert (list(seen.name), list(seen.position), list(seen.velocity)) == (["a", "b"], [0.1, 0.2], [])
    made = ros.imu_message(Imu(acc=(0.0, 0.1, 9.8), gyro=(0.2, 0.0, 0.0)), "imu")
    seen = messages.Imu.deserialize(bytes(store.serialize_cdr(made, ros.KINDS["imu"])))
    assert (seen.linear_acceleration.y, seen.angular_velocity.x, seen.orientation_covariance[0]) == (0.1, 0.2, -1.0)
    made = ros.contacts_message(FootContacts(touch=((True,), (False,)), normal_force_n=(None, None)))
    seen = messages.UInt8MultiArray.deserialize(bytes(store.serialize_cdr(made, ros.KINDS["contacts"])))
    assert list(seen.data) == [1, 0]


def test_the_height_map_lies_where_grid_map_puts_it() -> None:
    z = np.arange(6, dtype="<f4").reshape(2, 3)  # (y, x)
    m = ros.map_message(HeightMapMessage(rows=2, cols=3, cell=0.5, origin=(1.0, 2.0), data=z.tobytes()))
    assert types().serialize_cdr(m, ros.KINDS["map"])
    nx = {d.label: d.size for d in m.data[0].layout.dim}["row_index"]
    centre, size = m.info.pose.position, (m.info.length_x, m.info.length_y)
    for row in range(2):
        for column in range(3):  # grid_map: index (i, k) is at centre + length / 2 - (index + 1/2) resolution
            i = round((centre.x + size[0] / 2 - (1.0 + 0.5 * column)) / 0.5 - 0.5)
            k = round((centre.y + size[1] / 2 - (2.0 + 0.5 * row)) / 0.5 - 0.5)
            assert m.data[0].data[k * nx + i] == z[row, column]


def test_messages_of_several_topics_keep_their_order(net: Net) -> None:
    reader, writer, came = Ros2Node("reader", net.address), Ros2Node("writer", net.address), list[int]()
    for name in ("imu", "joints"):
        reader.subscribe(f"/{name}", ros.KINDS[name], lambda m: came.append(m.header.stamp.sec), pytest.fail)
    imu, joints = (writer.publisher(f"/{name}", ros.KINDS[name]) for name in ("imu", "joints"))
    still, end, sent = (0.0, 0.0, 0.0), time.monotonic() + WAIT_S, 0
    while len(came) < 600:
        assert time.monotonic() < end
        imu.put(ros.imu_message(Imu(acc=still, gyro=still).stamped(sent * 10**9, 0, 1, 0, "x"), "imu"))
        joints.put(ros.joints_message(JointState(position=still).stamped((sent + 1) * 10**9, 0, 1, 0, "x"), NAMES))
        sent += 2
    writer.close()
    reader.close()
    assert came == sorted(came)


def test_refusals(net: Net) -> None:
    with pytest.raises(SurefootError, match="package/msg/Name"):
        type_hash("nav_msgs/Odometry")
    with pytest.raises(SurefootError, match="letters"):
        data_key(0, "/a b", "nav_msgs/msg/Odometry")
    with pytest.raises(BusError, match="no router"):
        Ros2Node("x", "tcp/127.0.0.1:1")
    node, wrong, came = Ros2Node("x", net.address), list[str](), threading.Event()
    node.subscribe("/imu", ros.KINDS["imu"], lambda _: None, lambda text: (wrong.append(text), came.set()))
    with net.plain() as session:
        while not came.wait(0.05):
            session.put(data_key(0, "/imu", ros.KINDS["imu"]), b"\x00\x01\x00\x00junk")
    node.close()
    assert "no sensor_msgs/msg/Imu" in wrong[0]
