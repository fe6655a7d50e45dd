"""The state of the base for Quadruped-PyMPC is read back by an independent implementation of its types."""

from dataclasses import dataclass, field
from types import new_class
from typing import Any

import numpy as np
import pytest

from surefoot.bus import ros_messages as ros
from surefoot.bus.ros2 import type_hash, types
from surefoot.schemas.state import VelocityEstimate
from tests.surefoot.bus.test_ros2 import odometry
from tests.surefoot.toys import estimate

idl = pytest.importorskip("ros2_pyterfaces.cyclone.idl")
kinds = idl.types


def described(kind: str, **fields: Any) -> Any:
    """Return the class of a type: each field with its IDL type."""
    name, numbers = kind.rpartition("/")[2], {str: "", kinds.uint32: 0, kinds.float64: 0.0}
    body = {
        each: field(default=numbers[one]) if one in numbers else field(default=None) for each, one in fields.items()
    }
    return dataclass(
        new_class(
            name, (idl.IdlStruct,), {"typename": kind}, lambda out: out.update(body | {"__annotations__": fields})
        )
    )


THREE, FOUR = kinds.array[kinds.float64, 3], kinds.array[kinds.float64, 4]
HEAD = {"frame_id": str, "sequence_id": kinds.uint32, "timestamp": kinds.float64, "robot_name": str}
POSE = described("dls2_interface/msg/Pose", position=THREE, orientation=FOUR)
SCREW = described("dls2_interface/msg/Screw", linear=THREE, angular=THREE)
STATE = described(
    "dls2_interface/msg/BaseState", **HEAD, pose=POSE, velocity=SCREW, acceleration=SCREW,
    stance_status=kinds.sequence[bool],
)  # fmt: skip
FLAT = described(
    "dls2_msgs/msg/BaseStateMsg", **HEAD, position=THREE, orientation=FOUR, linear_velocity=THREE,
    angular_velocity=THREE, linear_acceleration=THREE, angular_acceleration=THREE, stance_status=FOUR,
)  # fmt: skip


def made(kind: str, later_ns: int = 0) -> Any:
    pose = odometry().model_copy(update={"velocity": (0.1, -0.2, 0.3)})
    velocity: VelocityEstimate = estimate(0.25).model_copy(update={"angular_velocity": (0.4, 0.5, 0.6)})
    message = ros.base_state_message(pose, velocity, (True, False, False, True), "odom", "go2", kind)
    ros.delay(message, later_ns)
    return bytes(types().serialize_cdr(message, ros.KINDS[kind]))


@pytest.mark.parametrize("kind", [STATE, FLAT], ids=lambda kind: kind.__name__)
def test_type_hash_and_head(kind: Any) -> None:
    assert type_hash(kind.get_type_name()) == kind.hash_rihs01()
    m = kind.deserialize(made(kind.__name__, 10**9))
    assert (m.frame_id, m.sequence_id, m.robot_name) == ("odom", 5, "go2")
    assert m.timestamp == pytest.approx(1235.567890123, abs=1e-6)
    assert [bool(foot) for foot in m.stance_status] == [True, False, False, True]


def test_pose_and_velocities() -> None:
    """Place and linear velocity in odom, quaternion x y z w, rates in axes of base_link."""
    one, other = STATE.deserialize(made("BaseState")), FLAT.deserialize(made("BaseStateMsg"))
    half = np.sqrt(0.5)
    for place, turn, speed, rate in (
        (one.pose.position, one.pose.orientation, one.velocity.linear, one.velocity.angular),
        (other.position, other.orientation, other.linear_velocity, other.angular_velocity),
    ):
        np.testing.assert_allclose(place, [1.0, 2.0, 0.3])
        np.testing.assert_allclose(turn, [0.0, 0.0, half, half])
        np.testing.assert_allclose(speed, [0.1, -0.2, 0.3])
        np.testing.assert_allclose(rate, [0.4, 0.5, 0.6])
    assert not np.any(other.linear_acceleration)
