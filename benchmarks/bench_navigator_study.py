"""Time to the goal of all controllers in the paper's world: episodes that served no choice, paired, 95 % intervals.

Parameters were chosen on stream 1 (episodes 0 to 6000), trainings on streams of their own; this is stream 0, episodes
20000 on. `limit` is the planner with true pose and drift. The tuned hand controllers have the planner's filter; the
paper's baseline has three states.

    python -m benchmarks.bench_navigator_study 20000:21000
    python -m benchmarks.bench_navigator_study 40000:80000 --drifts 0      one comparison, many episodes
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from surefoot.lab.train.evaluation import Seeds, episodes, paired, summary
from surefoot.services.navigator.environment.episodes import SECONDS_TAKEN
from surefoot.services.navigator.policy.arrays import arrays
from surefoot.services.navigator.policy.library import find
from surefoot.services.navigator.policy.params import load
from surefoot.services.navigator.policy.policies import (
    STEER_SHARE,
    STEER_TURN_DEG,
    TUNED_STAND_ABOVE,
    TUNED_STAND_SLOPE,
    hand,
)

STEER_COSTLY_ABOVE = -1.0
"""Nats; least time of the steering controller in `paper-arcs` on stream 1, of -3 .. -0.5."""
DRIFTS = (0, 1, 2, 3, 4, 5, 6, 7, 8)


@dataclass
class Study:
    """Runs policies on the same episodes and prints what it finds."""

    seeds: Seeds
    lines: list[dict[str, Any]]

    def times(self, params: str, policy: str, sets: tuple[str, ...] = (), seeds: Seeds | None = None) -> Any:
        """Run one policy, print its line, and return its results."""
        model = load(params, sets)
        world = arrays(model)
        if policy == "steer-costly":
            chosen = hand(world, policy, turn_deg=STEER_TURN_DEG, stand_above=STEER_COSTLY_ABOVE, steer=STEER_SHARE)
        elif policy.startswith("tuned-"):
            chosen = hand(
                world,
                policy,
                turn_deg=float(policy.removeprefix("tuned-")),
                stand_above=TUNED_STAND_ABOVE,
                slope=TUNED_STAND_SLOPE,
            )
        else:
            chosen = find("planner" if policy == "limit" else policy, model, world)
        results = episodes(world, chosen, seeds or self.seeds, knows=policy == "limit")
        s = summary(results)
        low, high = s["mean_ci95_s"]
        self.lines.append({"params": params, "set": sets, "policy": policy, **s})
        at_least, band = s["success_at_least"], s["nees_at_20_band95"]
        print(
            f"  {policy:14s} {s['mean_s']:7.2f} s ({low:.2f} .. {high:.2f})  sd {s['sd_s']:.2f}",
            f" median {s['median_s']:.1f}  p95 {s['p95_s']:.1f}  success {s['success']:.4f} (>= {at_least:.4f})",
            f" stands {s['stands']:.1f}  NEES {s['nees_at_20']:.2f} in {band[0]:.2f} .. {band[1]:.2f}",
            f" 95 % ellipsoids hold {100.0 * s['inside_95_at_20']:.1f} %",
            flush=True,
        )
        return results

    def compare(self, what: str, ours: Any, other: Any, most: float) -> None:
        """Print a paired difference in per cent and whether it is at most `most`."""
        p = paired(ours, other)
        low, high = p["difference_ci95_percent"]
        verdict = "ok" if p["difference_percent"] <= most else "MISSED"
        print(
            f"    {what:44s} {p['difference_percent']:+6.2f} % ({low:+.2f} .. {high:+.2f})  <= {most:+.1f} %  {verdict}"
        )
        self.lines.append({"compared": what, "most_percent": most, **p})

    def four(self, params: str, baseline: float, gap: float) -> None:
        """Compare the controllers with the paper's four actions."""
        print(f"{params}, four actions")
        three = self.times(params, "hand", ("filter.states=3",))
        plain, tuned, limit = (self.times(params, name) for name in ("hand", "tuned", "limit"))
        ours = self.times(params, "planner")
        self.compare("planner against tuned hand", ours, tuned, -2.0)
        self.compare("planner against limit", ours, limit, gap)
        self.compare("planner against 35 deg, three-state filter", ours, three, -baseline)
        self.compare("planner against 35 deg, same filter", ours, plain, 0.0)

    def arcs(self, params: str, least: float) -> None:
        """Compare the controllers with arcs, and with the 35 deg controller of four actions."""
        print(f"{params}, arcs")
        use = ("use='arcs'",)
        plain, steer, limit = (
            self.times(params, "hand"),
            self.times(params, "steer", use),
            self.times(params, "limit", use),
        )
        ours = self.times(params, "planner", use)
        self.compare("planner with arcs against 35 deg, four actions", ours, plain, -least)
        self.compare("planner against steering hand", ours, steer, 0.0)
        self.compare("planner against limit", ours, limit, 5.0)

    def costly(self) -> None:
        """Compare with switching costs and arcs that see little."""
        print("paper-arcs: blurred, switching costs, arcs that see little")
        steer, _ = self.times("paper-arcs", "steer-costly"), self.times("paper-arcs", "limit")
        self.compare("planner against steering hand", self.times("paper-arcs", "planner"), steer, -2.0)

    def drift(self, drifts: tuple[int, ...] = DRIFTS) -> None:
        """Compare at other drifts than the filter expects, deg per 10 cm."""
        for params in ("paper", "paper-blur"):
            for drift in drifts:
                print(f"{params}, drift {drift} deg per 10 cm")
                sets = (f"drift.per_10cm_deg={drift}",)
                tuned, ours = self.times(params, "tuned", sets), self.times(params, "planner", sets)
                self.compare("planner against tuned hand", ours, tuned, 1.0)
                if drift < 3:  # where larger thresholds suit the hand controller better than its own
                    others = [self.times(params, f"tuned-{deg}", sets) for deg in (21, 23, 25, 28)]
                    best = min(others, key=lambda r: float(r[:, SECONDS_TAKEN].mean()))
                    self.compare("planner against hand tuned to this drift", ours, best, 1.0)

    def sparse(self) -> None:
        """Report success where landmarks are few."""
        for density, least in ((10, 0.99), (5, 0.98)):
            for params in ("paper", "paper-blur"):
                print(f"{params}, {density} landmarks per m^2, success >= {least}")
                for name in ("planner", "tuned"):
                    self.times(params, name, (f"scene.landmarks_per_m2={density}",))

    def success(self, count: int) -> None:
        """Report success on many episodes."""
        for params in ("paper", "paper-blur"):
            print(f"{params}, {count} episodes, success >= 0.999")
            self.times(params, "planner", seeds=Seeds(self.seeds.first, self.seeds.first + count))


def main(arguments: list[str] | None = None) -> None:
    """Run all of it."""
    parser = argparse.ArgumentParser(prog="bench_navigator_study")
    parser.add_argument("episodes", nargs="?", default="20000:24000", help="first:end")
    parser.add_argument("--json", type=Path, help="also write all numbers to this file")
    parser.add_argument("--success", type=int, default=10_000, help="episodes of the success rate")
    parser.add_argument("--drifts", help="deg per 10 cm, by commas: only the comparison at these drifts")
    options = parser.parse_args(arguments)
    study = Study(Seeds(*(int(part) for part in options.episodes.split(":"))), [])
    if options.drifts is not None:
        study.drift(tuple(int(part) for part in options.drifts.split(",")))
    else:
        study.four("paper", 12.0, 1.5)
        study.four("paper-blur", 16.0, 4.0)
        study.arcs("paper", 25.0)
        study.arcs("paper-blur", 24.0)
        study.costly()
        study.sparse()
        study.success(options.success)
        study.drift()
    if options.json is not None:
        options.json.write_text(json.dumps(study.lines, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
