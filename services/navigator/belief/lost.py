"""Whether the believed pose is wrong: a filter over four hypotheses, fed with what becomes of the detections.

The robot is where it is believed to be ("right"), elsewhere on the map ("displaced"), where the map does not reach
("off_map"), or it sees nothing ("blind": a dark camera, or a place without landmarks). Of every detection one of three
things is seen: it belongs *here* (a landmark in its gate looks like it), *elsewhere* (only landmarks out of its gate
do), or it is *strange* (no landmark does). The hypotheses give them different shares; a frame multiplies their
probabilities by the likelihood of its counts,

    p_h <- p_h prod_c share_h[c]^n_c prod_matches f_h(nis),    and p <- p exp(rates dt) between frames.

f_right is an exponential density (chi^2_2 with `scale`), f of the others uniform over the gate. A frame's likelihood
ratio is bounded, because errors are common to a frame. The number of detections tells only "blind" from the others: a
displaced robot sees as many. With E landmarks expected to be recognised, P(none) = exp(-E `trust`) unless it is blind.
"""

import math
from dataclasses import dataclass, field, replace

from surefoot.errors import Refusal

from . import association
from .landmarks import FloorLandmarks
from .matching import Detections, Matches, MatchLimits, SightNoise, known_elsewhere

Shares = tuple[float, float, float]
"""Of detections here, elsewhere, strange."""


@dataclass(frozen=True)
class FrameEvidence:
    """What became of the detections of one frame."""

    here: int = 0
    """A landmark in the gate looks like it."""
    elsewhere: int = 0
    """Only landmarks out of the gate look like it."""
    strange: int = 0
    """No landmark looks like it."""
    nis: tuple[float, ...] = ()
    """Normalised innovation squared of the matched ones, 2 degrees of freedom."""
    expected: float = 0.0
    """Landmarks that should be recognised in this frame if the pose is right; 0 = not known."""


@dataclass(frozen=True)
class Footprint:
    """What a camera overlooks of the floor: a sector about the heading of base_link."""

    nearest: float = 0.35
    """m, from base_link."""
    farthest: float = 1.18
    """m, from base_link."""
    half_angle: float = math.radians(33.0)
    """rad, to either side."""


@dataclass(frozen=True)
class LostModel:
    """Shares and rates of the three hypotheses.

    Raises:
        Refusal: shares that do not add up to 1 or are not positive, rates that are negative.
    """

    right: Shares = (0.72, 0.20, 0.08)
    """With twice the false detections that are expected: a map grows old."""
    displaced: Shares = (0.10, 0.80, 0.10)
    """A wrong landmark in the gate looks right now and then; see `of`."""
    off_map: Shares = (0.03, 0.12, 0.85)
    """Floors look alike somewhere."""
    displacement_rate: float = 1e-3
    """1/s, that a pose which is right becomes wrong."""
    leaving_rate: float = 3e-5
    """1/s, that the robot leaves the map."""
    blinding_rate: float = 1e-3
    """1/s, that it no longer sees anything."""
    trust: float = 0.5
    """In the number of landmarks that should be recognised: part of it that is counted on."""
    recovery_rate: float = 1e-3
    """1/s, that a wrong pose becomes right by itself."""
    gate: float = 9.21
    """Of the matches' normalised innovation squared."""
    scale: float = 1.5
    """Mean of the normalised innovation squared over 2 that is still right."""
    most: float = 4.0
    """Largest logarithm of a likelihood ratio that a frame contributes."""
    threshold: float = 0.9
    """Probability from which the pose counts as lost."""
    memory_s: float = 3.0
    """s, of the counts that the reason names."""

    @classmethod
    def of(cls, noise: SightNoise, footprint: Footprint) -> "LostModel":
        """Return the model for a camera: the larger the gate beside the view, the more often chance fills it."""
        distance = 0.5 * (footprint.nearest + footprint.farthest)
        along = math.hypot(math.hypot(noise.range_sd, noise.range_share * distance), noise.common_range_sd)
        across = distance * math.hypot(noise.bearing_sd, noise.common_bearing_sd)
        view = footprint.half_angle * (footprint.farthest**2 - footprint.nearest**2)
        plain = cls()
        chance = min(1.0, math.pi * plain.gate * along * across / view)
        here = plain.displaced[0] + 0.4 * chance
        return replace(plain, displaced=(here, 0.9 - here, 0.1))

    def __post_init__(self) -> None:
        for name in ("right", "displaced", "off_map"):
            shares: Shares = getattr(self, name)
            if min(shares) <= 0.0 or abs(sum(shares) - 1.0) > 1e-9:
                raise Refusal("bad_lost_model", f"{name}: three shares > 0 that add up to 1, got {shares}", name)
        for name in (
            "displacement_rate",
            "leaving_rate",
            "blinding_rate",
            "recovery_rate",
            "memory_s",
            "scale",
            "most",
            "gate",
        ):
            value: float = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise Refusal("bad_lost_model", f"{name} is finite and > 0, got {value!r}", name)


