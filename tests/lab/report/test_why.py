"""Causes are named from what a recording shows: one made-up walk, and one thing wrong at a time."""

import json
from pathlib import Path
from random import Random
from typing import Any

import pytest

from surefoot.bus.interface import Raw
from surefoot.errors import SurefootError
from surefoot.lab.cli.main import main
from surefoot.lab.report.evidence import gather
from surefoot.lab.report.why import Explanation, explain, find_outcome
from surefoot.record.recording import RecordingWriter, topic_of
from surefoot.schemas.base import Header
from tests.lab.report.made_up import (
    AT,
    FEET,
    JOINTS,
    LEGS,
    TICKS,
    Edit,
    after,
    drops,
    edited,
    explained,
    falls,
    pushed,
    slides,
    slides_in_turn,
    walk,
)
from tests.surefoot.expect import expect_error


def leaves(rows: Any) -> None:
    after(rows, "hw/tick", lambda row, n: row.update(roster=["walker"]))


def dead(rows: Any) -> None:
    after(rows, "hw/joints", lambda row, n: row["position"].__setitem__(4, -1.0 + 1e-4 * (n % 7)))


def sticks(rows: Any) -> None:
    after(rows, "hw/joints", lambda row, n: row["position"].__setitem__(4, 0.123))


def freezes(rows: Any) -> None:
    after(rows, "hw/imu", lambda row, n: row.update(gyro=[0.0] * 3, acc=[0.0, 0.0, 9.8]))


def closes(rows: Any) -> None:
    after(rows, "hw/contacts", lambda row, n: row["touch"].__setitem__(0, [True]))


def still(rows: Any) -> None:
    held = rows["hw/joints"][AT - AT % 3]["position"]
    after(rows, "hw/joints", lambda row, n: row.update(position=list(held)))


def silent(rows: Any) -> None:
    """End the commands; the servos hold."""
    drops("cmd/joints")(rows)
    still(rows)


def repeats(rows: Any) -> None:
    after(rows, "state/velocity", lambda row, n: row.update(stamp_ns=AT * 10**7))


def stopped(rows: Any) -> None:
    rows["sim/status"][AT] = {**rows["hw/tick"][AT], "stopped": "operator", "failed": ""}


def delays(key: str, ticks: int) -> Edit:
    """Let the messages of a key come so many ticks later, with the stamps of their samples."""

    def edit(rows: Any) -> None:
        held = {tick: row for tick, row in rows[key].items() if tick >= AT}
        kept = {tick: row for tick, row in rows[key].items() if tick < AT}
        rows[key] = kept | {t + ticks: {**row, "tick": t + ticks} for t, row in held.items() if t + ticks < TICKS}

    return edit


def thins(key: str, every: int) -> Edit:
    def edit(rows: Any) -> None:
        ticks = list(rows[key])
        rows[key] = {tick: rows[key][tick] for n, tick in enumerate(ticks) if tick < AT or n % every == 0}

    return edit


def steepens(rows: Any) -> None:
    def change(row: Any, n: int) -> None:
        row.update(foot_position=[[x, y, z + 0.7 * x] for x, y, z in row["foot_position"]])

    after(rows, "sim/truth", change)


def steepens_unseen(rows: Any) -> None:
    """Without truth the planned footholds show the slope."""
    rows["sim/truth"].clear()
    after(rows, "state/gait", lambda row, n: row.update(footholds=[(x, y, 0.7 * x) for x, y in FEET]), 0)
    after(rows, "state/velocity", lambda row, n: row.update(g_up=[9.0, 0.0, 1.0]), AT)


def wild_imu(rows: Any) -> None:
    rng = Random(3)
    change = lambda row, n: row.update(acc=[rng.uniform(-150.0, 150.0) for _ in range(3)])  # noqa: E731
    after(rows, "hw/imu", change)
    drops("state/velocity")(rows)  # the filter refuses such samples


def wild_joints(rows: Any) -> None:
    rng = Random(3)
    after(rows, "hw/joints", lambda row, n: row.update(position=[rng.uniform(-3.0, 3.0) for _ in range(JOINTS)]))


def moves_unread(rows: Any) -> None:
    """Let all encoders stand still while the joints move."""
    for tick, row in rows["sim/truth"].items():
        row["joints"] = rows["cmd/joints"][tick]["position"]
    still(rows)


def reads_beside(rows: Any) -> None:
    """Let one encoder read another angle than the joint has, which follows its command."""
    for tick, row in rows["sim/truth"].items():
        row["joints"] = rows["cmd/joints"][tick]["position"]
    dead(rows)


def turns_beside(rows: Any) -> None:
    for row in rows["sim/truth"].values():
        row["angular_velocity"] = [0.0, 0.0, 0.0]
    after(rows, "hw/imu", lambda row, n: row.update(gyro=[w + 0.5 for w in row["gyro"]]))
    after(rows, "state/velocity", lambda row, n: row.update(filter_ok=False), AT + 40)


