"""The picture of a run against the messages it is made of."""

import math
from typing import Any

import numpy as np
import pytest
import scipy.stats

from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.lab.scene.film import UNITS_PER_M, film_of_recording, frame
from surefoot.lab.scene.scene import FORCE_LENGTH, KEYS, RobotScene, Snapshot
from surefoot.lab.scene.shapes import DrawnGround, body_of
from surefoot.lab.scene.styles import STYLES, VALUES
from surefoot.record.recording import open_readable, read_recording
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.reader import load_robot, robot_names
from surefoot.schemas.hw import Landmark
from surefoot.schemas.navigation import PoseBelief
from surefoot.schemas.state import SeenLandmarks
from surefoot.services.footholds.learning.quality import LEAST


@pytest.fixture(scope="module")
def film(recorded):
    return film_of_recording(open_readable(recorded), load_robot("ragno"))


@pytest.fixture(scope="module")
def truths(recorded):
    return {round(m.stamp_ns * 1e-9, 6): m.message() for m in read_recording(recorded, ("sim/truth",))}


def decoded(recorded: Any, key: str) -> list[Any]:
    return [item.message() for item in read_recording(recorded, (key,))]


def styles(shown: Snapshot | None) -> set[str]:
    assert shown is not None
    return {item.style for item in shown.items}


@pytest.mark.parametrize("name", robot_names())
def test_segments_of_every_robot_end_in_its_feet(name):
    robot = load_robot(name)
    body = body_of(robot)
    for leg in robot.legs:
        ends = [i for i, link in enumerate(body.link) if link == leg.foot.link]
        gaps = np.linalg.norm(body.local[ends] - leg.foot.position, axis=1)
        assert gaps.min() < 1e-6
    used = (
        {i for limb in body.limbs for i in limb[:2]}
        | {b.at for b in body.balls}
        | {i for f in body.faces for i in f.corners}
    )
    assert used == set(range(len(body.link)))


def test_every_snapshot_is_the_truth_of_its_time(film, truths):
    robot = load_robot("ragno")
    assert len(film.snapshots) > 100
    for shown in film.snapshots:
        truth = truths[round(shown.time, 6)]
        assert np.allclose(shown.position, truth.position, atol=1e-12)
        assert np.allclose(shown.rot, matrix_from_quat(np.array(truth.quat_wxyz)), atol=1e-12)
        feet = shown.position + foot_positions(robot.model, shown.joints) @ shown.rot.T
        assert np.allclose(feet, truth.foot_position, atol=1e-6)


def test_centre_of_mass_and_forces_lie_where_they_truly_are(film, truths):
    for shown in film.snapshots[30:]:
        truth = truths[round(shown.time, 6)]
        com = next(item.points[0] for item in shown.items if item.style == "com_planned")
        assert np.linalg.norm(com[:2] - truth.com[:2]) < 0.005
        tails = [item.points[0] for item in shown.items if item.style == "force"]
        loaded = [p for p, f in zip(truth.foot_position, truth.foot_force_n, strict=True) if f > 0.0]
        assert np.allclose(tails, loaded, atol=1e-6)


def test_certificate_arrows_hold_the_planned_centre_of_mass_within_the_friction_of_the_status(film, recorded):
    """Balance of forces and moments, and cones, by the arrows alone; nothing of the solver."""
    robot = load_robot("ragno")
    statuses = decoded(recorded, "state/stability")
    shown = [s for s in film.snapshots[30:] if any(item.style == "holding" for item in s.items)]
    assert len(shown) > 60
    for snapshot in shown:
        known = [each for each in statuses if abs(each.stamp_ns * 1e-9 - snapshot.time) < 0.1]
        arrows = next(item.points for item in snapshot.items if item.style == "holding")
        com = next(item.points[0] for item in snapshot.items if item.style == "com_planned")
        touching, force = arrows[::2], (arrows[1::2] - arrows[::2]) / (FORCE_LENGTH * body_of(robot).extent)
        assert len(force) in {sum(status.stance) for status in known}
        assert force.sum(axis=0) == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
        moment = np.cross(touching - [*com[:2], 0.0], force).sum(axis=0)
        assert moment == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
        assert (np.hypot(force[:, 0], force[:, 1]) <= known[0].mu * force[:, 2] + 1e-9).all()


def test_a_centre_of_mass_outside_has_no_forces_that_hold_it(recorded):
    scene = RobotScene(load_robot("ragno"))
    last = {m.key: m for m in read_recording(recorded, KEYS)}
    for key, item in last.items():
        scene.feed(key, item.message)
    assert "holding" in styles(scene.snapshot())
    away = last["state/stability"].message().model_copy(update={"com_planned": (0.5, 0.0), "margin_planned": None})
    scene.feed("state/stability", lambda: away)
    assert "holding" not in styles(scene.snapshot())


