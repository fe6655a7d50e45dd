"""The pages in a real browser, headless: no page asks for anything from outside, and their numbers are the bus's."""

import json
from types import SimpleNamespace
from urllib.parse import urlsplit

import numpy as np
import pytest

from surefoot.bus.interface import Delivery
from surefoot.lab.report.recorded import report_recording
from surefoot.lab.scene.film import UNITS_PER_M
from surefoot.lab.scene.scene import FORCE_LENGTH
from surefoot.lab.scene.shapes import body_of
from surefoot.lab.scene.styles import STYLES, VALUES
from surefoot.record.recording import open_readable
from surefoot.robot.reader import load_robot
from surefoot.schemas.system import Health, LogRecord
from surefoot.schemas.topics import HEALTH, LOG
from tests.browser import CHROMIUM, MISSING, Browser
from tests.lab.view.conftest import DONE

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


def test_a_drag_over_one_plot_zooms_all_and_a_double_click_shows_all_again(recorded, tmp_path, browser):
    path, _ = report_recording(recorded, None, tmp_path / "report.html")
    browser.go(path.as_uri())
    browser.wait(READY)
    axes = "JSON.stringify(report.charts.all.filter(c => c.box).map(c => [c.box.t0, c.box.t1]))"
    whole = json.loads(browser.run(axes))
    assert len(whole) > 8
    assert len({tuple(each) for each in whole}) == 1
    browser.run("document.querySelector('figure canvas').scrollIntoView({block: 'center'})")
    place = "const r = document.querySelector('figure canvas').getBoundingClientRect(); JSON.stringify([r.left, r.top])"
    left, top = json.loads(browser.run(f"(() => {{ {place.replace('JSON', 'return JSON')} }})()"))
    ((begin, end),) = {tuple(each) for each in whole}
    box = json.loads(browser.run("JSON.stringify(report.charts.all[0].box)"))
    xs = [box["left"] + share * (box["right"] - box["left"]) for share in (0.25, 0.75)]

    def mouse(kind, x, clicks=1):
        browser.call("Input.dispatchMouseEvent", type=f"mouse{kind}", x=left + x, y=top + 40.0, button="left",
                     buttons=int(kind != "Released"), clickCount=clicks)  # fmt: skip

    mouse("Pressed", xs[0])
    mouse("Moved", (xs[0] + xs[1]) / 2)
    mouse("Moved", xs[1])
    mouse("Released", xs[1])
    zoomed = {tuple(each) for each in json.loads(browser.run(axes))}
    ((first, last),) = zoomed
    assert first == pytest.approx(begin + 0.25 * (end - begin), abs=0.02 * (end - begin))
    assert last == pytest.approx(begin + 0.75 * (end - begin), abs=0.02 * (end - begin))
    for clicks in (1, 2):
        mouse("Pressed", xs[0], clicks)
        mouse("Released", xs[0], clicks)
    assert json.loads(browser.run(axes)) == whole
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


def test_every_button_of_a_simulator_asks_it_what_it_reads(server, client, recorded, browser):
    client.answers |= dict.fromkeys(("sim/pause", "sim/step", "sim/speed", "sim/push", "sim/fault", "sim/reset"), DONE)
    client.answers["sim/features"] = SimpleNamespace(
        queries=[key for key in client.answers if key != "sim/features"], faults=["imu_drop", "slip"]
    )
    browser.go(server.url)
    browser.wait("window.live")
    shown = "[...document.querySelectorAll('[data-needs]')].filter(e => !e.hidden).map(e => e.dataset.needs).join()"
    assert browser.run(shown) == "pause,speed,push,fault,reset"
    button, change = "document.querySelector('{}').click()", "{}.value = '{}'; {}.onchange({{target: {}}})"
    speed, kind = change.format(*("speed", "0.25", "speed", "speed")), "kind.value = 'slip'; kind.onchange()"
    for script, key, fields in (
        (button.format("[data-do=pause]"), "sim/pause", {}),
        (button.format("[title^=\"10 ms\"]"), "sim/step", {"ticks": 1}),
        (button.format("[title^=\"0.2 s\"]"), "sim/step", {"ticks": 20}),
        (button.format("[data-do=resume]"), "sim/step", {"ticks": None}),
        (speed, "sim/speed", {"rtf": 0.25}),
        (f"{kind}; target.value = 'lf'; document.getElementById('break').click()", "sim/fault",
         {"kind": "slip", "target": "lf", "duration": 2}),
        (button.format("[data-do=reset]"), "sim/reset", {"keep": True}),
    ):  # fmt: skip
        browser.run(f"{{const [speed, kind, target] = ['speed', 'kind', 'target'].map(n => document.getElementById(n));"
                    f"document.getElementById('answer').textContent = ''; {script}}}")  # fmt: skip
        browser.wait("document.getElementById('answer').textContent.endsWith('done')")
        asked, given = client.calls[-1]
        assert (asked, {name: given.get(name) for name in fields}) == (key, fields)
    assert not browser.faults


def test_a_refused_action_is_shown_with_its_reason(server, client, browser):
    client.answers["sim/pause"] = SimpleNamespace(accepted=False, reason="a step is under way")
    browser.go(server.url)
    browser.wait("window.live")
    browser.run("document.querySelector('[data-do=pause]').click()")
    browser.wait("document.getElementById('answer').textContent == 'pause: refused, a step is under way'")


def test_names_and_lines_of_the_system_are_text_and_never_markup(server, client, recorded, browser):
    bad = "<img src=x onerror=window.hit=1>"
    client.answers["sim/features"] = SimpleNamespace(queries=["sim/fault"], faults=[bad])
    browser.go(server.url)
    browser.wait("window.live")
    service = Health(service=bad, instance="", state="running", pid=1, trouble=bad, dropped={bad: 3})
    line = LogRecord(level="warning", text=bad)
    for topic, message in ((HEALTH, service), (LOG, line)):
        client.sinks[topic.key](Delivery(topic, message.stamped(0, 0, 1, 0, bad), None))
    client.hand_over(recorded)
    browser.wait(f"document.getElementById('log').textContent.includes({json.dumps(bad)})")
    browser.wait(f"document.getElementById('services').textContent.includes({json.dumps(bad)})")
    options = json.loads(browser.run("JSON.stringify([...document.querySelectorAll('#kind option')].map(o => o.text))"))
    assert bad in options
    assert browser.run("document.querySelectorAll('img').length") == 0
    assert browser.run("window.hit") is None
    assert not browser.faults


def test_a_page_of_an_ended_view_reports_it(server, browser):
    browser.go(server.url)
    browser.wait("window.live")
    server.close()
    browser.wait("['no connection', 'the view has ended; start it again'].includes(state.textContent)")
