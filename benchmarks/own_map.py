"""Walks on the map that the robot measures itself, beside walks on a given map: sliding, falls, errors of the cells.

Each walk is the scenario `ragno-own-map` with every service on the in-memory bus. The given map is that of the same
ground, exact or with the noise of scenarios (3 mm a cell, 1 % of the cells and some patches unknown).
"""

import math
from base64 import b64decode, b64encode
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.bench import Bench, table, words_of
from surefoot.geometry.rotations import matrix_from_quat, matrix_from_rpy, quat_from_matrix, rpy_from_matrix
from surefoot.lab.runs.local import run_local
from surefoot.lab.statistics import ratio, resampled_mean
from surefoot.lab.studies import Line, seeds_of, study
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.local import LocalSystem
from surefoot.schemas.hw import DepthImage
from surefoot.schemas.state import Odometry
from surefoot.schemas.topics import HW_DEPTH, STATE_ELEVATION, STATE_ODOMETRY
from surefoot.services.mapper.mapper import Mapper
from surefoot.services.mapper.service import MapperService
from surefoot.services.simulator.service import Simulator
from surefoot.services.simulator.world import PhysicsWorld
from surefoot.services.supervisor.scenarios.scenario import Scenario, load_scenario

BENCH = Bench("own_map")
ARMS = ("own", "noise", "exact")
"""Maps that walks use: the one that the robot measures (`own`), and given ones with `noise` and `exact`."""
NEAR = 0.3
"""Horizontal distance from the robot within which map cells are compared with the ground, m: where feet land."""
MOST = 1.3
"""Goal of the ratio of sliding on the robot's own map to that on a given map: at most this."""
FAULTY_FROM_NS = 8_000_000_000
"""Simulated time from which the camera of an arm ``own:FAULT`` is faulty, ns: half a metre before the end of the
walk."""


class CellErrors(NamedTuple):
    """Errors of the cells near the robot in one published map."""

    nees: float
    """Mean of squared height error over stated variance, no unit; 1 = consistent."""
    inside: float
    """Share of height errors within two stated standard deviations, 0 to 1."""
    error: float
    """Root mean square of the height errors, m."""
    deviation: float
    """Square root of the mean stated height variance, m."""
    known: float
    """Share of the cells whose height is known, 0 to 1."""
    seen: float
    """Share of the cells that the camera has measured, to which the errors refer, 0 to 1; other known cells are the
    plane under the feet at the start, which is exact in these scenarios."""


class _BadCamera:
    """Depth camera with a fault, which changes its images."""

    def __init__(self, fault: str) -> None:
        self.fault, self.frozen = fault, ""

    def __call__(self, image: DepthImage) -> DepthImage:
        """Return the image with the camera's fault."""
        depths = np.frombuffer(b64decode(image.depths), "<f4").reshape(image.height, image.width).copy()
        self.frozen = self.frozen or image.depths
        if self.fault == "frozen":
            return image.model_copy(update={"depths": self.frozen})
        if self.fault == "turned":
            down = matrix_from_rpy(0.0, math.radians(4.0), 0.0)
            turned = tuple(quat_from_matrix(down @ matrix_from_quat(np.array(image.quat_wxyz))).tolist())
            return image.model_copy(update={"quat_wxyz": turned})
        if self.fault == "dark":
            depths[:] = np.nan
        elif self.fault == "zero":
            depths[:] = 0.0
        elif self.fault == "gappy":
            depths[:, ::2] = np.nan
        elif self.fault == "long":
            depths *= 1.15
        else:
            raise ValueError(f"faults are frozen, turned, dark, zero, gappy, long; got {self.fault!r}")
        return image.model_copy(update={"depths": b64encode(depths.tobytes()).decode()})


def scenario_of(arm: str) -> Scenario:
    """Return the scenario of a walk on the robot's own map (`own`), or on a given map of a profile."""
    own = load_scenario("ragno-own-map")
    if arm.startswith("own"):
        return own
    world = own.world.model_copy(update={"map_profile": arm, "depth_camera": None})
    return replace(own, world=world, compose="ragno")


