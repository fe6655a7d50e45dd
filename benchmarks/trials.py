"""Trials of footholds: simulators over the network, and the same step from one state with several footholds."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.bench import Bench, table, words_of
from benchmarks.branches import PairedState, gap_share, paired_steps, trimmed
from benchmarks.foothold_walks import GROUNDS, rule_of
from benchmarks.rivals import nominal_rule
from surefoot.arrays import Array
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.lab.footholds.campaign import append, read, sample_of
from surefoot.lab.footholds.primitives import paper_trials, run_trials
from surefoot.lab.footholds.rules import random_rule
from surefoot.lab.footholds.walks import Rule
from surefoot.lab.footholds.workers import remote_workers
from surefoot.lab.statistics import RESAMPLINGS
from surefoot.lab.studies import Line, finished, seeds_of, study
from surefoot.robot.reader import load_robot
from surefoot.schemas.sim import PrimitiveTrial
from surefoot.services.footholds.learning.samples import StanceSample, gather
from surefoot.services.footholds.models.lattice import Bins, Lattice, filled
from tests.ports import free_address

BENCH = Bench("trials")

START_S = 300.0
"""Longest wait for a simulator to answer its first trial, s."""


def simulator(folder: Path, endpoint: str, namespace: str) -> subprocess.Popen[bytes]:
    """Start a simulator that waits for trials."""
    words = ["-m", "surefoot.lockstep.discover", "simulator", "--connect", endpoint, "--namespace", namespace]
    kept = {key: value for key, value in os.environ.items() if not key.startswith("SUREFOOT_")}
    with (folder / f"{namespace.replace('/', '-')}.log").open("ab") as log:
        return subprocess.Popen(
            [sys.executable, *words], stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, cwd=folder,
            env={**kept, "SUREFOOT_SIMULATOR_AUTOSTART": "false", "XDG_STATE_HOME": str(folder / "state")},
            start_new_session=True,
        )  # fmt: skip


def wait_for(place: str, folder: Path) -> None:
    """Wait until the simulator at endpoint `place` answers a first trial, at most `START_S` s."""
    until = time.monotonic() + START_S
    while True:
        try:
            campaign([PrimitiveTrial(primitive="flat")], folder / f"first-{time.monotonic_ns()}", [place])
            return
        except Exception as error:
            if time.monotonic() > until:
                raise SystemExit(f"{place} does not answer: {error}") from None
            time.sleep(0.5)


def campaign(
    trials: list[PrimitiveTrial], out: Path, places: list[str], show: Callable[[str, int], None] = lambda n, c: None
) -> float:
    """Run a campaign of trials on simulators; return the number of trials per second."""
    began = time.perf_counter()
    with remote_workers(places, 20.0) as workers:
        run_trials(load_robot("ragno"), trials, out, workers, show)
    return len(trials) / (time.perf_counter() - began)


def bins(path: Path) -> Bins:
    """Return the outcomes in a file of samples, counted by bins of the lattice."""
    found = gather(read(path)[0])
    return filled(Lattice(), found.x, found.r)


@BENCH.part()
def primitives(*, trials: int = 60) -> None:
    """Trials with ground primitives by simulators over the network: two beside one, and one of two killed.

    A router on the loopback interface, simulators in processes of their own. The campaign runs with one worker, with
    two, and with two of which one is killed after a quarter of the trials; the bins of all three must be equal. The
    ratio of trials per second needs two idle cores: the load of the machine is printed with it.

    Args:
        trials: number of trials of the campaign.
    """
    chosen, endpoint = (paper_trials() + paper_trials(noise=0.003, seeds=(1, 2, 3)))[:trials], free_address()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        router = ZenohBus(ZenohOptions("router", (), (endpoint,), "trials/router"))
        stack.callback(router.close)
        spaces = ["trials/one", "trials/two"]
        processes = [simulator(folder, endpoint, space) for space in spaces]
        for process in processes:
            stack.callback(process.wait)
            stack.callback(process.kill)
        places = [f"{space}@{endpoint}" for space in spaces]
        for place in places:
            wait_for(place, folder)
        one = campaign(chosen, folder / "one.jsonl", places[:1])
        two = campaign(chosen, folder / "two.jsonl", places)
        done: list[str] = []

        def show(name: str, samples: int) -> None:
            done.append(name)
            if len(done) == max(1, trials // 4):
                processes[1].send_signal(signal.SIGKILL)

        campaign(chosen, folder / "killed.jsonl", places, show)
        same = bins(folder / "one.jsonl") == bins(folder / "two.jsonl") == bins(folder / "killed.jsonl")
    load = os.getloadavg()[0]
    print(f"{trials} trials: one worker {one:.2f} a second, two {two:.2f} = {two / one:.2f}x (load {load:.1f})")
    print(f"one of two killed after {max(1, trials // 4)} trials: bins {'the same' if same else 'DIFFERENT'}")
    if not same:
        raise SystemExit(1)


RANDOM = "random-"
BRANCHES = 1000
"""Factor that makes step numbers of samples unique: the request's number times this factor plus the arm's index."""


@dataclass(frozen=True)
class Branching:
    """Conditions of steps from one state.

    Attributes:
        rules: selectors, comma-separated; see `foothold_walks.rule_of`.
        draws: random footholds from each state.
        every: a state at every n-th step; odd: both tripods.
        legs: one or all that land together.
        model: a model file, or shipped.
        robot: name of the robot.
    """

    rules: str = "nominal,hand,learned"
    draws: int = 5
    every: int = 3
    legs: str = "one"
    model: str = "shipped"
    robot: str = "ragno"


def pairs_of(ground: str, seed: int, how: Branching) -> tuple[list[Line], list[StanceSample]]:
    """Return the states of one walk, a line each, and the samples of their stances."""
    setting = replace(GROUNDS[ground], robot=how.robot)
    rules: dict[str, Rule] = {
        name: rule_of(name, seed, how.model, how.robot) or nominal_rule() for name in words_of(how.rules)
    }
    rules |= {f"{RANDOM}{k}": random_rule((seed + 1) * 1000 + k) for k in range(how.draws)}
    joined, states = paired_steps(seed, setting, nominal_rule(), rules, how.every, how.legs == "one")
    trial = f"pairs-{how.legs}-{how.robot}-{ground}-{seed}"
    samples = [
        replace(
            sample_of(stance, joined.selector.ground, trial), step=state.step * BRANCHES + number,
            friction=setting.friction, robot=how.robot, robot_hash=joined.robot.hash, source=f"pairs {ground}",
        )
        for state in states for number, arm in enumerate(state.arms) for stance in arm.stances
    ]  # fmt: skip
    return [_line(ground, seed, how.legs, state) for state in states], samples


def _line(ground: str, seed: int, legs: str, state: PairedState) -> Line:
    return {
        "ground": ground, "seed": seed, "legs": legs, "step": state.step, "in_question": state.legs,
        "arms": {arm.name: round(state.sliding(arm), 4) for arm in state.arms},
        "fallen": sum(arm.fallen for arm in state.arms),
    }  # fmt: skip


def complete(lines: list[Line], names: tuple[str, ...]) -> list[Line]:
    """Return the lines of states in which every selector and at least two random footholds have an outcome."""
    return [
        line for line in lines
        if "arms" in line and all(np.isfinite(line["arms"].get(name, np.nan)) for name in names)
        and len(_drawn(line)) >= 2
    ]  # fmt: skip


def _drawn(line: Line) -> Array:
    values = [value for name, value in line["arms"].items() if name.startswith(RANDOM)]
    found = np.array(values, dtype=np.float64)
    return found[np.isfinite(found)]


def shares(lines: list[Line], name: str) -> tuple[float, float]:
    """Return the share of the possible gain in sliding that a selector reaches, by mean and by trimmed mean."""
    drawn = [_drawn(line) for line in lines]
    best = np.array([np.nanmin(list(line["arms"].values())) for line in lines])
    chosen = np.array([line["arms"][name] for line in lines])
    return gap_share(drawn, chosen, best), gap_share(drawn, chosen, best, trimmed)


def share_interval(lines: list[Line], name: str) -> tuple[float, float]:
    """Return the 95 % interval of the share of the possible gain that a selector of footholds reaches, 0 to 1.

    The share is (random - selector) / (random - best) of the mean slidings; whole walks are resampled.

    Args:
        lines: states of walks, each with the sliding under every rule, mm.
        name: name of the selector.
    """
    rng, walks = np.random.default_rng(0), sorted({line["seed"] for line in lines})
    drawn = np.array([[_drawn(line).mean(), line["arms"][name], np.nanmin(list(line["arms"].values()))]
                      for line in lines])  # fmt: skip
    sums = np.array([drawn[[line["seed"] == walk for line in lines]].sum(axis=0) for walk in walks])
    total = sums[rng.integers(0, len(walks), (RESAMPLINGS, len(walks)))].sum(axis=1)
    low, high = np.percentile((total[:, 0] - total[:, 1]) / (total[:, 0] - total[:, 2]), [2.5, 97.5])
    return float(low), float(high)


def report(lines: list[Line], names: tuple[str, ...]) -> None:
    """Print the share of the possible gain of each selector for each ground and kind of state."""
    for ground, legs in sorted({(line["ground"], line["legs"]) for line in lines if "arms" in line}):
        found = complete([line for line in lines if (line["ground"], line["legs"]) == (ground, legs)], names)
        if len(found) < 2:
            continue
        drawn = np.mean([_drawn(line).mean() for line in found])
        best = np.mean([np.nanmin(list(line["arms"].values())) for line in found])
        rows: list[tuple[object, ...]] = []
        for name in names:
            slid, (mean, cut) = float(np.mean([line["arms"][name] for line in found])), shares(found, name)
            rows.append((name, slid, *(f"{100 * x:.0f} %" for x in (mean, *share_interval(found, name), cut))))
        what = f"{ground}, {legs} leg(s): {len(found)} states, random {drawn:.3f} mm, best {best:.3f} mm"
        table(what, ("selector", "sliding mm", "share of the gap", "from", "to", "trimmed"), rows)


@BENCH.part()
def pairs(
    *, grounds: str = "rough,mixed-0.4,elevation", seeds: str = "300:304", how: Branching, processes: int = 1,
    results: Path | None = None, samples: Path | None = None, show: bool = False,
) -> None:  # fmt: skip
    """Compare footholds from one state: print each selector's share of the largest possible reduction of sliding.

    From every third step of a walk with nominal footholds, each selector and some random footholds take the same step
    (`benchmarks.branches`). Printed is (random - chosen) / (random - best tried) of the sliding in the next
    stance, by the mean and by the mean without 5 % at each end, with 95 % intervals of 4000 resamplings of the walks.

    Args:
        grounds: names of grounds, comma-separated, see `foothold_walks.GROUNDS`.
        how: conditions.
        samples: file that the stances are appended to, to learn from.
        show: walk nothing, print what the results file holds.
    """
    jobs = [{"ground": ground, "seed": seed, "legs": how.legs}
            for seed in seeds_of(seeds) for ground in words_of(grounds)]  # fmt: skip
    function = partial(branched, how=how, samples=None if samples is None else str(samples))
    done = [] if show else study(function, jobs, results, processes=processes)
    lines = finished(results) if results is not None else done
    report([state for line in lines for state in line["states"]], words_of(how.rules))


def branched(ground: str, seed: int, legs: str, how: Branching, samples: str | None) -> Line:
    """Walk once with branches at its steps; return the compared states, and append the stances to a file of samples."""
    states, found = pairs_of(ground, seed, replace(how, legs=legs))
    if samples is not None and found:
        append(Path(samples), found[0].trial, found)
    return {"states": states}
