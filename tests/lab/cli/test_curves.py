"""Curves in letters: each value stands in the row and column of its place between the extremes."""

import math

import pytest

from surefoot.errors import FieldError
from surefoot.lab.cli.curves import LABEL, LINES, SPAN_S, Curves, has_numbers
from surefoot.schemas.hw import Imu
from surefoot.schemas.stability import StabilityStatus

COLUMNS = 52


def imu(time_s: float, gyro: tuple[float, float, float]) -> Imu:
    return Imu(gyro=gyro, acc=(0.0, 0.0, 9.81)).stamped(round(time_s * 1e9), round(time_s * 100), 1, 0, "x")


def drawn(curves: Curves) -> list[str]:
    return [line[LABEL + 2 :].ljust(COLUMNS - LABEL - 2) for line in curves.lines()[:LINES]]


def test_a_sine_is_drawn_where_it_is() -> None:
    curves, width = Curves("gyro", COLUMNS), COLUMNS - LABEL - 2
    times = [0.01 * n for n in range(1001)]
    for time in times:
        curves.add(imu(time, (math.sin(time), 2.0, 2.0)))
    rows, low = drawn(curves), min(math.sin(time) for time in times)
    for time in times:
        column, row = int((width - 1) * time / times[-1]), round((LINES - 1) * (2.0 - math.sin(time)) / (2.0 - low))
        assert rows[row][column] == "a"
    assert set(rows[0]) == {"c"}
    assert all(len(line) <= COLUMNS for line in curves.lines())
    assert curves.lines()[LINES].split() == ["0.00", "to", "10.00", "s"]
    assert curves.lines()[-1] == "c gyro.2 2"


def test_old_values_leave_and_a_new_run_begins_anew() -> None:
    curves = Curves("gyro", COLUMNS)
    curves.add(imu(0.0, (50.0, 0.0, 0.0)))
    curves.add(imu(SPAN_S + 1.0, (1.0, 0.0, 0.0)))
    assert float(curves.lines()[0].split()[0]) == 1.0
    curves.add(imu(2.0, (3.0, 3.0, 3.0)))
    assert curves.lines()[LINES].split() == ["2.00", "to", "2.00", "s"]


def test_fields_that_hold_numbers_can_be_drawn() -> None:
    drawn = [name for name, about in StabilityStatus.model_fields.items() if has_numbers(about.annotation)]
    assert {"mu", "margin_planned", "com_planned", "region", "tick"} <= set(drawn)
    assert not {"status", "source"} & set(drawn)


def test_values_that_are_absent_are_left_out_and_words_refused() -> None:
    margin = Curves("margin_planned", COLUMNS)
    status = StabilityStatus(
        status="point", region=(), mu=0.5, stance=(), com_planned=None, com_measured=None, margin_planned=None,
        margin_measured=None,
    )  # fmt: skip
    margin.add(status.stamped(0, 0, 1, 0, "x"))
    assert margin.lines() == ["margin_planned: no value"]
    with pytest.raises(FieldError) as refused:
        Curves("status", COLUMNS).add(status)
    assert (refused.value.field, "'point'" in str(refused.value)) == ("status", True)
