"""Goals of simulated robots: the real services of a run in one process, no truth in the loop, and what a fit predicts.

Runs of a seed are pairs: same floor, same robot. With ``--results FILE`` each finished run is a line of that file, and
runs that it holds are not repeated; begin a new file after a change of the code.
"""

import itertools
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchmarks.bench import Bench, table, words_of
from benchmarks.studies import failures, named
from surefoot.lab.fit.estimate import fit
from surefoot.lab.fit.events import read_run
from surefoot.lab.fit.output import write_model
from surefoot.lab.runs.local import run_local
from surefoot.lab.statistics import deviation, half_width, interval, p_of_mean
from surefoot.lab.studies import Line, finished, run_scenario, seeds_of, study, verdict_line
from surefoot.lab.train.evaluation import Seeds, episodes, summary
from surefoot.schemas.navigation import GotoRequest
from surefoot.schemas.sim import FaultRequest, PlaceRequest
from surefoot.services.navigator.policy.arrays import arrays
from surefoot.services.navigator.policy.library import find
from surefoot.services.navigator.policy.params import NavigationModel, load
from surefoot.services.supervisor.scenarios.scenario import Scenario, Step

BENCH = Bench("goals")

ARMS = {
    "hand": ("hand", "four"), "tuned": ("tuned", "four"), "planner": ("planner", "four"), "sarsa": ("sarsa", "four"),
    "steer arcs": ("steer", "arcs"), "planner arcs": ("planner", "arcs"),
}  # fmt: skip
"""Policy and action set of each arm by name; the first arm is the one that others are compared with."""
LONGEST_S = 600.0
"""Simulated time at which a run with a goal is ended, s: longer than any run that arrives."""
GOAL = (
    "goal_time_s", "goal_error_m", "pose_nees", "pose_inside", "pose_error_m", "max_tilt_deg", "recoveries", "fell",
    "goals_missed",
)  # fmt: skip
"""Names of the metrics of a run with a goal; None in a result where the run has no value."""
INSIDE = "in 95 % region"
"""Title of the column of `inside_of`."""
World = Literal["hard", "easy"]
WITHIN = 5.0
"""Largest difference of a predicted mean time from that of the live runs, %, at which the prediction meets the goal."""


def corridor(*steps: Step, easy: bool = False) -> Scenario:
    """Return the Nao's corridor of 5 m with time to end.

    Args:
        steps: in place of its own, none = its own.
        easy: with the robot's own camera and odometry, and without drift.
    """
    scenario = replace(named("nao-corridor"), max_duration_s=LONGEST_S)
    if easy:
        world = scenario.world.model_copy(update={"drift": 0.0, "camera": None, "landmarks": 60.0})
        scenario = replace(scenario, world=world, config={"navigator": {"params": "nao", "control": "odometry"}})
    return replace(scenario, steps=steps) if steps else scenario


def to_goal(arm: str, world: World, seed: int, record: Path | None = None) -> Line:
    """Walk to the goal with one policy; return its line.

    Args:
        arm: name in `ARMS`: policy and action set.
        world: hard = drift, the camera of Osswald et al., commands as control; easy = see `corridor`.
        seed: seed of all random numbers.
        record: folder for the recording, None = there is none.
    """
    policy, actions = ARMS[arm]
    scenario = corridor(easy=world == "easy")
    config = {"navigator": {**named("nao-corridor").config["navigator"], **scenario.config["navigator"]}}
    config["navigator"] |= {"policy": policy, "actions": actions}
    scenario = replace(scenario, config=config)
    if record is None:
        return run_scenario(scenario, seed, GOAL)
    record.mkdir(parents=True, exist_ok=True)
    path = record / f"{world}-{arm.replace(' ', '-')}-{seed}.mcap"
    return verdict_line(run_local(scenario, seed, recording=path).verdict, GOAL)


def to_goal_recorded(arm: str, world: World, seed: int, record: str) -> Line:
    """Walk to the goal with one policy and keep the recording in a folder."""
    return to_goal(arm, world, seed, Path(record))


