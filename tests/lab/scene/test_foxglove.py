"""Recordings as Foxglove's messages, read back by their descriptors."""

import math

import pytest
from mcap.reader import make_reader

from surefoot.lab.bags.exporting import export
from surefoot.record.recording import read_recording

pytest.importorskip("foxglove", reason="the extra `foxglove` is not installed")
pytest.importorskip("google.protobuf", reason="reading back needs protobuf")


def decoded(path):
    """Yield topic, stamp and message of each record, by the descriptors in the file alone."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    kinds = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if schema.id not in kinds:
                files, pool = descriptor_pb2.FileDescriptorSet.FromString(schema.data), descriptor_pool.DescriptorPool()
                waiting = list(files.file)
                while waiting:
                    each = waiting.pop(0)
                    try:
                        pool.Add(each)
                    except TypeError:  # what it imports is not there yet
                        waiting.append(each)
                kinds[schema.id] = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
            yield channel.topic, message.log_time, kinds[schema.id].FromString(message.data)


@pytest.fixture(scope="module")
def exported(recorded, tmp_path_factory):
    found = {}
    for topic, stamp, message in decoded(export(recorded, "foxglove", tmp_path_factory.mktemp("fox") / "walk.mcap")):
        found.setdefault(topic, []).append((stamp, message))
    return found


def test_every_kind_is_there(exported):
    assert set(exported) >= {
        "/tf", "/robot", "/scene", "/ground", "/map", "/odometry", "/joint_states", "/pose", "/log",
    }  # fmt: skip
    assert len(exported["/tf"]) > 200


def test_base_pose_is_the_truth(exported, recorded):
    truths = {item.stamp_ns: item.message() for item in read_recording(recorded, ("sim/truth",))}
    for stamp, message in exported["/tf"]:
        truth = truths[stamp]
        base = next(t for t in message.transforms if t.child_frame_id == "base_link")
        place, turn = base.translation, base.rotation
        assert (place.x, place.y, place.z) == pytest.approx(truth.position, abs=1e-6)
        dot = sum(a * b for a, b in zip((turn.w, turn.x, turn.y, turn.z), truth.quat_wxyz, strict=True))
        assert 2.0 * math.acos(min(1.0, abs(dot))) < 1e-6 or abs(abs(dot) - 1.0) < 1e-12


def test_the_robot_has_a_shape_in_every_frame_and_joints_by_name(exported):
    (_, robot), *_ = exported["/robot"]
    frames = {t.child_frame_id for t in exported["/tf"][-1][1].transforms}
    assert {entity.frame_id for entity in robot.entities} <= frames
    assert sum(len(e.cylinders) for e in robot.entities) >= 18
    _, joints = exported["/joint_states"][-1]
    assert len({joint.name for joint in joints.joints}) == 18


def test_the_map_has_its_cells(exported):
    _, grid = exported["/map"][0]
    assert len(grid.data) % grid.row_stride == 0
    assert grid.fields[0].name == "elevation"
