"""Maps from recordings: made-up walks with known places, a real run of the Nao against truth, the command line."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.maps.build import associate, build_map, estimated_look_noise
from surefoot.lab.maps.equations import BuildOptions
from surefoot.lab.maps.sightings import Sightings, read_sightings
from surefoot.lab.maps.summary import copied
from surefoot.record.recording import RecordingWriter
from surefoot.services.navigator.belief.landmark_files import load, save
from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from tests.services.navigator.belief.floors import EASY, LENGTH, Eye, floor
from tests.surefoot.expect import expect_error


def walk(frames=150):
    """Poses of a robot that walks 1.5 m, turns by 90 degrees and walks 1 m, with stops."""
    speed = np.where(np.arange(frames) % 30 < 22, 0.025, 0.0)
    turn = np.where((np.arange(frames) > 80) & (np.arange(frames) <= 100), math.pi / 40, 0.0)
    heading = np.cumsum(turn)
    step = np.where(turn > 0, 0.0, speed)
    return np.stack((np.cumsum(step * np.cos(heading)), np.cumsum(step * np.sin(heading)), heading), axis=1)


def drifted(poses, seed, bend=0.03, along=0.02):
    """The same by odometry: heading drifts by `bend` rad/m, lengths err by a part."""
    rng = np.random.default_rng(seed)
    d = np.diff(poses, axis=0)
    c, s = np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    local = np.stack((c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0]), axis=1)
    local *= 1.0 + along
    heading = poses[0, 2] + np.concatenate(([0.0], np.cumsum(d[:, 2] + bend * local[:, 0])))
    heading += 1e-4 * rng.standard_normal(len(heading))
    c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
    out = np.zeros_like(poses)
    out[1:, 0] = np.cumsum(c * local[:, 0] - s * local[:, 1])
    out[1:, 1] = np.cumsum(s * local[:, 0] + c * local[:, 1])
    out[:, :2] += poses[0, :2]
    out[:, 2] = heading
    return out


def made_up(seed=1, false=0.0, copied_share=0.0):
    world = floor(seed, 40.0, (-1.0, -1.5), (3.5, 3.0), copied=copied_share)
    eye, poses = Eye(world, EASY, seed, false=false), walk()
    frame, parts, ids = [], [], []
    for f, pose in enumerate(poses):
        seen, truth = eye.look(pose)
        frame += [f] * len(seen)
        parts.append(seen)
        ids.append(truth)
    return world, poses, np.concatenate(ids), Sightings(
        drifted(poses, seed), np.array(frame), np.concatenate([p.ranges for p in parts]),
        np.concatenate([p.bearings for p in parts]), np.concatenate([p.looks for p in parts]), "made up",
    )  # fmt: skip


def errors(made, world):
    """Distance of each landmark of a map from the one it looks like, after a rigid motion, and without."""
    which = ((world.descriptors[None] - made.descriptors[:, None]) ** 2).sum(axis=2).argmin(axis=1)
    a, b = made.positions, world.positions[which]
    u, _, v = np.linalg.svd((a - a.mean(0)).T @ (b - b.mean(0)))
    rot = (u @ np.diag([1.0, np.linalg.det(u @ v)]) @ v).T
    return np.hypot(*((a - a.mean(0)) @ rot.T + b.mean(0) - b).T), np.hypot(*(a - b).T), which


def test_landmarks_are_where_they_are_in_spite_of_drift():
    world, poses, _, seen = made_up()
    made = build_map(seen)
    aligned, plain, which = errors(made.world, world)
    assert len(made.world) > 100
    assert len(set(which.tolist())) == len(which)  # each once
    assert np.sqrt(np.mean(aligned**2)) < 0.02
    assert np.sqrt(np.mean(plain**2)) < 0.07
    odometry = np.hypot(*(seen.poses - poses)[:, :2].T)[-1]
    assert np.hypot(*(made.poses - poses)[:, :2].T)[-1] < odometry
    assert made.range_rms == pytest.approx(0.03, rel=0.15)
    assert made.bearing_rms == pytest.approx(math.radians(1.5), rel=0.15)
    assert made.look_sd == pytest.approx(0.05, rel=0.1)


def test_without_drift_places_are_as_good_as_their_deviations_say():
    world, poses, _, seen = made_up(2)
    exact = Sightings(poses, seen.frame, seen.ranges, seen.bearings, seen.looks, "exact")
    tight = BuildOptions(walk_share=1e-4, turn_share=1e-4, turn_per_m=1e-4, still_m=1e-6, still_rad=1e-6, range_sd=0.0)
    made = build_map(exact, tight)
    _, plain, _ = errors(made.world, world)
    ratio = np.mean(plain**2 / (2.0 * made.sd**2))
    assert 0.6 < ratio < 1.5


def test_false_detections_and_copies_make_few_wrong_landmarks():
    world, _, _, seen = made_up(3, false=0.1, copied_share=0.5)
    made = build_map(seen)
    near = np.hypot(*(made.world.positions[:, None] - world.positions[None]).transpose(2, 0, 1)).min(axis=1)
    assert len(made.world) > 80
    assert np.mean(near < 0.1) > 0.95


def test_association_keeps_different_landmarks_apart_and_joins_the_same():
    _, _, ids, seen = made_up(4)
    track = associate(seen, estimated_look_noise(seen), BuildOptions())
    pairs = {(int(a), int(b)) for a, b in zip(track, ids, strict=True)}
    assert len({a for a, _ in pairs}) == len(pairs)  # no track holds two landmarks
    assert len(pairs) < 1.1 * len({b for _, b in pairs})


def test_too_little_is_refused():
    _, _, _, seen = made_up(5)
    few = Sightings(seen.poses[:1], seen.frame[:5] * 0, seen.ranges[:5], seen.bearings[:5], seen.looks[:5], "few")
    with expect_error(SurefootError, "no_landmarks"):
        build_map(few)
    with pytest.raises(SurefootError):
        build_map(seen, BuildOptions(least=10_000))


def test_copies_are_counted():
    world = floor(6, copied=0.5)
    assert copied(world) == pytest.approx(0.5 * len(world), abs=15)
    assert copied(floor(7)) <= 2


def test_the_command_line_shows_and_checks_maps(tmp_path, answer, in_process):
    good = save(floor(8), tmp_path / "good")
    out = answer("map", "show", good, "--json")
    assert json.loads(out)["landmarks"] == len(floor(8))
    answer("map", "check", good)
    same = save(FloorLandmarks(floor(9).positions, np.ones((len(floor(9)), 3))), tmp_path / "same")
    code, out, _ = in_process("map", "check", same, "--json")
    assert (code, json.loads(out)["ok"]) == (1, False)
    (tmp_path / "torn.npz").write_bytes(good.read_bytes()[:100])
    code, out, _ = in_process("map", "check", tmp_path / "torn.npz", "--json")
    assert (code, json.loads(out)["error"]["code"]) == (2, "malformed")
    assert in_process("map", "show", tmp_path / "none.npz")[0] == 2
    cells = np.zeros((40, 60), dtype=np.int8)
    cells[:, 28:32] = 100
    (tmp_path / "split.pgm").write_bytes(b"P5\n60 40\n255\n" + (254 - 2 * cells.astype(np.uint8)).tobytes())
    yaml = tmp_path / "split.yaml"
    yaml.write_text("image: split.pgm\nresolution: 0.05\norigin: [0, 0, 0]\noccupied_thresh: 0.65\nfree_thresh: 0.25\n")
    code, out, _ = in_process("map", "show", yaml, "--json")
    assert (code, json.loads(out)["regions"]) == (0, 2)
    code, out, _ = in_process("map", "check", yaml, "--radius", "2")
    assert code == 1
    assert "nowhere" in out


def test_a_radius_beyond_what_is_computed_on_a_map_is_a_wrong_argument(tmp_path, in_process):
    (tmp_path / "wide.pgm").write_bytes(b"P5\n500 410\n255\n" + bytes([254]) * 500 * 410)
    yaml = tmp_path / "wide.yaml"
    yaml.write_text("image: wide.pgm\nresolution: 0.05\norigin: [0, 0, 0]\noccupied_thresh: 0.65\nfree_thresh: 0.25\n")
    assert in_process("map", "check", yaml, "--radius", "10")[0] == 0
    code, _, errors = in_process("map", "check", yaml, "--radius", "100")
    assert code == 2
    assert "radius: got 100, allowed is 0 to 10 m, 200 cells of 0.05 m" in errors


def test_recordings_without_landmarks_or_poses_are_refused(tmp_path):
    empty = RecordingWriter(tmp_path / "empty.mcap", {})
    empty.close({})
    with expect_error(SurefootError, "no_landmarks"):
        read_sightings(tmp_path / "empty.mcap")
    (tmp_path / "no.mcap").write_bytes(b"nothing")
    with pytest.raises(SurefootError):
        read_sightings(tmp_path / "no.mcap")


@pytest.mark.slow
def test_a_run_of_the_nao_makes_a_map_of_its_floor(tmp_path: Path, answer):
    """Within 3 cm where odometry alone would be off by 2 degrees and more; truth is read here, not by the tool."""
    from surefoot.lab.runs.local import run_local
    from surefoot.services.simulator.sensors.landmarks import scatter
    from surefoot.services.simulator.sensors.sight import FIELD
    from surefoot.services.supervisor.scenarios.scenario import parse_scenario

    walk = """
    description = "Nao stands, walks and turns"
    compose = "nao"
    max_duration_s = 40.0
    [world]
    terrain = "flat"
    map_profile = "exact"
    perturbation = 1.0
    [[step]]
    when = "ready"
    do = "stand"
    duration = 2.0
    [[step]]
    when = "ready"
    after_s = 2.0
    do = "walk"
    distance = 0.5
    [[step]]
    when = "walk_done"
    do = "turn"
    angle = 0.6
    """
    run_local(parse_scenario(walk, tmp_path / "walk.toml"), 3, recording=tmp_path / "run.mcap")
    out = tmp_path / "floor.npz"
    printed = answer("map", "build", tmp_path / "run.mcap", "--out", out, "--json")
    assert json.loads(printed)["landmarks"] > 40
    true = scatter(3, *FIELD, 60.0)
    aligned, plain, which = errors(load(out), FloorLandmarks(true.position, true.descriptor))
    assert len(set(which.tolist())) == len(which)
    assert np.sqrt(np.mean(aligned**2)) < 0.03
    assert np.sqrt(np.mean(plain**2)) < 0.05
    assert load(out).descriptor_length == LENGTH
