"""Worst moments of a run, by margin, slip, tilt, velocity error and fall."""

from dataclasses import dataclass

import numpy as np

from . import judge
from .traces import Traces


@dataclass(frozen=True)
class Moment:
    """Worst moment of a run in one plot: time, s, value in the unit of the plot, and a description."""

    plot: str
    time: float
    value: float
    text: str


def moments(traces: Traces, feet: tuple[str, ...]) -> tuple[Moment, ...]:
    """Return the worst moments of a run by margin, slip, tilt, velocity error and fall, in the order of time."""
    found: list[Moment] = []
    truth = traces.series("sim/truth")
    if len(truth):
        i = int(truth[:, 8].argmax())
        tilt = float(truth[i, 8] * judge.DEG)
        found.append(Moment("tilt", truth[i, 0], tilt, f"largest tilt, {tilt:.1f} deg"))
    stability = judge.since_ready(traces.series("state/stability"), traces.series("state/gait"))
    if len(stability) and np.isfinite(stability[:, 1]).any():
        i = int(np.nanargmin(stability[:, 1]))
        margin = 1000.0 * float(stability[i, 1])
        found.append(Moment("margin", stability[i, 0], margin, f"smallest static margin, {margin:.1f} mm"))
    if traces.stances:
        worst = max(traces.stances, key=lambda stance: stance.sliding)
        foot, slid = foot_name(feet, worst.foot), 1000.0 * worst.sliding
        found.append(Moment("slip", worst.time, slid, f"foot {foot} has slid {slid:.2f} mm in its stance"))
    error = judge.velocity_error(truth, traces.series("state/velocity"))
    if len(error):
        size = np.linalg.norm(error[:, 1:], axis=1)
        i = int(size.argmax())
        text = f"largest velocity error, {size[i]:.3f} m/s"
        found.append(Moment("velocity error", error[i, 0], float(size[i]), text))
    if traces.fallen_at is not None:
        found.append(Moment("", traces.fallen_at, 0.0, "the robot has fallen"))
    return tuple(sorted(found, key=lambda moment: moment.time))


def foot_name(feet: tuple[str, ...], index: int) -> str:
    """Return the name of a foot in capitals, or its number from 1 on where it has no name."""
    return feet[index].upper() if index < len(feet) else str(index + 1)
