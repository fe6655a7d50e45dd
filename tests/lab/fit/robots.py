"""Robots whose numbers are known: the events of their runs, drawn from formulas of their own."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surefoot.lab.fit.events import FRAME, MOVE, SEE, Run

WALK, LEFT, RIGHT, STAND, ARC_LEFT, ARC_RIGHT = 0, 1, 2, 3, 4, 5
"""Actions of the model `nao-paper`, in its order."""
TURN = {WALK: 0.0, LEFT: 23.0, RIGHT: -23.0, ARC_LEFT: 11.5, ARC_RIGHT: -11.5}
SECONDS = 1.8


@dataclass(frozen=True)
class Robot:
    """Numbers of a robot; m, deg and s."""

    along: float = 0.015
    across: float = 0.02
    heading: float = 2.0
    arc: tuple[float, float, float] = (0.03, 0.01, 4.0)
    turn_place: float = 0.02
    turn_heading: float = 4.0
    range: float = 0.05
    bearing: float = 4.0
    standing: float = 0.4
    tilt: float = 1.5
    pitch: float = 2.0
    fade: float = 33.28
    sway: float = 0.03
    sway_fade: float = 0.3
    drift: float = 2.0
    wander: float = 0.05
    forward: float = 0.9
    turned: float = 1.2
    arc_forward: float = 1.0
    arc_turned: float = 0.7
    height: float = 0.45


def run_of(robot: Robot, rng: np.random.Generator, actions: list[int], *, frames: int = 2, seen: int = 5) -> Run:
    """Return the events of a run; each sighting has a landmark of its own, so no map is needed.

    Args:
        robot: its numbers.
        rng: of all noise.
        actions: carried out one after the other; each has `frames` frames with `seen` landmarks.
        frames: per action.
        seen: landmarks in each frame.
    """
    start_sd, start_yaw_sd = 0.03, math.radians(3.0)
    x, y, yaw = rng.normal(0.0, start_sd), rng.normal(0.0, start_sd), rng.normal(0.0, start_yaw_sd)
    drift = math.radians(rng.normal(0.0, robot.drift)) / 0.1
    roll = rng.normal(0.0, math.radians(robot.tilt))
    pitch = rng.normal(math.radians(robot.pitch), math.radians(robot.tilt))
    sway = rng.normal(0.0, robot.sway)
    events: list[tuple[float, ...]] = []
    for action in actions:
        for _ in range(frames):
            if action != STAND:
                way = 0.0 if action in (LEFT, RIGHT) else 0.1
                along, across, heading, forward, turned = {
                    WALK: (robot.along, robot.across, robot.heading, robot.forward, 1.0),
                    ARC_LEFT: (*robot.arc, robot.arc_forward, robot.arc_turned),
                    ARC_RIGHT: (*robot.arc, robot.arc_forward, robot.arc_turned),
                }.get(action, (robot.turn_place, robot.turn_place, robot.turn_heading, 1.0, robot.turned))
                pieces = 3  # motions between two frames
                for _ in range(pieces):
                    part = 1.0 / (frames * pieces)
                    turn = part * (math.radians(TURN[action]) * turned + drift * way)
                    middle = yaw + 0.5 * turn
                    ahead = part * way * forward + math.sqrt(part) * rng.normal(0.0, along)
                    left = math.sqrt(part) * rng.normal(0.0, across)
                    x += ahead * math.cos(middle) - left * math.sin(middle)
                    y += ahead * math.sin(middle) + left * math.cos(middle)
                    yaw += turn + math.sqrt(part) * rng.normal(0.0, math.radians(heading))
                    if way:
                        drift += math.sqrt(part) * rng.normal(0.0, math.radians(robot.wander) / 0.1)
                    events.append((MOVE, float(action), part))
            dt = SECONDS / frames
            keep, keep_sway = math.exp(-dt / robot.fade), math.exp(-dt / robot.sway_fade)
            mean, sd = math.radians(robot.pitch), math.radians(robot.tilt)
            pitch = mean + keep * (pitch - mean) + math.sqrt(1.0 - keep**2) * rng.normal(0.0, sd)
            roll = keep * roll + math.sqrt(1.0 - keep**2) * rng.normal(0.0, sd)
            sway = keep_sway * sway + math.sqrt(1.0 - keep_sway**2) * rng.normal(0.0, robot.sway)
            events.append((FRAME, dt))
            share = robot.standing if action == STAND else 1.0
            for _ in range(seen):
                r, b = rng.uniform(0.4, 1.1), rng.uniform(-0.55, 0.55)
                mark = (x + r * math.cos(yaw + b), y + r * math.sin(yaw + b))
                # a tilted camera sees a floor point elsewhere; the body is sway to the left of its path
                h = robot.height
                stretch = (h * h + r * r) / h
                range_ = r + stretch * (pitch * math.cos(b) + roll * math.sin(b)) - sway * math.sin(b)
                bearing = b + h / r * (roll * math.cos(b) - pitch * math.sin(b)) - sway * math.cos(b) / r
                range_ += rng.normal(0.0, share * robot.range)
                bearing += rng.normal(0.0, share * math.radians(robot.bearing))
                events.append((SEE, *mark, range_, bearing, float(action == STAND)))
    run = Run(Path("made up"))
    run.events = np.array([(*event, *([0.0] * (6 - len(event)))) for event in events])
    return run


def truth_of(robot: Robot, *, arcs: bool = False) -> dict[str, float]:
    """Return the numbers under the keys of the model `nao-paper`, of arcs only where they are asked for."""
    truth = {
        "sight.range_sd": robot.range,
        "sight.bearing_sd_deg": robot.bearing,
        "sight.standing_share": robot.standing,
        "sight.tilt_sd_deg": robot.tilt,
        "sight.pitch_deg": robot.pitch,
        "sight.sway_sd": robot.sway,
        "drift.known_sd_deg": robot.drift,
        "actions.walk.along_sd": robot.along,
        "actions.walk.across_sd": robot.across,
        "actions.walk.heading_sd_deg": robot.heading,
        "actions.walk.forward": 0.1 * robot.forward,
        "actions.left.along_sd": robot.turn_place,
        "actions.left.heading_sd_deg": robot.turn_heading,
        "actions.left.turn_deg": 23.0 * robot.turned,
        "actions.right.turn_deg": -23.0 * robot.turned,
    }
    own = {
        "actions.arc_left_11.along_sd": robot.arc[0],
        "actions.arc_left_11.across_sd": robot.arc[1],
        "actions.arc_left_11.heading_sd_deg": robot.arc[2],
        "actions.arc_left_11.forward": 0.1 * robot.arc_forward,
        "actions.arc_right_11.turn_deg": -11.5 * robot.arc_turned,
    }
    return {**truth, **own} if arcs else truth
