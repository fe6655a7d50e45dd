"""The pages in a real browser, headless: no page asks for anything from outside, and their numbers are the bus's."""

import json
from urllib.parse import urlsplit

import numpy as np
import pytest

from surefoot.lab.report.recorded import report_recording
from surefoot.lab.scene.film import UNITS_PER_M
from surefoot.lab.scene.scene import FORCE_LENGTH
from surefoot.lab.scene.shapes import body_of
from surefoot.lab.scene.styles import STYLES, VALUES
from surefoot.record.recording import open_readable
from surefoot.robot.reader import load_robot
from tests.browser import CHROMIUM, MISSING, Browser

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason=MISSING)
READY = "document.body?.dataset.ready == '1'"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Browser(tmp_path_factory.mktemp("profile")) as running:
        yield running


def numbers(browser):
    """Return the numbers beside the picture, by title."""
    rows = "[...document.querySelectorAll('.numbers div')]"
    return dict(json.loads(browser.run(f"JSON.stringify({rows}.map(d => [...d.children].map(e => e.textContent)))")))


def outside(browser):
    """Return the addresses of other machines that the page asked for."""
    return [url for url in browser.asked if urlsplit(url).hostname not in (None, "127.0.0.1")]


def test_a_report_replays_and_asks_for_nothing(recorded, tmp_path, browser):
    path, _ = report_recording(recorded, None, tmp_path / "report.html")
    browser.asked.clear()
    browser.go(f"{path.as_uri()}#t=2.5")
    browser.wait(READY)
    assert browser.run("document.querySelector('.clock').textContent") == "2.50 s"
    assert browser.run("document.querySelectorAll('figcaption').length") > 8
    drawn = set(json.loads(browser.run("JSON.stringify(report.replay.frames.flatMap(f => f.items.map(i => i[0])))")))
    assert {"holding", "expected"} <= {list(STYLES)[number] for number in drawn}
    assert path.as_uri() in browser.asked
    assert not outside(browser)
    assert not browser.faults


def test_a_click_on_a_worst_moment_or_a_plot_moves_the_replay(recorded, tmp_path, browser):
    path, _ = report_recording(recorded, None, tmp_path / "report.html")
    browser.go(path.as_uri())
    browser.wait(READY)
    clock, slider = "document.querySelector('.clock').textContent", "document.querySelector('input[type=range]').value"
    rows = "[...document.querySelectorAll('.worst [data-t]')]"
    times = [float(each) for each in json.loads(browser.run(f"JSON.stringify({rows}.map(e => e.dataset.t))"))]
    assert len(set(times)) > 2
    for number, at in enumerate(times):
        browser.run(f"{rows}[{number}].click()")
        assert browser.run(clock) == f"{at:.2f} s"
        assert float(browser.run(slider)) == pytest.approx(at, abs=0.05)
    plot = "document.querySelector('figure canvas')"
    for kind in ("pointerdown", "pointerup"):
        event = f"new PointerEvent('{kind}', {{bubbles: true, pointerId: 1, clientX: x, clientY: y}})"
        inside = f"const b = {plot}.getBoundingClientRect(), x = b.left + b.width / 2, y = b.top + b.height / 2"
        browser.run(f"{{{inside}; {plot}.setPointerCapture = () => 0; {plot}.dispatchEvent({event})}}")
    end = open_readable(recorded).end_ns * 1e-9
    assert browser.run(clock) not in [f"{at:.2f} s" for at in times]
    assert float(browser.run(slider)) == pytest.approx(end / 2, abs=0.1 * end)
    assert not browser.faults


def test_the_live_page_shows_the_numbers_of_the_bus(server, client, recorded, browser):
    browser.asked.clear()
    browser.go(server.url)
    browser.wait("window.live")
    last = client.hand_over(recorded)
    browser.wait(READY)
    shown = numbers(browser)
    expected = {
        "margin": 1000.0 * last["state/stability"].margin_planned,
        "margin_measured": 1000.0 * last["state/stability"].margin_measured,
        "speed": last["state/velocity"].velocity[0],
        "remaining": last["state/gait"].remaining,
        "nis": last["state/velocity"].nis,
    }
    for name, value in expected.items():
        title, unit, digits = VALUES[name]
        number, _, its_unit = shown[title].partition(" ")
        assert its_unit == unit
        assert float(number) == pytest.approx(value, abs=0.51 * 10.0**-digits), name
    assert browser.run("document.querySelector('.words').textContent").startswith(last["state/gait"].state)
    assert browser.asked
    assert not outside(browser)
    assert not browser.faults


def test_the_page_draws_the_certificate_and_the_scores_of_the_bus(server, client, recorded, browser):
    browser.go(server.url)
    browser.wait("window.live")
    browser.run(
        "window.words = new Set(); const fill = CanvasRenderingContext2D.prototype.fillText;"
        "CanvasRenderingContext2D.prototype.fillText = function (text, ...at) {"
        " words.add(text); return fill.call(this, text, ...at); }; 0"
    )
    last = client.hand_over(recorded, 2.4)  # three feet swing
    browser.wait(READY)
    styles = list(STYLES)
    items = json.loads(browser.run("JSON.stringify(window.live.frame.items)"))
    (arrows,) = (item[1:] for item in items if styles[item[0]] == "holding")
    ends = np.array(arrows).reshape(-1, 2, 3) / UNITS_PER_M
    robot = load_robot("ragno")
    weights = (ends[:, 1, 2] - ends[:, 0, 2]) / (FORCE_LENGTH * body_of(robot).extent)
    assert len(ends) == sum(last["state/stability"].stance)
    assert weights.sum() == pytest.approx(1.0, abs=0.01)
    labels = [item[-1] for item in items if styles[item[0]] == "expected"]
    scores = {f"Q {leg.score:.3f}  slip {leg.slip:.3f}" for leg in last["footholds/chosen"].legs}
    assert {label.partition(" (")[0] for label in labels} == scores
    browser.wait(f"{json.dumps(labels)}.every(label => words.has(label))")
    for layer in ("certificate", "footholds"):
        assert browser.run(f"[...document.querySelectorAll('.layers span')].some(e => e.textContent == '{layer}')")
    assert not browser.faults


def test_buttons_of_the_page_ask_the_driver(server, client, stops, recorded, browser):
    browser.go(server.url)
    browser.wait("window.live")
    shown = "[...document.querySelectorAll('[data-needs]')].filter(e => !e.hidden).map(e => e.dataset.needs).join()"
    assert browser.run(shown) == "pause,push"
    for words, asked in (("[data-do=pause]", "sim/pause"), ("[data-push]", "sim/push")):
        browser.run(f"document.querySelector('{words}').click()")
        browser.wait("document.getElementById('answer').textContent.endsWith('done')")
        assert client.calls[-1][0] == asked
        browser.run("document.getElementById('answer').textContent = ''")
    browser.run("document.querySelector('.stop').click()")
    browser.wait("document.getElementById('answer').textContent == 'stop: done, held'")
    assert stops


def test_a_page_of_an_ended_view_reports_it(server, browser):
    browser.go(server.url)
    browser.wait("window.live")
    server.close()
    browser.wait("['no connection', 'the view has ended; start it again'].includes(state.textContent)")
