"""Footholds on families of ground that no kind of the simulator makes: six to report on, five to choose settings by.

A family and a seed give terrain, friction (0.3 to 0.9) and the map that the robot gets: exact, noisy, gappy, shifted in
turn. The shapes share no code with `surefoot.services.simulator.ground.shapes`. With ``--results FILE`` each finished
walk is a line of that file, and walks that it holds are not repeated.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.bench import Bench, table, words_of
from benchmarks.foothold_walks import Lines, paired, rule_of, sliding
from surefoot.arrays import Array
from surefoot.geometry.heightmap import HeightMap
from surefoot.lab.footholds.campaign import append, read, sample_of
from surefoot.lab.footholds.rules import random_rule
from surefoot.lab.footholds.walks import JoinedWalk, Setting, walk
from surefoot.lab.statistics import mean_ratio, ratio
from surefoot.lab.studies import Line, finished, seeds_of, study
from surefoot.services.footholds.learning.fit import CANDIDATES, LearnOptions, learn
from surefoot.services.footholds.learning.quality import prediction_quality
from surefoot.services.footholds.learning.samples import StanceSample, gather
from surefoot.services.simulator.ground.grid import BLEND, PAD_END, box_heights, slab, smooth
from surefoot.services.simulator.ground.terrain import Terrain, TerrainBox, observed_map

BENCH = Bench("foothold_grounds")

Random = np.random.Generator
CELL, X0, NX, NY = 0.005, -0.6, 341, 221
"""`CELL`: edge of a cell, m; `X0`: x of the first column of cells, m; `NX`, `NY`: number of cells along x and y."""
WAY = 0.6
"""Length of a walk over a family of ground, m."""
FRICTION = (0.3, 0.9)
MAPS = ("exact", "noise", "gappy", "shifted")
GAPS = 25.0
"""Density of round unknown holes in a gappy map, 1/m^2; their radius is 10 to 30 mm."""


@dataclass(frozen=True, eq=False)
class Course:
    """Conditions, terrain and map of one walk over a family of grounds."""

    setting: Setting
    terrain: Terrain
    heights: HeightMap
    """Height map that the robot gets: exact or with errors."""


def _axes() -> tuple[Array, Array]:
    """Return x (1, nx) and y (ny, 1) of the cell centres, m."""
    steps = np.arange(max(NX, NY), dtype=np.float64)
    return (X0 + CELL * steps[:NX])[None, :], (CELL * (steps[:NY] - NY // 2))[:, None]


def _spectral(rng: Random, exponent: float, shortest: float = 0.012) -> Array:
    """Return heights of random phases, amplitudes falling with frequency^-(1 + exponent), (ny, nx), unit rms."""
    f = np.hypot(np.fft.fftfreq(NY, CELL)[:, None], np.fft.rfftfreq(NX, CELL)[None, :])
    size = np.where((f > 1.5) & (f < 1.0 / shortest), np.maximum(f, 1e-9) ** -(1.0 + exponent), 0.0)
    z = np.fft.irfft2(size * np.exp(2j * math.pi * rng.random(f.shape)), (NY, NX))
    return z / z.std()


def _steep(z: Array, slope: float) -> Array:
    """Return heights (ny, nx) m scaled so that the mean slope between neighbouring cells is `slope`, no unit."""
    return z * (slope * CELL / np.abs(np.diff(z, axis=1)).mean())


def _fractal(rng: Random) -> Array:
    return _steep(_spectral(rng, rng.uniform(0.2, 1.1)), rng.uniform(0.2, 0.4))


def _uneven(rng: Random) -> Array:
    return _steep(_spectral(rng, rng.uniform(0.5, 1.0)), rng.uniform(0.1, 0.25))


def _places(rng: Random, density: float) -> tuple[Array, Array]:
    """Return x and y of random points behind the pad at the start, m; `density` in 1/m^2."""
    end, half = X0 + NX * CELL, 0.5 * NY * CELL
    n = rng.poisson(density * (end - PAD_END) * 2.0 * half)
    return rng.uniform(PAD_END, end, n), rng.uniform(-half, half, n)


def _terraces(rng: Random) -> Array:
    rise = rng.uniform(0.008, 0.02)
    return rise * np.round(_steep(_spectral(rng, 1.1, 0.06), rng.uniform(0.2, 0.35)) / rise)


def _rubble(rng: Random) -> Array:
    x, y = _axes()
    z = 0.004 * _spectral(rng, 0.9)
    for cx, cy in zip(*_places(rng, 500.0), strict=True):
        r, up, base = rng.uniform(0.012, 0.04), rng.uniform(0.4, 0.9), rng.uniform(-0.02, 0.0)
        cols, rows = np.abs(x[0] - cx) < r, np.abs(y[:, 0] - cy) < r
        away = (x[:, cols] - cx) ** 2 + (y[rows] - cy) ** 2
        part = np.ix_(rows, cols)
        z[part] = np.maximum(z[part], np.where(away < r * r, base + up * np.sqrt(np.maximum(r * r - away, 0.0)), -1.0))
    return z


def _beams(rng: Random) -> Array:
    x, y = _axes()
    yaw, z = rng.uniform(-0.8, 0.8), 0.002 * _spectral(rng, 0.9)
    across = x * math.cos(yaw) + y * math.sin(yaw)
    at = -1.5
    while at < 2.5:
        wide, height, flank = rng.uniform(0.02, 0.06), rng.uniform(0.006, 0.028), rng.uniform(0.004, 0.012)
        bow = 0.01 * np.sin((y * math.cos(yaw) - x * math.sin(yaw)) / 0.15 + rng.uniform(0.0, 6.0))
        z = z + height * np.clip((0.5 * wide - np.abs(across + bow - at)) / flank, 0.0, 1.0)
        at += wide + rng.uniform(0.02, 0.06)
    return z


def _land(rng: Random) -> Array:
    """Return heights (ny, nx) m of ridges and valleys: folded noise of four octaves, each weaker in earlier valleys."""
    z, weight = np.zeros((NY, NX)), np.ones((NY, NX))
    for octave in range(4):
        ridge = (1.0 - np.abs(np.tanh(_spectral(rng, 1.5, 0.16 / 2**octave)))) ** 2
        z += weight * ridge * 0.045 / 1.9**octave
        weight = np.clip(weight * ridge * 1.6, 0.0, 1.0)
    return _steep(z, rng.uniform(0.2, 0.35))


def _plates(rng: Random) -> Array:
    x, y = _axes()
    px, py = _places(rng, 140.0)
    nearest = np.argmin((x[..., None] - px) ** 2 + (y[..., None] - py) ** 2, axis=2)
    up, sx, sy = rng.uniform(0.0, 0.028, px.size), *rng.uniform(-0.25, 0.25, (2, px.size))
    return up[nearest] + sx[nearest] * (x - px[nearest]) + sy[nearest] * (y - py[nearest])


def _craters(rng: Random) -> Array:
    x, y = _axes()
    z = 0.004 * _spectral(rng, 0.8)
    for cx, cy in zip(*_places(rng, 60.0), strict=True):
        r = rng.uniform(0.02, 0.06)
        u = np.hypot(x - cx, y - cy) / r
        z += rng.uniform(0.15, 0.4) * r * (np.exp(-0.5 * ((u - 1.0) / 0.25) ** 2) - np.exp(-0.5 * (u / 0.6) ** 2))
    return z


def _waves(rng: Random) -> Array:
    x, y = _axes()
    z = np.zeros((NY, NX))
    for wave in np.exp(rng.uniform(np.log(0.03), np.log(0.2), 9)):
        yaw, phase = rng.uniform(0.0, math.pi), rng.uniform(0.0, 6.3)
        z += 0.06 * wave * np.sin(2.0 * math.pi * (x * math.cos(yaw) + y * math.sin(yaw)) / wave + phase)
    return z


def _pyramids(rng: Random) -> Array:
    x, y = _axes()
    z = 0.003 * _spectral(rng, 0.8)
    for cx, cy in zip(*_places(rng, 250.0), strict=True):
        yaw, r, steep = rng.uniform(0.0, math.pi), rng.uniform(0.015, 0.04), rng.uniform(-0.8, 0.8)
        u, v = (x - cx) * math.cos(yaw) + (y - cy) * math.sin(yaw), (y - cy) * math.cos(yaw) - (x - cx) * math.sin(yaw)
        z += steep * np.maximum(r - np.maximum(np.abs(u), np.abs(v)), 0.0)
    return z


def _grain(rng: Random) -> Array:
    exponent = rng.choice([rng.uniform(-0.3, 0.1), rng.uniform(1.2, 1.6)])
    return _steep(_spectral(rng, exponent, 0.02), rng.uniform(0.15, 0.35))


def _boxes(rng: Random, ground: Array) -> tuple[TerrainBox, ...]:
    """Return random boxes of 2 to 10 cm, half sunk into ground of heights (ny, nx) m, tilted by slopes up to 0.2."""
    x, y = _axes()
    out: list[TerrainBox] = []
    for cx, cy in zip(*_places(rng, 55.0), strict=True):
        edges, up, yaw = rng.uniform(0.02, 0.10, 2), rng.uniform(0.004, 0.028), rng.uniform(0.0, math.pi)
        tilt = rng.uniform(-0.2, 0.2, 2)
        if cx > PAD_END + 0.1:
            foot = float(ground[np.argmin(np.abs(y[:, 0] - cy)), np.argmin(np.abs(x[0] - cx))])
            out.append(slab(cx, cy, foot + up, (tilt[0], tilt[1]), 0.04, (edges[0], edges[1]), yaw))
    return tuple(out)


SHAPES: dict[str, Callable[[Random], Array]] = {
    "fractal": _fractal, "boxes": _uneven, "terraces": _terraces, "rubble": _rubble, "beams": _beams, "land": _land,
    "plates": _plates, "craters": _craters, "waves": _waves, "pyramids": _pyramids,
    "grain": _grain,
}  # fmt: skip
REPORTED = tuple(SHAPES)[:6]
"""Families of ground that results are reported on; no setting was chosen by them."""
CHOSEN_BY = tuple(SHAPES)[6:]
"""Families of ground by which settings are chosen; no result is reported on them."""


def course(family: str, seed: int, robot: str = "ragno") -> Course:
    """Return conditions, terrain and map of a walk on a family of ground; equal arguments give equal courses."""
    rng = np.random.default_rng([seed, *family.encode()])
    x, y = _axes()
    friction, profile = round(float(rng.uniform(*FRICTION)), 2), MAPS[seed % len(MAPS)]
    z = SHAPES[family](rng)
    z = (z - np.median(z)) * smooth((x - PAD_END) / BLEND)
    ground = HeightMap(z=z.astype(np.float32), cell=CELL, origin=(X0, float(y[0, 0])))
    boxes = _boxes(rng, z) if family == "boxes" else ()
    for box in boxes:
        z = np.maximum(z, box_heights(box, x, y))
    terrain = Terrain(family, seed, float(np.ptp(z)), ground.with_z(z.astype(np.float32)), ground, boxes=boxes)
    return Course(
        Setting(family, WAY, friction=friction, profile=profile, robot=robot), terrain, _seen(terrain, profile, seed)
    )


def _seen(terrain: Terrain, profile: str, seed: int) -> HeightMap:
    """Return the map that the robot gets; profile `gappy`: a tenth of the cells and round holes are unknown."""
    if profile != "gappy":
        return observed_map(terrain, profile, seed)
    rng, z = np.random.default_rng([seed, *b"gaps"]), terrain.map.z.copy()
    x, y = _axes()
    z[rng.random(z.shape) < 0.1] = np.nan
    for cx, cy in zip(*_places(rng, GAPS), strict=True):
        z[np.hypot(x - cx, y - cy) < rng.uniform(0.01, 0.03)] = np.nan
    return replace(terrain.map.with_z(z))


def walked(ground: str, rule: str, seed: int, model: str, robot: str) -> Line:
    """Walk over a ground of a family, drawn by the seed, under a rule of footholds; return its figures."""
    c = course(ground, seed, robot)
    done = walk(seed, c.setting, rule_of(rule, seed, model, robot), (c.terrain, c.heights))
    return {"sliding_mm": done.sliding_mm, "reached": done.reached, "fallen": done.fallen, "reason": done.reason}


def compared(lines: Lines, grounds: list[str], one: str, other: str) -> Iterator[tuple[object, ...]]:
    """Yield the ratio of the sliding of two rules on each ground, and its mean over the grounds, with intervals."""
    pairs = [pair for ground in grounds if len((pair := paired(lines, ground, one, other))[0]) > 1]
    for ground in grounds:
        pair = paired(lines, ground, one, other)
        if len(pair[0]) > 1:
            fell = [sum(bool(line["fallen"]) for (g, r, _), line in lines.items() if (g, r) == (ground, rule))
                    for rule in (one, other)]  # fmt: skip
            slid = [float(np.mean(sliding(lines, ground, rule))) for rule in (one, other)]
            won = int((pair[0] < pair[1]).sum())
            yield ground, other, *slid, *ratio(*pair), f"{won} of {len(pair[0])}", f"{fell[0]} {fell[1]}"
    if pairs:
        yield f"mean of {len(pairs)} families", other, None, None, *mean_ratio(pairs), "", ""


@BENCH.part("--families waves --seeds 1 --rules hand")
def families(
    *, rules: str = "learned,min-k2:4,hand", families: str = ",".join(REPORTED), seeds: str = "0:12",
    model: str = "shipped", robot: str = "ragno", results: Path | None = None, processes: int = 2,
) -> None:  # fmt: skip
    """Compare learned footholds with other rules on unseen families of ground: sliding per stance, paired over seeds.

    Intervals are 95 % of resampled seeds. Settings are chosen by the families of `CHOSEN_BY`.

    Args:
        rules: names of rules, comma-separated, see `foothold_walks`; the first is compared with the others.
        families: names of families of ground, comma-separated.
        model: a model file, or shipped.
        robot: name of the robot.
    """
    names, places = words_of(rules), words_of(families)
    jobs = [{"ground": ground, "rule": rule, "seed": seed}
            for seed in seeds_of(seeds) for ground in places for rule in names]  # fmt: skip
    done = study(partial(walked, model=model, robot=robot), jobs, results, processes=processes)
    lines = {(line["ground"], line["rule"], line["seed"]): line for line in [*finished(results), *done]}
    header = ("family", "other", f"{names[0]}, mm", "other, mm", "ratio", "from", "to", "won", "falls")
    rows = [row for other in names[1:] for row in compared(lines, list(places), names[0], other)]
    table(f"{robot}, model {model}: contact sliding per stance", header, rows)


def random_stances(families: Sequence[str], seeds: Sequence[int], file: Path) -> list[StanceSample]:
    """Return stances with random footholds on families, one walk a family and seed; a file keeps them."""
    done = read(file)[1] if file.exists() else {}
    for seed, family in itertools.product(seeds, families):
        if f"{family}-{seed}" in done:
            continue
        c = course(family, seed)
        joined = JoinedWalk(seed, c.setting, random_rule(seed), (c.terrain, c.heights)).run()
        robot, ground = joined.robot, joined.selector.ground
        made = [sample_of(stance, ground, f"{family}-{seed}") for stance in joined.stances.found]
        append(file, f"{family}-{seed}", [
            replace(each, friction=c.setting.friction, robot=robot.name, robot_hash=robot.hash,
                    source=f"random {family} {c.setting.profile}") for each in made])  # fmt: skip
    return read(file)[0]


@BENCH.part()
def curve(
    *, samples: Path = Path("samples.jsonl"), held: Path = Path("held.jsonl"), sizes: str = "2,4,8,16,24",
    draws: int = 5, seeds: str = "60:66",
) -> None:  # fmt: skip
    """Print a learning curve: quality of slip models of few to many walks, on families of ground that none has seen.

    Args:
        samples: file of samples that `surefoot footholds collect` wrote.
        held: stances with random footholds on the families of `CHOSEN_BY`; made where absent.
        sizes: numbers of walks, comma-separated.
        draws: sets of walks drawn for each size.
        seeds: seeds of the stances that are held out.
    """
    learned, _, _ = read(samples)
    test = random_stances(CHOSEN_BY, seeds_of(seeds), held)
    trials = sorted({each.trial for each in learned})
    rows: list[tuple[object, ...]] = []
    for size in (min(int(text), len(trials)) for text in words_of(sizes)):
        found: list[tuple[float, ...]] = []
        for draw in range(1 if size == len(trials) else draws):
            chosen = set(np.random.default_rng([draw, size]).choice(trials, size, replace=False).tolist())
            own = gather([each for each in learned if each.trial in chosen])
            folds = min(5, len(chosen))
            model = learn(own, LearnOptions(folds=folds, candidates=CANDIDATES[:1]))
            quality = prediction_quality(model, test)
            found.append((len(own), quality.spearman, quality.warned, quality.held))
        spread = np.std(found, axis=0)
        rows.append((size, *np.mean(found, axis=0), float(spread[1]), float(spread[3])))
    table(f"simple rule learned from walks, {len(test)} stances on {', '.join(CHOSEN_BY)}",
          ("walks", "stances", "rank", "AUC", "80 % hold", "sd of rank", "sd of hold"), rows)  # fmt: skip
