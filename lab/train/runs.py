"""Parallel Sarsa(lambda) trainings of a navigation policy, and selection of the best."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from surefoot.errors import SurefootError
from surefoot.services.navigator.environment.episodes import run_episodes
from surefoot.services.navigator.policy.arrays import REACHED, arrays
from surefoot.services.navigator.policy.decider import Policy
from surefoot.services.navigator.policy.library import provenance_of
from surefoot.services.navigator.policy.params import NavigationModel
from surefoot.services.navigator.policy.planner import planner

from ..pools import worker_threads
from .sarsa import Schedule, Training, train

SELECTION = 2**40
"""Index of the random stream of the episodes by which the best of several trainings is selected; no training or
evaluation uses this stream."""
SELECTED_ON = 500  # episodes


@dataclass
class Trained:
    """Result of one training: seed, mean time (s) and share of success on the selection episodes, True if selected."""

    seed: int
    mean_s: float
    success: float
    kept: bool = False


def make_planner(model: NavigationModel) -> Policy:
    """Return the planner of a model: a policy whose table of action values is computed, not learned."""
    return planner(arrays(model), provenance_of(model, "planner"))


def make_sarsa(
    model: NavigationModel,
    schedule: Schedule,
    seed: int,
    runs: int,
    out: Path,
    *,
    resume: bool = False,
    progress: Callable[[float, str], None] = lambda share, step: None,
) -> tuple[Policy, list[Trained]]:
    """Train a policy by Sarsa with seeds seed .. seed + runs - 1 on all cores; return the best one and all trainings.

    Args:
        model: navigation model of the robot.
        schedule: settings of the training.
        seed: seed of the first training.
        runs: number of trainings.
        out: policy file; checkpoints are kept beside it and removed at the end.
        resume: True: continue from existing checkpoints; False: begin anew.
        progress: called with the share that is done, 0 to 1, and the state of a training in words.
    """
    lock, over, world, done = threading.Lock(), threading.Event(), arrays(model), dict[int, int]()

    def note(training: Training) -> None:
        if over.is_set():
            raise SurefootError("cancelled", "the trainings were interrupted")
        recent = training.seconds[max(0, training.done - 100) : training.done].mean()
        with lock:
            done[training.seed] = training.done
            share = sum(done.values()) / (runs * schedule.episodes)
            progress(share, f"seed {training.seed}: {training.done} episodes, now {recent:.1f} s each")

    def one(number: int) -> tuple[Policy, Trained]:
        training, path = Training(model, number, schedule), checkpoint(out, number)
        if resume and path.exists():
            training.take_up(path)
        policy = train(training, path, note)
        results = run_episodes(world, policy, SELECTION, 0, SELECTED_ON)
        reached = float((results["ended"] == REACHED).mean())
        return policy, Trained(number, float(results["seconds"].mean()), reached)

    with worker_threads() as pool:
        try:
            made = list(pool.map(one, range(seed, seed + runs)))
        finally:
            over.set()  # on Ctrl-C: the pool waits for each training to come to its next checkpoint
    policy, best = min(made, key=lambda each: (-each[1].success, each[1].mean_s))
    best.kept = True
    for number in range(seed, seed + runs):
        checkpoint(out, number).unlink(missing_ok=True)
    return replace(policy, provenance={**policy.provenance, "chosen_of": str(runs)}), [each[1] for each in made]


def checkpoint(out: Path, seed: int) -> Path:
    """Return the path of the checkpoint of a training with this seed, beside the policy file `out`."""
    return out.with_name(f"{out.stem}.seed{seed}.checkpoint.npz")
