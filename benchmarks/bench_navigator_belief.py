"""What planning over beliefs gains over the planner, and what a decision costs: rollouts and PFT-DPW, paired episodes.

The floor's landmarks and the model are known to these peers exactly, so their gain is an upper bound of what the same
search could gain live. An action that rollouts find better replaces that of the base policy only if it is so by some
standard errors over the same samples. Numbers were chosen on episodes 0 to 30.

    python -m benchmarks.bench_navigator_belief --params paper-arcs --peer rollouts --episodes 60000:60200
    python -m benchmarks.bench_navigator_belief --params paper-arcs --peer tree --sims 1000

With ``--results`` every finished episode is a line of that file, and episodes that it holds are not run again.
"""

import argparse
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bench_navigator_study import STEER_COSTLY_ABOVE
from benchmarks.peers.belief_search import rollouts, scratch_of, tree
from surefoot.lab.statistics import interval
from surefoot.services.navigator.environment.episodes import SECONDS_TAKEN, run_episodes
from surefoot.services.navigator.environment.model import episode_room, episode_state
from surefoot.services.navigator.environment.world import act, begin
from surefoot.services.navigator.policy.arrays import KIND, OUTCOME, RUNNING, STAND, TIME, Arrays, arrays
from surefoot.services.navigator.policy.choose import room_to_choose
from surefoot.services.navigator.policy.library import find
from surefoot.services.navigator.policy.params import load
from surefoot.services.navigator.policy.policies import STEER_SHARE, STEER_TURN_DEG, Policy, choose_with, hand

BEST_OF = 4
"""Actions that rollouts compare: those of the planner's largest values, always with the stand and the base's."""
SEARCHES = 2**43
"""Random stream of the searches, of no evaluation."""


@dataclass
class Peer:
    """Decides by search; a decision returns the action."""

    world: Arrays
    planner: Policy
    base: Policy
    kind: str
    sims: int
    depth: int
    explore: float
    sure: float

    def __post_init__(self) -> None:
        a = len(self.world.names)
        self._parts, self._scratch = self.world.tables, scratch_of(self.world)
        self._room = room_to_choose(4, a)
        self._values, self._mask = self._room.values, self._room.mask
        self._costs = np.zeros((a, self.sims))

    def _by(self, policy: Policy, mean: Any, cov: Any, status: Any) -> int:
        goal = (5.0, 0.0)
        return choose_with(policy, self.world, mean, cov, goal, status, self._room)

    def decide(self, floor: Any, run: int, mean: Any, cov: Any, status: Any) -> int:
        """Return the action for a belief."""
        if self.kind == "tree":
            tree(
                self.planner.tables, self._parts, floor, run, mean, cov, status, self._scratch, self.sims,
                self.depth, self.explore, self._values,
            )  # fmt: skip
            return int(self._values.argmax())
        own = self._by(self.base, mean, cov, status)
        self._by(self.planner, mean, cov, status)
        order = [i for i in np.argsort(-self._values, kind="stable") if self._mask[i]]
        tried = np.zeros(len(self._values), dtype=np.bool_)
        tried[[*order[:BEST_OF], own]] = True
        tried |= (self.world.actions[:, KIND] == STAND) & self._mask
        if tried.sum() == 1:
            return own
        rollouts(self.base.tables, self._parts, floor, run, mean, cov, status, tried, self._scratch, self._costs)
        gains = self._costs[own] - self._costs
        best, least = own, 0.0
        for a in np.flatnonzero(tried):
            mean_gain = float(gains[a].mean())
            if mean_gain > least and mean_gain > self.sure * float(gains[a].std(ddof=1)) / np.sqrt(self.sims):
                best, least = int(a), mean_gain
        return best


