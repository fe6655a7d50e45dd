"""Planted faults begin at their time and change what they name alone."""

from dataclasses import fields

import numpy as np
import pytest

from surefoot.lab.estimation.planted import PLANTED, STEP_NS, altered
from surefoot.lab.estimation.track import track
from tests.lab.estimation.walks import noisy

AT = 8.0
CHANGED: dict[str, set[str]] = {
    "switch stuck on": {"contact"}, "switch stuck off": {"contact"}, "switches swapped": {"contact"},
    "legs swapped": {"foot_position", "foot_rot"}, "encoders of a leg frozen": {"foot_position", "foot_rot"},
    "all encoders frozen": {"foot_position", "foot_rot"}, "encoder jumps 3 cm": {"foot_position"},
    "encoder off by 2 cm": {"foot_position"}, "leg scaled by 1.1": {"foot_position"},
    "clock back 0.1 s": {"stamp_ns", "foot_ns", "order"}, "inertial unit still 0.5 s": {"w", "q"},
}  # fmt: skip


@pytest.mark.parametrize("name", CHANGED)
def test_a_fault_changes_what_it_names_from_its_time_on(name: str) -> None:
    log = noisy()
    bad = PLANTED[name](log, AT, 1)
    found: set[str] = set()
    for part in fields(log):
        a, b = getattr(log, part.name), getattr(bad, part.name)
        if part.name == "order" and b is not None:
            found.add("order")
        elif isinstance(a, np.ndarray) and not np.array_equal(a, b):
            found.add(part.name)
            if part.name in ("contact", "foot_position", "foot_rot", "foot_ns"):
                early = log.foot_ns < log.stamp_ns[0] + round(1e9 * AT)
                np.testing.assert_array_equal(a[early], b[early])
    assert found == CHANGED[name]
    if name.startswith(("encoder ", "leg ")):
        np.testing.assert_array_equal(log.foot_position[:, 0], bad.foot_position[:, 0])


def test_late_feet_come_after_their_time_and_inside_the_log() -> None:
    log = noisy()
    bad = PLANTED["feet late 50 ms"](log, AT, 0)
    assert (np.diff(bad.foot_ns) > 0).all()
    assert bad.foot_ns[-1] <= log.stamp_ns[-1]
    assert bad.foot_ns[len(bad.foot_ns) * 3 // 4] - log.foot_ns[len(bad.foot_ns) * 3 // 4] == 50_000_000


def test_a_switch_that_hangs_is_altered_while_its_foot_is_elsewhere() -> None:
    log = noisy()
    for name, value in (("switch stuck on", False), ("switch stuck off", True)):
        rows = altered(log, PLANTED[name](log, AT, 1), AT)
        in_use = np.searchsorted(log.foot_ns, log.stamp_ns, side="right") - 1
        since = (in_use >= 0) & (log.foot_ns[in_use] >= log.stamp_ns[0] + round(1e9 * AT))
        np.testing.assert_array_equal(rows, (log.contact[in_use, 1] == value) & since)
    assert not altered(log, log, AT).any()


def test_a_swap_twice_is_none() -> None:
    log = noisy()
    for name in ("legs swapped", "switches swapped"):
        twice = PLANTED[name](PLANTED[name](log, AT, 0), AT, 1)
        np.testing.assert_array_equal(twice.foot_position, log.foot_position)
        np.testing.assert_array_equal(twice.contact, log.contact)


def test_the_clock_steps_back_once_and_estimates_go_on() -> None:
    log = noisy()
    bad = PLANTED["clock back 0.1 s"](log, AT, 0)
    assert (np.diff(bad.stamp_ns) < 0).sum() == 1
    assert log.stamp_ns[-1] - bad.stamp_ns[-1] == STEP_NS
    assert np.isfinite(track("best", bad).v).all()


def test_switches_that_contradict_the_rest_are_reported_and_a_clean_walk_is_not() -> None:
    """Swapped switches: `sensors_ok` is false within half a second; without them no flag ever is."""
    log = noisy()
    at_s = 0.5 * float(log.seconds[-1])
    clean, bad = track("best", log), track("best", PLANTED["switches swapped"](log, at_s, 0))
    assert clean.flags["filter_ok"][log.scored].all()
    assert clean.flags["sensors_ok"][log.scored].all()
    after = (log.seconds >= at_s) & (log.seconds < at_s + 0.5)
    assert not bad.flags["sensors_ok"][after].all()
