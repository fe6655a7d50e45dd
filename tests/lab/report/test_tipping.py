"""Slides and accelerations of a robot that tips over are effects: the cause is the support that it left."""

from typing import Any

import pytest

from tests.lab.report.made_up import AT, after, edited, explained, falls, pushed, slides


def tips(rows: Any, at: int = AT) -> None:
    """Let the CoM leave the support; .4 s later feet slide under load, .6 s later the trunk is accelerated."""
    after(rows, "state/stability", lambda row, n: row.update(margin_planned=-2e-3 * n - 1e-3), at)
    after(rows, "sim/truth", lambda row, n: row.update(contact_sliding=[2e-4 * n] * 2 + [0.0] * 2), at + 40)
    after(rows, "sim/truth", lambda row, n: row.update(velocity=[0.05, min(0.1 * n, 2.0), 0.0]), at + 60)
    falls(rows, at + 100)


def test_a_robot_that_tips_over_slides_and_accelerates_as_an_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    found = explained(edited(tips), monkeypatch)
    assert found.outcome is not None
    assert found.cause is not None
    assert (found.cause.code, found.outcome.code, found.cause.begin) == ("support", "fall", pytest.approx(5.0))
    assert "it leaves its support, margin_planned falls to" in found.sentence
    assert {each.code for each in found.chain} >= {"slip", "push"}


def test_a_push_of_a_trot_which_leaves_its_support_in_each_step_is_the_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    def trots(rows: Any) -> None:
        for tick, row in rows["state/stability"].items():
            row.update(margin_planned=-0.02 if tick % 25 < 12 or tick >= AT - 5 else 0.01)
        pushed(rows)
        falls(rows)

    found = explained(edited(trots), monkeypatch)
    assert (found.cause and found.cause.code) == "push"


def test_feet_with_hardly_any_load_are_dragged_on_any_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    def drags(rows: Any) -> None:
        after(rows, "sim/truth", lambda row, n: row.update(foot_force_n=[1.0, 1.0, 9.0, 9.0]), AT - 50)
        slides(rows)
        falls(rows)

    def bears(rows: Any) -> None:
        after(rows, "sim/truth", lambda row, n: row.update(foot_force_n=[4.0, 4.0, 6.0, 6.0]), AT - 50)
        slides(rows)
        falls(rows)

    without = ("hw/contacts",)  # whose switches would contradict these forces
    causes = [explained(edited(edit, without), monkeypatch).cause for edit in (drags, bears)]
    assert [cause and cause.code for cause in causes] == [None, "friction"]


def test_feet_that_slid_long_before_are_not_the_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    def early(rows: Any) -> None:
        after(rows, "sim/truth", lambda row, n: row.update(contact_sliding=[1e-4 * min(n, 60)] * 2 + [0.0] * 2), 120)
        tips(rows, 650)

    found = explained(edited(early), monkeypatch)
    assert found.cause is not None
    assert (found.cause.code, found.cause.begin) == ("support", pytest.approx(6.5))
