"""Changes of a landmark map: planted ones are found, and nothing else; the new map and the command line."""

import json
import math

import numpy as np
import pytest

from surefoot.bus.codec import encode
from surefoot.bus.interface import Raw
from surefoot.errors import SurefootError
from surefoot.lab.maps.sightings import SureSightings, read_sure
from surefoot.lab.maps.update import LEAST, MapUpdate, changes_of
from surefoot.record.recording import RecordingWriter
from surefoot.schemas.hw import Landmark, LandmarkDetections
from surefoot.schemas.navigation import PoseBelief
from surefoot.schemas.terrain import LandmarkMap
from surefoot.schemas.topics import HW_LANDMARKS, STATE_POSE, TERRAIN_LANDMARKS
from surefoot.services.navigator.belief.landmark_files import load, save
from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from tests.services.navigator.belief.floors import EASY, LENGTH, Eye, floor, unit
from tests.services.navigator.journeys import Journey
from tests.surefoot.expect import expect_error

PLACE_SD, TURN_SD = 0.03, math.radians(1.5)
LOW, HIGH = (-1.0, -1.5), (3.5, 3.0)


def walk(rng, frames=1500):
    """Poses of a robot that walks and turns by itself within 3 m, ten frames a second."""
    poses, x, y, heading = [], 0.3, 0.0, 0.0
    goal = rng.uniform((0.0, -0.5), (2.5, 2.0))
    for _ in range(frames):
        bearing = math.remainder(math.atan2(goal[1] - y, goal[0] - x) - heading, 2.0 * math.pi)
        if abs(bearing) > 0.4:
            heading += math.copysign(0.04, bearing)
        else:
            x, y = x + 0.01 * math.cos(heading), y + 0.01 * math.sin(heading)
        if math.hypot(goal[0] - x, goal[1] - y) < 0.1:
            goal = rng.uniform((0.0, -0.5), (2.5, 2.0))
        poses.append((x, y, heading))
    return np.array(poses)


def believed(poses, rng):
    """The poses with errors that fade within a second, as those of a navigator that sees landmarks."""
    error, out = np.zeros(3), []
    for _ in poses:
        error = 0.9 * error + math.sqrt(1.0 - 0.81) * rng.standard_normal(3) * (PLACE_SD, PLACE_SD, TURN_SD)
        out.append(error)
    return poses + np.array(out)


def sightings(world, seed, frames=1500, recognised=0.3, false=0.0, noise=EASY):
    """Return what a walking robot sees of a floor, and where it believes to be."""
    rng = np.random.default_rng((seed, 3))
    poses = walk(rng, frames)
    eye, parts, number = Eye(world, noise, seed, recognised=recognised, false=false, tilt=0.01), [], []
    for f, pose in enumerate(poses):
        seen, _ = eye.look(pose)
        parts.append(seen)
        number += [f] * len(seen)
    covs = np.tile(np.diag((PLACE_SD**2, PLACE_SD**2, TURN_SD**2)), (frames, 1, 1))
    return SureSightings(
        believed(poses, rng), covs, np.arange(frames) // 10, np.array(number),
        np.concatenate([p.ranges for p in parts]), np.concatenate([p.bearings for p in parts]),
        np.concatenate([p.looks for p in parts]),
    )  # fmt: skip