@BENCH.part()
def policies(
    *, seeds: str = "100:102", world: World = "hard", arms: str = ",".join(ARMS), results: Path | None = None,
    record: Path | None = None, processes: int | None = None,
) -> None:  # fmt: skip
    """Nao walks 5 m to a goal with every policy, no truth in the loop; runs of a seed are pairs.

    Goals: with four actions the planner at least 9 % faster than the 35 deg controller, the learner faster by a paired
    t-test; arcs at least 15 %; every goal reached with a true error of at most 0.2 m, no wall touched, no fall.

    Args:
        world: hard: drift of 2 deg per 10 cm, camera as of Osswald et al., commands as control; easy: own camera and
            odometry.
        arms: policies, comma-separated; the first is what the others are compared with.
        record: folder for the recordings, for `surefoot fit` and `goals transfer`; default: none are kept.
    """
    names, more = words_of(arms), {} if record is None else {"record": str(record)}
    jobs = [{"arm": arm, "world": world, "seed": seed, **more} for seed in seeds_of(seeds) for arm in names]
    lines = study(to_goal_recorded if more else to_goal, jobs, results, processes=processes, show=failures)
    by = {(line["arm"], line["seed"]): line for line in lines}
    rows: list[tuple[object, ...]] = []
    for arm in names:
        own = [line for line in lines if line["arm"] == arm]
        good = [line for line in own if line["values"]["goal_time_s"] is not None and not line["problems"]]
        times = np.array([line["values"]["goal_time_s"] for line in good])
        nees = [line["values"]["pose_nees"] for line in own]
        rows.append(
            (
                arm, len(own), len(good), float(times.mean()) if good else np.nan, deviation(times),
                max((line["values"]["goal_error_m"] for line in good), default=np.nan), float(np.mean(nees)), max(nees),
                inside_of(own),
                float(np.mean([line["values"]["recoveries"] or 0.0 for line in own])), saved(by, arm, names[0]),
            )
        )  # fmt: skip
    header = ("policy", "runs", "reached", "time s", "sd", "largest error m", "NEES", "largest", INSIDE, "recoveries",
              f"faster than {names[0]}")  # fmt: skip
    table(f"{world} world, seeds {seeds}", header, rows)


def inside_of(lines: list[Line]) -> str:
    """Return how many of the poses of runs are in their 95 % region: in the mean, and in the worst run, as text."""
    found = [line["values"]["pose_inside"] for line in lines if line["values"].get("pose_inside") is not None]
    return f"{np.mean(found):.1f} % ({min(found):.0f})" if found else "-"


def saved(by: dict[tuple[str, int], Line], arm: str, base: str) -> str:
    """Return the paired saving of time in per cent with its 95 % interval, and the p-value of the t-test, as text.

    Args:
        by: results of runs by name of the policy and seed; runs of both policies with one seed are a pair.
        arm: policy that saves time.
        base: policy that it is compared with.

    Returns:
        "" if both are the same or fewer than two pairs arrived.
    """
    pairs = [
        (line["values"]["goal_time_s"], by[base, seed]["values"]["goal_time_s"])
        for (name, seed), line in by.items() if name == arm and (base, seed) in by
    ]  # fmt: skip
    share = [100.0 * (b - a) / b for a, b in pairs if a is not None and b is not None]
    if arm == base or len(share) < 2:
        return ""
    low, high = interval(share)
    return f"{np.mean(share):+.1f} % ({low:.1f} to {high:.1f}), p {p_of_mean(share):.1e}"


def to(x: float, y: float) -> Step:
    """Return a scenario step that sends the robot to x, y m, map, at the beginning."""
    return Step("goto", when="ready", request=GotoRequest(position=(x, y)))


def dark(easy: bool) -> Scenario:
    """Return the scenario of the corridor, about 90 s long, with a camera that sees nothing from 40 s on.

    Args:
        easy: True: the robot's own camera and odometry; False: the paper's coarse camera and odometry that drifts.
    """
    fault = FaultRequest(kind="camera_dark", duration=LONGEST_S)
    return corridor(to(5.0, 0.0), Step("fault", when="ready", after_s=40.0, request=fault), easy=easy)


def moved_right() -> Scenario:
    """Return the scenario `nao-lost` with the robot put down 0.7 m away to its right, turned by 90 deg to the right."""
    scenario, place = named("nao-lost"), PlaceRequest(forward=0.3, left=-0.63, turn=-1.5708)
    steps = tuple(replace(step, request=place) if step.do == "place" else step for step in scenario.steps)
    return replace(scenario, steps=steps)


