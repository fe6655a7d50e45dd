"""The interior-point kernel against clarabel, linear programs, and its own certificates."""

import numpy as np
import pytest

from surefoot.services.stability.programs.contacts import equally_spaced
from surefoot.services.stability.programs.fan import Fan
from surefoot.services.stability.programs.interior import FAILED, NO_DUAL, NO_PRIMAL, SOLVED, solve_lanes
from surefoot.services.stability.programs.newton import factor, solve
from surefoot.services.stability.programs.reduced import reduce
from surefoot.services.stability.programs.reference import Reference, solve_one
from surefoot.services.stability.regions.careful import Oracle
from tests.services.stability.certificate import balance, force_violation, twist_violation
from tests.services.stability.oracles import literal_support, pyramid_support
from tests.services.stability.sets import feasible_sets, random_set

SIXTEEN = equally_spaced(16)


def test_support_equals_clarabel_on_the_reduced_dual() -> None:
    rng = np.random.default_rng(1)
    solved = 0
    for _ in range(60):
        contacts = random_set(rng, int(rng.integers(2, 13)), 85.0, (0.0, 1.5))
        oracle = Oracle(contacts, *reduce(contacts))
        fan = oracle.fan(SIXTEEN, 16)
        reference = Reference(oracle.reduced.a, oracle.reduced.c)
        for k in range(16):
            answer = reference.solve(oracle.reduced.h @ SIXTEEN[k])
            assert fan.status[k] == answer.status
            if answer.status == SOLVED:
                solved += 1
                assert abs(fan.value[k] - answer.value) <= 1e-8 * max(1.0, abs(answer.value))
    assert solved > 300


def test_support_equals_the_literal_program_and_lies_between_pyramids() -> None:
    for contacts in feasible_sets(2, 6):
        oracle = Oracle(contacts, *reduce(contacts))
        support = oracle.support(oracle.fan(SIXTEEN[1::5], 4), np.arange(3))
        for k, a in enumerate(support.direction):
            assert support.value[k] == pytest.approx(literal_support(contacts, a), abs=3e-7)
            low, high = pyramid_support(contacts, a, 48, False), pyramid_support(contacts, a, 48, True)
            assert low - 1e-9 <= support.value[k] <= high + 1e-9
            assert high - low < 2e-3


def test_every_value_is_proved_from_both_sides() -> None:
    for contacts in feasible_sets(3, 25, (2, 13)):
        oracle = Oracle(contacts, *reduce(contacts))
        support = oracle.support(oracle.fan(SIXTEEN, 16), np.arange(16))
        for k in range(16):
            assert twist_violation(contacts, support.twist[k], support.direction[k]) < 1e-9
            assert support.twist[k][2] == support.value[k]
            assert force_violation(contacts, support.force[k]) < 1e-9
            assert balance(contacts, support.force[k], support.point[k]) < 1e-8
            assert abs(support.gap[k]) < 2e-9


def test_lanes_do_not_influence_each_other() -> None:
    contacts = random_set(np.random.default_rng(4), 5)
    oracle = Oracle(contacts, *reduce(contacts))
    together = oracle.fan(SIXTEEN[:8], 8)
    for k in range(8):
        alone = oracle.fan(SIXTEEN[k : k + 1], 1)
        assert alone.value[0] == together.value[k]
        np.testing.assert_array_equal(alone.force[0], together.force[k])


def test_five_unknowns_equal_clarabel() -> None:
    rng = np.random.default_rng(5)
    for contacts in feasible_sets(6, 10):
        r = reduce(contacts)[0]
        a, b = SIXTEEN[3], np.array([-SIXTEEN[3][1], SIXTEEN[3][0]])
        wide = np.concatenate((r.a, (r.h @ b)[:, :, None]), axis=2)
        c = np.append(r.c, rng.uniform(-0.2, 0.2))
        status, value, *_ = solve_one(wide, r.h @ a, c)
        answer = Reference(wide, c).solve(r.h @ a)
        assert status == answer.status
        if status == SOLVED:
            assert value == pytest.approx(answer.value, abs=1e-8)


