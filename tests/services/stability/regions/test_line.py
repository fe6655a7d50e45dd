"""Contacts on one line, with unlimited friction: regions, extents and margins beside linear programs of scipy."""

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from surefoot import stability
from surefoot.arrays import Array
from surefoot.services.stability.programs.contacts import ContactSet, contact_set
from surefoot.services.stability.regions.margin import extent, margin
from surefoot.services.stability.regions.region import region
from tests.services.stability.certificate import balance, force_violation, twist_violation
from tests.services.stability.sets import UP


def program(contacts: ContactSet, direction: Array, through: Array | None = None) -> tuple[str, float]:
    """Return status and largest value of direction (2,) times the CoM, by a linear program over forces and CoM.

    Unlimited friction makes the cones half-spaces, so that the program is linear. `through`: the CoM lies on the line
    through this point (2,) m along `direction`.
    """
    n = len(contacts)
    rows, right = np.zeros((6, 3 * n + 2)), np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    for i, (x, y, z) in enumerate(contacts.position):
        rows[:3, 3 * i : 3 * i + 3] = np.eye(3)
        rows[3:, 3 * i : 3 * i + 3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    rows[3, -1], rows[4, -2] = -1.0, 1.0
    if through is not None:
        across = np.array([-direction[1], direction[0]])
        rows, right = np.vstack((rows, [*np.zeros(3 * n), *across])), np.append(right, across @ through)
    push = np.zeros((n, 3 * n + 2))
    for i in range(n):
        push[i, 3 * i : 3 * i + 3] = -contacts.normal[i]
    free = [(None, None)] * (3 * n + 2)
    found = linprog(np.append(np.zeros(3 * n), -direction), push, np.zeros(n), rows, right, free)
    return {0: "ok", 2: "infeasible", 3: "unbounded"}[found.status], math.nan if found.fun is None else -found.fun


def lines(seed: int, count: int) -> list[tuple[ContactSet, Array]]:
    """Return sets of 2 to 4 contacts on lines in every direction, and the horizontal unit vector (2,) of each line."""
    rng, made = np.random.default_rng(seed), []
    for k in range(count):
        angle = rng.uniform(0.0, 2.0 * np.pi) if k % 4 else rng.integers(4) * 0.5 * np.pi
        slope, n = (0.0, 0.0, rng.uniform(-0.5, 0.5), rng.uniform(2.0, 9.0))[k % 4], int(rng.integers(2, 5))
        along = np.array([np.cos(angle), np.sin(angle), slope])
        position = rng.uniform(-0.5, 0.5, 3) * (k % 3 > 0) + rng.uniform(-0.3, 0.3, (n, 1)) * along
        side = np.cross(along, UP) / np.linalg.norm(np.cross(along, UP))
        up = np.cross(side, along) / np.linalg.norm(np.cross(side, along))
        kinds = (np.tile(UP, (n, 1)), rng.normal(size=(n, 3)) * 0.3 + UP, up + rng.normal(size=(n, 1)) * 0.5 * side)
        made.append((contact_set(position, kinds[k // 4 % 3], math.inf), along[:2]))
    return made


SETS = lines(3, 36)


@pytest.mark.parametrize("k", range(len(SETS)))
def test_regions_and_extents_are_those_of_linear_programs(k: int) -> None:
    contacts, line = SETS[k]
    across, slanted = np.array([-line[1], line[0]]), np.array([0.6, 0.8])
    directions = np.array([line, -line, across, -across, slanted])
    found = region(contacts, directions)
    wanted = [program(contacts, d) for d in directions]
    assert found.support.status == tuple(status for status, _ in wanted)
    for i, (status, value) in enumerate(wanted):
        if status == "ok":
            assert found.support.value[i] == pytest.approx(value, abs=1e-6)
            assert twist_violation(contacts, found.support.twist[i], directions[i]) <= 1e-8
            assert force_violation(contacts, found.support.force[i]) <= 1e-8
            assert balance(contacts, found.support.force[i], found.support.point[i]) < 1e-7
            assert abs(found.support.gap[i]) < 1e-7
        elif status == "unbounded":
            shift = found.support.force[i]
            assert force_violation(contacts, shift) <= 1e-8 * np.abs(shift).max()
            assert np.abs(shift.sum(axis=0)).max() <= 1e-8 * np.abs(shift).max()
            moment = np.cross(contacts.position, shift).sum(axis=0)  # of c x e_z, with c the shift of the CoM
            assert directions[i] @ [-moment[1], moment[0]] == pytest.approx(1.0, abs=1e-6)
    middle = contacts.position[:, :2].mean(axis=0)
    for d in directions:
        status, value = program(contacts, d, middle)
        got = extent(found, middle, d)
        assert got.status == {"infeasible": "missed"}.get(status, status)
        if status == "ok":
            assert got.value == pytest.approx(value - d @ middle, abs=1e-6)
    assert extent(found, middle + 0.05 * across, line).status == "missed"
    if found.status == "unbounded":  # others may end before the middle
        assert extent(found, middle, across).value == pytest.approx(0.0, abs=1e-9)
        away = margin(found, found.inner[0] + 0.05 * across).value
        assert away == pytest.approx(-0.05, abs=1e-6)


def test_level_contacts_hold_between_their_ends_only() -> None:
    feet = stability.contacts([[0.0, 0.0, 0.0], [0.06, 0.08, 0.0], [0.12, 0.16, 0.0]], friction=math.inf)
    found = stability.region(feet, directions=[[-0.8, 0.6], [0.6, 0.8]])
    assert found.status == "segment"
    np.testing.assert_allclose(found.support.value, [0.0, 0.2], atol=1e-9)
    assert stability.margin(feet, [0.03, 0.04]) == 0.0
    assert stability.margin(feet, [0.03 - 0.008, 0.04 + 0.006]) == pytest.approx(-0.01)


def test_a_sloping_line_is_held_all_along_and_nowhere_beside() -> None:
    feet = stability.contacts([[0.0, 0.0, 0.0], [0.06, 0.08, 0.05]], friction=math.inf)
    found = stability.region(feet, directions=[[-0.8, 0.6], [0.6, 0.8]])
    assert (found.status, found.support.status) == ("unbounded", ("ok", "unbounded"))
    assert stability.margin(feet, [3.0, 4.0]) == 0.0
    assert stability.margin(feet, [0.03 - 0.008, 0.04 + 0.006]) == -math.inf
