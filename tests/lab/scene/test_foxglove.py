"""Recordings as Foxglove's messages, read back by the descriptors in the file alone."""

import json
import math
import shutil
import subprocess

import numpy as np
import pytest
from mcap.reader import make_reader

from surefoot.errors import SurefootError
from surefoot.lab.bags.exporting import export
from surefoot.lab.scene.foxglove import KINDS
from surefoot.lab.scene.pages import LAYOUT
from surefoot.lab.scene.primitives import surface
from surefoot.lab.scene.scene import KEYS
from surefoot.lab.scene.shapes import body_of
from surefoot.record.recording import RecordingWriter, read_recording, recording_info, topic_of
from surefoot.robot.reader import ROBOTS, load_robot, robot_names
from tests.lab.scene.protobuf import reader_of

pytest.importorskip("foxglove", reason="the extra `foxglove` is not installed")


@pytest.fixture(scope="module")
def file(recorded, tmp_path_factory):
    return export(recorded, "foxglove", tmp_path_factory.mktemp("fox") / "walk.mcap")


@pytest.fixture(scope="module")
def exported(file):
    """Messages by topic, each with its stamp, ns."""
    found, kinds = {}, {}
    with file.open("rb") as opened:
        for schema, channel, message in make_reader(opened, validate_crcs=True).iter_messages():
            if channel.message_encoding == "json":
                content = json.loads(message.data)
            else:
                kind = kinds.setdefault(schema.id, None) or reader_of(schema.data, schema.name)
                kinds[schema.id] = kind
                content = kind.FromString(message.data)
            found.setdefault(channel.topic, []).append((message.log_time, content))
    return found


def placed(transforms):
    """Return place and quaternion (w, x, y, z) of each frame in its parent."""
    found = {}
    for t in transforms:
        turn = t.rotation
        found[t.child_frame_id] = (
            np.array([t.translation.x, t.translation.y, t.translation.z]),
            np.array([turn.w, turn.x, turn.y, turn.z]),
        )
    return found


def test_every_kind_is_there_for_every_snapshot(exported):
    assert set(exported) >= {*KINDS, "/values", "/shape/base_link", "/shape/ground"}
    assert len(exported["/tf"]) > 200
    for topic in ("/pose", "/joint_states", "/values"):
        assert [stamp for stamp, _ in exported[topic]] == [stamp for stamp, _ in exported["/tf"]], topic


def test_base_pose_is_the_truth(exported, recorded):
    truths = {item.stamp_ns: item.message() for item in read_recording(recorded, ("sim/truth",))}
    for (stamp, message), (_, named) in zip(exported["/tf"], exported["/pose"], strict=True):
        place, turn = placed(message.transforms)["base_link"]
        truth = truths[stamp]
        assert place == pytest.approx(truth.position, abs=1e-6)
        assert math.sqrt(1.0 - min(1.0, float(turn @ truth.quat_wxyz) ** 2)) < 1e-6
        assert (named.pose.position.x, named.pose.position.y, named.pose.position.z) == tuple(place)


def test_feet_by_the_frames_are_where_they_truly_are(exported, recorded):
    robot = load_robot("ragno")
    truths = {item.stamp_ns: item.message() for item in read_recording(recorded, ("sim/truth",))}
    stamp, message = exported["/tf"][100]
    frames = placed(message.transforms)

    def turned(quat, vector):
        w, v = quat[0], quat[1:]
        return vector + 2.0 * np.cross(v, np.cross(v, vector) + w * vector)

    base, base_turn = frames["base_link"]
    for leg, foot in zip(robot.legs, truths[stamp].foot_position, strict=True):
        place, turn = frames[robot.links[leg.foot.link].name]
        assert base + turned(base_turn, place + turned(turn, leg.foot.position)) == pytest.approx(foot, abs=1e-6)


def test_the_robot_has_a_shape_in_every_frame_and_joints_by_name(exported):
    (_, robot), *_ = exported["/robot"]
    frames = {t.child_frame_id for t in exported["/tf"][-1][1].transforms}
    assert {entity.frame_id for entity in robot.entities} <= frames
    assert {topic.removeprefix("/shape/") for topic in exported if topic.startswith("/shape/")} - {"ground"} <= frames
    assert sum(len(e.cylinders) for e in robot.entities) >= 18
    _, joints = exported["/joint_states"][-1]
    assert len({joint.name for joint in joints.joints}) == 18


