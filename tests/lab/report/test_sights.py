"""Images in the report: matches lie where the camera shows them, gates where recognition had them."""

import numpy as np
import pytest

from surefoot.lab.report.charts import charts
from surefoot.lab.report.plots import draw
from surefoot.lab.report.traces import Traces
from surefoot.lab.scene.sights import MOST_ACTIONS, features, in_image
from surefoot.services.vision.recognise import RecogniseParams
from surefoot.services.vision.view import greys
from tests.lab.glimpse import AT, ENTROPY, glimpse
from tests.services.vision.shots import OPTICS, camera, world


@pytest.fixture
def traces() -> Traces:
    """Traces of one image, read while the robot has moved on by 2 cm."""
    found = Traces()
    for key, message in glimpse():
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
    assert sight.entropy == ENTROPY


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
    assert f"entropy {ENTROPY} nats" in plots["What it saw"]
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
