"""Images in, landmarks out: accuracy against known poses, and honesty where there is nothing to see."""

from base64 import b64encode

import numpy as np
import pytest

from surefoot.services.vision.conditions import conditions
from surefoot.services.vision.eye import BLIND_IMAGES, Eye
from surefoot.services.vision.recognise import Believed, Recognised
from surefoot.services.vision.view import greys
from tests.services.vision.shots import base, extractor, shot, world

POSES = ((0.15, 0.03, 0.1), (0.05, -0.08, -0.05), (0.25, 0.1, 0.2, 0.03, -0.04))


def eye(kind="orb", seed=0) -> Eye:
    return Eye(extractor(kind), world(kind, seed))


def off(seen, pose, kind="orb"):
    """Distances of recognised landmarks from their places in the map, by the true pose."""
    x, y, yaw = pose[:3]
    c, s = np.cos(yaw), np.sin(yaw)
    at = np.stack(
        (x + c * seen.places[:, 0] - s * seen.places[:, 1], y + s * seen.places[:, 0] + c * seen.places[:, 1]), 1
    )
    return np.hypot(*(at - world(kind).positions[seen.landmarks]).T)


@pytest.mark.parametrize("kind", ["orb", "sift"])
@pytest.mark.parametrize("pose", POSES)
def test_landmarks_are_where_the_map_has_them(kind, pose):
    believed = Believed(np.array(pose[:3]) + 0.04, np.diag([0.0025, 0.0025, 0.0025]))
    for each in (believed, None):
        seen = eye(kind).look(shot(pose, noise=3), base(*pose[3:]), each)
        assert len(seen.landmarks) >= 15
        assert seen.flags == ()
        assert np.median(off(seen, pose, kind)) < 0.004
        assert off(seen, pose, kind).max() < 0.03


def test_another_floor_an_image_upside_down_or_another_place_give_no_landmark():
    pose = POSES[0]
    believed = Believed(np.array(pose), np.diag([0.0025, 0.0025, 0.0025]))
    flipped = shot(pose)
    flipped = flipped.model_copy(update={"pixels": b64encode(greys(flipped)[::-1, ::-1].tobytes()).decode()})
    for image in (shot(pose, seed=4), flipped):
        mine = eye()
        for noise in range(BLIND_IMAGES):
            seen = mine.look(image if noise % 2 else image.model_copy(update={"width": 320}), base(), believed)
            mine._before = None
            assert len(seen.landmarks) == 0
        assert "unrecognised" in seen.flags
        assert len(eye().look(image, base(), None).landmarks) == 0


def test_a_few_matches_by_chance_do_not_hide_that_the_floor_is_unknown(monkeypatch):
    """One image in three with as many matches as chance brings into wide gates: the flag comes with the fourth."""
    found = iter([(0, 200), (9, 215), (0, 200), (0, 210)])

    def by_chance(places, *_):
        agreed, compared = next(found)
        index = np.arange(agreed)
        return Recognised(index, index, False, agreed, compared, 1.0)

    monkeypatch.setattr("surefoot.services.vision.eye.recognise", by_chance)
    mine, image, flags = eye(), shot(POSES[0]), []
    for _ in range(BLIND_IMAGES):
        mine._before = None
        flags.append(mine.look(image, base(), Believed(np.zeros(3), np.eye(3))).flags)
    assert flags == [(), (), (), ("unrecognised",)]


def shares(monkeypatch, counts):
    """Return whether a floor counts as unknown after each image with so many of 180 features recognised."""
    found = iter(counts)

    def recognised(*_):
        index = np.arange(next(found))
        return Recognised(index, index, False, len(index), 180, 1.0)

    monkeypatch.setattr("surefoot.services.vision.eye.recognise", recognised)
    mine, image, unknown = eye(), shot(POSES[0]), []
    for _ in counts:
        mine._before = None
        unknown.append("unrecognised" in mine.look(image, base(), Believed(np.array(POSES[0]), np.eye(3))).flags)
    return unknown


def test_a_known_floor_of_few_recognised_features_stays_known(monkeypatch):
    assert not any(shares(monkeypatch, [16] * BLIND_IMAGES + [6] * 2 * BLIND_IMAGES))


def test_an_unknown_floor_that_chance_repeats_stays_unknown_until_more_is_recognised(monkeypatch):
    """A belief that follows matches by chance finds the same ones again: 0.033 of the features in each image."""
    first = [False] * (BLIND_IMAGES - 1)
    assert shares(monkeypatch, [6] * 10) == first + [True] * 7
    assert shares(monkeypatch, [1] * 8 + [6] * 8 + [16] * 3) == first + [True] * 14 + [False] * 2