def test_recognised_landmarks_lie_where_the_belief_places_them_within_one_gate(recorded):
    scene = RobotScene(load_robot("ragno"))
    for item in read_recording(recorded, ("hw/joints", "sim/truth")):
        scene.feed(item.key, item.message)
    truth = decoded(recorded, "sim/truth")[-1]
    cov = np.diag([1e-4, 1e-4, 4e-4])
    pose = PoseBelief(
        pose=(1.0, 2.0, np.pi / 2), covariance=tuple(cov.ravel().tolist()), entropy=-8.0, drift=0.0, drift_sd=0.1,
        map_from_odom=(0.0, 0.0, 0.0), initialised=True, control="odometry", matched=2,
    ).stamped(truth.stamp_ns, truth.tick, truth.epoch, 0, "navigator")  # fmt: skip
    marks = (Landmark(range=1.0, bearing=0.0, descriptor=()), Landmark(range=0.5, bearing=np.pi / 2, descriptor=()))
    seen = SeenLandmarks(landmarks=marks, fresh=True, features=40)
    seen = seen.stamped(truth.stamp_ns, truth.tick, truth.epoch, 0, "vision")
    scene.feed("state/pose", lambda: pose)
    scene.feed("state/landmarks", lambda: seen)
    shown = scene.snapshot()
    items = {item.style: item.points[:, :2] for item in shown.items}
    assert items["match"] == pytest.approx(np.array([[1.0, 3.0], [0.5, 2.0]]), abs=1e-9)
    assert np.hypot(*(items["gate"] - [1.0, 3.0]).T) == pytest.approx(0.04 + np.sqrt(9.21 * 5e-4))
    assert (shown.values["entropy"], shown.values["features"], shown.values["matches"]) == (-8.0, 40, 2)
    scene.feed("state/landmarks", lambda: seen.model_copy(update={"fresh": False, "landmarks": ()}))
    assert "match" in styles(scene.snapshot())


def test_labels_are_score_slip_and_interval_of_the_choice_whose_foothold_is_stepped_to(film, recorded):
    chosen, gaits = decoded(recorded, "footholds/chosen"), decoded(recorded, "state/gait")
    names, labels = load_robot("ragno").leg_names, 0
    for snapshot in film.snapshots[30:]:
        gait = [m for m in gaits if m.stamp_ns * 1e-9 <= snapshot.time + 1e-9][-1]
        known = {leg.leg: leg for m in chosen if m.tick <= gait.tick for leg in m.legs}
        expected = set()
        for name, stands, status in zip(names, gait.stance, gait.foothold_status, strict=True):
            if not stands and status == "ok":
                leg = known[name]
                spread = scipy.stats.gamma(a := ((leg.slip - LEAST) / leg.spread) ** 2, scale=(leg.slip - LEAST) / a)
                low, high = LEAST + spread.ppf([0.1, 0.9])
                expected.add(f"Q {leg.score:.3f}  slip {leg.slip:.3f} ({low:.3f} to {high:.3f})")
        assert {item.text for item in snapshot.items if item.style == "expected"} == expected
        labels += len(expected)
    assert labels > 100


def test_region_holds_the_centre_of_mass_when_the_margin_says_so(film):
    for shown in film.snapshots[30:]:
        region = next(item.points[:, :2] for item in shown.items if item.style == "region")
        com = next(item.points[0, :2] for item in shown.items if item.style == "com_planned")
        edges = np.roll(region, -1, axis=0) - region
        inside = np.cross(np.c_[edges, np.zeros(len(edges))], np.c_[com - region, np.zeros(len(region))])[:, 2]
        distance = (inside / np.linalg.norm(edges, axis=1)).min()
        assert 1000.0 * distance == pytest.approx(shown.values["margin"], abs=0.1)


def test_estimate_stays_near_the_truth_and_footholds_near_the_ground(film):
    for shown in film.snapshots[60:]:
        assert np.linalg.norm(shown.estimate[0][:2] - shown.position[:2]) < 0.01
        for item in shown.items:
            if item.style.startswith("foothold"):
                assert abs(item.points[0, 2] - film.scene.ground.at(item.points[:, :2])[0]) < 0.03


def test_a_page_gets_whole_numbers_and_every_value(film):
    shown = film.snapshots[80]
    page = frame(shown)
    assert np.allclose(np.array(page["points"]).reshape(-1, 3) / UNITS_PER_M, shown.points, atol=0.51 / UNITS_PER_M)
    assert len(page["values"]) == len(VALUES)
    assert all(0 <= item[0] < len(STYLES) for item in page["items"])


def test_joints_of_another_robot_make_no_picture(recorded):
    scene = RobotScene(load_robot("nao"))
    for item in read_recording(recorded, ("sim/truth",)):
        scene.feed(item.key, item.message)
    assert scene.snapshot() is None