CASES: list[tuple[str, Edit]] = [
    ("imu", turns_beside),
    ("imu", wild_imu), ("joints", wild_joints), ("joints", moves_unread), ("encoder", reads_beside),
    ("friction", slides), ("friction", slides_in_turn), ("push", pushed), ("service", leaves), ("servo", dead),
    ("encoder", sticks), ("imu", freezes), ("imu", drops("hw/imu")), ("joints", drops("hw/joints")),
    ("contacts", drops("hw/contacts")), ("switch", closes), ("command", still), ("stop", stopped),
    ("late", delays("hw/imu", 20)), ("late", delays("hw/joints", 30)), ("late", delays("hw/contacts", 12)),
    ("imu", thins("hw/imu", 4)), ("joints", thins("hw/joints", 3)),
    ("stale", drops("state/velocity")), ("stale", silent), ("stale", repeats), ("cone", steepens),
]  # fmt: skip


@pytest.mark.parametrize(("code", "edit"), CASES, ids=lambda p: p if isinstance(p, str) else "")
def test_one_fault_before_a_fall_is_its_cause(code: str, edit: Edit, monkeypatch: pytest.MonkeyPatch) -> None:
    def both(rows: Any) -> None:
        edit(rows)
        falls(rows)

    found = explained(edited(both), monkeypatch)
    assert found.cause is not None
    assert (found.cause.code, found.outcome and found.outcome.code) == (code, "fall")
    assert found.cause.begin == pytest.approx(0.01 * AT, abs=0.6)
    assert all(found.cause.begin <= each.begin <= 0.01 * (AT + 100) for each in found.chain)


def test_without_truth_a_slope_is_seen_in_the_planned_footholds(monkeypatch: pytest.MonkeyPatch) -> None:
    found = explained(edited(steepens_unseen), monkeypatch)
    assert found.cause is not None
    assert (found.cause.code, found.outcome and found.outcome.code) == ("cone", "fall")
    assert "the feet need 0.70 of their load" in found.sentence


def test_a_push_that_takes_several_joints_off_their_commands_is_the_cause_and_a_dead_servo_before_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def off(rows: Any, joints: tuple[int, ...], at: int) -> None:
        for joint in joints:
            after(rows, "hw/joints", lambda row, n, j=joint: row["position"].__setitem__(j, -1.0 + 1e-4 * (n % 7)), at)

    def extreme(rows: Any) -> None:
        pushed(rows)
        off(rows, (1, 4, 7), AT + 1)
        falls(rows)

    def dead_before(rows: Any) -> None:
        pushed(rows)
        off(rows, (4,), AT - 15)
        off(rows, (1, 7, 10), AT + 1)
        falls(rows)

    causes = [explained(edited(edit), monkeypatch).cause for edit in (extreme, dead_before)]
    assert [cause and cause.code for cause in causes] == ["push", "servo"]


def test_nothing_is_blamed_in_a_walk_without_an_accident(monkeypatch: pytest.MonkeyPatch) -> None:
    assert gather(edited(lambda rows: None)) == []
    assert explained(edited(lambda rows: None), monkeypatch) == Explanation(None, None, ())

    def harmless(rows: Any) -> None:
        pushed(rows)
        after(rows, "sim/truth", lambda row, n: row.update(contact_sliding=[0.0] * LEGS))

    quiet = explained(edited(harmless), monkeypatch)
    assert quiet.cause is None
    falling = explained(edited(falls), monkeypatch)
    assert falling.cause is None
    assert "no cause was found" in falling.sentence


def test_a_refusal_is_no_cause_of_the_walk_that_is_abandoned_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuses(row: Any, n: int) -> None:
        row.update(state="walking" if n < 7 else "refused", reason="out of reach")

    found = explained(edited(lambda rows: after(rows, "state/gait", refuses)), monkeypatch)
    assert (found.outcome and found.outcome.code, found.cause) == ("abandoned", None)
    assert "(out of reach) at 5.07 s; no cause was found" in found.sentence


def test_a_filter_that_begins_beyond_its_bounds_is_no_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    def begins(rows: Any) -> None:
        for tick in range(50):
            rows["state/velocity"][tick].update(filter_ok=False)
        falls(rows, 400)

    assert explained(edited(begins), monkeypatch).cause is None


def test_two_feet_that_slide_in_turn_are_no_ice(monkeypatch: pytest.MonkeyPatch) -> None:
    found = explained(edited(lambda rows: slides_in_turn(rows, 2, 50)), monkeypatch)
    assert found.outcome is not None
    assert (found.outcome.code, found.cause) == ("slip", None)