JOURNEYS: dict[str, Callable[[], Scenario]] = {
    "corner": lambda: named("nao-corner"), "lost": lambda: named("nao-lost"), "lost-right": moved_right,
    "behind": lambda: corridor(to(-0.6, 0.3), easy=True), "behind-hard": lambda: corridor(to(-0.6, 0.3)),
    "dark": lambda: dark(easy=True), "dark-hard": lambda: dark(easy=False), "hexapod": lambda: named("ragno-goal"),
}  # fmt: skip
"""Functions that return each scenario with a goal besides the straight corridor (which begins at x = -1 m), by name."""


def travelled(journey: str, seed: int) -> Line:
    """Run one of the journeys on one seed; return its line of results."""
    return run_scenario(replace(JOURNEYS[journey](), max_duration_s=LONGEST_S), seed, GOAL)


@BENCH.part()
def journeys(
    *, seeds: str = "0:1", journeys: str = ",".join(JOURNEYS), results: Path | None = None, processes: int | None = None
) -> None:
    """Journeys besides the straight corridor, with the shipped models and no truth in the loop.

    `behind` has its goal behind the robot, `dark` loses the camera half way, so that odometry alone is left. The hard
    world has no odometry: there reaching the goal does not count, but the covariance of the belief must grow with the
    error. Goals: within 0.2 m of the goal (0.25 m by odometry alone), NEES of the pose at most 2 per degree of freedom
    (4 for the mean of one run), no fall.

    Args:
        journeys: names of journeys, comma-separated.
    """
    names = words_of(journeys)
    jobs = [{"journey": name, "seed": seed} for seed in seeds_of(seeds) for name in names]
    lines = study(travelled, jobs, results, processes=processes)
    rows: list[tuple[object, ...]] = []
    for name in names:
        own = [line for line in lines if line["journey"] == name]
        found = {key: np.array([line["values"][key] for line in own], dtype=np.float64) for key in GOAL}
        reached = sum(line["values"]["goals_missed"] == 0.0 and not line["problems"] for line in own)
        rows.append(
            (
                name, len(own), reached, float(found["goal_time_s"].mean()), float(found["goal_error_m"].max()),
                float(found["pose_error_m"].max()), float(found["pose_nees"].mean()), float(found["pose_nees"].max()),
                inside_of(own),
                float(found["recoveries"].mean()), float(np.nansum(found["fell"])),
                ", ".join(sorted({failed for line in own for failed in line["failed"]})) or "none",
            )
        )  # fmt: skip
    header = ("journey", "runs", "reached", "time s", "largest error m", "pose rms m", "NEES", "largest", INSIDE,
              "recoveries", "fell", "not met")  # fmt: skip
    table(f"seeds {seeds}", header, rows)


@dataclass(frozen=True)
class Compared:
    """Time to the goal of one policy in live runs and in the fitted environment."""

    arm: str
    times: dict[int, float]
    """Time to the goal of each live run, s, by seed."""
    failed: int
    """Number of live runs that are left out because the goal was missed or the robot fell."""
    predicted: float
    """Mean time to the goal over the episodes in the fitted environment, s."""
    success: float
    """Share of the episodes in the fitted environment that reach the goal, 0 to 1."""

    @property
    def live(self) -> float:
        """Mean time to the goal of the live runs, s."""
        return float(np.mean(list(self.times.values())))

    @property
    def error(self) -> float:
        """Excess of the predicted mean time to the goal over that of the live runs, %."""
        return 100.0 * (self.predicted / self.live - 1.0)


def fitted(recordings: tuple[str, ...], params: str) -> NavigationModel:
    """Return the model fitted to recordings, and print its numbers."""
    base, paths = load(params), [Path(name) for name in recordings]
    found = fit([read_run(path, base) for path in paths], base, print)
    rows = [(key, each.value, each.low, each.high) for key, each in sorted(found.values.items())]
    table(f"{found.improvement:.1f} nats likelier than {params}", ("parameter", "value", "from", "to"), rows)
    print(f"  not decided: {', '.join(found.undecided) or 'none'}")
    with tempfile.TemporaryDirectory() as folder:
        return write_model(found, params, [path.name for path in paths], Path(folder) / "fitted.toml")


