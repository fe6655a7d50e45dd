"""Reports of recordings: whole, cut off, without truth, of an unknown robot, with names that look like markup."""

import html
import json
import re
from dataclasses import replace
from typing import Any

import pytest

from surefoot.errors import SurefootError
from surefoot.lab.cli.view import _recorded as shown
from surefoot.lab.report.judge import judge
from surefoot.lab.report.page import About, render
from surefoot.lab.report.recorded import report_recording
from surefoot.lab.report.traces import Traces
from surefoot.lab.report.why import explain
from surefoot.lab.runs.live import _reported as reported
from surefoot.lab.scene.film import FRAMES_HZ
from surefoot.record.recording import RecordingWriter, open_readable, read_recording, topic_of
from surefoot.robot.reader import robot_file
from surefoot.schemas.base import Header
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario

from .test_report import content


def copy(source, target, metadata, keep=lambda key: True, change=lambda key, data: data, summary=None):
    """Write a recording anew with other metadata, without some keys, and with other bytes of some messages."""
    writer = RecordingWriter(target, metadata)
    for item in read_recording(source):
        if keep(item.key):
            raw = replaced(item.raw(), item.key, change)
            header = Header(stamp_ns=item.stamp_ns, source=item.key.rpartition("/")[2])
            topic: Any = topic_of(item.key)
            writer.write(topic, header, raw)
    writer.close(summary or {})
    return target


def replaced(raw, key, change):
    return raw._replace(payload=change(key, raw.payload))


@pytest.fixture(scope="module")
def whole(recorded, tmp_path_factory):
    path, verdict = report_recording(recorded, None, tmp_path_factory.mktemp("report") / "report.html")
    return path.read_text(encoding="utf-8"), verdict


def test_a_report_has_a_film_of_the_whole_walk(whole, recorded):
    text, _ = whole
    film = content(text)["film"]
    times = [frame["t"] for frame in film["frames"]]
    end = open_readable(recorded).end_ns * 1e-9
    assert times == sorted(times)
    assert times[-1] == pytest.approx(end, abs=2.0 / FRAMES_HZ)
    assert len(times) == pytest.approx(end * FRAMES_HZ, rel=0.1)
    assert film["head"]["ground"] is not None
    assert film["marks"]
    assert len(text) < 5_000_000


def head(text):
    """Return the head of a page, as text."""
    return html.unescape(text[text.index("<header>") : text.index("</header>")])


def test_the_cause_of_a_failure_stands_on_top_of_the_report_of_a_recording_and_of_a_run(whole, recorded, tmp_path):
    def fallen(key, data):
        late = key == "sim/truth" and json.loads(data)["tick"] > 400
        return data.replace(b'"fallen":false', b'"fallen":true') if late else data

    failed = copy(recorded, tmp_path / "failed.mcap", {"robot": "ragno"}, change=fallen)
    sentence = "it fell at 4.01 s; no cause was found in the recording"
    assert explain(failed).sentence == sentence
    of_recording, _ = report_recording(failed, None, tmp_path / "recording.html")
    verdict = judge(Traces(), {}, problems=("it fell",))
    of_run, stated = reported(tmp_path / "run.html", About("a run"), Traces(), verdict, failed)
    assert stated.notes == (sentence,)
    assert of_run is not None
    for path in (of_recording, of_run):
        text = path.read_text(encoding="utf-8")
        assert f'<p class="why"><b>Why</b> {sentence}</p>' in head(text)
        assert text.count(sentence) == 1
    passed, _ = reported(tmp_path / "run.html", About("a run"), Traces(), judge(Traces(), {}), recorded)
    assert passed is not None
    for text in (whole[0], passed.read_text(encoding="utf-8")):
        assert 'class="why"' not in head(text)


def test_a_report_names_the_versions_of_the_run(whole, recorded):
    text, _ = whole
    versions = open_readable(recorded).metadata["versions"]
    assert {"python", "numpy", "mujoco"} <= versions.keys()
    assert all(f"{name} {value}" in text for name, value in versions.items())


