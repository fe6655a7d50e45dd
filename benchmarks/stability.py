"""Support regions: times beside clarabel, area that 16 directions leave out, many sets at once, random sets."""

import os
from collections import Counter
from functools import partial

import numpy as np

from benchmarks.bench import Bench, Call, best_of, goal, table
from surefoot.arrays import Array
from surefoot.geometry.polygon import area
from surefoot.kernels.jit import kernel
from surefoot.robot.reader import load_robot
from surefoot.services.stability.programs.contacts import ContactSet, contact_set, equally_spaced
from surefoot.services.stability.programs.interior import SOLVED
from surefoot.services.stability.programs.reduced import reduce
from surefoot.services.stability.regions.careful import Oracle, Reference
from surefoot.services.stability.regions.many import COARSE, batch, pack
from surefoot.services.stability.regions.margin import extent, margin
from surefoot.services.stability.regions.model import Region
from surefoot.services.stability.regions.region import region
from surefoot.services.stability.rehearsal import rehearse
from surefoot.services.stability.sensing.state import WatchParams, watch
from tests.services.stability.certificate import balance, force_violation, twist_violation
from tests.services.stability.oracles import literal_support

BENCH = Bench("stability")

SIXTEEN = equally_spaced(16)
LEFT_OUT = 0.005
"""Share of a region's area, 0 to 1, that the inner polygon of 16 adaptive directions lacks; above it the share that
the best polygon of 16 border points lacks is printed beside it."""


def normals(slope: Array, heading: Array) -> Array:
    """Return the unit normals of n slopes, rad, that fall towards headings, rad, (n,) each, z up: (n, 3)."""
    return np.column_stack((np.sin(slope) * np.cos(heading), np.sin(slope) * np.sin(heading), np.cos(slope)))


def stance(rng: np.random.Generator, n: int, slope_deg: float = 30.0, mu: float | None = None) -> ContactSet:
    """Return a stance of 20 cm on uneven ground, feasible, whose region is not simply the hull.

    Args:
        rng: source.
        n: contacts.
        slope_deg: steepest slope, deg.
        mu: friction of all contacts; None = 0.3 to 0.9.
    """
    while True:
        xy, z = rng.uniform(-0.1, 0.1, (n, 2)), rng.uniform(-0.03, 0.03, n)
        normal = normals(np.radians(rng.uniform(0.0, slope_deg, n)), rng.uniform(0.0, 2.0 * np.pi, n))
        friction = rng.uniform(0.3, 0.9, n) if mu is None else mu
        found = contact_set(np.column_stack((xy, z)), normal, friction)
        seen = region(found, SIXTEEN)
        if seen.status == "ok" and not seen.exact:
            return found


def us(function: Call, calls: int = 5, blocks: int = 3) -> float:
    """Return the smallest mean time of a call over blocks of calls, us."""
    return 1e6 * best_of(function, blocks, calls)


def costs(s: ContactSet) -> list[float]:
    """Return the times of the stability functions for one stance, and that of clarabel, us."""
    oracle, found = Oracle(s, *reduce(s)), region(s, limit=16)
    reference = Reference(oracle.reduced.a, oracle.reduced.c, 1e-8)
    c = s.position[:, :2].mean(axis=0)
    return [
        us(lambda: region(s, SIXTEEN)), us(lambda: region(s, tolerance=1e-9, limit=16)), us(lambda: region(s)),
        us(lambda: oracle.fan(SIXTEEN, 16)), us(lambda: Oracle(s, *reduce(s)).fan(SIXTEEN[1:2], 1)),
        us(lambda: margin(found, c)),
        us(lambda: extent(found, c, SIXTEEN[3])),
        us(lambda: [reference.solve(oracle.reduced.h @ a) for a in SIXTEEN], 1),
        us(lambda: [literal_support(s, a, tolerance=1e-8) for a in SIXTEEN[:4]], 1, 1) * 4.0,
    ]  # fmt: skip


