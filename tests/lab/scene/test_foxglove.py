"""Recordings as Foxglove's messages, read back by the descriptors in the file alone."""

import json
import math
import subprocess
import sys

import numpy as np
import pytest
from mcap.reader import make_reader

from surefoot.errors import SurefootError
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.lab.bags import foxglove
from surefoot.lab.bags.exporting import export
from surefoot.lab.scene.foxglove import KINDS
from surefoot.lab.scene.pages import LAYOUT
from surefoot.lab.scene.primitives import Primitives, surface
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
    for topic in ("/pose", "/joint_states", "/values"):
        assert [stamp for stamp, _ in exported[topic]] == [stamp for stamp, _ in exported["/tf"]], topic


def test_base_pose_is_the_truth(exported, recorded):
    truths = {item.stamp_ns: item.message() for item in read_recording(recorded, ("sim/truth",))}
    assert [stamp for stamp, _ in exported["/tf"]] == sorted(truths)
    assert len(truths) > 400  # each tick
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


def test_odometry_has_velocity_and_covariances_of_the_estimator(exported, recorded):
    keys = ("state/odometry", "state/velocity")
    found = {(item.key, item.stamp_ns): item.message() for item in read_recording(recorded, keys)}
    initialised, mount = 0, matrix_from_quat(load_robot("ragno").imu.quat_wxyz)
    for stamp, message in exported["/odometry"][::20]:
        odometry, velocity = (found[key, stamp] for key in keys)
        spread = np.array(message.pose_covariance).reshape(6, 6)
        own = np.array(odometry.pose_covariance).reshape(6, 6)
        assert spread == pytest.approx(spread.T, abs=1e-12)
        assert np.linalg.eigvalsh(spread[:3, :3]) == pytest.approx(np.linalg.eigvalsh(own[:3, :3]), abs=1e-12)
        assert spread[[2, 5], [2, 5]] == pytest.approx(own[[2, 5], [2, 5]], abs=1e-12)  # only turned about the vertical
        if velocity.initialised:
            initialised += 1
            linear, angular = message.linear_velocity, message.angular_velocity
            assert (linear.x, linear.y, linear.z) == pytest.approx(velocity.velocity, abs=1e-12)
            assert (angular.x, angular.y, angular.z) == pytest.approx(velocity.angular_velocity, abs=1e-12)
            wide = np.array(message.velocity_covariance).reshape(6, 6)
            theirs = mount @ np.array(velocity.covariance).reshape(6, 6)[3:, 3:] @ mount.T
            assert wide[:3, :3] == pytest.approx(theirs, abs=1e-12)
            assert not wide[3:].any()
    assert initialised > 5


def test_joint_states_have_the_torques_that_the_driver_measured(exported, recorded):
    measured = {item.stamp_ns: item.message() for item in read_recording(recorded, ("hw/joints",))}
    compared = 0
    for stamp, message in exported["/joint_states"]:
        if stamp in measured and measured[stamp].torque is not None:
            compared += 1
            assert tuple(joint.effort for joint in message.joints) == measured[stamp].torque
            assert not any(joint.HasField("velocity") for joint in message.joints)  # which Ragno does not measure
    assert compared > 10
    assert sum(message.joints[0].HasField("effort") for _, message in exported["/joint_states"]) > 400


@pytest.mark.parametrize(("rate", "most", "apart"), [(None, 20_000, 0.01), (25.0, 20_000, 0.04), (None, 50, 0.08)])
def test_the_rate_of_an_export_is_that_of_the_ticks_or_as_stated(recorded, tmp_path, monkeypatch, rate, most, apart):
    monkeypatch.setattr(foxglove, "MOST_SNAPSHOTS", most)
    path = export(recorded, "foxglove", tmp_path / "out.mcap", rate_hz=rate)
    with path.open("rb") as opened:
        reader = make_reader(opened)
        stamps = [message.log_time for _, _, message in reader.iter_messages(topics=["/tf"])]
        lines = [reader_of(s.data, s.name).FromString(m.data).message for s, _, m in reader.iter_messages(["/log"])]
    steps = np.diff(stamps) * 1e-9
    assert np.median(steps) == pytest.approx(apart, abs=0.011 if most == 50 else 1e-9)
    assert len(stamps) <= most + 1
    assert ("a snapshot for each tick" in lines) == (rate is None and most > 50)
    assert any("as the recording has" in line for line in lines) == (most == 50)


