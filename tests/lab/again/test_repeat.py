"""A recording repeats its run: the same hash, the first difference by key, tick and field, changes from a tick on."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from surefoot.errors import SurefootError
from surefoot.lab.again.bisect import first_difference
from surefoot.lab.again.commands import _ending
from surefoot.lab.again.compare import compare
from surefoot.lab.again.repeat import FORMS, Change, RecordedRun, Verification, changed, kept, verify
from surefoot.lab.cli.main import main
from surefoot.lab.report.judge import METRICS
from surefoot.lab.runs.local import run_local
from surefoot.record.recording import ReadableRecording, RecordingWriter, read_recording, recording_info, topic_of
from surefoot.robot.reader import ROBOT_FILE, load_robot, robot_file
from surefoot.schemas.base import Header
from surefoot.services.footholds.models.files import shipped
from surefoot.services.supervisor.scenarios.scenario import parse_scenario
from tests.surefoot.expect import expect_error

WALK = """
description = "two steps"
compose = "ragno"
max_duration_s = 4.2
[[step]]
when = "ready"
do = "walk"
distance = 0.3
"""
GOAL = """
description = "a goal, and the first steps to it"
compose = "nao-goal"
[[step]]
when = "ready"
do = "goto"
position = [1.0, 0.0]
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short walk; in its last second the robot steps."""
    path = tmp_path_factory.mktemp("again") / "run.mcap"
    run_local(parse_scenario(WALK), 5, recording=path)
    return path


def copied(source: Path, to: Path, **tables: dict[str, str]) -> Path:
    """Write a recording again with other metadata and, for gait messages of tick 350 on, another phase."""
    info = recording_info(source)["metadata"]
    run = {**info["run"], **tables.pop("run", {})}
    edit = tables.pop("edit", {})
    writer = RecordingWriter(to, run, {name: info[name] for name in ("scenario", "versions")} | tables)
    for item in read_recording(source):
        topic, raw = topic_of(item.key), item.raw()
        assert topic is not None
        content = json.loads(raw.attachment or raw.payload)
        if edit and item.key == "state/gait" and content["tick"] == 350:
            raw = raw._replace(payload=json.dumps({**content, **edit}).encode())
        head = Header(
            stamp_ns=item.stamp_ns, tick=content["tick"], epoch=1, seq=content["seq"], source=content["source"]
        )
        writer.write(topic, head, raw)
    writer.close(info["surefoot"], info["hashes"])
    return to


def test_a_recording_repeats_its_run_and_a_changed_one_is_found(recorded: Path, tmp_path: Path) -> None:
    found = verify(RecordedRun.of(recorded), tmp_path / "again.mcap")
    assert found.same
    assert found.first is None
    assert not found.versions
    assert first_difference(recorded, tmp_path / "again.mcap") is None
    other = copied(recorded, tmp_path / "edited.mcap", edit={"trunk_height": 0.5})  # type: ignore[arg-type]
    first = first_difference(recorded, other)
    assert first is not None
    assert (first.key, first.tick, first.field, first.b) == ("state/gait", 350, "trunk_height", "0.5")
    changed_file = verify(RecordedRun.of(other))
    assert (changed_file.recorded, changed_file.altered) == (changed_file.repeated, ("state/gait",))
    assert not changed_file.same


@pytest.mark.parametrize(
    ("altered", "last", "lines"),
    [
        ((), "one", ["the run repeats to the bit"]),
        (
            ("hw/imu", "state/gait"),
            "one",
            ["inputs (of the driver): hw/imu", "outputs (of services): state/gait", "not fit it"],
        ),
        (("state/gait",), "other", ["outputs (of services): state/gait", "the run does not repeat"]),
    ],
)
def test_the_end_of_a_verification_parts_what_was_altered_from_what_repeats(
    altered: tuple[str, ...], last: str, lines: list[str]
) -> None:
    shown = list(_ending(Verification("one", last, (), None, {}, altered)))
    assert len(shown) == len(lines)
    assert all(line.endswith(end) for line, end in zip(shown, lines, strict=True)), shown


def test_without_a_change_whatif_gives_the_recorded_hash_and_with_one_only_what_follows_differs(
    recorded: Path, tmp_path: Path
) -> None:
    run = RecordedRun.of(recorded)
    short = replace(run, scenario=replace(run.scenario, max_duration_s=4.2))
    assert changed(short, 3.9, [], tmp_path / "same.mcap") == run.run_hash
    changes = [Change.of("friction=0.05"), Change.of("foot=lf:+.02")]
    assert changed(short, 3.9, changes, tmp_path / "other.mcap") != run.run_hash
    first = first_difference(recorded, tmp_path / "other.mcap")
    assert first is not None
    assert first.tick >= 389


def test_the_comparison_shows_margins_and_slip_of_both_runs(recorded: Path, tmp_path: Path) -> None:
    run = RecordedRun.of(recorded)
    changed(run, 3.2, [Change.of("push=y:30")], tmp_path / "pushed.mcap")
    rows = {row.title: (row.before, row.after) for row in compare(run.recording, tmp_path / "pushed.mcap", 3.2)}

    def numbers(name: str) -> list[float]:
        return [float(text.split()[0]) for text in rows[METRICS[name].title]]

    for name in ("min_margin_m", "min_margin_measured_m"):
        before, after = numbers(name)
        assert 0.0 < after < before < 0.1
    for name in ("mean_slip_mm", "max_slip_mm"):
        before, after = numbers(name)
        assert after > 10.0 * before > 0.0
    assert rows[METRICS["fell"].title] == ("no", "no")
    same = compare(run.recording, recorded, 3.2)
    assert [row.before for row in same] == [row.after for row in same] == [before for before, _ in rows.values()]


def test_without_a_change_a_biped_on_its_way_to_a_goal_has_the_recorded_hash_to_the_end(tmp_path: Path) -> None:
    scenario = replace(parse_scenario(GOAL), max_duration_s=2.2)
    done = run_local(scenario, 5, recording=tmp_path / "run.mcap")
    gait = [json.loads(item.data)["state"] for item in read_recording(tmp_path / "run.mcap", ("state/gait",))]
    assert gait[-1] == "walking"
    run = RecordedRun.of(tmp_path / "run.mcap")
    assert changed(run, 1.5, [], tmp_path / "same.mcap") == run.run_hash == done.run_hash
    assert first_difference(tmp_path / "run.mcap", tmp_path / "same.mcap") is None


@pytest.mark.parametrize(
    ("text", "part"),
    [
        *(
            (text, "allowed are")
            for text in ("friction", "friction=a", "colour=1", "foot=lf", "friction=nan", "push=5")
        ),
        ("foot=lf:1", "0.2 m"),
        ("push=z:3", "x or y"),
        ("fault=imu_drp:2", "got fault 'imu_drp' (did you mean 'imu_drop'?)"),
        ("friction=-1", "got -1, allowed is above 0 to 10"),
        ("push=y:1e9", "got 1e+09, allowed is -1e+06 to 1e+06 N"),
        ("fricton=.5", "got 'fricton' (did you mean 'friction'?)"),
    ],
)
def test_wrong_changes_name_what_is_allowed(text: str, part: str) -> None:
    for each in (part, FORMS):
        with expect_error(SurefootError, "invalid", field="set", text=each):
            Change.of(text)


def test_recordings_that_cannot_be_repeated_are_refused_in_a_sentence(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cases: list[tuple[dict[str, Any], str]] = [
        ({"run": {"mode": "paced"}}, "only runs in lockstep"),
        ({"run": {"robot_hash": "0"}}, "has changed since"),
        ({"scenario": {"json": "{"}}, "is not JSON"),
        ({"scenario": {}}, "carries no scenario"),
    ]
    for number, (tables, part) in enumerate(cases):
        path = copied(recorded, tmp_path / f"{number}.mcap", **tables)
        with pytest.raises(SystemExit) as ended:
            main(["verify", str(path)])
        assert ended.value.code != 0
        shown = capsys.readouterr().err
        assert part in shown
        assert "Traceback" not in shown
    run = RecordedRun.of(recorded)
    for at, change, part in ((99.0, "friction=1", "allowed is 0 to"), (3.0, "foot=xx:0.01", "legs are lf")):
        with expect_error(SurefootError, "invalid", text=part):
            changed(run, at, [Change.of(change)], tmp_path / "no.mcap")


def test_a_repetition_that_is_interrupted_leaves_no_file(tmp_path: Path) -> None:
    out = tmp_path / "again.mcap"

    def interrupted() -> None:
        with kept(out) as target:
            target.write_bytes(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []
    with kept(out) as target:
        target.write_bytes(b"whole")
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"whole"]


def test_a_run_whose_robot_and_model_are_gone_or_others_now_repeats_from_its_recording_alone(tmp_path: Path) -> None:
    robot, model = tmp_path / "heavy", tmp_path / "model.json"
    robot.mkdir()
    text = robot_file("ragno").read_text()
    (robot / ROBOT_FILE).write_text(re.sub(r"(?m)^mass = .*$", "mass = 1.3", text, count=1))
    assert load_robot(robot).hash != load_robot("ragno").hash
    shutil.copy(shipped("ragno") or "", model)
    scenario = parse_scenario(f"{WALK}[config.footholds]\nslip_model = {json.dumps(str(model))}\n")
    path = tmp_path / "run.mcap"
    done = run_local(replace(scenario, robot=str(robot), max_duration_s=1.0), 5, recording=path)
    shutil.rmtree(robot)
    model.write_text("{}")
    assert verify(RecordedRun.of(path)).repeated == done.run_hash
    robot.mkdir()
    (robot / ROBOT_FILE).write_text(text)  # another one in its place
    assert verify(RecordedRun.of(path)).repeated == done.run_hash


def test_names_of_attached_files_are_no_paths(tmp_path: Path) -> None:
    """A recording of a stranger writes nothing outside of the folder of its repetition, whatever it calls its files."""
    scenario = parse_scenario(WALK)
    config = {"../../x": {"y": "a.toml"}, "footholds": {"slip_model": "gone.json"}}
    files = {"../../x.y.toml": b"1", "..": b"2", "": b"3", "footholds.slip_model.json": b"4"}
    run = RecordedRun(
        ReadableRecording(tmp_path / "run.mcap", {}, 0, 0),
        replace(scenario, robot="ragno", config=config),
        0,
        "",
        {},
        "",
        {},
        1,
        files,
    )
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    found = run._with_files(folder)  # pyright: ignore[reportPrivateUsage]
    assert {path.parent for path in tmp_path.rglob("*") if path.is_file()} == {folder}
    assert Path(found.config["footholds"]["slip_model"]).read_bytes() == b"4"
