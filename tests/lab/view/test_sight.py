"""The image on the page of a running system: its picture and marks are those of the messages, and only with vision."""

import base64
import json
import weakref
from io import BytesIO
from threading import Event

import numpy as np
import pytest
from PIL import Image

from surefoot.bus.interface import Delivery
from surefoot.lab.scene.sights import SightKeeper, in_image
from surefoot.lab.view.live import LiveFrames
from surefoot.lab.view.newest import NewestScene
from surefoot.lab.view.page import live_page
from surefoot.lab.view.server import ViewServer
from surefoot.lab.view.sight import WIDEST, LiveSight, drawn
from surefoot.record.recording import topic_of
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import JointState
from surefoot.services.vision.view import greys
from tests.browser import CHROMIUM, MISSING, Browser
from tests.lab.glimpse import glimpse
from tests.lab.view.quiet import QuietClient

WAIT_S = 60.0
NAO = load_robot("nao")


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
    assert sight.look() == (0, "null")  # of no image there is nothing to show


def joints(stamp_ns, epoch=1):
    message = JointState(position=tuple(NAO.neutral)).stamped(stamp_ns, 0, epoch, 0, "simulator")
    return {"hw/joints": delivery("hw/joints", message)}


@pytest.mark.parametrize(("stamp_ns", "epoch"), [(0, 2), (10**7, 1)], ids=["reset", "another driver"])
def test_a_new_run_begins_without_an_image(quiet, stamp_ns, epoch):
    sight = LiveSight(quiet)
    newest = NewestScene(quiet, NAO, sight.take, sight.forget)
    quiet.newest = joints(10**9)
    newest.look()
    given(sight, quiet, glimpse())
    number, shown = sight.look()
    assert shown != "null"
    quiet.newest = joints(stamp_ns, epoch)
    newest.look()
    given(sight, quiet, glimpse()[1:])  # refers to an image of the run before
    assert sight.look() == (number + 1, "null")


def test_the_subscription_of_images_ends_when_no_page_looks(quiet, monkeypatch):
    ended, newest = Event(), quiet.bus.newest

    def subscribe(topic):
        look = newest(topic)
        weakref.finalize(look, ended.set if topic.key == "hw/image" else bool)
        return look

    quiet.bus.newest = subscribe
    live = LiveFrames(quiet, NAO, lambda reason: (True, reason))
    try:
        given(live._sight, quiet, glimpse())
        assert live._sight.look()[1] != "null"
        monkeypatch.setattr("surefoot.lab.view.live.IDLE_S", 0.0)
        assert ended.wait(WAIT_S)
        assert live._sight.look()[1] == "null"
    finally:
        live.close()


def test_a_caption_without_a_believed_pose_states_no_entropy(quiet):
    sight = LiveSight(quiet)
    given(sight, quiet, [each for each in glimpse() if each[0] != "state/pose"])
    text = json.loads(sight.look()[1])["text"]
    assert "matches" in text
    assert "entropy" not in text


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
def test_the_page_shows_the_image_and_asks_for_nothing_from_outside(quiet, recorded, tmp_path, monkeypatch):
    monkeypatch.setattr("surefoot.lab.view.live.IDLE_S", 600.0)  # the image comes before the page
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
