"""One direction by the scalar solver: the same answers as the solver of many lanes, and the same verdicts."""

import math

import numpy as np
import pytest

from surefoot.services.stability.programs.contacts import contact_set
from surefoot.services.stability.programs.directions import equally_spaced
from surefoot.services.stability.programs.interior import FAILED, solve_lanes
from surefoot.services.stability.programs.oracle import Oracle
from surefoot.services.stability.programs.single import solve_single, support_value
from surefoot.services.stability.regions.region import region
from tests.services.stability.certificate import twist_violation
from tests.services.stability.sets import SQUARE, UP, feasible_sets, random_set, tilted

SIXTEEN = equally_spaced(16)


def test_values_points_and_certificates() -> None:
    for contacts in feasible_sets(50, 25):
        support = region(contacts, SIXTEEN).support
        for k in range(0, 16, 3):
            found = support_value(contacts, SIXTEEN[k])
            assert found.status == "ok"
            assert found.value == pytest.approx(support.value[k], abs=1e-8)
            assert SIXTEEN[k] @ found.point == pytest.approx(found.value, abs=1e-8)
            assert twist_violation(contacts, found.twist, SIXTEEN[k]) < 1e-8 * max(1.0, np.abs(found.twist).max())
            assert found.twist[2] == found.value


def test_same_outcomes_as_many_lanes() -> None:
    """Any slope, any friction: solved, no forces, no bound; not one verdict differs."""
    rng = np.random.default_rng(51)
    c, seen = np.array([0.0, 0.0, 1.0, 0.0]), set()
    for _ in range(300):
        contacts = random_set(rng, int(rng.integers(2, 9)), 85.0, (0.05, 1.5), 0.2)
        r = Oracle(contacts).reduced
        b = r.h @ SIXTEEN[int(rng.integers(16))]
        n = len(contacts)
        lam, x, error, status = np.empty((4, 1)), np.empty((n, 3, 1)), np.empty(1), np.empty(1, dtype=np.int64)
        solve_lanes(r.a, np.ascontiguousarray(b[:, :, None]), c, lam, x, error, status, 0.0)
        mine, forces = np.zeros(4), np.empty((n, 3))
        found = solve_single(r.a, b, mine, forces)
        if FAILED in (found, status[0]):
            continue
        assert found == status[0]
        seen.add(int(found))
        if found == 1:
            assert mine[2] == pytest.approx(lam[2, 0], abs=1e-8 * max(1.0, abs(lam[2, 0])))
    assert seen == {1, 2, 3}


@pytest.mark.parametrize(
    ("position", "normal", "mu", "status", "value"),
    [
        ([], [], [], "infeasible", math.nan),
        ([(0.1, 0.2, 0.0)], [UP], [0.5], "ok", 0.1),
        (SQUARE, [UP] * 4, [0.0] * 4, "ok", 0.1),
        (SQUARE, [UP] * 4, [math.inf] * 4, "ok", 0.1),
        (SQUARE, [tilted(45.0)] * 4, [0.5] * 4, "infeasible", math.nan),
        ([(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)], [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)], [0.8] * 2, "ok", None),
        ([(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)], [UP, (0.0, 0.0, -1.0)], [0.8] * 2, "unbounded", math.nan),
    ],
)
def test_special_sets(position: list, normal: list, mu: list, status: str, value: float | None) -> None:
    contacts = contact_set(np.reshape(position, (-1, 3)), np.reshape(normal, (-1, 3)), mu)
    found = support_value(contacts, np.array([1.0, 0.0]))
    whole = region(contacts, SIXTEEN)
    assert found.status == (whole.support.status[0] if whole.status != "infeasible" else "infeasible")
    if value is not None:
        assert found.status == status
        np.testing.assert_allclose(found.value, value, atol=1e-9)
