"""The pages in a real browser, headless: no page asks for anything from outside, and their numbers are the bus's."""

import json
from urllib.parse import urlsplit

import pytest

from surefoot.lab.report.recorded import report_recording
from surefoot.lab.scene.scene import VALUES
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
    assert path.as_uri() in browser.asked
    assert not outside(browser)
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