def test_map_and_cloud_of_the_ground_agree(exported):
    _, grid = exported["/map"][0]
    heights = np.frombuffer(grid.data, "<f4")
    assert len(heights) % grid.column_count == 0
    assert grid.fields[0].name == "elevation"
    _, cloud = exported["/shape/ground"][0]
    places = np.frombuffer(cloud.data, np.dtype([("place", "<f4", 3), ("colour", "u1", 4)]))["place"]
    assert places[:, 2] == pytest.approx(heights[np.isfinite(heights)])


def test_the_file_holds_what_the_recording_holds_about_itself(file, recorded):
    with file.open("rb") as opened:
        reader = make_reader(opened)
        metadata = {each.name: dict(each.metadata) for each in reader.iter_metadata()}
        attached = {each.name: each.data for each in reader.iter_attachments()}
    assert metadata == recording_info(recorded)["metadata"]
    assert attached["robot.toml"] == (ROBOTS / "ragno" / "robot.toml").read_bytes()
    assert json.loads(attached[LAYOUT])["layout"]


def test_the_layout_shows_channels_that_exist(exported):
    from surefoot.lab.scene.pages import asset

    layout = json.loads(asset(LAYOUT))["configById"]
    shown = {path["value"].partition(".")[0] for panel in layout.values() for path in panel.get("paths", ())}
    shown |= {topic for panel in layout.values() for topic in panel.get("topics", {})}
    shown |= {panel["topicToRender"] for panel in layout.values() if "topicToRender" in panel}
    assert shown
    assert shown <= set(exported)


@pytest.mark.parametrize("name", robot_names())
def test_points_of_a_surface_lie_on_the_parts_of_their_link(name):
    body = body_of(load_robot(name))
    for link in sorted(set(body.link.tolist())):
        places, colours = surface(body, link)
        assert len(places) == len(colours)
        radius = max([p.radius for p in (*body.limbs, *body.balls)], default=0.0)
        own = body.local[body.link == link]
        low, high = own.min(axis=0) - radius, own.max(axis=0) + radius
        assert np.all((places >= low - 1e-9) & (places <= high + 1e-9))


def test_without_a_posture_nothing_is_written(recorded, tmp_path):
    bare = RecordingWriter(tmp_path / "bare.mcap", {"robot": "ragno"})
    for item in read_recording(recorded, ("state/gait",)):
        bare.write(topic_of(item.key), item.message(), item.raw())
    bare.close({})
    with pytest.raises(SurefootError, match="no posture"):
        export(bare.path, "foxglove", tmp_path / "out.mcap")
    assert [path.name for path in tmp_path.iterdir()] == ["bare.mcap"]


def test_without_truth_the_base_is_the_estimate(recorded, tmp_path):
    bare = RecordingWriter(tmp_path / "bare.mcap", {"robot": "ragno"})
    last = None
    for item in read_recording(recorded, tuple(key for key in KEYS if key != "sim/truth")):
        bare.write(topic_of(item.key), item.message(), item.raw())
        last = item.message() if item.key == "state/odometry" else last
    bare.close({})
    with export(bare.path, "foxglove", tmp_path / "out.mcap").open("rb") as opened:
        *_, (schema, _, message) = make_reader(opened).iter_messages(topics=["/pose"])
    pose = reader_of(schema.data, schema.name).FromString(message.data).pose
    assert (pose.position.x, pose.position.y, pose.position.z) == pytest.approx(last.position, abs=1e-9)


def test_rerun_reads_the_frames_and_the_surface_of_the_robot(file, tmp_path):
    rerun = shutil.which("rerun") or pytest.skip("pip install rerun-sdk")
    target = str(tmp_path / "run.rrd")
    subprocess.run([rerun, "mcap", "convert", str(file), "-o", target], check=True, capture_output=True)
    printed = subprocess.run([rerun, "rrd", "print", target], check=True, capture_output=True, text=True).stdout
    assert [
        each for each in ("/tf", "/pose", "/scene", "/map", "/log", "/shape/base_link") if each not in printed
    ] == []