def errors_of(mapper: Mapper, odometry: Odometry, world: PhysicsWorld) -> CellErrors:
    """Return the errors of the map's cells against the true ground, both relative to the robot.

    Args:
        mapper: the map; it lies in the frame of the odometry.
        odometry: believed pose of the robot.
        world: the ground, and where the robot is.
    """
    heights, variances = mapper.heights() or (np.zeros((0, 0)), np.zeros((0, 0)))
    truth, (x, y, z) = world.truth(), odometry.position
    turn = float(rpy_from_matrix(matrix_from_quat(truth.quat_wxyz))[2]) - odometry.yaw
    rows, cols = np.mgrid[0 : heights.shape[0], 0 : heights.shape[1]]
    ahead, left = mapper.origin[0] + mapper.grid.cell * cols - x, mapper.origin[1] + mapper.grid.cell * rows - y
    c, s = math.cos(turn), math.sin(turn)
    ground = world.terrain.map.height(
        truth.position[0] + c * ahead - s * left, truth.position[1] + s * ahead + c * left
    )
    error = (heights - z) - (ground - truth.position[2])
    near = (np.hypot(ahead, left) <= NEAR) & np.isfinite(ground)
    known = near & np.isfinite(error)
    assert mapper.layers is not None
    seen = known & (mapper.layers.variance < (0.5 * mapper.params.start_deviation) ** 2)
    e2, v = error[seen] ** 2, variances[seen]
    return CellErrors(
        float(np.mean(e2 / v)), float(np.mean(e2 <= 4.0 * v)), math.sqrt(e2.mean()), math.sqrt(v.mean()),
        float(known.sum() / near.sum()), float(seen.sum() / near.sum()),
    )  # fmt: skip


def walked(arm: str, seed: int) -> Line:
    """Walk under an arm; return sliding, fall, distance, and the mean errors of cells over the published maps."""
    found: list[CellErrors] = []
    mappers: list[MapperService] = []

    def watch(system: LocalSystem) -> None:
        services = {node.name: node.service for node in system.nodes}
        mapper, simulator = services.get("mapper"), services["simulator"]
        if not isinstance(mapper, MapperService) or not isinstance(simulator, Simulator):
            return
        mappers.append(mapper)
        on_tick, spoil = mapper.on_tick, _BadCamera(arm.partition(":")[2]) if ":" in arm else None

        def looked(inputs: TickInputs) -> None:
            image = inputs.get(HW_DEPTH)
            if spoil is not None and image is not None and inputs.tick.stamp_ns >= FAULTY_FROM_NS:
                inputs = replace(inputs, messages={**inputs.messages, HW_DEPTH.key: spoil(image)})
            on_tick(inputs)
            odometry = inputs.get(STATE_ODOMETRY)
            if STATE_ELEVATION.due(inputs.number) and mapper.mapper.images and odometry is not None:
                found.append(errors_of(mapper.mapper, odometry, simulator.world))

        mapper.on_tick = looked

    run = run_local(scenario_of(arm), seed, meddle=watch)
    value = {row.name: row.value for row in run.verdict.rows}
    cells = {name: float(np.mean([getattr(one, name) for one in found])) for name in CellErrors._fields if found}
    return {
        "slide_mm": value["mean_slip_mm"], "fell": bool(value["fell"]), "way_m": value["distance_m"],
        "hash": run.run_hash, "problems": list(run.verdict.problems), **cells,
        "refused": dict(mappers[0].mapper.refused) if mappers else {},
    }  # fmt: skip


@BENCH.part("--seeds 0:1 --arms own")
def walks(
    *, seeds: str = "700:712", arms: str = ",".join(ARMS), results: Path | None = None, processes: int = 2
) -> None:
    """Compare walks on the robot's own map and on given ones: 0.9 m of rough ground of 4 cm, paired over seeds.

    Args:
        arms: maps, comma-separated: own, and given maps: noise, exact; own:FAULT with a camera that fails after 8 s:
            frozen, dark (no depth), zero, gappy (every other column), turned (4 deg), long (15 % too far).
    """
    names = words_of(arms)
    jobs = [{"arm": arm, "seed": seed} for seed in seeds_of(seeds) for arm in names]
    lines = study(walked, jobs, results, processes=processes)
    by = {arm: [line for line in lines if line["arm"] == arm] for arm in names}
    slides = {arm: np.array([line["slide_mm"] for line in found]) for arm, found in by.items()}
    rows: list[tuple[object, ...]] = []
    for arm in names:
        fell, least = sum(line["fell"] for line in by[arm]), min(line["way_m"] for line in by[arm])
        over = (None, None, None) if "own" not in slides or arm == "own" else ratio(slides["own"], slides[arm])
        refused: Counter[str] = sum((Counter(line["refused"]) for line in by[arm]), Counter())
        why = ", ".join(f"{count} {reason}" for reason, count in refused.items())
        rows.append((arm, float(slides[arm].mean()), fell, least, *over, why))
    header = ("map", "sliding mm", "fell", "least way m", "own / it", "from", "to", "images refused")
    table(f"contact sliding per stance, {len(seeds_of(seeds))} seeds; goal of own / given: {MOST:g}", header, rows)
    own = [line for line in by.get("own", ()) if "nees" in line]
    if len(own) > 1:
        cells = [(name, *resampled_mean([line[name] for line in own])) for name in CellErrors._fields]
        table(f"cells within {NEAR:g} m of the robot", ("what", "mean", "from", "to"), cells)