def passed(world, seed, frames=1500):
    """Number of seconds in which each landmark was well in view of the same walk, by the true poses."""
    poses, times = walk(np.random.default_rng((seed, 3)), frames), [set() for _ in range(len(world))]
    for f, (x, y, heading) in enumerate(poses):
        d = world.positions - (x, y)
        r, b = np.hypot(*d.T), np.angle(np.exp(1j * (np.arctan2(d[:, 1], d[:, 0]) - heading)))
        for i in np.flatnonzero((r > 0.45) & (r < 1.05) & (np.abs(b) < 0.45)):
            times[i].add(f // 10)
    return np.array([len(each) for each in times])


def planted(seed, least=10):
    """A map, the floor after 3 landmarks vanished, 2 moved and 2 came, and the indices of these."""
    world = floor(seed, 20.0, LOW, HIGH)
    rng = np.random.default_rng((seed, 4))
    near = rng.permutation(np.flatnonzero(passed(world, seed) >= least))
    gone, moved, new = near[:3], near[3:5], near[5:7]
    positions = world.positions.copy()
    for i in moved:
        far = [k for k in near[7:] if math.dist(world.positions[k], world.positions[i]) > 0.5]
        positions[i] = world.positions[far[0]] + rng.uniform(-0.1, 0.1, 2)
    now = FloorLandmarks(np.delete(positions, gone, axis=0), np.delete(world.descriptors, gone, axis=0))
    known = np.setdiff1d(np.arange(len(world)), new)
    old = FloorLandmarks(world.positions[known], world.descriptors[known], 4, "made up")
    where = {int(k): i for i, k in enumerate(known)}
    return old, now, {
        "vanished": {where[int(i)] for i in gone}, "moved": {where[int(i)]: positions[i] for i in moved},
        "new": [positions[i] for i in new],
    }  # fmt: skip


def score(found: MapUpdate, true):
    """Number of changes that are right, of all listed, and of those planted that are listed; NEES of the places."""
    right, nees = 0, []
    for change in found.changes:
        place = None
        if change.kind == "vanished":
            right += change.landmark in true["vanished"]
            continue
        if change.kind == "moved":
            place = true["moved"].get(change.landmark)
        elif true["new"]:
            place = min(true["new"], key=lambda each: math.dist(each, change.place))
        if place is not None and math.dist(place, change.place) < 0.15:
            right += 1
            error = place - np.array(change.place)
            nees.append(float(error @ np.linalg.solve(np.array(change.covariance).reshape(2, 2), error)) / 2)
    return right, len(found.changes), nees


def test_planted_changes_are_found_and_nothing_else():
    """Over 10 seeds: 30 vanished, 20 moved and 20 new landmarks of some 400 a floor."""
    right = listed = 0
    nees = []
    for seed in range(10):
        old, now, true = planted(seed)
        found = changes_of(old, sightings(now, seed))
        one = score(found, true)
        right, listed = right + one[0], listed + one[1]
        nees += one[2]
        assert all(change.looks >= LEAST and change.probability >= 0.99 for change in found.changes)
    assert listed - right <= 1
    assert right >= 68
    assert np.mean(nees) < 1.0  # poses count as if they erred alike in all frames


@pytest.mark.parametrize("false", [0.0, 0.1])
def test_nothing_is_listed_on_unchanged_maps(false):
    """With and without detections that carry the look of another landmark."""
    for seed in range(10):
        world = floor(seed, 20.0, LOW, HIGH)
        found = changes_of(world, sightings(world, seed, 600, false=false))
        assert found.changes == ()
        assert found.world is world
        assert found.looked_at > 30


def test_the_new_map_has_what_was_found(tmp_path):
    old, now, true = planted(3)
    found = changes_of(old, sightings(now, 3), "a walk")
    new = load(save(found.world, tmp_path / "new.npz"))
    assert (len(new), new.version, new.source) == (len(old) - 3 + 2, 5, "a walk")
    gone = old.positions[[*true["vanished"], *true["moved"]]]
    assert np.hypot(*(new.positions[:, None] - gone[None]).T).min() > 1e-3  # none is left at its old place
    for place, landmark in [(p, i) for i, p in true["moved"].items()] + [(p, None) for p in true["new"]]:
        one = int(np.hypot(*(new.positions - place).T).argmin())
        assert math.dist(new.positions[one], place) < 0.1
        assert 0.0 < new.sd[one] < 0.1
        if landmark is not None:
            assert np.array_equal(new.descriptors[one], old.descriptors[landmark])
    assert changes_of(new, sightings(now, 3)).changes == ()  # and nothing is left to change


class Watched(Journey):
    """A journey that keeps the frame of the camera in `shown`."""

    shown = None

    def frame(self):
        """Keep what the camera recognises."""
        self.shown = super().frame()
        return self.shown


def test_a_navigator_with_an_old_map_shows_what_changed():
    """The live one in process: its floor lacks 4 of the map's 320 landmarks, has 4 elsewhere and 4 more."""
    journey = Watched(seed=5)
    places, looks = journey.places.copy(), journey.looks.copy()
    middle = np.flatnonzero((np.abs(places[:, 1]) < 0.4) & (places[:, 0] > 0.6) & (places[:, 0] < 2.4))
    gone, moved, new = middle[:4], middle[4:8], middle[8:12]
    journey.places[gone] += 50.0
    journey.places[moved] = places[middle[12:16]] + 0.05
    known = np.setdiff1d(np.arange(320), new)
    old = FloorLandmarks(places[known], looks[known])
    journey.maps[TERRAIN_LANDMARKS.key] = LandmarkMap(
        count=len(old), descriptor_length=8, data=old.to_bytes(), version=1
    )
    poses, covs, number, marks = [], [], [], []
    journey.step(20)
    for x in (2.6, 0.0, 2.6, 0.0):
        journey.goto(x, 0.1)
        for _ in range(12_000):
            journey.step()
            shown, journey.shown = journey.shown, None
            if shown is not None:
                tracker = journey.service.localiser.tracker
                number += [len(poses)] * len(shown.landmarks)
                marks += shown.landmarks
                poses.append(tracker.pose)
                covs.append(tracker.cov[:3, :3].copy())
            if journey.pilot.state not in ("navigating", "stopping", "idle"):
                break
        assert journey.pilot.state == "succeeded"
    seen = SureSightings(
        np.array(poses), np.array(covs), np.arange(len(poses)) // 10, np.array(number),
        np.array([m.range for m in marks]), np.array([m.bearing for m in marks]),
        np.array([m.descriptor for m in marks]),
    )  # fmt: skip
    found = changes_of(old, seen)
    where = {int(k): i for i, k in enumerate(known)}
    true = {
        "vanished": {where[int(i)] for i in gone}, "moved": {where[int(i)]: journey.places[i] for i in moved},
        "new": [places[i] for i in new],
    }  # fmt: skip
    right, listed, _ = score(found, true)
    assert listed == right
    assert right >= 9


def recorded(path, seen):
    """A recording of detections and believed poses."""
    writer, stamp = RecordingWriter(path, {}), 0
    for f, pose in enumerate(seen.poses):
        stamp = f * 100_000_000
        mine = np.flatnonzero(seen.frame == f)
        marks = tuple(
            Landmark(range=seen.ranges[d], bearing=seen.bearings[d], descriptor=tuple(seen.looks[d])) for d in mine
        )
        belief = PoseBelief(
            pose=tuple(pose), covariance=tuple(seen.covs[f].ravel()), entropy=0.0, drift=0.0, drift_sd=0.0,
            map_from_odom=(0.0, 0.0, 0.0), initialised=True, control="odometry", matched=0, stamp_ns=stamp,
        )  # fmt: skip
        for topic, message in (
            (STATE_POSE, belief),
            (HW_LANDMARKS, LandmarkDetections(landmarks=marks, stamp_ns=stamp)),
        ):
            writer.write(topic, message, Raw(*encode(message), ""))
    writer.close({})
    return path


def test_the_command_lists_and_writes_only_when_asked(tmp_path, answer, complaint):
    old, now, _ = planted(3)
    seen, map_file = sightings(now, 3), save(old, tmp_path / "old.npz")
    run, new = recorded(tmp_path / "run.mcap", seen), tmp_path / "new.npz"
    before, words = map_file.read_bytes(), ("map", "update", run, "--map", map_file)
    read = read_sure([run], 0.1)
    assert np.allclose(read.poses, seen.poses)
    assert np.array_equal(read.look, seen.look)
    assert np.array_equal(read.frame, seen.frame)
    listed = json.loads(answer(*words, "--json"))
    assert [each["kind"] for each in listed["changes"]] == ["vanished"] * 3 + ["moved"] * 2 + ["new"] * 2
    assert listed["file"] is None
    assert not new.exists()
    assert str(new) in answer(*words, "--write", new)
    assert len(load(new)) == len(old) - 1
    for existing in (new, map_file):
        assert "--replace" in complaint(*words, "--write", existing)
    assert map_file.read_bytes() == before
    answer(*words, "--write", map_file, "--replace")
    assert load(map_file).sha256 == load(new).sha256
    with expect_error(SurefootError, "no_landmarks"):
        read_sure([run], 0.01)


def test_what_does_not_fit_the_map_is_refused():
    world = floor(0, 20.0, LOW, HIGH)
    seen = sightings(world, 0, 50)
    with expect_error(SurefootError, "bad_descriptor"):
        changes_of(FloorLandmarks(world.positions, world.descriptors[:, :4]), seen)
    other = FloorLandmarks(world.positions, unit(np.random.default_rng(9).standard_normal((len(world), LENGTH))))
    with expect_error(SurefootError, "no_landmarks"):
        changes_of(FloorLandmarks(other.positions + 50.0, other.descriptors), seen)