def test_a_start_near_the_answers_on_both_sides_is_shorter_and_ends_the_same() -> None:
    """b is linear in the direction, so for a = p a_k + q a_m their twists, mixed alike, are feasible."""
    turn, iterations = np.radians(10.0), np.zeros(2)
    here, there = np.array([[1.0, 0.0]]), np.array([[np.cos(turn), np.sin(turn)]])
    middle = here + there
    p = 1.0 / np.linalg.norm(middle)
    for contacts in feasible_sets(7, 20):
        oracle = Oracle(contacts, *reduce(contacts))
        r = oracle.reduced
        ends, direct = oracle.fan(np.concatenate((here, there)), 2), oracle.fan(p * middle, 1)
        if (ends.status != SOLVED).any():
            continue
        rhs = np.ascontiguousarray((r.h @ (p * middle)[0])[:, :, None])
        for k, share in enumerate((0.0, 0.98)):
            lam = (p * (ends.unknown[0] + ends.unknown[1]))[:, None].copy()
            x = (0.5 * (ends.force[0] + ends.force[1]))[:, :, None].copy()
            error, status = np.empty(1), np.empty(1, dtype=np.int64)
            iterations[k] += solve_lanes(r.a, rhs, r.c, lam, x, error, status, share)
            assert status[0] == SOLVED
            assert lam[2, 0] == pytest.approx(direct.value[0], abs=1e-8)
    assert 0.0 < iterations[1] < 0.8 * iterations[0]


def test_verdicts_of_hand_made_programs() -> None:
    """One cone, one unknown direction each: solved, no forces, no bound."""
    a = np.zeros((1, 3, 4))
    a[0, 0, 2] = 1.0
    lam, x, error, status = np.empty((4, 8)), np.empty((1, 3, 8)), np.empty(8), np.empty(8, dtype=np.int64)
    rhs = np.zeros((1, 3, 8))
    solve_lanes(a, rhs, np.array([0.0, 0.0, 1.0, 0.0]), lam, x, error, status, 0.0)
    assert (status == SOLVED).all()
    np.testing.assert_allclose(lam[2], 0.0, atol=1e-8)
    solve_lanes(a, rhs, np.array([0.0, 0.0, -1.0, 0.0]), lam, x, error, status, 0.0)
    assert (status == NO_PRIMAL).all()
    np.testing.assert_allclose(lam[2], 1.0)  # the ray: objective -1
    rhs[0, 1] = 1.0  # pulls along a cone coordinate that the unknown does not reach
    solve_lanes(np.zeros((1, 3, 4)), rhs, np.array([0.0, 0.0, 0.0, 0.0]), lam, x, error, status, 0.0)
    assert (status == NO_DUAL).all()
    np.testing.assert_allclose((x * rhs).sum(axis=(0, 1)), 1.0)


@pytest.mark.parametrize("unknowns", [3, 4, 5, 6])
def test_factor_and_solve_against_numpy(unknowns: int) -> None:
    from surefoot.services.stability.programs.lanes import MATRIX, P1, SIZE

    rng = np.random.default_rng(unknowns)
    g = np.zeros(SIZE)
    b = rng.normal(size=(8, unknowns, unknowns + 2))
    m = b @ b.transpose(0, 2, 1)
    right = rng.normal(size=(8, unknowns))
    for j in range(unknowns):
        g[P1 + 8 * j : P1 + 8 * j + 8] = right[:, j]
        for i in range(j + 1):
            o = MATRIX + 8 * (j * (j + 1) // 2 + i)
            g[o : o + 8] = m[:, j, i]
    factor(g, unknowns, 8)
    solve(g, unknowns, P1, 8)
    got = g[P1 : P1 + 8 * unknowns].reshape(unknowns, 8).T
    np.testing.assert_allclose(got, np.linalg.solve(m, right[:, :, None])[:, :, 0], rtol=1e-7)


def test_a_null_direction_is_left_alone() -> None:
    from surefoot.services.stability.programs.lanes import MATRIX, P1, SIZE

    g = np.zeros(SIZE)
    for j in (0, 2, 3):  # unknown 1 is felt by no contact
        o = MATRIX + 8 * (j * (j + 1) // 2 + j)
        g[o : o + 8] = 4.0
    g[P1 : P1 + 32] = 1.0
    factor(g, 4, 8)
    solve(g, 4, P1, 8)
    np.testing.assert_allclose(g[P1 : P1 + 32].reshape(4, 8)[:, 0], [0.25, 0.0, 0.25, 0.25], atol=1e-12)


def test_the_fallback_answers_when_the_kernel_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    from surefoot.services.stability.regions import careful as module

    contacts = random_set(np.random.default_rng(7), 4)
    expected = Oracle(contacts, *reduce(contacts)).fan(SIXTEEN, 16).value.copy()

    def gives_up(r: object, fan: Fan, *rest: object) -> tuple[int, bool, None]:
        fan.status[:16] = FAILED
        return 0, False, None

    monkeypatch.setattr(module, "explore", gives_up)
    fan = Oracle(contacts, *reduce(contacts)).fan(SIXTEEN, 16)
    np.testing.assert_allclose(fan.value, expected, atol=1e-8)
    assert (fan.status == SOLVED).all()
