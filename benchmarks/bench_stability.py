"""Speed of the stability functions against clarabel, and their verdicts on many random sets.

python -m benchmarks.bench_stability [--sets 10000] [--repeats 60]
"""

import argparse
import os
import time
from collections import Counter
from collections.abc import Callable

import numpy as np

from surefoot.geometry.polygon import area
from surefoot.kernels.jit import kernel
from surefoot.robot.reader import load_robot
from surefoot.services.stability.programs.contacts import Array, ContactSet, contact_set, equally_spaced
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

SIXTEEN = equally_spaced(16)
LEFT_OUT = 0.005  # of the area; where 16 adaptive directions leave out more, the best choice is shown


def stance(rng: np.random.Generator, n: int) -> ContactSet:
    """20 cm stance on uneven ground: slopes to 30 degrees, friction 0.3 to 0.9; feasible, without a short cut."""
    while True:
        xy, z = rng.uniform(-0.1, 0.1, (n, 2)), rng.uniform(-0.03, 0.03, n)
        s, h = np.radians(rng.uniform(0.0, 30.0, n)), rng.uniform(0.0, 2.0 * np.pi, n)
        normal = np.column_stack((np.sin(s) * np.cos(h), np.sin(s) * np.sin(h), np.cos(s)))
        found = contact_set(np.column_stack((xy, z)), normal, rng.uniform(0.3, 0.9, n))
        seen = region(found, SIXTEEN)
        if seen.status == "ok" and not seen.exact:
            return found


def microseconds(function: Callable[[], object], calls: int = 5, blocks: int = 3) -> float:
    """Smallest mean time of a call over blocks: short blocks see through a loaded machine."""
    function()
    best = np.inf
    for _ in range(blocks):
        began = time.perf_counter()
        for _ in range(calls):
            function()
        best = min(best, (time.perf_counter() - began) / calls)
    return 1e6 * best


def speed(repeats: int) -> None:
    """Median over random stances of the best time, and the ratio to clarabel in the same run."""
    rng = np.random.default_rng(0)
    robot = load_robot("ragno")
    print("contacts | region 16  adaptive 16  to 0.1 mm  kernel 16  one  margin  extent | clarabel  (23) fresh | ratio")
    for n in (3, 4, 6, 12):
        rows: list[list[float]] = []
        for _ in range(repeats):
            s = stance(rng, n)
            oracle, found = Oracle(s, *reduce(s)), region(s, limit=16)
            reference = Reference(oracle.reduced.a, oracle.reduced.c, 1e-8)
            c = s.position[:, :2].mean(axis=0)
            rows.append(
                [
                    microseconds(lambda s=s: region(s, SIXTEEN)),
                    microseconds(lambda s=s: region(s, tolerance=1e-9, limit=16)),
                    microseconds(lambda s=s: region(s)),
                    microseconds(lambda o=oracle: o.fan(SIXTEEN, 16)),
                    microseconds(lambda s=s: Oracle(s, *reduce(s)).fan(SIXTEEN[1:2], 1)),
                    microseconds(lambda f=found, c=c: margin(f, c)),
                    microseconds(lambda f=found, c=c: extent(f, c, SIXTEEN[3])),
                    microseconds(lambda r=reference, o=oracle: [r.solve(o.reduced.h @ a) for a in SIXTEEN], 1),
                    microseconds(lambda s=s: [literal_support(s, a, tolerance=1e-8) for a in SIXTEEN[:4]], 1, 1) * 4.0,
                ]
            )
        m = np.median(np.array(rows), axis=0)
        cells = "  ".join(f"{v:8.1f}" for v in m)
        print(f"{n:8d} | {cells} us | {m[3] / m[7]:.3f}, {m[3] / m[8]:.3f}")
    up, q = np.array([0.0, 0.0, 9.81]), robot.neutral + 0.02 * rng.normal(size=18)
    for touch in (np.ones(6, dtype=bool), np.array([1, 0, 1, 0, 1, 0], dtype=bool)):
        for torque in (None, np.zeros(18)):
            t = microseconds(lambda u=touch, w=torque: watch(robot, q, u, up, w, WatchParams()))
            name = "without" if torque is None else "with"
            print(f"state/stability, {int(touch.sum())} feet, {name} torques: {t:.0f} us")


