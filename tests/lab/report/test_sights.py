"""Images in the report: matches lie where the camera shows them, gates where recognition had them."""

import math

import numpy as np
import pytest

from surefoot.lab.report.charts import charts
from surefoot.lab.report.plots import draw
from surefoot.lab.report.sights import MOST_ACTIONS, features, in_image
from surefoot.lab.report.traces import Traces
from surefoot.schemas.navigation import PoseBelief
from surefoot.schemas.state import Odometry
from surefoot.services.vision.eye import Eye
from surefoot.services.vision.messages import landmarks_message
from surefoot.services.vision.motion import OdometryAt, since
from surefoot.services.vision.recognise import Believed, RecogniseParams
from surefoot.services.vision.view import greys
from tests.services.vision.shots import HEIGHT, OPTICS, base, camera, extractor, shot, world

AT, LATER_NS, WAY = (0.12, 0.03, 0.1), 60_000_000, 0.02
COV = np.diag([1e-4, 2e-4, 9e-4])


def odometry(stamp_ns: int, x: float) -> Odometry:
    half = 0.5 * AT[2]
    message = Odometry(
        position=(x, AT[1], HEIGHT), quat_wxyz=(math.cos(half), 0.0, 0.0, math.sin(half)), yaw=AT[2],
        velocity=(0.0, 0.0, 0.0), covariance=(0.0,) * 16, initialised=True,
    )  # fmt: skip
    return message.stamped(stamp_ns, 0, 1, 0, "estimator")


@pytest.fixture
def traces() -> Traces:
    """Traces of one image, read while the robot has moved on by 2 cm."""
    found, belief = Traces(), Believed(np.array(AT), COV)
    image = shot(AT, stamp_ns=10_000_000)
    pose = PoseBelief(
        pose=AT, covariance=tuple(COV.ravel().tolist()), entropy=-7.5, drift=0.0, drift_sd=0.1,
        map_from_odom=(0.0, 0.0, 0.0), initialised=True, control="odometry", matched=0,
    ).stamped(0, 0, 1, 0, "navigator")  # fmt: skip
    seen = Eye(extractor(), world()).look(image, base(), belief)
    then, now = (OdometryAt(0, (x, AT[1], AT[2]), np.eye(3)) for x in (AT[0], AT[0] + WAY))
    marks = landmarks_message(since(seen.places, then, now), seen, world().codes, image.stamp_ns, ())
    before = marks.model_copy(update={"image_stamp_ns": 5})
    for key, message in (
        ("state/landmarks", before.stamped(0, 0, 1, 0, "vision")),
        ("hw/image", image), ("state/odometry", odometry(10_000_000, AT[0])), ("state/pose", pose),
        ("state/odometry", odometry(10_000_000 + LATER_NS, AT[0] + WAY)),
        ("state/landmarks", marks.stamped(10_000_000 + LATER_NS, 7, 1, 1, "vision")),
    ):  # fmt: skip
        found.feed(key, message)
    return found


def test_matches_are_drawn_where_the_camera_sees_the_features_of_the_map(traces):
    (sight,) = traces.sights.by_action.values()
    codes = np.array([mark.descriptor for mark in sight.seen.landmarks])
    which = (codes @ world().codes.T).argmax(axis=1)
    eye = camera(*AT)
    rays = (np.column_stack([world().positions[which], np.zeros(len(which))]) - eye.position) @ eye.rot
    expected = OPTICS.focal * rays[:, :2] / rays[:, 2:] + (OPTICS.width / 2, OPTICS.height / 2)
    assert len(which) >= 10
    assert np.abs(in_image(sight.places, sight) - expected).max() < 2.5
    assert sight.entropy == -7.5


def test_gates_are_those_within_which_recognition_looked(traces):
    (sight,) = traces.sights.by_action.values()
    far = np.hypot(*sight.places.T)
    assert sight.reach == pytest.approx(RecogniseParams().slack + np.sqrt(9.21 * (2e-4 + far**2 * 9e-4)), rel=1e-9)


def test_features_lie_in_the_image(traces):
    (sight,) = traces.sights.by_action.values()
    found = features(sight, greys(sight.image))
    assert len(found) == sight.seen.features
    assert ((found >= 0.0) & (found <= (OPTICS.width, OPTICS.height))).all()


def test_the_report_shows_the_image_and_a_chart_of_features(traces):
    plots = draw(traces, {})
    assert "<image" in plots["What it saw"]
    assert "entropy -7.5 nats" in plots["What it saw"]
    chart = next(each for each in charts(traces, (), {}, ()) if each["title"] == "Features of an image")
    assert [len(series["t"]) for series in chart["series"]] == [2, 2, 2]


def test_an_image_that_is_none_is_a_sentence(traces):
    (action, sight), *_ = traces.sights.by_action.items()
    traces.sights.by_action[action] = sight._replace(image=sight.image.model_copy(update={"pixels": "#"}))
    assert "base64" in draw(traces, {})["What it saw"]


def test_images_of_few_actions_are_kept(traces):
    (sight,) = traces.sights.by_action.values()
    for k in range(2 * MOST_ACTIONS):
        traces.sights.landmarks(sight.seen, f"action {k}")
    assert len(traces.sights.by_action) == MOST_ACTIONS