@pytest.mark.parametrize(("kind", "rate"), [("csv", 10.0), ("foxglove", 0.0), ("foxglove", float("nan"))])
def test_a_rate_that_no_export_can_have_is_refused(recorded, tmp_path, kind, rate):
    with pytest.raises(SurefootError) as refused:
        export(recorded, kind, tmp_path / "out", rate_hz=rate)
    assert (refused.value.code, refused.value.field) == ("invalid", "rate")
    assert not list(tmp_path.iterdir())


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


@pytest.fixture(scope="module")
def in_rerun(file, tmp_path_factory):
    """Chunks of the export as rerun's recording holds them: table by table, by name of the entity."""
    chunk = pytest.importorskip("rerun.chunk", reason="rerun is not installed: pip install rerun-sdk")
    target, found = tmp_path_factory.mktemp("rerun") / "run.rrd", {}
    command = [sys.executable, "-m", "rerun", "mcap", "convert", str(file), "-o", str(target)]
    subprocess.run(command, check=True, capture_output=True)
    for each in chunk.RrdReader(target).stream():
        found.setdefault(each.entity_path, []).append(each.to_record_batch())
    return found


def rows(tables, key):
    """Rows of the tables that have the column `key`, each with its stamp, ns."""
    for table in tables:
        if key in table.schema.names:
            yield from zip(table["timestamp"].cast("int64").to_pylist(), table.to_pylist(), strict=True)


def test_every_transform_and_pose_of_the_export_is_in_rerun_to_a_micrometre(in_rerun, exported, recorded):
    truths = {item.stamp_ns: item.message() for item in read_recording(recorded, ("sim/truth",))}
    sent = {(stamp, name): place for stamp, each in exported["/tf"] for name, place in placed(each.transforms).items()}
    kept, based = 0, 0
    for stamp, row in rows(in_rerun["/tf"], "Transform3D:translation"):
        (name,), (place,), (turn,) = (row[f"Transform3D:{key}"] for key in ("child_frame", "translation", "quaternion"))
        expected, quat = sent[stamp, name]
        assert place == pytest.approx(expected, abs=1e-6)
        assert [turn[3], *turn[:3]] == pytest.approx(quat, abs=1e-6)
        kept += 1
        if name == "base_link":
            assert place == pytest.approx(truths[stamp].position, abs=1e-6)
            based += 1
    assert (kept, based) == (len(sent), len(truths))
    poses = list(rows(in_rerun["/pose"], "InstancePoses3D:translations"))
    assert len(poses) == len(truths)
    for stamp, row in poses:
        assert row["InstancePoses3D:translations"][0] == pytest.approx(truths[stamp].position, abs=1e-6)


def test_rerun_draws_points_and_text_and_keeps_the_rest_as_messages(in_rerun):
    names = {path: {name for table in found for name in table.schema.names} for path, found in in_rerun.items()}
    assert "Points3D:positions" in names["/shape/base_link"] & names["/shape/ground"]
    assert "TextLog:text" in names["/log"]
    kept = {"/scene": "SceneUpdate", "/robot": "SceneUpdate", "/map": "Grid", "/odometry": "Odometry"}
    for path, kind in (kept | {"/joint_states": "JointStates"}).items():  # as docs/view.md states
        assert f"foxglove.{kind}:message" in names[path], path


def test_arrows_point_from_their_tail_to_their_tip():
    random = np.random.default_rng(7)
    for tip in [*random.normal(size=(20, 3)), np.array([0.0, 0.0, 2.0]), np.array([0.0, 0.0, -2.0])]:
        sent = Primitives().arrow(np.zeros(3), tip, 0.01, "#102030")
        schema = sent.get_schema()
        arrow = reader_of(schema.data, schema.name).FromString(sent.encode())
        turn = arrow.pose.orientation
        along = matrix_from_quat(np.array([turn.w, turn.x, turn.y, turn.z]))[:, 0]
        assert along == pytest.approx(tip / np.linalg.norm(tip), abs=1e-9)
        assert arrow.shaft_length + arrow.head_length == pytest.approx(np.linalg.norm(tip))