def walk(peer: Peer, episode: int) -> tuple[float, int, int, float]:
    """Return the seconds, decisions, stands and the mean s of a decision of one episode of stream 0."""
    world = peer.world
    state, room = episode_state(world), episode_room(4)
    floor, ahead, ahead_cov, status = (state.marks, state.first), state.ahead_mean, state.ahead_cov, state.status
    begin(world.scene, 0, episode, state)
    spent, decisions, stands = 0.0, 0, 0
    while status[OUTCOME] == RUNNING:
        began = time.process_time()
        chosen = peer.decide(floor, SEARCHES + 1000 * episode + decisions, ahead, ahead_cov, status)
        spent += time.process_time() - began
        decisions += 1
        stands += bool(world.actions[chosen, KIND] == STAND)
        act(world.tables, 0, episode, chosen, state, room)
    return float(status[TIME]), decisions, stands, spent / decisions


def compare(name: str, ours: Any, others: Any) -> None:
    """Print the paired difference in per cent."""
    low, high = (100.0 * x / float(others.mean()) for x in interval(ours - others))
    difference = 100.0 * float((ours - others).mean()) / float(others.mean())
    print(f"  against {name:12s} {others.mean():7.2f} s: {difference:+6.2f} % ({low:+.2f} .. {high:+.2f})")


def main() -> None:
    """Run what is missing and print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--params", default="paper-arcs")
    parser.add_argument("--peer", choices=("rollouts", "tree"), default="rollouts")
    parser.add_argument("--base", choices=("planner", "steer", "tuned"), default="planner", help="ends rollouts")
    parser.add_argument("--episodes", default="60000:60020", help="first:end")
    parser.add_argument("--sims", type=int, default=48, help="samples of each action, or simulations of the tree")
    parser.add_argument("--depth", type=int, default=12, help="of the tree")
    parser.add_argument("--explore", type=float, default=0.5, help="s")
    parser.add_argument("--sure", type=float, default=2.0, help="standard errors that a rollout must gain")
    parser.add_argument("--results", type=Path, help="file that keeps finished episodes")
    options = parser.parse_args()
    first, end = (int(part) for part in options.episodes.split(":"))
    model = load(options.params)
    world = arrays(model)
    if world.states != 4 or world.actions[:, -1].any():
        parser.error(f"--params {options.params}: the peers know no common errors of a frame and no delay of decisions")
    planner = find("planner", model, world)
    costly = hand(world, "steer", turn_deg=STEER_TURN_DEG, stand_above=STEER_COSTLY_ABOVE, steer=STEER_SHARE)
    steer = costly if world.switching.any() else find("steer", model, world)
    bases = {"planner": planner, "steer": steer, "tuned": find("tuned", model, world)}
    peer = Peer(
        world, planner, bases[options.base], options.peer, options.sims, options.depth, options.explore, options.sure
    )
    key = [options.params, options.peer, options.base, options.sims, options.depth, options.explore, options.sure]
    done: dict[int, list[float]] = {}
    if options.results is not None and options.results.exists():
        lines = [json.loads(text) for text in options.results.read_text(encoding="utf-8").splitlines() if text]
        done = {line["episode"]: line["values"] for line in lines if line["key"] == key}
    for episode in range(first, end):
        if episode not in done:
            done[episode] = list(walk(peer, episode))
            if options.results is not None:
                with options.results.open("a", encoding="utf-8") as stream_:
                    stream_.write(json.dumps({"key": key, "episode": episode, "values": done[episode]}) + "\n")
    found = np.array([done[episode] for episode in range(first, end)])
    low, high = interval(found[:, 0])
    print(f"{options.params}, {options.peer} with {options.base}, {options.sims} simulations, {end - first} episodes:")
    print(f"  {found[:, 0].mean():.2f} s ({low:.2f} .. {high:.2f}), {found[:, 2].mean():.1f} stands,", end=" ")
    print(f"{1e3 * found[:, 3].mean():.1f} ms a decision")
    rivals = {"planner": planner, "steer": steer} if any("arc" in name for name in world.names) else bases
    for name, policy in rivals.items():
        compare(name, found[:, 0], run_episodes(world, policy, 0, first, end - first)[:, SECONDS_TAKEN])
    compare("pose known", found[:, 0], run_episodes(world, planner, 0, first, end - first, True)[:, SECONDS_TAKEN])


if __name__ == "__main__":
    main()
