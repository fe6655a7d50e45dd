"""The image on the page of a running system: its picture and marks are those of the messages, and only with vision."""

import base64
import json
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from surefoot.bus.interface import Delivery
from surefoot.lab.scene.sights import SightKeeper, in_image
from surefoot.lab.view.live import LiveFrames
from surefoot.lab.view.page import live_page
from surefoot.lab.view.server import ViewServer
from surefoot.lab.view.sight import WIDEST, LiveSight, drawn
from surefoot.record.recording import topic_of
from surefoot.robot.reader import load_robot
from surefoot.services.vision.view import greys
from tests.browser import CHROMIUM, MISSING, Browser
from tests.lab.glimpse import glimpse
from tests.lab.view.quiet import QuietClient

WAIT_S = 60.0


def delivery(key, message):
    return Delivery(topic_of(key), message, None)


def given(sight, client, messages):
    """Let a view take messages one look after the other."""
    for key, message in messages:
        client.newest = {key: delivery(key, message)} if key == "hw/image" else {}
        sight.images()
        if key != "hw/image":
            sight.take(delivery(key, message))


@pytest.fixture
def quiet():
    return QuietClient()


def test_picture_and_marks_are_those_of_the_last_image(quiet):
    sight, keeper = LiveSight(quiet), SightKeeper()
    given(sight, quiet, glimpse())
    for key, message in glimpse():
        take = {"hw/image": keeper.image, "state/odometry": keeper.moved, "state/pose": keeper.believed}.get(key)
        take(message) if take else keeper.landmarks(message, "")
    expected = keeper.by_action[""]
    number, text = sight.look()
    content = json.loads(text)
    picture = np.asarray(Image.open(BytesIO(base64.b64decode(content["jpeg"]))))
    assert picture.shape == (content["height"], content["width"]) == (240, 320)
    assert np.abs(picture.astype(float) - greys(expected.image)).mean() < 6.0
    matches = np.array(content["matches"]).reshape(-1, 2)
    assert matches == pytest.approx(in_image(expected.places, expected), abs=0.051)
    assert len(content["gates"]) == len(matches) >= 10
    assert len(content["features"]) == 2 * expected.seen.features
    assert f"{len(matches)} matches" in content["text"]
    assert sight.look() == (number, text)


def test_images_are_asked_for_once_vision_publishes_only(quiet):
    asked = []
    quiet.bus.newest = lambda topic: asked.append(topic.key) or (lambda: None)
    sight = LiveSight(quiet)
    messages = glimpse()
    given(sight, quiet, [each for each in messages if each[0] != "state/landmarks"])
    assert asked == []
    given(sight, quiet, messages)
    assert asked == ["hw/image"]
    assert sight.look() == (1, "null")  # of no image there is nothing to show


def test_a_new_run_begins_without_an_image(quiet):
    sight = LiveSight(quiet)
    given(sight, quiet, glimpse())
    number, _ = sight.look()
    given(sight, quiet, [(key, message.model_copy(update={"epoch": 2})) for key, message in glimpse()[2:3]])
    assert sight.look() == (number + 1, "null")


def test_a_large_image_is_made_small_and_what_is_no_image_is_left_out(quiet):
    keeper = SightKeeper()
    for key, message in glimpse():
        take = {"hw/image": keeper.image, "state/odometry": keeper.moved, "state/pose": keeper.believed}.get(key)
        take(message) if take else keeper.landmarks(message, "")
    small = keeper.by_action[""]
    image = small.image
    pixels = base64.b64encode(np.kron(greys(image), np.ones((4, 4), np.uint8)).tobytes()).decode()
    four = {"width": 1280, "height": 960, "focal": 4 * image.focal, "pixels": pixels, "center": (640.0, 480.0)}
    content = drawn(small._replace(image=image.model_copy(update=four)))
    assert (content["width"], content["height"]) == (WIDEST, 0.75 * WIDEST)
    grown = np.array(content["matches"]) / np.array(drawn(small)["matches"])
    assert grown == pytest.approx(WIDEST / 320, rel=0.01)
    assert len(content["jpeg"]) < 60_000
    broken = [(k, m.model_copy(update={"pixels": "#"}) if k == "hw/image" else m) for k, m in glimpse()]
    sight = LiveSight(quiet)
    given(sight, quiet, broken)
    assert sight.look()[1] == "null"


@pytest.mark.skipif(CHROMIUM is None, reason=MISSING)
def test_the_page_shows_the_image_and_asks_for_nothing_from_outside(quiet, recorded, tmp_path):
    live = LiveFrames(quiet, load_robot("ragno"), lambda reason: (True, reason))
    given(live._sight, quiet, glimpse())  # while no page looks
    server = ViewServer(live_page("a robot"), live, 0)
    assert '<figure id="sight" hidden>' in live_page("a robot")
    try:
        with Browser(tmp_path / "profile") as browser:
            browser.go(server.url)
            browser.wait("window.live")
            quiet.hand_over(recorded)
            browser.wait("!document.getElementById('sight').hidden", WAIT_S)
            shown = json.loads(browser.run("JSON.stringify(window.live.sight)"))
            assert shown == json.loads(live._sight.shown[1])
            grey = "(() => { const c = document.querySelector('#sight canvas'), d = c.getContext('2d')"
            grey += ".getImageData(0, 0, c.width, c.height).data; let g = 0; for (let i = 0; i < d.length; i += 4)"
            grey += " if (d[i] < d[i + 1] - 40) g++; return [c.width, c.height, g]; })()"
            width, height, green = json.loads(browser.run(f"JSON.stringify({grey})"))
            assert (width, height) == (320, 240)
            assert green > 10 * len(shown["matches"]) / 2  # rings
            assert all(url.startswith((server.url[:20], "data:")) for url in browser.asked)
            assert not browser.faults
    finally:
        server.close()
