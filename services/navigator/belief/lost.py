"""Check of the believed pose: a filter over four hypotheses, fed with the fates of the detections.

The robot is where it is believed to be ("right"), elsewhere on the map ("displaced"), where the map does not reach
("off_map"), or it sees nothing ("blind": a dark camera, or a place without landmarks). Every detection is one of three:
it belongs *here* (a landmark in its gate looks like it), *elsewhere* (only landmarks out of its gate
do), or it is *strange* (no landmark does). The hypotheses give them different shares; a frame multiplies their
probabilities by the likelihood of its counts,

    p_h <- p_h prod_c share_h[c]^n_c prod_matches f_h(nis),    and p <- p exp(rates dt) between frames.

f_right is an exponential density (chi^2_2 with `scale`), f of the others uniform over the gate. A frame's likelihood
ratio is bounded, because errors are common to a frame. The number of detections separates only "blind" from the
others: a displaced robot sees as many. With E landmarks expected to be recognised, P(none) = exp(-E `trust`) unless
the robot is blind.
"""

import math
from dataclasses import dataclass, field, replace

from surefoot.errors import Refusal

from . import association
from .landmarks import FloorLandmarks
from .matching import Detections, Matches, MatchLimits, SightNoise, known_elsewhere

Shares = tuple[float, float, float]
"""Shares of detections here, elsewhere, strange; they add up to 1."""


@dataclass(frozen=True)
class FrameEvidence:
    """Fates of the detections of one frame, counted."""

    here: int = 0
    """Detections that a landmark in the gate looks like."""
    elsewhere: int = 0
    """Detections that only landmarks out of the gate look like."""
    strange: int = 0
    """Detections that no landmark looks like."""
    nis: tuple[float, ...] = ()
    """Normalised innovation squared of the matched ones, 2 degrees of freedom."""
    expected: float = 0.0
    """Expected number of recognised landmarks if the pose is right; 0 = not known."""


@dataclass(frozen=True)
class Footprint:
    """Footprint of a camera on the floor: a sector about the heading of base_link."""

    nearest: float = 0.35
    """Least distance from base_link, m."""
    farthest: float = 1.18
    """Largest distance from base_link, m."""
    half_angle: float = math.radians(33.0)
    """Angle to either side, rad."""


@dataclass(frozen=True)
class LostModel:
    """Shares and rates of the three hypotheses.

    Raises:
        Refusal: shares that do not add up to 1 or are not positive, rates that are negative.
    """

    right: Shares = (0.72, 0.20, 0.08)
    """Shares if the pose is right, with twice the expected false detections: a map grows old."""
    displaced: Shares = (0.10, 0.80, 0.10)
    """Shares if the robot is elsewhere on the map: a wrong landmark in the gate looks right now and then; see `of`."""
    off_map: Shares = (0.03, 0.12, 0.85)
    """Shares if the robot is off the map: floors look alike somewhere."""
    displacement_rate: float = 1e-3
    """Rate at which a right pose becomes wrong, 1/s."""
    leaving_rate: float = 3e-5
    """Rate at which the robot leaves the map, 1/s."""
    blinding_rate: float = 1e-3
    """Rate at which the robot stops seeing anything, 1/s."""
    trust: float = 0.5
    """Part of the expected number of recognised landmarks that counts."""
    recovery_rate: float = 1e-3
    """Rate at which a wrong pose becomes right by itself, 1/s."""
    gate: float = 9.21
    """Gate of the normalised innovation squared of a match."""
    scale: float = 1.5
    """Mean of half the normalised innovation squared of a right pose."""
    most: float = 4.0
    """Largest logarithm of the likelihood ratio of one frame, nats."""
    threshold: float = 0.9
    """Probability from which the pose counts as lost."""
    memory_s: float = 3.0
    """Time constant of the counts in the reason, s."""

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
    """Probabilities of the hypotheses, and recent counts of detections."""

    right: float = 1.0
    """Probability that the robot is at its believed place."""
    displaced: float = 0.0
    """Probability that it is elsewhere on the map."""
    off_map: float = 0.0
    """Probability that it is off the map."""
    blind: float = 0.0
    """Probability that nothing is seen where landmarks should be: a dark camera, or a wrong pose."""
    recent: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0))
    """Detections here, elsewhere, strange, older ones counted less."""

    missed: float = 0.0
    """Landmarks that were expected of late and not recognised."""

    @property
    def probability(self) -> float:
        """Probability that the believed pose is wrong and landmarks show it."""
        return self.displaced + self.off_map

    @property
    def doubt(self) -> float:
        """Probability that the pose is wrong or that nothing is seen."""
        return self.displaced + self.off_map + self.blind

    def reason(self, model: LostModel) -> str:
        """Return the reason why the pose is uncertain, in words; empty if it is not."""
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
    """Return the number of landmarks in the footprint at a pose, x, y in m and heading in rad, frame map."""
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
    """Return the evidence of a frame for and against the believed pose.

    A detection with several alike landmarks in its gate counts as here; one that no rigid motion explains does not
    count.

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
    """Return the state dt s later without a frame: probabilities follow the rates, counts fade.

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
    """Return the log density ratio of a match's nis under a right pose and a wrong one, within +- ln 3."""
    s = 2.0 * model.scale
    inside = 1.0 - math.exp(-model.gate / s)
    ratio = math.log(model.gate / (s * inside)) - nis / s
    return max(-math.log(3.0), min(math.log(3.0), ratio))