def adaptive(count: int, seed: int = 1) -> None:
    """Area that 16 directions leave out, adaptive and equally spaced; where much, what the best 16 corners would."""
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
            hopeless.append((lost[-1][0], 1.0 - (area(border) - least_cut(border, 16)) / whole))
    m = 100.0 * np.array(lost)
    for name, column in (("adaptive", m[:, 0]), ("fixed", m[:, 1])):
        print(
            f"area left out by 16 {name} directions, {count} stances: median {np.median(column):.2f} %, "
            f"95 % {np.quantile(column, 0.95):.2f} %, 99 % {np.quantile(column, 0.99):.2f} %, max {column.max():.2f} %"
        )
    for ours, best in hopeless:
        print(
            f"  a curved one: {100 * ours:.2f} %; the best 16 of 110 points of its border leave out {100 * best:.2f} %"
        )


@kernel
def least_cut(border: Array, corners: int) -> float:
    """Least area between a convex polygon (m, 2) and one whose corners are `corners` of its points."""
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


def together(count: int) -> None:
    """Status and margin of many sets, one by one, in one call, and on all cores."""
    rng = np.random.default_rng(3)
    sets = [stance(rng, int(rng.integers(3, 7))) for _ in range(200)]
    sets, com = [sets[k % 200] for k in range(count)], rng.uniform(-0.1, 0.1, (count, 2))
    p, v, m = (np.concatenate([getattr(s, name) for s in sets]) for name in ("position", "normal", "mu"))
    many = pack(p, v, m, [len(s) for s in sets], com)
    few = range(0, count, max(1, count // 500))
    single = microseconds(lambda: [margin(region(sets[k], tolerance=COARSE), com[k]) for k in few], 1) / len(few)
    cores, answers = os.cpu_count() or 1, [batch(many, threads=1)]
    alone = microseconds(lambda: batch(many, threads=1), 1)
    shared = microseconds(lambda: answers.append(batch(many, threads=cores)), 1)
    same = all(a.margin.tobytes() == answers[0].margin.tobytes() for a in answers)
    print(
        f"{count} sets of 3 to 6 contacts: one by one {single:.0f} us a set, in one call {alone / count:.1f}, on "
        f"{cores} cores {shared / count:.1f} ({shared / 1e3:.0f} ms in all); same bits on any number: {same}"
    )


def random_set(rng: np.random.Generator) -> ContactSet:
    """1 to 12 contacts, slopes to 85 degrees, friction 0 to 1.5; half on one plane, line or spot, or doubled."""
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
    normal = np.column_stack((np.sin(s) * np.cos(h), np.sin(s) * np.sin(h), np.cos(s)))
    return contact_set(p, normal, rng.uniform(0.0, 1.5, n))


def refuted(found: Region) -> str:
    """What the certificates of a region do not prove; empty when all holds."""
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


def verdicts(count: int) -> None:
    """Statuses of random sets, each proved by its certificates; values against clarabel at 1e-11."""
    rng = np.random.default_rng(2)
    seen: Counter[str] = Counter()
    wrong: Counter[str] = Counter()
    worst, certified = 0.0, 0
    for _ in range(count):
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
    print(f"{count} random sets: {dict(seen)}")
    print(f"  wrong verdicts or values: {dict(wrong) or 0}; largest difference to clarabel {worst:.1e} m,")
    print(f"  {certified} values where clarabel is further off, decided by the certified gap <= 1e-8")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=2000, help="random sets for the verdicts")
    parser.add_argument("--repeats", type=int, default=60, help="stances per row of the speed table")
    options, _ = parser.parse_known_args()
    rehearse(load_robot("ragno"), WatchParams())
    speed(options.repeats)
    for seed in (1, 2, 3, 4):
        adaptive(10 * options.repeats, seed)
    together(10_000)
    verdicts(options.sets)


if __name__ == "__main__":
    main()
