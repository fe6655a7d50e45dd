"""Faults of cameras and rangers are named where a goal is missed, and nowhere else; holes of a file are no faults."""

from typing import Any

import pytest

from .test_why import AT, TICKS, Edit, after, drops, edited, explained, falls


def seeing(rows: Any) -> None:
    """Add camera, ranger, vision and the pose of a robot that walks to a goal, which is missed at the end."""
    for key in ("hw/landmarks", "hw/image", "hw/range", "state/landmarks", "state/pose", "navigator/feedback"):
        rows[key] = {}
    for tick in range(0, TICKS, 10):
        head, way = {**rows["hw/tick"][tick]}, 5e-4 * tick
        seen = [{"range": 1.0 - way, "bearing": 0.0, "descriptor": [0.1]}]
        rows["hw/landmarks"][tick] = {**head, "landmarks": seen}
        rows["hw/image"][tick] = {**head, "width": 8}
        rows["hw/range"][tick] = {**head, "distance": 2.0 - way}
        rows["state/landmarks"][tick] = {**head, "flags": []}
        rows["state/pose"][tick] = {**head, "pose": [way, 0.0, 0.0], "matched": 1}
        rows["navigator/feedback"][tick] = {**head, "state": "navigating"}
    rows["navigator/feedback"][TICKS - 1] = {
        "tick": TICKS - 1, "state": "failed", "error_code": "lost", "navigation_time": 6.0
    }  # fmt: skip


SIGHTS: list[tuple[str, str, Edit]] = [
    ("camera", "no landmark for", lambda rows: after(rows, "hw/landmarks", lambda row, n: row.update(landmarks=[]))),
    ("camera", "one view", lambda rows: after(rows, "hw/landmarks", lambda row, n: row.update(landmarks=[[1]]))),
    ("camera", "is in the map", lambda rows: after(rows, "state/pose", lambda row, n: row.update(matched=0))),
    ("camera", "are dark", lambda rows: after(rows, "state/landmarks", lambda row, n: row.update(flags=["dark"]))),
    ("camera", "no hw/image", drops("hw/image")),
    ("camera", "no hw/landmarks", drops("hw/landmarks")),
    ("ranger", "reads 0.10 m", lambda rows: after(rows, "hw/range", lambda row, n: row.update(distance=0.1))),
    ("ranger", "no hw/range", drops("hw/range")),
]


@pytest.mark.parametrize(("code", "text", "edit"), SIGHTS, ids=[text.replace(" ", "-") for _, text, _ in SIGHTS])
def test_a_missed_goal_and_no_fall_is_due_to_a_faulty_camera_or_ranger(
    code: str, text: str, edit: Edit, monkeypatch: pytest.MonkeyPatch
) -> None:
    def both(rows: Any) -> None:
        seeing(rows)
        edit(rows)

    def fallen(rows: Any) -> None:
        both(rows)
        falls(rows)

    found, fell = explained(edited(both), monkeypatch), explained(edited(fallen), monkeypatch)
    assert found.cause is not None
    assert (found.cause.code, found.outcome and found.outcome.code) == (code, "goal")
    assert text in found.sentence
    assert found.cause.begin == pytest.approx(0.01 * AT, abs=0.2)
    assert fell.cause is None
    assert fell.outcome is not None
    sound = explained(edited(seeing), monkeypatch)
    assert sound.cause is None
    assert sound.outcome is not None


def test_a_robot_that_stands_may_see_one_echo_and_a_hole_in_the_file_is_no_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def halted(rows: Any) -> None:
        seeing(rows)
        after(rows, "sim/truth", lambda row, n: row.update(position=[0.25, 0.0, 0.1]))
        after(rows, "hw/range", lambda row, n: row.update(distance=0.1))

    def torn(rows: Any) -> None:
        for messages in rows.values():
            for tick in range(AT, AT + 60):
                messages.pop(tick, None)
        falls(rows)

    for edit in (halted, torn):
        found = explained(edited(edit), monkeypatch)
        assert found.outcome is not None
        assert found.cause is None, found.sentence