@BENCH.part("--repeats 1")
def speed(*, repeats: int = 60) -> None:
    """Print times of the stability functions, medians over random stances, and their ratio to clarabel's.

    Args:
        repeats: stances of each row.
    """
    rng, robot = np.random.default_rng(0), load_robot("ragno")
    rehearse(robot, WatchParams())
    rows: list[tuple[object, ...]] = []
    for n in (3, 4, 6, 12):
        m = np.median(np.array([costs(stance(rng, n)) for _ in range(repeats)]), axis=0)
        rows.append((str(n), *(f"{v:.1f}" for v in m), f"{m[3] / m[7]:.3f}", f"{m[3] / m[8]:.3f}"))
    header = ("contacts", "region 16", "adaptive 16", "to 0.1 mm", "kernel 16", "one", "margin", "extent", "clarabel",
              "(23) fresh", "kernel / clarabel", "/ fresh")  # fmt: skip
    table("us", header, rows)
    up, q = np.array([0.0, 0.0, 9.81]), robot.neutral + 0.02 * rng.normal(size=18)
    for touch in (np.ones(6, dtype=bool), np.array([1, 0, 1, 0, 1, 0], dtype=bool)):
        for name, torque in (("without", None), ("with", np.zeros(18))):
            t = us(partial(watch, robot, q, touch, up, torque, WatchParams()))
            goal(f"state/stability, {int(touch.sum())} feet, {name} torques", t, unit="us")


@BENCH.part("--count 2")
def adaptive(*, count: int = 600) -> None:
    """Area that 16 directions leave out, adaptive and equally spaced, for four seeds.

    Where it is much, what the best 16 corners would leave out is printed.

    Args:
        count: random stances of each seed.
    """
    for seed in (1, 2, 3, 4):
        rng = np.random.default_rng(seed)
        lost: list[tuple[float, float]] = []
        hopeless: list[tuple[float, float]] = []
        for _ in range(count):
            s = stance(rng, int(rng.integers(3, 9)))
            whole = area(region(s, tolerance=1e-5, limit=720).inner)
            mine, fixed = region(s, tolerance=1e-9, limit=16), region(s, SIXTEEN)
            lost.append((1.0 - area(mine.inner) / whole, 1.0 - area(fixed.inner) / whole))
            if lost[-1][0] > LEFT_OUT:
                border = region(s, tolerance=1e-9, limit=110).inner
                hopeless.append((100 * lost[-1][0], 100 - 100 * (area(border) - least_cut(border, 16)) / whole))
        rows = [(name, *(float(x) for x in 100.0 * np.quantile(column, (0.5, 0.95, 0.99, 1.0))))
                for name, column in zip(("adaptive", "fixed"), np.array(lost).T, strict=True)]  # fmt: skip
        header = ("directions", "median", "95 %", "99 %", "largest")
        table(f"area left out by 16 directions in %, {count} stances of seed {seed}", header, rows)
        for ours, best in hopeless:
            print(f"  a curved one: {ours:.2f} %; the best 16 of 110 points of its border leave out {best:.2f} %")


@kernel
def least_cut(border: Array, corners: int) -> float:
    """Return the least area, m^2, between a convex polygon (m, 2) m and one with `corners` of its corners."""
    m = border.shape[0]
    cut = np.zeros((m, m))  # between the border from i to j and the chord
    for i in range(m):
        total = 0.0
        for step in range(1, m):
            j, k = (i + step) % m, (i + step - 1) % m
            total += 0.5 * (
                (border[k, 0] - border[i, 0]) * (border[j, 1] - border[i, 1])
                - (border[k, 1] - border[i, 1]) * (border[j, 0] - border[i, 0])
            )
            cut[i, j] = total
    best = np.inf
    for first in range(m):  # a corner; the least cut of all ways on from it, by the number of corners so far
        least = np.full((corners + 1, m + 1), np.inf)
        least[0, 0] = 0.0
        for c in range(corners):
            for i in range(m):
                if least[c, i] == np.inf:
                    continue
                for j in range(i + 1, m + 1):
                    if j - i < m:
                        value = least[c, i] + cut[(first + i) % m, (first + j) % m]
                        least[c + 1, j] = min(least[c + 1, j], value)
        best = min(best, least[:, m].min())
    return best


