"""Walks of the bipeds over many seeds: falls, speed, yaw, pushes, what the walker costs.

One process per seed: world, estimator and walker joined by function calls, in the order of a control tick and with the
one-tick actuation delay of bus servos. Truth is read by the judge only. Finished runs are kept in a file, so that an
interrupted study goes on where it was.

    python -m benchmarks.bench_biped bioloid --distance 1 --level 1 --seeds 0:100
    python -m benchmarks.bench_biped nao --turn 138 --seeds 0:20
    python -m benchmarks.bench_biped bioloid --push --seeds 0:4
"""

import argparse
import dataclasses
import hashlib
import json
import math
import os
import sys
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks import biped_walk, joined
from benchmarks.biped_walk import Capture, Setting, Walk, walk


def study(jobs: Iterable[tuple[int, Setting]], processes: int, keep: Path) -> list[Walk]:
    """All jobs, each in a process of its own; finished ones come from the file `keep`."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    done: dict[str, Walk] = {}
    if keep.is_file():
        for line in keep.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            key = row.pop("key")
            at = row.pop("capture")
            done[key] = Walk(**row, capture=None if at is None else Capture(*at))
    jobs = list(jobs)
    keys = [_key(seed, setting) for seed, setting in jobs]
    missing = [(key, job) for key, job in zip(keys, jobs, strict=True) if key not in done]
    keep.parent.mkdir(parents=True, exist_ok=True)
    if missing:
        with ProcessPoolExecutor(processes) as pool, keep.open("a", encoding="utf-8") as file:
            running = {pool.submit(partial(walk, seed, setting)): key for key, (seed, setting) in missing}
            for n, job in enumerate(as_completed(running)):
                key, one = running[job], job.result()
                done[key] = one
                file.write(json.dumps({"key": key, **asdict(one)}) + "\n")
                file.flush()
                good = sum(done[k].ok for k in keys if k in done)
                print(f"\r{n + 1}/{len(missing)} runs, {good} ok", end="", file=sys.stderr, flush=True)
            print(file=sys.stderr)
    return [done[key] for key in keys]


def _key(seed: int, setting: Setting) -> str:
    """Job and code: a run of other code is another run."""
    text = json.dumps([seed, dataclasses.asdict(setting), code_version()], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def code_version() -> str:
    """Digest of everything a run depends on."""
    root = Path(__file__).parents[1]
    names = sorted(
        path
        for folder in ("surefoot", "services/simulator", "services/estimator", "services/walker")
        for kind in ("*.py", "*.toml")
        for path in (root / folder).rglob(kind)
    )
    digest = hashlib.sha256()
    for path in (*names, Path(biped_walk.__file__), Path(joined.__file__)):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def summary(walks: list[Walk], setting: Setting) -> str:
    """One line for a table."""
    good = [w for w in walks if w.ok]

    def mean(name: str) -> float:
        return float(np.mean([getattr(w, name) for w in good])) if good else math.nan

    speed = [100.0 * w.x / w.walk_s for w in good if w.walk_s > 0]
    per_metre = max(0.01, abs(setting.distance or 1.0))
    yaw = [w.yaw_deg / per_metre for w in good]
    return ", ".join(
        (
            f"{len(good)}/{len(walks)} ok",
            f"{sum(w.fallen for w in walks)} fell",
            f"x {mean('x'):.3f} m, |y| {float(np.mean([abs(w.y) for w in good] or [math.nan])):.3f} m",
            f"{float(np.mean(speed or [math.nan])):.2f} cm/s",
            f"yaw {mean('yaw_deg'):.1f} deg, sigma {float(np.std(yaw or [math.nan])):.1f} deg/m",
            f"tilt {mean('tilt_deg'):.1f} (max {max(w.tilt_deg for w in walks):.1f}) deg",
            f"twist {mean('twist_deg'):.2f} deg, slip {mean('slip_mm'):.1f} mm",
            f"odometry {mean('odometry_mm'):.0f} mm, {mean('heading_error_deg'):.1f} deg",
            f"steps to stop <= {max(w.stop_steps for w in walks)}",
            f"saturated {100 * mean('saturated'):.1f} %",
            f"walker {mean('walker_us'):.0f} us (p99 {mean('walker_p99_us'):.0f})",
        )
    )


def push_table(walks: list[Walk], jobs: list[tuple[int, Setting]]) -> str:
    """Survival by force, the lost directions and phases with their capture points, and what those tell."""
    lines: list[str] = []
    runs = [(w, s.push) for w, (_, s) in zip(walks, jobs, strict=True) if s.push]
    for force in sorted({p[0] for _, p in runs}):
        here = [(w, p) for w, p in runs if p[0] == force]
        good = sum(w.ok for w, _ in here)
        lines.append(f"{force:4.1f} N: {good}/{len(here)} survive ({100 * good / len(here):.1f} %)")
        for way in sorted({p[1:] for w, p in here if not w.ok}):
            same = [w for w, p in here if p[1:] == way]
            lost = [w for w in same if not w.ok]
            at = [w.capture for w in lost if w.capture is not None]
            where = "no push" if not at else (
                f"capture point {np.mean([c.ahead_mm for c in at]):+.0f} mm ahead, "
                f"{np.mean([c.outward_mm for c in at]):+.0f} mm outward of the ankle, "
                f"{np.mean([c.beyond_mm for c in at]):+.0f} mm beyond the {'/'.join(sorted({c.edge for c in at}))} edge"
            )  # fmt: skip
            lines.append(f"    {way[0]:3.0f} deg, phase {way[1]:.2f}: lost {len(lost)}/{len(same)}, {where}")
    found = [(w.ok, w.capture) for w, _ in runs if w.capture is not None]
    lines.append("survived by the place of the true capture point at the end of the push:")
    for edge in ("outer", "inner", "front", "rear"):
        for low, high in ((-math.inf, 0.0), (0.0, 10.0), (10.0, 20.0), (20.0, 40.0), (40.0, math.inf)):
            here = [ok for ok, c in found if c.edge == edge and low < c.beyond_mm <= high]
            if here:
                lines.append(f"    {edge} edge, {low:.0f} to {high:.0f} mm beyond: {sum(here)}/{len(here)}")
    return "\n".join(lines)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", nargs="?", default="bioloid")
    parser.add_argument("--distance", type=float, default=1.0)
    parser.add_argument("--turn", type=float, help="deg")
    parser.add_argument("--arc", type=float, help="deg over the distance")
    parser.add_argument("--level", type=float, default=1.0)
    parser.add_argument("--backlash", type=float, help="deg")
    parser.add_argument("--friction", type=float)
    parser.add_argument("--stop", type=float, help="s after the command")
    parser.add_argument("--push", action="store_true", help="8 directions x 4 phases, 0.1 s")
    parser.add_argument("--forces", default="4,6,8,10,12")
    parser.add_argument("--seeds", default="0:10", help="first:end")
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=NUMBER", help="of BipedParams")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--keep", type=Path, default=Path.home() / ".cache/surefoot/bench_biped.jsonl")
    parser.add_argument("--show", action="store_true", help="every run")
    args = parser.parse_args()
    params = tuple((name, float(value)) for name, _, value in (item.partition("=") for item in args.set))
    setting = Setting(
        args.robot, None if args.turn is not None else args.distance, args.turn, args.arc, args.level, args.backlash,
        args.friction, args.stop, None, params,
    )  # fmt: skip
    first, end = (int(value) for value in args.seeds.split(":"))
    jobs = [(seed, setting) for seed in range(first, end)]
    if args.push:
        short = replace(setting, distance=0.3 if args.robot == "bioloid" else 0.5)
        jobs = [
            (seed, replace(short, push=(force, 45.0 * d, phase)))
            for force in (float(f) for f in args.forces.split(","))
            for seed, _ in jobs
            for d in range(8)
            for phase in (0.0, 0.25, 0.5, 0.75)
        ]
    walks = study(jobs, args.jobs, args.keep)
    for one in walks:
        if args.show or (not one.ok and not args.push):
            print(json.dumps(asdict(one)))
    print(push_table(walks, jobs) if args.push else f"{args.robot}, seeds {args.seeds}: {summary(walks, setting)}")


if __name__ == "__main__":
    main()
