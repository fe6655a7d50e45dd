"""Samples of stances, as arrays for learning and as lines of an append-only file."""

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array

from ..features import Layer
from ..models.lattice import LARGEST, coordinates
from ..relief import SCALES, patch_features

PATCH = 13
"""Number of cells along an edge of the square of heights that a sample keeps."""
UNKNOWN_UM = -(2**31)
"""Value that stands for the height of an unknown cell in a sample, micrometres."""


@dataclass(frozen=True, slots=True)
class StanceSample:
    """One step of a foot (a stance) as a sample for learning: ground, chosen foothold, stroke and measured slip."""

    trial: str
    """Name of the walk or trial; folds of the cross-validation hold whole trials."""
    leg: int
    step: int
    """Number of the choice of footholds in the trial; trial, leg and step together name the stance."""
    k1: float
    """Coefficient K1 of the chosen cell on the map of the choice, m: > 0 on a top edge, < 0 in a hole."""
    k2: float
    """Coefficient K2 (steepness and roughness) of the chosen cell, m."""
    cos_k3: float
    """Cosine of K3, the angle between ground normal and stroke, of the chosen cell: < 0 faces the push, > 0 slips."""
    k4: float
    """Distance of the chosen cell from the nominal foothold, m."""
    stroke: tuple[float, float, float]
    """Movement f of the foot relative to the body while it stands, map axes, m."""
    sliding: float
    """Distance that the contact point slid in the ground plane during the stance, m."""
    displacement: float
    """Horizontal displacement of the foot centre during the stance, m; d of Walas & Belter."""
    load: float
    """Mean normal force on the foot in the stance, N; NaN = not known."""
    friction: float
    """Coefficient of friction of the ground, in simulation, no unit; NaN = not known."""
    cell: float
    """Edge of a cell of the map that the coefficients come from, m."""
    smooth: bool
    """True if the map went through the 3 x 3 median filter, False if its heights are as received."""
    foot_radius: float
    """Radius of the foot sphere, m."""
    robot: str
    robot_hash: str
    source: str
    """Origin of the sample in words: ground, map and rule that chose the foothold."""
    scale: int = SCALES[0]
    """Cells on each side of the middle of the fitted planes, 1 to 4; the noisier the map, the larger."""
    heights_um: tuple[int, ...] = ()
    """Heights that planes are fitted to (`FootholdGround.even`) around the chosen cell, relative to it, 13 x 13 cells
    row by row, micrometres; -2^31 = unknown; empty = not kept."""

    def around(self) -> Layer | None:
        """Return the heights about the chosen cell relative to it, (n, n) m, NaN = unknown; None if there are none."""
        edge = math.isqrt(len(self.heights_um))
        if edge * edge != len(self.heights_um) or edge < 3:
            return None
        rise = np.array(self.heights_um, dtype=np.float64).reshape(edge, edge)
        return np.where(rise == UNKNOWN_UM, np.nan, 1e-6 * rise).astype(np.float32)

    @property
    def length(self) -> float:
        """Length |f| of the stroke, the movement of the foot relative to the body in stance, m."""
        return math.sqrt(math.fsum(value * value for value in self.stroke))

    @property
    def slip(self) -> float:
        """Slip per stroke of the stance: distance slid by the contact point over the length of f, no unit."""
        return self.sliding / self.length

    @property
    def problem(self) -> str:
        """Reason why the sample cannot be learned from, empty if it can."""
        numbers = (self.k1, self.k2, self.cos_k3, self.k4, *self.stroke, self.sliding, self.displacement)
        if not all(math.isfinite(value) for value in numbers):
            return "not_finite"
        if self.length < 1e-4:
            return "no_stroke"
        if self.sliding < 0.0 or self.displacement < 0.0 or self.k2 < 0.0 or self.k4 < 0.0:
            return "negative"
        return "huge" if self.slip > LARGEST else ""


@dataclass(frozen=True, eq=False)
class SampleSet:
    """Samples of stances as arrays for learning, one row for each stance."""

    x: Array
    """Ground of each stance on the axes of the lattice: K1 / K2, K2 / (8 cell), cos K3, (n, 3), no unit."""
    r: Array
    """Slip per stroke of each stance, (n,), no unit."""
    trial: NDArray[np.int64]
    """Index of each sample's trial, (n,)."""
    kept: tuple[StanceSample, ...]
    refused: dict[str, int]
    """Number of samples rejected, by reason: not_finite, no_stroke, negative, huge, twice, no_heights, unknown_ground,
    unhealthy."""
    relief: bool = True
    """True if the points `x` come from fitted planes, False if from the 3 x 3 cells of Walas & Belter."""

    def __len__(self) -> int:
        return len(self.r)

    @property
    def why_refused(self) -> str:
        """Reasons and numbers of the samples left out, in words."""
        return ", ".join(f"{name} {n}" for name, n in sorted(self.refused.items())) or "none came"