@pytest.mark.parametrize("side", ["left", "right", "upper", "lower"])
def test_a_half_that_shows_nothing_of_the_map_is_flagged_within_four_images_and_the_other_half_is_used(side):
    belief, mine, flags = Believed(np.array(POSES[0]), np.diag([0.0004] * 3)), eye(), []
    for noise in range(BLIND_IMAGES + 1):
        image = shot(POSES[0], noise=noise)
        pixels = greys(image).copy()
        half = {"left": np.s_[:, :160], "right": np.s_[:, 160:], "upper": np.s_[:120], "lower": np.s_[120:]}[side]
        if noise:
            pixels[half] = 90 + pixels[half] // 50  # grey, so that neither dark nor covered
        seen = mine.look(image.model_copy(update={"pixels": b64encode(pixels.tobytes()).decode()}), base(), belief)
        flags.append(seen.flags)
        assert np.median(off(seen, POSES[0])) < 0.006
    assert flags == [()] * BLIND_IMAGES + [("half_blind",)]


def test_halves_are_watched_over_new_images_in_a_row():
    belief, mine = Believed(np.array(POSES[0]), np.diag([0.0004] * 3)), eye()
    for noise in range(BLIND_IMAGES - 1):
        mine.look(shot(POSES[0], noise=noise), base(), belief)
    assert len(mine._halves) == BLIND_IMAGES - 1
    assert "frozen" in mine.look(shot(POSES[0], noise=noise), base(), belief).flags
    assert len(mine._halves) == BLIND_IMAGES - 1  # nothing new
    mine.world = None
    assert mine.look(shot(POSES[0], noise=noise + 1), base(), belief).flags == ("no_map",)
    assert len(mine._halves) == 0


def test_a_half_of_which_the_map_knows_nothing_is_not_blind():
    """The map ends in the middle of the image, and so do the features: a wall, for example."""
    pose, mine = (0.1, 0.0, 0.0), eye()
    mine.world = mine.world.chosen(mine.world.positions[:, 1] > 0.0)
    for noise in range(2 * BLIND_IMAGES):
        image = shot(pose, noise=noise)
        pixels = greys(image).copy()
        pixels[:, 160:] = 90
        image = image.model_copy(update={"pixels": b64encode(pixels.tobytes()).decode()})
        assert mine.look(image, base(), Believed(np.array(pose), np.diag([0.0004] * 3))).flags == ()


def test_a_wrong_focal_length_is_noticed_by_the_scale():
    mine, flags = eye(), ()
    for k in range(20):
        pose = (0.02 * (k % 10), 0.0, 0.0)
        image = shot(pose, noise=k)
        seen = mine.look(image.model_copy(update={"focal": 0.9 * image.focal}), base(), None)
        flags = seen.flags
        if "scale" in flags or "unrecognised" in flags:
            break
    assert {"scale", "unrecognised"} & set(flags)
    assert len(seen.landmarks) == 0


@pytest.mark.parametrize(
    ("scales", "flagged"),
    [((0.8, 0.82, 0.79), True), ((1.2, 1.17, 1.11), True), ((1.2, 0.8, 1.2), False), ((0.8, 0.82, 0.95), False)],
)
def test_three_images_far_off_to_one_side_are_a_wrong_scale(monkeypatch, scales, flagged):
    """The median of eight images came too late where a strong zoom left few matches."""
    found, mine = iter(scales), eye()
    some = np.arange(5)
    monkeypatch.setattr(mine, "_recognised", lambda *_: Recognised(some, some, False, 60, 200, next(found)))
    for _ in scales[1:]:
        assert "scale" not in mine.look(shot(POSES[0]), base(), None).flags
        mine._before = None
    seen = mine.look(shot(POSES[0]), base(), None)
    assert ("scale" in seen.flags) is flagged
    assert (len(seen.landmarks) == 0) is flagged


def test_conditions_of_pixels():
    assert conditions(np.full((1, 1), 90, np.uint8), None) == ()
    rng = np.random.default_rng(0)
    good = rng.integers(60, 200, (48, 64)).astype(np.uint8)
    assert conditions(good, None) == conditions(good, good + 1) == ()
    assert conditions(good, good.copy()) == ("frozen",)
    assert conditions(good // 64, None) == ("dark",)
    assert conditions(np.maximum(good, 251), None) == ("bright",)
    half = good.copy()
    half[:, :32] //= 32
    assert conditions(half, None) == ("covered",)


def test_what_cannot_be_read_is_a_flag():
    image = shot(POSES[0])
    assert eye().look(image.model_copy(update={"pixels": "?"}), base(), None).flags == ("bad_image",)
    plain = image.model_copy(update={"pixels": b64encode(bytes([120]) * 320 * 240).decode()})
    assert eye().look(plain, base(), None).flags == ("featureless",)
    assert Eye(extractor(), None).look(image, base(), None).flags == ("no_map",)
