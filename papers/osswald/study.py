"""Experiments of Osswald et al., section VI, in simulation: tuning, trainings, 100 + 100 episodes, claims.

Nothing here is chosen by the episodes that are reported: the hand controller's entropy threshold, and which of ten
trainings stands for the one of Osswald et al., are chosen on random streams of their own.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array, Record
from surefoot.errors import ConfigError
from surefoot.lab.train.evaluation import EVALUATION, Seeds, episodes
from surefoot.lab.train.runs import SELECTED_ON, SELECTION
from surefoot.lab.train.sarsa import Schedule, Training
from surefoot.services.navigator.policy.arrays import REACHED, Arrays, arrays
from surefoot.services.navigator.policy.decider import PAPER_TURN_DEG, TUNED_TURN_DEG, Policy, hand
from surefoot.services.navigator.policy.params import NavigationModel, load

from .episode import Episode, drift_of, follow_all
from .learner import paths

THREE_STATES = "filter.states=3"
"""Setting of the filter of Osswald et al.: its state is the pose only, and drift is noise."""
AS_PRINTED = Schedule(alpha=(0.2, 0.2), eps=(0.1, 0.1), trace=0.85, episodes=1500, average_from=1.0)
"""Schedule of training of Osswald et al., section VI-A, with eps taken as the share of exploring actions."""
SETTLING = Schedule()
"""Schedule of training of this project: step size and exploration fall, tables are averaged at the end."""
PRINTED_GAMMA = 0.95
TRAININGS = range(5000, 5010)
HAND_EPISODES, LEARNED_EPISODES = Seeds(50_000, 50_100), Seeds(50_100, 50_200)
"""Seeds of 100 episodes each, drawn independently as by Osswald et al.; `HAND_EPISODES`: of the hand-made controller;
`LEARNED_EPISODES`: of the learned one."""
PAIRED_EPISODES = Seeds(51_000, 52_000)
TUNING_STREAM, TUNING_EPISODES = 1, Seeds(0, 1000)
THRESHOLDS = (-4.5, -4.0, -3.5, -3.0, -2.5, -2.0, -1.0)  # nats
TURN_THRESHOLDS = (12.0, TUNED_TURN_DEG, 25.0, PAPER_TURN_DEG, 45.0, 60.0)  # deg
EVERY = 10  # training episodes from one drawn path to the next, Fig. 3
TURNING_WALKS = 50  # of them are walked step by step
BRIEF = 500  # training episodes of the errata
TRAINED = 0.8
"""Share of the progress of `compare`, 0 to 1, that training takes."""


@dataclass(frozen=True)
class Vision:
    """Results in one of the two simulated worlds: moderate blur (section VI-B) or strong blur (VI-D).

    Results of episodes are records RESULT, as `run_episodes` returns them.

    Attributes:
        model: navigation model of the world.
        world: the model as arrays.
        thresholds: mean time (s) and success of the 35 deg controller by entropy threshold (nats), tuning episodes.
        threshold: entropy threshold of least time among those with full success, nats.
        trained: time of the episodes of each training, s, (trainings, 1500).
        chosen: index of the training that did best on the episodes of the selection.
        hand: results of the 35 deg controller, (100,).
        learned: results of the chosen training's policy, (100,).
        hand_walks: the episodes of `hand` step by step.
        walks: the episodes of `learned` step by step, with the policy of each training.
        drifts: drift of the episodes that follow, rad per m, (1000,).
        paired_hand: results of the 35 deg controller, (1000,).
        paired_learned: results of each training on the episodes of `drifts`, (trainings, 1000).
        paired_settling: results after trainings with this project's schedule on these episodes, (trainings, 1000).
        tuned: results of a hand controller with TUNED_TURN_DEG on these episodes, (1000,).
    """

    model: NavigationModel
    world: Arrays
    thresholds: dict[float, tuple[float, float]]
    threshold: float
    trained: Array
    chosen: int
    hand: Record
    learned: Record
    hand_walks: tuple[Episode, ...]
    walks: tuple[tuple[Episode, ...], ...]
    drifts: Array
    paired_hand: Record
    paired_learned: Record
    paired_settling: Record
    tuned: Record

    @property
    def learned_walks(self) -> tuple[Episode, ...]:
        """Course of the episodes with the policy of the chosen training."""
        return self.walks[self.chosen]


@dataclass(frozen=True)
class NavigationStudy:
    """Results of all experiments of Osswald et al., section VI.

    Attributes:
        normal: world with moderate blur, sections VI-A to C.
        blur: world with strong blur, section VI-D.
        paths: every 10th episode of the chosen training in normal vision: number and path.
        turning: 35 deg and other thresholds (deg) of the hand controller: results on 1000 episodes, and 50 walks.
        refusal: the error that refuses the printed gamma.
        printed_gamma: results of a policy trained with it, without our guard against standing.
        reversed_eps: s, time of training episodes if the greedy action is taken once in ten times.
    """

    normal: Vision
    blur: Vision
    paths: tuple[tuple[int, Episode], ...]
    turning: dict[float, tuple[Record, tuple[Episode, ...]]]
    refusal: str
    printed_gamma: Record
    reversed_eps: Array


def tune(world: Arrays, seeds: Seeds = TUNING_EPISODES) -> tuple[dict[float, tuple[float, float]], float]:
    """Return time, s, and success of the 35 deg controller by entropy threshold, nats, and the threshold to use (VI-B).

    The threshold to use is that with the most success, and of several the one with the least mean time.
    """
    found: dict[float, tuple[float, float]] = {}
    for h in THRESHOLDS:
        results = episodes(world, hand(world, stand_above=h), seeds, stream=TUNING_STREAM)
        found[h] = float(results["seconds"].mean()), float((results["ended"] == REACHED).mean())
    return found, min(found, key=lambda h: (-found[h][1], found[h][0]))


def choose_of(world: Arrays, policies: list[Policy]) -> int:
    """Return the index of the policy with most success, then least time, on episodes that serve only this choice."""
    results = [episodes(world, policy, Seeds(0, SELECTED_ON), stream=SELECTION) for policy in policies]
    return min(
        range(len(results)),
        key=lambda i: (-(results[i]["ended"] == REACHED).sum(), results[i]["seconds"].mean()),
    )


def compare(model: NavigationModel, progress: Callable[[float], None] = lambda share: None) -> Vision:
    """Train policies in one world, and return their results and those of the hand-made controller.

    `progress`: gets the share that is done.
    """
    world = arrays(model)
    thresholds, threshold = tune(world)
    own = hand(world, stand_above=threshold)
    trainings, settling = list[Training](), list[Policy]()
    for number, seed in enumerate(TRAININGS, 1):
        trainings.append(train(model, seed))
        settling.append(train(model, seed, SETTLING).policy())
        progress(TRAINED * number / len(TRAININGS))
    policies = [training.policy() for training in trainings]
    chosen = choose_of(world, policies)
    one_by_one = EVALUATION, LEARNED_EPISODES.first, LEARNED_EPISODES.count
    return Vision(
        model,
        world,
        thresholds,
        threshold,
        np.array([training.seconds for training in trainings]),
        chosen,
        episodes(world, own, HAND_EPISODES),
        episodes(world, policies[chosen], LEARNED_EPISODES),
        follow_all(world, own, EVALUATION, HAND_EPISODES.first, HAND_EPISODES.count),
        tuple(follow_all(world, policy, *one_by_one) for policy in policies),
        np.array([drift_of(world, e) for e in range(PAIRED_EPISODES.first, PAIRED_EPISODES.end)]),
        episodes(world, own, PAIRED_EPISODES),
        np.array([episodes(world, policy, PAIRED_EPISODES) for policy in policies]),
        np.array([episodes(world, policy, PAIRED_EPISODES) for policy in settling]),
        episodes(world, hand(world, turn_deg=TUNED_TURN_DEG, stand_above=threshold), PAIRED_EPISODES),
    )


def train(model: NavigationModel, seed: int, schedule: Schedule = AS_PRINTED) -> Training:
    """Run a training of Sarsa(lambda) with a seed to its end, and return it."""
    training = Training(model, seed, schedule)
    training.advance(schedule.episodes)
    return training


def with_printed_gamma() -> tuple[str, Record]:
    """Return the error text that refuses the printed discount gamma .95, and results of a policy trained with it.

    Results are a record RESULT of each of 100 episodes, (100,), as `run_episodes` returns them. Guards against endless
    stands are off.
    """
    try:
        load("paper", (f"reward.gamma={PRINTED_GAMMA}",))
        refusal = ""
    except ConfigError as error:
        refusal = str(error)
    free = load("paper", (THREE_STATES, "guards.stands=1000000", "guards.turns=1000000"))
    training = Training(free, TRAININGS[0], AS_PRINTED)
    training.world.tables.scene[0].gamma = PRINTED_GAMMA
    training.advance(AS_PRINTED.episodes)
    return refusal, episodes(arrays(free), training.policy(), Seeds(PAIRED_EPISODES.first, PAIRED_EPISODES.first + 100))


def study(progress: Callable[[float, str], None] = lambda share, step: None) -> NavigationStudy:
    """Run all experiments of Osswald et al., section VI, and return the results; takes about half a minute."""
    normal, blur = (load(name, (THREE_STATES,)) for name in ("paper", "paper-blur"))
    step = "trainings and 100 + 100 episodes"
    seen = compare(normal, lambda share: progress(0.4 * share, f"{step}, moderate blur"))
    blurred = compare(blur, lambda share: progress(0.4 + 0.4 * share, f"{step}, strong blur"))
    progress(0.8, "paths of a training, other turning thresholds, errata")
    drawn = paths(Training(normal, TRAININGS[seen.chosen], AS_PRINTED), EVERY)
    turning: dict[float, tuple[Record, tuple[Episode, ...]]] = {}
    for deg in TURN_THRESHOLDS:
        policy = hand(seen.world, turn_deg=deg, stand_above=seen.threshold)
        turning[deg] = (
            episodes(seen.world, policy, PAIRED_EPISODES),
            follow_all(seen.world, policy, EVALUATION, PAIRED_EPISODES.first, TURNING_WALKS),
        )
    refusal, printed = with_printed_gamma()
    mostly_random = Schedule(alpha=(0.2, 0.2), eps=(0.9, 0.9), average_from=1.0, episodes=BRIEF)
    reversed_eps = train(normal, TRAININGS[0], mostly_random).seconds
    return NavigationStudy(seen, blurred, drawn, turning, refusal, printed, reversed_eps)