def gather(samples: Iterable[StanceSample], relief: bool = True) -> SampleSet:
    """Return the samples that can be learned from, each stance once, in an order that does not depend on theirs.

    Args:
        samples: samples of one robot, cell, filter and foot.
        relief: True: coefficients of planes at the scale of each map; False: those of 3 x 3 cells (Walas & Belter).
    """
    refused: Counter[str] = Counter()
    found: dict[tuple[str, int, int], StanceSample] = {}
    points: dict[tuple[str, int, int], Array] = {}
    for each in samples:
        key, problem = (each.trial, each.leg, each.step), each.problem
        if not problem and key in found:
            problem = "twice"
        if not problem:
            points[key], problem = _point(each, relief)
        if problem:
            refused[problem] += 1
        else:
            found[key] = each
    kept = tuple(found[key] for key in sorted(found))
    trials = {name: k for k, name in enumerate(sorted({each.trial for each in kept}))}
    return SampleSet(
        np.array([points[key] for key in sorted(found)]).reshape(-1, 3), np.array([each.slip for each in kept]),
        np.array([trials[each.trial] for each in kept], dtype=np.int64), kept, dict(refused), relief,
    )  # fmt: skip


def _point(sample: StanceSample, relief: bool) -> tuple[Array, str]:
    """Return the ground of a sample on the axes of the lattice, (3,), and why there is none; empty if there is.

    `relief`: True: by planes fitted to the heights that the sample keeps; False: by its own coefficients.
    """
    k = np.array([[sample.k1, sample.k2, sample.cos_k3]])
    if relief:
        around = sample.around()
        if around is None:
            return np.zeros(3), "no_heights"
        k = np.array([[layer[0, 0] for layer in patch_features(around, sample.scale, sample.stroke, sample.cell, 0)]])
    if not np.isfinite(k).all():
        return np.zeros(3), "unknown_ground"
    return coordinates(k[:, 0], k[:, 1], k[:, 2], sample.cell)[0], ""


# --- lines of a file --------------------------------------------------------------------------------------------------

_NAMES = tuple(each.name for each in fields(StanceSample))


def line_of(sample: StanceSample) -> str:
    """Return a sample as a line of JSON without its end."""
    return json.dumps({"sample": asdict(sample)})


def end_of(trial: str, count: int) -> str:
    """Return the line of a sample file that marks a trial of `count` samples as complete."""
    return json.dumps({"end": trial, "samples": count})


def read_lines(lines: Iterable[str]) -> tuple[list[StanceSample], dict[str, int], int]:
    """Return the samples of all complete trials, their numbers by trial, and how many lines could not be read.

    A trial that a worker left unfinished has no end and does not count; one that is given twice counts once.
    """
    waiting: dict[str, list[StanceSample]] = {}
    complete: dict[str, list[StanceSample]] = {}
    bad = 0
    for text in lines:
        if not text.strip():
            continue
        try:
            entry: Any = json.loads(text)
            if "sample" in entry:
                sample = _sample(entry["sample"])
                waiting.setdefault(sample.trial, []).append(sample)
            else:
                trial, count = str(entry["end"]), int(entry["samples"])
                found = waiting.pop(trial, [])
                if len(found) < count:
                    bad += 1
                elif trial not in complete:
                    complete[trial] = found[len(found) - count :]
        except (ArithmeticError, KeyError, RecursionError, TypeError, ValueError):
            bad += 1
    samples = [each for trial in complete.values() for each in trial]
    return samples, {trial: len(found) for trial, found in complete.items()}, bad


def trial_lines(trial: str, samples: Iterable[StanceSample]) -> Iterator[str]:
    """Return the lines of a complete trial in a sample file: one of JSON per sample, then the line that ends it."""
    count = 0
    for count, each in enumerate(samples, 1):  # noqa: B007 - the last number is written
        yield line_of(each)
    yield end_of(trial, count)


def _sample(entry: dict[str, Any]) -> StanceSample:
    entry = dict(entry)
    stroke = tuple(float(value) for value in entry["stroke"])
    entry.setdefault("scale", SCALES[0])  # files of before planes were fitted
    if len(stroke) != 3 or set(entry) != set(_NAMES):
        raise ValueError("not the fields of a sample")
    numbers = ("k1", "k2", "cos_k3", "k4", "sliding", "displacement", "load", "friction", "cell", "foot_radius")
    entry |= {name: float(entry[name]) for name in numbers}
    entry |= {"leg": int(entry["leg"]), "step": int(entry["step"]), "stroke": stroke, "scale": int(entry["scale"])}
    return StanceSample(**{**entry, "heights_um": tuple(int(value) for value in entry["heights_um"])})
