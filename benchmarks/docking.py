"""Docking of the simulated Nao on a marker: where the marker lies in the end, by the truth of the simulator.

The request states the marker 0.11 m beside its place, so that only the sight of it leads there.
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.bench import Bench, table, words_of
from benchmarks.studies import named
from surefoot.arrays import Array
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.lab.runs.local import run_local
from surefoot.lab.studies import Line, seeds_of, study
from surefoot.lockstep.local import LocalSystem
from surefoot.robot.reader import load_robot
from surefoot.schemas.navigation import DockRequest
from surefoot.schemas.sim import ResetRequest
from surefoot.services.simulator.building import build_world
from surefoot.services.supervisor.scenarios.scenario import Step

BENCH = Bench("docking")

Kind = Literal["goal", "landmark"]
MARKER, ASIDE, OFFSET = (1.0, 0.15), (0.1, -0.05), (0.5, 0.0)
"""`MARKER`: place of the marker of the goal, and about that of the landmark, m, frame map; `ASIDE`: error of the place
that the request states, m; `OFFSET`: wanted place of the marker in base_link, m."""


def docked(kind: Kind, yaw: float | None, seed: int) -> Line:
    """Dock the Nao on a marker; return the true errors of the marker's place, of its bearing and of the heading.

    Args:
        kind: goal: the marker of the goal; landmark: the landmark of the map nearest to the same place.
        yaw: wanted heading, rad, frame map; None = any.
        seed: seed of all random numbers.
    """
    scenario = named("nao-corner")
    world = scenario.world.model_copy(update={"terrain": "corridor", "goal": MARKER})
    place, row = np.array(MARKER), None
    if kind == "landmark":
        found = build_world(load_robot("nao"), ResetRequest(seed=seed, world=world)).world.sight
        assert found is not None
        assert found.landmarks is not None
        row = int(np.argmin(np.hypot(*(found.landmarks.position - place).T)))
        place = found.landmarks.position[row]
    request = DockRequest(
        landmark=row, position=(float(place[0]) + ASIDE[0], float(place[1]) + ASIDE[1]), offset=OFFSET, yaw=yaw
    )
    scenario = replace(
        scenario, world=world, limits={}, max_duration_s=240.0, steps=(Step(do="dock", when="ready", request=request),)
    )
    services = {}

    def meddle(system: LocalSystem) -> None:
        services.update({node.service.name: node.service for node in system.nodes})

    run = run_local(scenario, seed, without=("recorder", "stability"), meddle=meddle)
    truth, (result,) = services["simulator"].world.truth(), services["navigator"].results.last
    return {
        "state": result.state, "error": result.error_code, "reason": result.reason, "time": result.navigation_time,
        "approaches": result.progress.approaches, "problems": list(run.verdict.problems), "wall_s": run.wall_s,
        **errors(truth.position, truth.quat_wxyz, place, yaw),
    }  # fmt: skip


def errors(position: Array, quat_wxyz: Array, place: Array, yaw: float | None) -> dict[str, float | None]:
    """Return the distance of a marker from its wanted place, m, the error of its bearing and of the heading, deg.

    Args:
        position: place of base_link, (3,) m, map.
        quat_wxyz: rotation from base_link to map, (4,).
        place: place of the marker, (2,) m, map.
        yaw: wanted heading, rad; None = any: its error is None.
    """
    rot = matrix_from_quat(np.asarray(quat_wxyz))
    heading = math.atan2(rot[1, 0], rot[0, 0])
    dx, dy = place - np.asarray(position)[:2]
    c, s = math.cos(heading), math.sin(heading)
    ahead, left = c * dx + s * dy, c * dy - s * dx
    off = None if yaw is None else math.degrees(math.remainder(heading - yaw, math.tau))
    bearing = math.degrees(math.atan2(left, ahead) - math.atan2(OFFSET[1], OFFSET[0]))
    return {"beside": math.hypot(ahead - OFFSET[0], left - OFFSET[1]), "bearing": bearing, "heading": off}


def shown(line: Line) -> None:
    """Print the end of a run and its true errors."""
    print(f"  {line['kind']} {line['yaw']} seed {line['seed']}: {line['state']} {100.0 * line['beside']:.1f} cm "
          f"{line['bearing']:.1f} deg {line['heading']}: {line['reason']} {line['problems']}", flush=True)  # fmt: skip


@BENCH.part()
def live(
    *, seeds: str = "0:10", kinds: str = "goal,landmark", headings: str = "any,0,20", results: Path | None = None,
    processes: int | None = None,
) -> None:  # fmt: skip
    """Nao docks on a marker 1 m ahead; goal: 3 cm and 3 deg at each success, by the truth.

    Args:
        kinds: goal: the marker of the goal; landmark: a landmark of the map.
        headings: wanted headings, deg, or any.
    """
    yaws = [None if word == "any" else math.radians(float(word)) for word in words_of(headings)]
    jobs = [{"kind": k, "yaw": yaw, "seed": seed} for seed in seeds_of(seeds) for k in words_of(kinds) for yaw in yaws]
    lines = study(docked, jobs, results, processes=processes, show=shown)
    rows: list[tuple[object, ...]] = []
    for kind in words_of(kinds):
        for yaw in yaws:
            own = [line for line in lines if (line["kind"], line["yaw"]) == (kind, yaw)]
            good = [line for line in own if line["state"] == "succeeded"]
            far = sorted(100.0 * line["beside"] for line in good)
            turned = [max(abs(line["bearing"]), abs(line["heading"] or 0.0)) for line in good]
            rows.append((
                kind, "any" if yaw is None else round(math.degrees(yaw)), len(own), len(good),
                float(np.median(far)) if far else np.nan, max(far, default=np.nan), max(turned, default=np.nan),
                float(np.median([line["time"] for line in own])), max(line["approaches"] for line in own),
                ", ".join(sorted({line["error"] for line in own} - {""})) or "-",
            ))  # fmt: skip
    header = ("marker", "heading deg", "runs", "docked", "median cm", "largest cm", "largest deg", "median s",
              "most approaches", "other ends")  # fmt: skip
    table(f"seeds {seeds}, true errors of the docked", header, rows)