def test_coarse_ground_keeps_its_place_and_mean():
    rng = np.random.default_rng(0)
    fine = DrawnGround(rng.normal(size=(100, 200)), 0.01, (-0.5, 0.25))
    coarse = fine.coarse(1000)
    step = round(coarse.cell / fine.cell)
    assert coarse.heights.size <= 1000
    assert coarse.heights[0, 0] == pytest.approx(fine.heights[:step, :step].mean())
    assert coarse.origin[0] - 0.5 * coarse.cell == pytest.approx(fine.origin[0] - 0.5 * fine.cell)


def test_all_beside_the_robot_lies_where_the_messages_of_its_time_place_it(recorded):
    """Support, forces and estimate, point by point in plain Python, from the messages alone."""
    robot, scene = load_robot("ragno"), RobotScene(load_robot("ragno"))
    last, compared = dict[str, Any](), set[str]()
    for number, item in enumerate(read_recording(recorded, KEYS)):
        last[item.key] = item.message()
        scene.feed(item.key, item.message)
        if number % 50 or not {"sim/truth", "state/stability"} <= set(last):
            continue
        shown = scene.snapshot()
        assert shown is not None
        for style, points in expected(robot, last["sim/truth"], last["state/stability"]).items():
            found = [item.points for item in shown.items if item.style == style]
            assert np.vstack(found) == pytest.approx(np.array(points), abs=1e-9), style
            compared.add(style)
        if shown.estimate is not None:
            position, rot = shown.estimate
            ghost = next(item.points for item in shown.items if item.style == "ghost")
            assert np.abs((ghost - position) @ rot) == pytest.approx(np.tile(robot.trunk.box / 2.0, (16, 1)))
            assert len(np.unique(ghost.round(9), axis=0)) == 8
            compared.add("ghost")
    assert compared == {"region", "plumb", "com_measured", "force", "ghost"}


def expected(robot, truth, status):
    """Return points (n, 3) m, world, by style, of a true pose and the stability status of its time."""
    w, x, y, z = truth.quat_wxyz
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    heights = [foot[2] for foot, on in zip(truth.foot_position, status.stance, strict=True) if on]
    ground = np.mean(heights) - robot.foot_radius

    def world(place, height=ground):
        (a, b), (at_x, at_y, _) = place, truth.position
        ahead, left = math.cos(yaw) * a - math.sin(yaw) * b, math.sin(yaw) * a + math.cos(yaw) * b
        return at_x + ahead, at_y + left, height

    longer, found = FORCE_LENGTH * body_of(robot).extent / (GRAVITY * robot.mass), dict[str, Any]()
    if len(status.region) > 2 and (status.margin_planned or 0.0) >= 0.0:
        found["region"] = [world(place) for place in status.region]
    if status.com_planned is not None:
        found["plumb"] = [world(status.com_planned, truth.com[2]), world(status.com_planned)]
    if status.com_measured is not None:
        found["com_measured"] = [world(status.com_measured)]
    loaded = [(*p, f) for p, f in zip(truth.foot_position, truth.foot_force_n, strict=True) if f]
    if loaded:
        found["force"] = [(a, b, c + up) for a, b, c, force in loaded for up in (0.0, longer * force)]
    return found


def test_a_stability_status_of_another_robot_is_left_out(recorded):
    scene = RobotScene(load_robot("ragno"))
    last = {m.key: m for m in read_recording(recorded, KEYS)}
    other = last["state/stability"].message().model_copy(update={"stance": (True,) * 4})
    for key, item in (last | {"state/stability": None}).items():
        scene.feed(key, item.message if item is not None else lambda: other)
    assert "region" not in styles(scene.snapshot())


def test_messages_with_other_numbers_of_feet_end_no_picture(recorded):
    robot, scene = load_robot("ragno"), RobotScene(load_robot("ragno"))
    last = {m.key: m.message() for m in read_recording(recorded, KEYS)}
    for key, message in last.items():
        scene.feed(key, lambda message=message: message)
    scene.snapshot()
    marks, truth, gait = len(scene.marks), last["sim/truth"], last["state/gait"]
    for feet in (0, len(robot.legs) - 2, len(robot.legs) + 2):
        numbers = {"stances": (99,) * feet, "contact_sliding": (1.0,) * feet, "stance_sliding": (0.0,) * feet}
        other = truth.model_copy(update=numbers)
        swings = gait.model_copy(update={"stance": (False,) * feet})
        scene.feed("sim/truth", lambda other=other: other)
        scene.feed("state/gait", lambda swings=swings: swings)
        assert not {"foothold", *(("slips",) if feet else ())} & styles(scene.snapshot())
        scene.feed("sim/truth", lambda: truth)
        assert styles(scene.snapshot())
        assert len(scene.marks) == marks
