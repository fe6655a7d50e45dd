"""Landmarks a Nao recognises in one image, standing and walking: the real services of a seed in one process.

Osswald et al. matched 3.25 features a frame on a slowly walking Nao and far more on a standing one. Read from
`hw/landmarks` and `state/gait` of a recorded run, truth not involved.

    python -m benchmarks.bench_landmarks --seeds 0:5
"""

import argparse
import statistics
import tempfile
from pathlib import Path

from surefoot.lab.runs.local import run_local
from surefoot.record.recording import read_recording
from surefoot.schemas.topics import HW_LANDMARKS, HW_RANGE, STATE_GAIT
from surefoot.services.supervisor.scenarios.scenario import Scenario, parse_scenario

WALK = """
description = "Nao stands, then walks on a floor with landmarks and a goal, towards a wall"
compose = "nao"
max_duration_s = 40.0
[world]
terrain = "room"
map_profile = "exact"
perturbation = 1.0
goal = [0.9, 0.0]
[[step]]
when = "ready"
do = "stand"
duration = 3.0
[[step]]
when = "ready"
after_s = 3.0
do = "walk"
distance = {distance}
"""


def scenario(distance: float) -> Scenario:
    """Stand for 3 s, walk so many metres."""
    return parse_scenario(WALK.format(distance=distance), Path("landmarks.toml"))


def run(seed: int, distance: float, path: Path) -> tuple[dict[str, list[int]], int, list[float | None]]:
    """One recorded run.

    Args:
        seed: of everything random.
        distance: of the walk, m.
        path: of the recording.

    Returns:
        Landmarks of each frame by the gait's state, frames with the goal marker, distances of the ultrasound in m.
    """
    run_local(scenario(distance), seed, recording=path)
    frames: dict[str, list[int]] = {}
    goals, echoes, state = 0, list[float | None](), ""
    for item in read_recording(path, (HW_LANDMARKS.key, HW_RANGE.key, STATE_GAIT.key)):
        message = item.message()
        match item.key:
            case STATE_GAIT.key:
                state = message.state  # pyright: ignore[reportAttributeAccessIssue] - of its key
            case HW_RANGE.key:
                echoes.append(message.distance)  # pyright: ignore[reportAttributeAccessIssue]
            case _:
                frames.setdefault(state, []).append(len(message.landmarks))  # pyright: ignore[reportAttributeAccessIssue]
                goals += message.goal is not None  # pyright: ignore[reportAttributeAccessIssue]
    return frames, goals, echoes


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:5", help="first:end")
    parser.add_argument("--distance", type=float, default=0.7, help="m")
    args = parser.parse_args()
    first, end = (int(value) for value in args.seeds.split(":"))
    means: dict[str, list[float]] = {"standing": [], "walking": []}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, end):
            frames, goals, echoes = run(seed, args.distance, Path(folder) / f"{seed}.mcap")
            for name, values in means.items():
                values.append(statistics.mean(frames[name]))
            heard = [echo for echo in echoes if echo is not None]
            counts = ", ".join(f"{name} {values[-1]:.2f} of {len(frames[name])}" for name, values in means.items())
            print(f"seed {seed}: {counts} frames; goal in {goals}; wall from {heard[0]:.2f} to {heard[-1]:.2f} m")
    for name, values in means.items():
        print(f"{name}: {statistics.mean(values):.2f} landmarks a frame ({min(values):.2f} to {max(values):.2f})")


if __name__ == "__main__":
    main()