@BENCH.part("--count 200")
def together(*, count: int = 10_000) -> None:
    """Print the time of status and margin of many contact sets: one by one, in one call, and on all cores.

    Args:
        count: sets.
    """
    rng = np.random.default_rng(3)
    sets = [stance(rng, int(rng.integers(3, 7))) for _ in range(200)]
    sets, com = [sets[k % 200] for k in range(count)], rng.uniform(-0.1, 0.1, (count, 2))
    p, v, m = (np.concatenate([getattr(s, name) for s in sets]) for name in ("position", "normal", "mu"))
    many = pack(p, v, m, [len(s) for s in sets], com)
    few = range(0, count, max(1, count // 500))
    cores, answers = os.cpu_count() or 1, [batch(many, threads=1)]
    single = us(lambda: [margin(region(sets[k], tolerance=COARSE), com[k]) for k in few], 1) / len(few)
    alone = us(lambda: batch(many, threads=1), 1) / count
    shared = us(lambda: answers.append(batch(many, threads=cores)), 1) / count
    same = all(a.margin.tobytes() == answers[0].margin.tobytes() for a in answers)
    rows = [("one by one", single), ("in one call", alone), (f"on {cores} cores", shared)]
    table(f"{count} sets of 3 to 6 contacts; same bits on any number of cores: {same}", ("way", "us a set"), rows)


def random_set(rng: np.random.Generator) -> ContactSet:
    """Return 1 to 12 contacts, slopes to 85 degrees, friction 0 to 1.5; half on one plane, line or spot, or doubled."""
    n = int(rng.integers(1, 13))
    p = rng.uniform(-0.2, 0.2, (n, 3)) * [1.0, 1.0, rng.choice([0.0, 0.2, 1.0])]
    s, h = np.radians(rng.uniform(0.0, rng.choice([10.0, 30.0, 60.0, 85.0]), n)), rng.uniform(0.0, 2.0 * np.pi, n)
    kind = rng.random()
    if kind < 0.2:
        s[:], h[:] = s[0], h[0]
    elif kind < 0.3:
        p[:] = p[0]
    elif kind < 0.4:
        p = p[0] + np.outer(rng.uniform(-1.0, 1.0, n), 0.2 * rng.normal(size=3))
    elif kind < 0.5:
        p[-1] = p[0]
    return contact_set(p, normals(s, h), rng.uniform(0.0, 1.5, n))


def refuted(found: Region) -> str:
    """Return the claim about a region that its certificates do not prove; empty when all are proved."""
    s, support = found.contacts, found.support
    if found.status == "infeasible":
        assert found.sinking is not None
        size = np.abs(found.sinking).max()
        return "infeasible" if twist_violation(s, found.sinking, np.zeros(2)) > 1e-8 * size else ""
    for k, status in enumerate(support.status):
        a, force = support.direction[k], support.force[k]
        size = max(1.0, np.abs(force).max())
        if status == "ok":
            forces = max(force_violation(s, force), balance(s, force, support.point[k])) / size
            twist = twist_violation(s, support.twist[k], a) / max(1.0, np.abs(support.twist[k]).max())
            if max(twist, forces) > 1e-7 or abs(support.gap[k]) > 1e-8 * max(1.0, abs(support.value[k])):
                return "value"
        elif status == "unbounded":
            moment = np.cross(s.position, force).sum(axis=0)
            com, size = np.array([-moment[1], moment[0]]), np.abs(force).max()
            if max(force_violation(s, force), balance(s, force, com, 0.0)) > 1e-8 * size or a @ com < 0.1:
                return "unbounded"
    return ""


@BENCH.part("--sets 50")
def verdicts(*, sets: int = 2000) -> None:
    """Statuses of random sets, each proved by its certificates; values against clarabel at 1e-11.

    Args:
        sets: random sets.
    """
    rng = np.random.default_rng(2)
    seen: Counter[str] = Counter()
    wrong: Counter[str] = Counter()
    worst, certified = 0.0, 0
    for _ in range(sets):
        s = random_set(rng)
        found = region(s, SIXTEEN)
        seen[found.status] += 1
        if reason := refuted(found):
            wrong[reason] += 1
        if found.status != "ok" or found.exact:
            continue
        oracle = Oracle(s, *reduce(s))
        reference = Reference(oracle.reduced.a, oracle.reduced.c)
        for k in range(0, 16, 5):
            answer = reference.solve(oracle.reduced.h @ SIXTEEN[k])
            value = oracle.reduced.length * answer.value + SIXTEEN[k] @ oracle.anchor
            error = abs(value - found.support.value[k]) / max(1.0, abs(value))
            if answer.status != SOLVED or error > 1e-8:
                certified += 1  # clarabel is off; the duality gap, checked above, decides
            else:
                worst = max(worst, error)
    print(f"{sets} random sets: {dict(seen)}")
    print(f"  wrong verdicts or values: {dict(wrong) or 0}; largest difference to clarabel {worst:.1e} m,")
    print(f"  {certified} values where clarabel is further off, decided by the certified gap <= 1e-8")