@dataclass(frozen=True)
class LostState:
    """Probabilities of the hypotheses, and what they were fed with of late."""

    right: float = 1.0
    """The robot is where it is believed to be."""
    displaced: float = 0.0
    """It is elsewhere on the map."""
    off_map: float = 0.0
    """It is off the map."""
    blind: float = 0.0
    """Nothing is seen where landmarks should be: a dark camera, or a wrong pose."""
    recent: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0))
    """Detections here, elsewhere, strange, older ones counted less."""

    missed: float = 0.0
    """Landmarks that should have been recognised of late and were not."""

    @property
    def probability(self) -> float:
        """That the believed pose is wrong and landmarks show it."""
        return self.displaced + self.off_map

    @property
    def doubt(self) -> float:
        """Probability that the pose is wrong or that nothing is seen: reason enough to stand and look around."""
        return self.displaced + self.off_map + self.blind

    def reason(self, model: LostModel) -> str:
        """Return in words why the pose is in doubt; empty if it is not."""
        if self.doubt < model.threshold:
            return ""
        here, elsewhere, strange = (round(value) for value in self.recent)
        total = here + elsewhere + strange
        if self.blind > self.probability:
            return f"nothing is seen where about {round(self.missed)} landmarks should have been recognised of late"
        if self.off_map > self.displaced:
            return f"{strange} of about {total} landmarks seen of late are not on the map"
        return f"{elsewhere} of about {total} landmarks seen of late belong elsewhere on the map"


def in_view(world: FloorLandmarks, pose: tuple[float, float, float], footprint: Footprint) -> int:
    """Count the landmarks of the map that a camera overlooks from a pose, x, y in m and heading in rad, frame map."""
    return association.in_view(
        world.positions, pose[0], pose[1], pose[2], footprint.nearest, footprint.farthest, footprint.half_angle
    )


def evidence_of(
    matches: Matches,
    seen: Detections,
    world: FloorLandmarks,
    noise: SightNoise,
    expected: float = 0.0,
    limits: MatchLimits | None = None,
) -> FrameEvidence:
    """Return what a frame says about whether the pose is wrong.

    A detection with several alike landmarks in its gate belongs here, too; one that no rigid motion explains counts
    for nothing.

    Args:
        matches: of the frame at the believed pose.
        seen: its detections.
        world: landmarks.
        noise: of the camera.
        expected: landmarks in view there times the share that is recognised in this action; 0 = not known.
        limits: those of the match; None = the defaults of `MatchLimits`.
    """
    counts = matches.counts
    here = counts["matched"] + counts["surplus"] + counts["doubled"] + counts["ambiguous"]
    away = counts["far"] + counts["unlike"]
    elsewhere = known_elsewhere(matches, seen, world, noise, limits)
    return FrameEvidence(here, elsewhere, away - elsewhere, tuple(matches.nis.tolist()), expected)


def passed(state: LostState, dt: float, model: LostModel) -> LostState:
    """Return the state dt s later when nothing was seen: probabilities follow the rates, counts fade.

    Raises:
        Refusal: dt is negative or not finite.
    """
    if not (math.isfinite(dt) and dt >= 0.0):
        raise Refusal("bad_time", f"dt is finite and >= 0 s, got {dt!r}", "dt")
    leave = 1.0 - math.exp(-model.displacement_rate * dt)
    vanish = 1.0 - math.exp(-model.leaving_rate * dt)
    back = 1.0 - math.exp(-model.recovery_rate * dt)
    dim = 1.0 - math.exp(-model.blinding_rate * dt)
    displaced = state.displaced * (1.0 - back) + state.right * leave
    off_map = state.off_map * (1.0 - back) + state.right * vanish
    blind = state.blind * (1.0 - back) + state.right * dim
    fade = math.exp(-dt / model.memory_s)
    recent = (state.recent[0] * fade, state.recent[1] * fade, state.recent[2] * fade)
    right = max(0.0, 1.0 - displaced - off_map - blind)
    return LostState(right, displaced, off_map, blind, recent, state.missed * fade)


def observed(state: LostState, frame: FrameEvidence, model: LostModel) -> LostState:
    """Return the state after a frame."""
    right = _log_likelihood(model.right, frame) + sum(_nis_ratio(value, model) for value in frame.nis)
    others = (_log_likelihood(model.displaced, frame), _log_likelihood(model.off_map, frame))
    ratios = [max(-model.most, min(model.most, other - right)) for other in others]
    displaced, off_map = state.displaced * math.exp(ratios[0]), state.off_map * math.exp(ratios[1])
    count = frame.here + frame.elsewhere + frame.strange
    expected = model.trust * frame.expected
    blind = state.blind * (math.exp(min(model.most, expected)) if count == 0 else math.exp(-model.most))
    total = state.right + displaced + off_map + blind
    recent = (state.recent[0] + frame.here, state.recent[1] + frame.elsewhere, state.recent[2] + frame.strange)
    missed = state.missed + max(0.0, frame.expected - count)
    return LostState(state.right / total, displaced / total, off_map / total, blind / total, recent, missed)


def _log_likelihood(shares: Shares, frame: FrameEvidence) -> float:
    here, elsewhere, strange = (math.log(share) for share in shares)
    return frame.here * here + frame.elsewhere * elsewhere + frame.strange * strange


def _nis_ratio(nis: float, model: LostModel) -> float:
    """Logarithm of the density of a match's nis under a right pose over that under a wrong one, at most ln 3."""
    s = 2.0 * model.scale
    inside = 1.0 - math.exp(-model.gate / s)
    ratio = math.log(model.gate / (s * inside)) - nis / s
    return max(-math.log(3.0), min(math.log(3.0), ratio))
