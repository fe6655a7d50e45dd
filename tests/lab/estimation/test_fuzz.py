"""The fuzzer corrupts what it names, and sees what must not be."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from surefoot.lab.estimation import fuzz as fuzzing
from surefoot.lab.estimation.fuzz import CORRUPTIONS, Inputs, feed, fuzz, inputs_of
from surefoot.lab.estimation.track import LogRunner
from tests.lab.estimation.walks import noisy

MILD = ("foot NaN", "gyro NaN", "stamp back", "feet twice", "leg frozen", "feet lost", "imu lost", "switch on")


def test_inputs_are_the_log_in_order():
    log = noisy()
    rows = list(inputs_of(log, range(len(log.stamp_ns))))
    assert [x.stamp_ns for x in rows] == log.stamp_ns.tolist()
    assert sum(len(x.feet) for x in rows) == np.sum(log.foot_ns <= log.stamp_ns[-1])
    assert all(sample[0] <= x.stamp_ns for x in rows for sample in x.feet)


@pytest.mark.parametrize("kind", CORRUPTIONS)
def test_every_corruption_changes_something_and_not_the_log(kind):
    log = noisy()
    before = (log.w.copy(), log.q.copy(), log.foot_position.copy(), log.foot_rot.copy(), log.contact.copy())
    rng, memory, changed = np.random.default_rng(0), {}, False
    pairs = zip(*(inputs_of(log, range(300, 360)) for _ in range(2)), strict=True)
    for x, clean in pairs:
        CORRUPTIONS[kind](x, rng, memory)
        changed = changed or _differs(x, clean)
    assert changed
    after = (log.w, log.q, log.foot_position, log.foot_rot, log.contact)
    for a, b in zip(before, after, strict=True):
        np.testing.assert_array_equal(a, b)


def _differs(x: Inputs, y: Inputs) -> bool:
    if (x.stamp_ns, x.imu, len(x.feet)) != (y.stamp_ns, y.imu, len(y.feet)):
        return True
    pairs = [(x.w, y.w), (x.q, y.q)]
    pairs += [
        (np.asarray(a), np.asarray(b)) for f, g in zip(x.feet, y.feet, strict=True) for a, b in zip(f, g, strict=True)
    ]
    return not all(np.array_equal(a, b, equal_nan=False) for a, b in pairs)


def test_mild_corruptions_are_survived_and_noted(monkeypatch):
    monkeypatch.setattr(fuzzing, "CORRUPTIONS", {kind: CORRUPTIONS[kind] for kind in MILD})
    found = fuzz("ekf", noisy(), 24, 0)
    assert found.trials == 24
    assert not found.broken
    assert sum(found.silent.values()) == 0
    assert found.flagged["gyro NaN"] == found.by_kind["gyro NaN"]


@pytest.mark.parametrize("kind", ["gyro NaN", "imu spike", "stamp back", "feet late", "feet twice", "foot torn off"])
def test_rows_by_the_kernel_are_rows_one_by_one(kind):
    log, rng, memory = noisy(), np.random.default_rng(0), {}
    running = LogRunner("best", log, {})
    for x in inputs_of(log, range(500)):
        feed(running, x)
    inputs = list(inputs_of(log, range(500, 560)))
    for x in inputs[:40]:
        CORRUPTIONS[kind](x, rng, memory)
    one = fuzzing._one_by_one(deepcopy(running), inputs, log.v[500:])
    rows = fuzzing._by_rows(deepcopy(running), inputs, log.v[500:])
    assert one[0] == rows[0] == ""
    assert one[2] == rows[2]
    np.testing.assert_array_equal(one[3], rows[3])
    assert (one[1] <= rows[1]).all()  # gaps are a word for a tenth of a second only


class Liar(LogRunner):
    """Twice the speed, no flag."""

    def estimate(self):
        return super().estimate()._replace(
            velocity_imu=np.array([0.5, 0.0, 0.0]), inputs_ok=True, filter_ok=True, sensors_ok=True,
            slipping=np.zeros(2, dtype=bool),
        )  # fmt: skip

    @property
    def refused(self):
        return {}


def test_a_lie_is_seen(monkeypatch):
    monkeypatch.setattr(fuzzing, "LogRunner", Liar)
    found = fuzz("ekf", replace(noisy()), 4, 0)
    assert sum(found.silent.values()) + sum(found.broken.values()) == 4


class Broken(LogRunner):
    """An estimate that is no number."""

    def estimate(self):
        return super().estimate()._replace(velocity=np.full(3, np.nan))


def test_what_must_never_be_is_seen(monkeypatch):
    monkeypatch.setattr(fuzzing, "LogRunner", Broken)
    found = fuzz("ekf", noisy(), 3, 0)
    assert sum(found.broken.values()) == 3
    assert all("velocity not finite" in text for text in found.broken)
