"""Errors of a camera that all images of a walk share: found from made-up rays, and taken off before a map is made."""

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.geometry.rotations import matrix_from_rotvec
from surefoot.lab.maps.images import map_of
from surefoot.lab.maps.turned import TILTS, FloorLook, camera_error, effects, tilts, turn_of
from surefoot.services.vision.eye import Eye
from tests.services.vision.shots import extractor
from tests.surefoot.expect import expect_error

from .test_images import OUT_AND_BACK, looks_of, nearest

CAMERA = (0.06, 0.0, 0.47)


def seen_by(camera, places, pitch, roll):
    """Places at which a camera turned by a pitch and a roll takes points of the floor to be, by rays and a plane."""
    rays = np.column_stack([places - camera[:2], np.full(len(places), -camera[2])])
    rays = rays @ matrix_from_rotvec(np.array([roll, -pitch, 0.0])).T
    return camera[:2] - rays[:, :2] * camera[2] / rays[:, 2:]


def walk(error, poses=OUT_AND_BACK, noise=0.002, drift=0.0):
    """Looks of a camera with errors p, q, f, g, s (rad), u, v (m), with the true places and looks of the features."""
    made, places, looks = looks_of(poses, noise=noise, drift=drift)
    p, q, f, g, s, u, v = error
    for k, look in enumerate(made):
        pitch, roll = (p, q) + np.array([f, g]) @ turn_of(look.pose[2])
        seen = seen_by(CAMERA, look.places, pitch, roll) @ turn_of(s).T + (u, v)
        made[k] = look._replace(places=seen, camera=CAMERA)
    return made, places, looks


def numbers_of(made, looks):
    """Number of the feature of each sighting in order."""
    return np.concatenate(
        [[int(np.flatnonzero((looks == row).all(axis=1))[0]) for row in look.descriptors] for look in made]
    )


@pytest.mark.parametrize(("p", "q"), [(1e-4, 0.0), (0.0, 1e-4), (1e-4, -2e-4)])
def test_effects_of_a_tilt_are_those_of_its_rays(p, q):
    places = np.random.default_rng(0).uniform((0.3, -0.5), (1.1, 0.5), (40, 2))
    moved = seen_by(CAMERA, places, p, q) - places
    assert tilts(places, CAMERA) @ [p, q] == pytest.approx(moved, abs=2e-6 * 1e-2 + 1e-3 * np.abs(moved).max())


@pytest.mark.parametrize("seed", range(6))
def test_a_camera_shows_its_error_on_a_way_there_and_back(seed):
    rng = np.random.default_rng(seed)
    error = rng.uniform(-1.0, 1.0, 7) * (0.02, 0.02, 0.01, 0.01, 0.03, 0.01, 0.01)
    made, _, looks = walk(error)
    found = camera_error(made, numbers_of(made, looks))
    assert found[:5] == pytest.approx(error[:5], abs=2e-3)
    assert found[5:] == pytest.approx(error[5:], abs=3e-3)


@pytest.mark.parametrize("exact", [True, False])
def test_a_map_of_a_tilted_camera_is_that_of_a_level_one(exact):
    made, places, looks = walk((0.02, 0.01, 0.0, 0.005, 0.0, 0.0, 0.0))
    plain = np.concatenate([np.hypot(*(a.places - b.places).T) for a, b in zip(made, walk((0.0,) * 7)[0], strict=True)])
    world = map_of(made, Eye(extractor(), None), "c", "s", exact=exact)
    assert np.median(plain) > 0.02
    assert len(world) > 50
    assert np.median(nearest(world, places, looks)) < 0.006


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("height", [0.0, -0.47, np.nan, np.inf])
def test_a_camera_that_is_not_above_the_floor_is_refused(height, exact):
    made, *_ = walk((0.0,) * 7)
    made[4] = made[4]._replace(camera=(*CAMERA[:2], height))
    with expect_error(SurefootError, "invalid", "camera"):
        map_of(made, Eye(extractor(), None), "c", "s", exact=exact)


def test_effects_leave_out_what_is_not_looked_for():
    look = FloorLook((0.0, 0.0, 0.0), np.ones((3, 2)), np.zeros((3, 32), np.uint8), CAMERA)
    assert not effects(look, TILTS)[:, :, TILTS:].any()
    assert effects(look)[:, :, TILTS:].any()
