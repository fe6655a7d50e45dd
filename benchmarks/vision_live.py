"""Vision, live: goals on images of the floor alone, the map of a corridor, and what a fit to images predicts."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.bench import Bench, table, words_of
from benchmarks.goals import ARMS, GOAL, predicted, saved
from benchmarks.studies import failures, named
from surefoot.lab.runs.local import run_local
from surefoot.lab.statistics import deviation
from surefoot.lab.studies import Line, finished, seeds_of, study, verdict_line
from surefoot.lab.vision.blur import map_by_grid, still_camera
from surefoot.lab.vision.replay import floor
from surefoot.services.navigator.policy.params import load as load_params
from surefoot.services.supervisor.scenarios.scenario import Scenario
from surefoot.services.vision.feature_map import save
from surefoot.services.vision.features import Kind

BENCH = Bench("vision_live")

ARRIVED = 0.2
"""Largest true distance from the goal, m, at which a run counts as arrived."""


@BENCH.part()
def grid(out: str = "grid.npz", /, *, texture: str = "parquet", seed: int = 1, features: Kind = "orb") -> None:
    """Write the map of the corridor from still images of known poses.

    Args:
        out: file.
        texture: name of the floor's texture.
        seed: seed of the texture.
        features: kind of image features, orb or sift.
    """
    camera = still_camera(floor(texture, seed), 0.01)
    world = map_by_grid(camera, features, np.arange(-0.6, 5.6, 0.1).tolist(), (-0.5, -0.25, 0.0, 0.25, 0.5))
    print(f"{save(world, out)}: {len(world)} features")


STARTS = (0.3, 0.25, 0.3)
"""Largest magnitude of the random offset of start poses of live runs in x, y (m) and heading (rad)."""


def from_elsewhere(world: Path, arm: str, texture: str, seed: int) -> Scenario:
    """Return the Nao's corridor with images, from a start pose of the seed that the belief states with an error.

    Args:
        world: map of the floor's features.
        arm: policy and actions, of `goals.ARMS`.
        texture: name of the floor's texture.
        seed: seed of start and error, which has the deviations of the model.
    """
    rng = np.random.default_rng([seed, 28])
    start = rng.uniform(-1.0, 1.0, 3) * STARTS
    scenario = named("examples/vision/nao-eyes.toml")
    model = load_params(str(scenario.config["navigator"]["params"])).filter
    sds = (model.position_sd, model.position_sd, math.radians(model.heading_sd_deg))
    x, y, yaw = (start + rng.standard_normal(3) * sds).tolist()
    policy, actions = ARMS[arm]
    navigator = scenario.config["navigator"] | {
        "landmarks": str(world), "policy": policy, "actions": actions, "start_x": x, "start_y": y, "start_yaw": yaw,
    }  # fmt: skip
    floor_seen = scenario.world.model_copy(update={"start": tuple(start.tolist()), "texture": texture})
    return replace(scenario, world=floor_seen, config={"navigator": navigator, "vision": {"map": str(world)}})


def on_images(world: str, arm: str, texture: str, seed: int, record: str = "") -> Line:
    """Walk to the goal on images alone; return its line.

    Args:
        world: map of the floor's features, a file.
        arm: policy and actions, of `goals.ARMS`.
        texture: name of the floor's texture.
        seed: seed of all random numbers but those of the floor.
        record: folder for the recording; empty = there is none.
    """
    scenario = from_elsewhere(Path(world), arm, texture, seed)
    if not record:
        return verdict_line(run_local(scenario, seed, without=("recorder",)).verdict, GOAL)
    Path(record).mkdir(parents=True, exist_ok=True)
    path = Path(record) / f"eyes-{texture}-{arm.replace(' ', '-')}-{seed}.mcap"
    return verdict_line(run_local(scenario, seed, recording=path).verdict, GOAL)


@BENCH.part()
def live(
    world: str = "",
    /,
    *,
    seeds: str = "100:102",
    arms: str = "hand,planner arcs",
    texture: str = "parquet",
    results: Path | None = None,
    record: str = "",
    processes: int | None = None,
) -> None:
    """Nao walks 5 m to a goal on images of the floor alone, no truth in the loop; runs of a seed are pairs.

    Goals: all runs arrive within 0.2 m, the planner at least 7 % faster than the hand-made controller (7.1 % on the
    robot of Osswald et al.).

    Args:
        world: map of the floor, of `surefoot map build` (texture_seed 1).
        arms: policies of `goals`, comma-separated; the first is what the others are compared with.
        texture: name of the floor's texture.
        record: folder for the recordings; empty = none are kept.
    """
    names = words_of(arms)
    more = {"record": record} if record else {}
    jobs = [
        {"world": world, "arm": arm, "texture": texture, "seed": seed, **more}
        for seed in seeds_of(seeds) for arm in names
    ]  # fmt: skip
    lines = study(on_images, jobs, results, processes=processes, show=failures)
    by = {(line["arm"], line["seed"]): line for line in lines}
    rows: list[tuple[object, ...]] = []
    for arm in names:
        own = [line["values"] for line in lines if line["arm"] == arm]
        there = [each for each in own if each["goals_missed"] == 0.0]
        times = np.array([each["goal_time_s"] for each in there])
        errors = [each["goal_error_m"] for each in there]
        pose = float(np.mean([each["pose_error_m"] for each in own]))
        consistency = float(np.mean([each["pose_nees"] for each in own]))
        rows.append(
            (
                arm, len(own), len(there), sum(error <= ARRIVED for error in errors), max(errors, default=math.nan),
                float(times.mean()) if there else math.nan, deviation(times), 100.0 * pose, consistency,
                saved(by, arm, names[0]),
            )
        )  # fmt: skip
    header = ("policy", "runs", "arrived", "within 0.2 m", "largest error m", "time s", "sd", "pose rms cm", "NEES",
              f"faster than {names[0]}")  # fmt: skip
    table(f"{texture}, images alone, seeds {seeds}", header, rows)


@BENCH.part()
def transfer(
    fitted: str = "", /, *, others: str = "nao", live: Path | None = None, arms: str = "hand,planner arcs",
    episodes: int = 1000,
) -> None:  # fmt: skip
    """Time to the goal that a fit of images predicts, for policies made for the fit and for other models, beside live.

    Goals: within 5 % of the live runs; the policy of the fit at most 1 % slower than that of another model.

    Args:
        fitted: model of `surefoot fit navigator --landmarks`, the environment of all episodes.
        others: models that policies are made for, besides that, comma-separated.
        live: results file of `vision live`, of other seeds than the recordings.
        arms: policies of `goals`, comma-separated.
        episodes: of each.
    """
    environment = load_params(fitted)
    closing = environment.switching.get("walk", {}).get("stand", 0.0)
    rows: list[tuple[object, ...]] = []
    for arm in words_of(arms):
        ended = [line["values"] for line in finished(live, arm=arm)]
        times = [values["goal_time_s"] for values in ended if values["goals_missed"] == 0.0]
        walked = float(np.mean(times)) if times else math.nan
        for name in (fitted, *words_of(others)):
            found = predicted(environment, load_params(name), arm, episodes)
            time_s = found["mean_s"] + closing
            rows.append((arm, name, time_s, found["success"], len(times), walked, 100.0 * (time_s / walked - 1.0)))
    table(f"{episodes} episodes", ("policy", "made for", "s", "success", "live runs", "live s", "error %"), rows)