def test_a_recording_that_was_cut_off_is_shown_up_to_the_cut(recorded, tmp_path):
    data = recorded.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) * 2 // 3])
    path, verdict = report_recording(cut, None, tmp_path / "cut.html")
    text = path.read_text(encoding="utf-8")
    assert "only a part of the recording can be read" in verdict.notes[0]
    frames = content(text)["film"]["frames"]
    assert 1.0 < frames[-1]["t"] < 4.0
    for limits, word in (({"min_distance_m": 100.0}, "NO VERDICT"), ({"min_margin_m": 9.0}, "FAIL")):
        scenario = replace(load_scenario(find_scenario("rough-terrain")), limits=limits)
        _, verdict = report_recording(cut, scenario, tmp_path / "cut.html")
        assert verdict.word == word
        assert ("which leaves open: distance walked" in verdict.notes[-1]) == (word == "NO VERDICT")


def test_without_truth_the_robot_is_where_it_is_estimated(recorded, tmp_path):
    bare = copy(recorded, tmp_path / "bare.mcap", {"namespace": "surefoot/ragno"}, lambda key: key != "sim/truth")
    path, _ = report_recording(bare, None, tmp_path / "bare.html")
    film = content(path.read_text(encoding="utf-8"))["film"]
    last: Any = {item.key: item for item in read_recording(bare, ("state/odometry",))}["state/odometry"].message()
    shown = [x / film["head"]["unit"] for x in film["frames"][-1]["base"]]
    assert shown == pytest.approx(last.position, abs=2e-3)


def test_an_unknown_robot_costs_the_replay_only(recorded, tmp_path):
    other = copy(recorded, tmp_path / "other.mcap", {"robot": "<script>alert(1)</script>"})
    path, _ = report_recording(other, None, tmp_path / "other.html")
    text = path.read_text(encoding="utf-8")
    assert "No replay" in text
    assert content(text)["charts"]
    assert "alert(1)</script>" not in text


def test_names_are_never_markup(invented):
    name = "<script>alert(1)</script>"
    about = About(name, name, 0, {name: name}, {}, (name,) * 6)
    traces = invented.walk(200)
    traces.note(1.0, name)
    text = render(about, traces, judge(traces, {}, notes=(name,)))
    assert name not in text
    assert text.count("<script") == 2
    assert name.upper() in json.dumps(content(text)).replace("\\u003c", "<")


def test_a_report_of_nothing_still_stands():
    text = render(About("x"), Traces(), judge(Traces(), {}))
    assert content(text) == {"charts": [], "film": None}


@pytest.mark.parametrize(
    ("limits", "word"),
    [({}, "NO VERDICT"), ({"no_fall": 0.0}, "LIMITS MET"), ({"min_distance_m": 100.0}, "FAIL")],
    ids=["without limits", "met", "missed"],
)
def test_a_recording_passes_nothing_beyond_its_limits(recorded, tmp_path, limits, word):
    scenario = replace(load_scenario(find_scenario("rough-terrain")), limits=limits)
    path, verdict = report_recording(recorded, scenario, tmp_path / "report.html")
    assert verdict.word == word
    assert f": {word}</title>" in path.read_text(encoding="utf-8")


def test_a_limit_without_data_gives_no_verdict_but_another_may_be_missed(recorded, tmp_path):
    bare = copy(recorded, tmp_path / "bare.mcap", {"namespace": "surefoot/ragno"}, lambda key: key != "sim/truth")
    for limits, word in (({"no_fall": 0.0}, "NO VERDICT"), ({"no_fall": 0.0, "min_margin_m": 9.0}, "FAIL")):
        scenario = replace(load_scenario(find_scenario("rough-terrain")), limits=limits)
        _, verdict = report_recording(bare, scenario, tmp_path / "bare.html")
        assert verdict.word == word
        assert verdict.notes[-1].startswith("the recording holds no data on: fell")


def test_a_recording_with_messages_that_their_topics_do_not_allow_gives_no_verdict(recorded, tmp_path):
    scenario = replace(load_scenario(find_scenario("rough-terrain")), limits={"no_fall": 0.0})
    for key, field in (("hw/imu", b'"gyro":['), ("hw/joints", b'"position":['), ("sim/truth", b'"quat_wxyz":[')):
        spoilt = copy(
            recorded,
            tmp_path / "spoilt.mcap",
            {},
            change=lambda _, data, field=field: data.replace(field, field + b"NaN,"),
        )
        _, verdict = report_recording(spoilt, scenario, tmp_path / "spoilt.html")
        assert verdict.word == "NO VERDICT"
        assert verdict.ok
        assert any(f"of {key} are no messages" in note for note in verdict.notes)
        assert "nothing went wrong in what can be read" in explain(spoilt).sentence