def predicted(model: NavigationModel, base: NavigationModel, arm: str, count: int) -> dict[str, Any]:
    """Return the summary of an arm's episodes; the policy is the one made for the base model, as it ran live."""
    policy, actions = ARMS[arm]
    chosen, home = (each.model_copy(update={"use": actions}) for each in (model, base))
    return summary(episodes(arrays(chosen), find(policy, home), Seeds(0, count)))


def compare(lines: list[Line], model: NavigationModel, base: NavigationModel, count: int) -> list[Compared]:
    """Return the comparison of live and predicted times of each arm that reached the goal in two live runs or more.

    Live times end when the robot stands, so the closing step is added to those of the environment.
    """
    closing = model.switching.get("walk", {}).get("stand", 0.0)
    rows: list[Compared] = []
    for arm in ARMS:
        own = {line["seed"]: line for line in lines if line["arm"] == arm}
        times = {
            seed: float(line["values"]["goal_time_s"]) for seed, line in own.items()
            if line["values"]["goal_time_s"] is not None and not line["problems"]
        }  # fmt: skip
        if len(times) >= 2:
            found = predicted(model, base, arm, count)
            rows.append(Compared(arm, times, len(own) - len(times), found["mean_s"] + closing, found["success"]))
    return rows


def wrong_pairs(rows: list[Compared]) -> tuple[list[tuple[str, str]], int]:
    """Return the pairs of arms that are predicted in the opposite order to live, and how many pairs differ live.

    Two arms differ live if the 95 % interval of their difference over the same seeds excludes zero.
    """
    wrong: list[tuple[str, str]] = []
    apart = 0
    for a, b in itertools.combinations(rows, 2):
        seeds = sorted(a.times.keys() & b.times.keys())
        if len(seeds) < 2:
            continue
        differences = [a.times[seed] - b.times[seed] for seed in seeds]
        mean = float(np.mean(differences))
        if abs(mean) <= half_width(differences):
            continue
        apart += 1
        if mean * (a.predicted - b.predicted) <= 0.0:
            wrong.append((a.arm, b.arm))
    return wrong, apart


@BENCH.part()
def transfer(
    *recordings: str, live: Path | None = None, world: World = "hard", params: str = "", model: str = "",
    episodes: int = 2000,
) -> None:  # fmt: skip
    """Mean time to the goal and ranking of the policies as a fit of recordings predicts them, beside live runs.

    The recordings are runs of other seeds than the live ones (`surefoot run nao-corridor --seed N`). Their fit makes an
    environment in which each policy walks many episodes. Goals: each mean within 5 % of the live one, and all policies
    that differ significantly in the live runs ranked as live.

    Args:
        recordings: MCAP files of other seeds than the live runs.
        live: results file of `python -m benchmarks goals`.
        world: world of the live runs.
        params: model that the fit begins with; default: that of the world.
        model: a fitted model (.toml) in place of recordings, or any other.
        episodes: per policy.
    """
    if live is None or not (recordings or model):
        print("needs --live, and recordings or --model: nothing to compare")
        return
    home = {"hard": "nao-paper", "easy": "nao"}[world]  # the model that the live policies are made for
    chosen = load(model) if model else fitted(recordings, params or home)
    rows = compare(finished(live, world=world), chosen, load(home), episodes)
    if not rows:
        print(f"{live} has no policy with two runs of the {world} world that reached the goal")
        return
    by_live, by_model = (sorted(rows, key=lambda row, k=k: getattr(row, k)) for k in ("live", "predicted"))
    table(
        f"{world} world", ("policy", "runs", "failed", "live s", "+-", "predicted s", "error %", "rank", "predicted"),
        [
            (row.arm, len(row.times), row.failed, row.live, half_width(list(row.times.values())), row.predicted,
             row.error, by_live.index(row) + 1, by_model.index(row) + 1) for row in rows
        ],
    )  # fmt: skip
    wrong, apart = wrong_pairs(rows)
    print(f"within {WITHIN:g} %: {sum(abs(row.error) <= WITHIN for row in rows)} of {len(rows)} policies;", end=" ")
    print(f"least success of a policy: {min(row.success for row in rows):.4f}")
    print(f"pairs that differ in the live runs: {apart}, of these ranked otherwise: {wrong or 'none'}")