def test_a_fault_that_was_over_long_before_is_not_the_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    def early(rows: Any) -> None:
        for tick in range(150, 180):
            del rows["hw/imu"][tick]
        slides(rows)
        falls(rows)

    found = explained(edited(early), monkeypatch)
    assert found.cause is not None
    assert found.cause.code == "friction"


def test_without_truth_tilt_and_slipping_flags_stand_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def edit(rows: Any) -> None:
        after(rows, "state/velocity", lambda row, n: row.update(slipping=[True] * LEGS))
        after(rows, "state/velocity", lambda row, n: row.update(g_up=[9.0, 0.0, 1.0]), AT + 100)

    found = explained(edited(edit, without=("sim/truth",)), monkeypatch)
    assert found.cause is not None
    assert (found.cause.code, found.outcome and found.outcome.code) == ("friction", "fall")


@pytest.mark.parametrize(("feet", "cause"), [(2, None), (4, "margin")])
def test_margins_of_a_biped_are_no_cause(feet: int, cause: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    def misses(rows: Any) -> None:
        rows["navigator/feedback"] = {AT: {"epoch": 1, "tick": AT, "state": "failed", "error_code": "timeout"}}
        late = {tick: row for tick, row in rows["state/stability"].items() if AT - 20 <= tick < AT - 11}
        for row in rows["state/stability"].values():
            row.update(stance=row["stance"][:feet])
        for row in late.values():
            row.update(margin_planned=-0.04)

    found = explained(edited(misses), monkeypatch)
    assert found.outcome is not None
    assert found.outcome.code == "goal"
    assert (found.cause and found.cause.code) == cause


def test_halts_goals_and_lost_support_are_outcomes() -> None:
    def goal(rows: Any) -> None:
        rows["navigator/feedback"] = {AT: {"epoch": 1, "tick": AT, "state": "failed", "error_code": "lost"}}

    edits: dict[str, Edit] = {
        "halt": lambda rows: after(rows, "state/gait", lambda row, n: row.update(state="hold")),
        "unsupported": lambda rows: after(rows, "state/stability", lambda row, n: row.update(margin_planned=-0.01)),
        "stopped": stopped,
        "goal": goal,
        "abandoned": lambda rows: after(
            rows, "state/gait", lambda row, n: row.update(state="refused", reason="tilted")
        ),
    }
    for code, edit in edits.items():
        outcome = find_outcome(edited(edit))
        assert outcome is not None, code
        assert outcome.code == code
    standing = edited(
        lambda rows: after(rows, "state/gait", lambda row, n: row.update(state=("refused", "standing")[not n]))
    )
    assert find_outcome(standing) is None  # a command was refused


def test_a_file_of_another_version_or_cut_off_is_read_as_far_as_it_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.mcap"
    rows = walk()
    slides(rows)
    writer = RecordingWriter(path, {"robot": "<script>"})
    for key in ("sim/truth", "hw/imu"):
        topic = topic_of(key)
        assert topic is not None
        for tick, row in rows[key].items():
            payload = b"[1]" if tick == 3 else json.dumps({**row, "tilted": [None]}).encode()
            writer.write(
                topic, Header(stamp_ns=tick * 10**7, tick=tick, epoch=1, seq=tick, source="x"), Raw(payload, None, "")
            )
    writer.close({})
    found = explain(path)
    assert found.cause is not None
    assert found.cause.code == "friction"
    with pytest.raises(SystemExit) as ended:
        main(["why", str(path)])
    assert ended.value.code == 1
    assert "2 feet slide" in capsys.readouterr().out
    (tmp_path / "none.mcap").write_bytes(b"")
    with expect_error(SurefootError, "malformed", text="is empty"):
        explain(tmp_path / "none.mcap")


def test_what_cannot_be_read_is_stated_and_is_no_good_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, topic = tmp_path / "run.mcap", topic_of("sim/truth")
    assert topic is not None
    writer, random = RecordingWriter(path, {"robot": "ragno"}), Random(0)
    for tick, row in walk()["sim/truth"].items():
        header = Header(stamp_ns=tick * 10**7, tick=tick, epoch=1, seq=tick, source="x")
        writer.write(topic, header, Raw(json.dumps({**row, "pad": random.randbytes(450).hex()}).encode(), None, ""))
    writer.close({})
    whole = path.read_bytes()
    assert explain(path).damage == ""
    half = len(whole) // 2
    for spoilt in (whole[:half], whole[:half] + bytes([whole[half] ^ 1]) + whole[half + 1 :]):
        path.write_bytes(spoilt)
        found = explain(path)
        assert found.outcome is None
        assert "stance without support or abandoned walk; only a part can be read: " in found.sentence
        with pytest.raises(SystemExit) as ended:
            main(["why", str(path)])
        assert ended.value.code == 1
        assert "only a part can be read" in capsys.readouterr().out