def test_a_recording_without_a_run_has_no_report(recorded, tmp_path):
    other = copy(recorded, tmp_path / "other.mcap", {}, lambda key: key.startswith("health/"))
    with pytest.raises(SurefootError, match=r"other\.mcap has none of sim/truth"):
        report_recording(other, None, tmp_path / "other.html")
    assert not (tmp_path / "other.html").exists()


DAMAGE = {
    "cut": lambda data: data[: len(data) * 2 // 3],
    "no summary": lambda data: data[:-200],
    "flipped": lambda data: data[: len(data) // 2] + bytes([data[len(data) // 2] ^ 8]) + data[len(data) // 2 + 1 :],
    "hole": lambda data: data[: len(data) // 3] + bytes(5000) + data[len(data) // 3 + 5000 :],
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_of_a_damaged_recording_report_why_and_view_use_what_is_sound_and_state_the_loss(recorded, tmp_path, kind):
    spoilt = tmp_path / "spoilt.mcap"
    spoilt.write_bytes(DAMAGE[kind](recorded.read_bytes()))
    found = re.search(r"[\d.]+ % of its (\d+ messages|bytes)", open_readable(spoilt).damage)
    assert found is not None
    loss = found.group(0)
    _, verdict = report_recording(spoilt, None, tmp_path / "spoilt.html")
    assert loss in verdict.notes[0]
    assert loss in explain(spoilt).sentence
    text = shown(spoilt)
    assert loss in text
    times = [frame["t"] for frame in content(text)["film"]["frames"]]
    assert times == sorted(times)
    assert len(times) > 40
    if kind in ("flipped", "no summary"):  # what stands behind the damage is shown, too
        assert times[-1] > 4.0


def test_a_recording_carries_what_its_report_needs(recorded, tmp_path, monkeypatch):
    """Robot and models are attached: a report elsewhere, where the robot is not known, has the replay."""
    files = open_readable(recorded).found.attachments
    assert files["robot.toml"] == robot_file("ragno").read_bytes()
    assert json.loads(files["footholds.slip_model.json"])
    monkeypatch.setattr("surefoot.robot.reader.ROBOTS", tmp_path / "none")
    path, _ = report_recording(recorded, None, tmp_path / "report.html")
    assert content(path.read_text(encoding="utf-8"))["film"]["frames"]
    assert explain(recorded).outcome is None


def test_wall_time_and_hashes_of_the_configuration_are_stated_where_the_recording_has_them(whole, recorded, tmp_path):
    for hashes, listed in (({"walker": 64 * "ab"}, "walker abababababab<"), (["x"], ""), (None, "")):
        stated = {"wall_s": "2.500", "configuration": json.dumps(hashes)}
        file = copy(recorded, tmp_path / "run.mcap", {"robot": "ragno"}, summary=stated)
        text = report_recording(file, None, tmp_path / "report.html")[0].read_text(encoding="utf-8")
        assert "2.500 s from the first to the last tick" in text
        assert ("Hashes of the configuration" in text) is bool(listed)
        assert listed in text
    assert "Wall time" in whole[0]


def test_a_report_names_what_its_recording_does_not_state(recorded, whole, tmp_path):
    """A run in one process states the configuration of its services; a file that is cut off has no summary."""
    text = whole[0]
    assert re.search("Hashes of the configuration</td><td><code>.*stability [0-9a-f]{12}, .*walker [0-9a-f]{12}", text)
    assert "Message hash" in text
    assert "Not stated" not in text
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[: recorded.stat().st_size // 2])
    text = report_recording(cut, None, tmp_path / "cut.html")[0].read_text(encoding="utf-8")
    missing = "wall time, hashes of the configuration, message hash: it has no summary, which is written at the end"
    assert missing in text
    bare = copy(recorded, tmp_path / "bare.mcap", {"robot": "ragno"}, summary={"run_hash": "ab"})
    text = report_recording(bare, None, tmp_path / "bare.html")[0].read_text(encoding="utf-8")
    assert "wall time, hashes of the configuration: its summary has none" in text


def test_a_report_of_a_file_whose_name_is_no_utf8_names_its_bytes(recorded, tmp_path):
    """Before, it ended with an internal error as the report was written."""
    odd = tmp_path / "a\udc80\nb.mcap"
    odd.symlink_to(recorded)
    path, _ = report_recording(odd, None, tmp_path / "report.html")
    assert "a\\udc80" in path.read_text(encoding="utf-8")
