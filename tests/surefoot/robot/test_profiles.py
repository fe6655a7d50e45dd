"""Limits of the profiles of sensors: a number at its limit is taken, the next beyond it refused by its path."""

import math
from typing import Any

import pytest

import surefoot.robot.profiles as profiles
from surefoot.robot.description import RobotError
from surefoot.robot.profiles import CameraFile, DepthCameraFile, ImuFile, RangerFile, profile_names, read_profile
from surefoot.tables import read_toml, validated
from tests.surefoot.expect import expect_error

INF = math.inf
LIMITS: list[tuple[Any, str, float, float]] = [
    (CameraFile, "pitch_deg", -90.0, 90.0),
    (CameraFile, "width_px", 8, 8192),
    (CameraFile, "height_px", 8, 8192),
    (CameraFile, "field_deg", math.nextafter(1.0, 2.0), 170.0),
    (CameraFile, "period_ms", 10, 10_000),
    (CameraFile, "exposure_ms", 5e-324, 1000.0),
    (CameraFile, "detect", 0.0, 1.0),
    (CameraFile, "most", 1, 10_000),
    (RangerFile, "field_deg", 5e-324, 180.0),
    (RangerFile, "period_ms", 10, 10_000),
    (DepthCameraFile, "pitch_deg", -90.0, 90.0),
    (DepthCameraFile, "width_px", 8, 320),
    (DepthCameraFile, "height_px", 8, 320),
    (DepthCameraFile, "field_deg", math.nextafter(1.0, 2.0), 170.0),
    (DepthCameraFile, "longest", INF, 100.0),
    (DepthCameraFile, "dropout", 0.0, 1.0),
]
"""Model, field, least and largest value; inf = another test."""


def content(model: Any) -> dict[str, Any]:
    return read_toml(profiles.ROBOTS / model.folder / f"{profile_names(model)[0]}.toml")


@pytest.mark.parametrize(("model", "field", "least", "most"), LIMITS, ids=lambda x: getattr(x, "__name__", None))
def test_a_number_is_taken_at_its_limit_and_refused_beyond(model, field, least, most):
    for limit, way in ((least, -1), (most, 1)):
        if limit != INF:
            validated(model, content(model) | {field: limit}, RobotError)
            beyond = limit + way if isinstance(limit, int) else math.nextafter(limit, way * INF)
            with expect_error(RobotError, "value", field=field, text=f"got {beyond}"):
                validated(model, content(model) | {field: beyond}, RobotError)


@pytest.mark.parametrize("model", [RangerFile, DepthCameraFile])
def test_the_longest_distance_is_above_the_shortest(model):
    shortest = content(model)["shortest"]
    validated(model, content(model) | {"longest": math.nextafter(shortest, INF)}, RobotError)
    for longest in (shortest, -1.0):
        with expect_error(RobotError, "value", field="longest", text=f"above shortest = {shortest}"):
            validated(model, content(model) | {"longest": longest}, RobotError)


@pytest.mark.parametrize("model", [ImuFile, CameraFile, RangerFile, DepthCameraFile])
def test_an_unknown_profile_is_refused_with_the_known_ones_and_one_of_another_name_too(model, tmp_path, monkeypatch):
    with expect_error(RobotError, "unknown_name", field="sensor", text="got 'nope', known are") as caught:
        read_profile(model, "nope", "sensor")
    assert all(name in str(caught.value) for name in profile_names(model))
    shipped = profiles.ROBOTS / model.folder / f"{profile_names(model)[0]}.toml"
    (tmp_path / model.folder).mkdir()
    (tmp_path / model.folder / "mine.toml").write_text(shipped.read_text())
    monkeypatch.setattr(profiles, "ROBOTS", tmp_path)
    with expect_error(RobotError, "value", field=f"{model.folder}.mine.name", text=f"got '{shipped.stem}'"):
        read_profile(model, "mine", "sensor")
