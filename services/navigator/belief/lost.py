"""Check of the believed pose: a filter over five hypotheses, updated with matched detections and ranger echoes.

The robot is where it is believed to be ("right"), elsewhere on the map ("displaced"), on a map that does not fit the
floor ("misfit": stretched, or a belief surer than its errors), where the map does not reach ("off_map"), or nothing is
seen where landmarks should be ("blind": a dark camera, a wall, a hole). Every detection is one of three: it belongs
*here* (a landmark in its gate looks like it), *elsewhere* (only landmarks out of its gate do), or it is *strange* (no
landmark does). The hypotheses give them different shares; a frame multiplies their probabilities by its likelihood,

    p_h <- p_h prod_d share_h(d) prod_matches f_h(nis),    and p <- p exp(rates dt) between frames.

With m similar landmarks on A m^2 and a gate of G m^2, chance puts one into the gate of a displaced robot with
c = 1 - exp(-m G / A): its share of here is `least + (whole - least) c`. f_right is an exponential density (chi^2_2 with
`scale`), f_misfit a wider one, f of the others uniform over the gate. The likelihood ratio of a frame is bounded,
because errors are common to a frame; frames far apart share fewer. With E landmarks expected to be recognised,
P(none) = exp(-E `trust`) unless the robot is blind. Lost is 1 - p_right above a threshold.
"""

import math
from dataclasses import dataclass, field, replace

from surefoot.arrays import Array
from surefoot.errors import Refusal

from . import association
from .gate import FAR, INVALID, OUTLIER, UNLIKE
from .landmarks import FloorLandmarks
from .matching import Detections, Matches, SightNoise, gate_areas, look_alikes

Shares = tuple[float, float, float]
"""Shares of three classes of detections or echoes; they add up to 1. Detections: here (like a landmark in the gate),
elsewhere (only like landmarks outside the gate), strange (like no landmark)."""


@dataclass(frozen=True)
class FrameEvidence:
    """Detections of one frame counted by what they show of the believed pose."""

    here: int = 0
    """Number of detections that resemble a landmark in the gate, i.e. near enough by the believed pose."""
    elsewhere: int = 0
    """Number of detections that only resemble landmarks outside the gate of the believed pose."""
    strange: int = 0
    """Number of detections that resemble no landmark of the map."""
    nis: tuple[float, ...] = ()
    """Normalised innovation squared of each matched detection, 2 degrees of freedom."""
    expected: float = 0.0
    """Expected number of recognised landmarks if the pose is right; 0 = unknown."""
    chances: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())
    """Probabilities that chance puts a similar landmark into a displaced robot's gate: of detections in the gate, of
    those outside; empty = the model's share for all."""


@dataclass(frozen=True)
class Footprint:
    """Part of the floor that a camera sees: a sector about the heading of base_link."""

    nearest: float = 0.35
    """Least distance of visible floor from base_link, m."""
    farthest: float = 1.18
    """Largest distance of visible floor from base_link, m."""
    half_angle: float = math.radians(33.0)
    """Half the opening angle of the visible sector of floor, to either side of the heading, rad."""


@dataclass(frozen=True)
class LostModel:
    """Numbers of the check whether the believed pose is wrong: shares and rates of its hypotheses.

    The hypotheses are that the pose is right, that the robot was displaced, that the map does not fit, that the robot
    is off the map, and that it sees nothing. Each expects shares of detections here (a landmark near enough by the
    believed pose looks like it), elsewhere (only landmarks farther off do) and strange (none does). The shares of a
    hypothesis are positive and add up to 1, rates are positive; neither is checked.
    """

    right: Shares = (0.72, 0.20, 0.08)
    """Prior shares of detections (in the gate, only outside, unlike any landmark) if the pose is right. They allow for
    twice the expected false detections: a map grows old."""
    weight: float = 40.0
    """Weight of the prior shares beside those observed: they count as this number of detections."""
    remembered: float = 400.0
    """Largest number of observed detections that count in the shares of a right pose; older ones count less."""
    fewest: tuple[float, float] = (0.06, 0.02)
    """Lower bounds of a right pose's shares of detections like landmarks outside the gate only, and like none."""
    sure: float = 0.03
    """Probability of being lost above which detections do not update the shares of a right pose."""
    displaced: Shares = (0.10, 0.80, 0.10)
    """Shares of detections (in the gate, only outside, unlike any landmark) if the robot is elsewhere on the map: a
    wrong landmark in the gate looks right now and then."""
    misfit: Shares = (0.62, 0.33, 0.05)
    """Shares of detections (in the gate, only outside, unlike any landmark) if the map does not fit: matches with large
    innovations, and some outside the gate."""
    off_map: Shares = (0.03, 0.12, 0.85)
    """Shares of detections (in the gate, only outside, unlike any landmark) if the robot is off the map: floors look
    alike somewhere."""
    displacement_rate: float = 1e-3
    """Rate at which a robot with a right pose is displaced to elsewhere on the map, 1/s."""
    misfit_rate: float = 1e-3
    """Rate at which the map, or the covariance of the belief, stops fitting, 1/s."""
    leaving_rate: float = 3e-5
    """Rate at which the robot leaves the map, 1/s."""
    blinding_rate: float = 1e-3
    """Rate at which the camera stops seeing anything, 1/s."""
    trust: float = 0.5
    """Factor t in P(no landmark recognised | right pose) = exp(-t E) for E expected landmarks, no unit."""
    recovery_rate: float = 1e-3
    """Rate at which a wrong pose becomes right by itself, 1/s."""
    gate: float = 9.21
    """Largest normalised innovation squared of a match, 2 degrees of freedom: chi^2_2(.99)."""
    scale: float = 1.2
    """Mean of half the normalised innovation squared of matches if the pose is right, no unit."""
    misfit_scale: float = 4.0
    """Mean of half the normalised innovation squared of matches if the map does not fit, no unit."""
    most: float = 4.0
    """Bound on the log likelihood ratio of a frame 0.1 s after the last one, nats: frames so close share errors."""
    most_apart: float = 8.0
    """Bound on the log likelihood ratio of a frame 1 s or more after the last one, nats."""
    whole: float = 0.82
    """Share of detections in the gate for a displaced robot if chance always puts a similar landmark there, 0 to 1."""
    echoes: Shares = (0.90, 0.08, 0.02)
    """Shares of ranger echoes if the pose is right: as by the map, nearer (an unknown obstacle), farther."""
    echoes_displaced: Shares = (0.40, 0.30, 0.30)
    """Shares of ranger echoes if the robot is displaced: as by the map, nearer, farther."""
    echo_most: float = 3.0
    """Bound on the log likelihood ratio of all ranger echoes together, nats: alone they never decide."""
    echo_s: float = 1.0
    """Least time between two ranger echoes that count, s; echoes between them are ignored."""
    threshold: float = 0.9
    """Probability of a wrong pose from which on the robot counts as lost."""
    memory_s: float = 3.0
    """Time constant of the detection counts from which the reason of a wrong pose is worded, s."""


@dataclass(frozen=True)
class LostState:
    """State of the check whether the believed pose is wrong: probabilities of its hypotheses, counts of detections."""

    right: float = 1.0
    """Probability that the robot is where it is believed to be."""
    displaced: float = 0.0
    """Probability that the robot is elsewhere on the map than believed."""
    off_map: float = 0.0
    """Probability that the robot is off the map."""
    blind: float = 0.0
    """Probability that the camera sees nothing where landmarks should be: dark, a wall, a hole."""
    misfit: float = 0.0
    """Probability that the map does not fit the floor, or that the covariance is smaller than the pose's errors."""
    recent: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0))
    """Number of recent detections in the gate, only like landmarks outside it, unlike any; older ones count less."""
    missed: float = 0.0
    """Number of landmarks that were expected recently and not recognised; older ones count less."""
    apart: float = 0.0
    """Time since the last frame of detections, s."""
    usual: Shares = (0.0, 0.0, 0.0)
    """Number of detections, while the pose counted as right, in the gate, only like landmarks outside it, unlike any;
    older ones count less."""
    echo: tuple[float, float] = (0.0, math.inf)
    """Log likelihood ratio of "displaced" over "right" by the ranger echoes so far, nats, bounded; time since the last
    counted echo, s."""

    @property
    def probability(self) -> float:
        """Probability that the belief is wrong or nothing is seen where it should be."""
        return self.displaced + self.off_map + self.misfit + self.blind

    def reason(self, model: LostModel) -> str:
        """Return the reason why the pose is uncertain, in words; empty if it is not."""
        return self.words if self.probability >= model.threshold else ""

    @property
    def words(self) -> str:
        """Text on the most probable hypothesis under which the believed pose is wrong, whatever its probability."""
        here, elsewhere, strange = (round(value) for value in self.recent)
        total = here + elsewhere + strange
        texts = {
            self.displaced: f"{elsewhere} of about {total} landmarks seen of late belong elsewhere on the map",
            self.misfit: f"about {total} landmarks seen of late lie farther from their places than the belief allows",
            self.off_map: f"{strange} of about {total} landmarks seen of late are not on the map",
            self.blind: f"nothing is seen where about {round(self.missed)} landmarks should have been recognised",
        }
        return texts[max(texts)]


def in_view(world: FloorLandmarks, pose: tuple[float, float, float], footprint: Footprint) -> int:
    """Return the number of landmarks in the footprint at a pose, x, y in m and heading in rad, frame map."""
    return association.in_view(
        world.positions, pose[0], pose[1], pose[2], footprint.nearest, footprint.farthest, footprint.half_angle
    )


def evidence_of(
    matches: Matches,
    cov: Array,
    seen: Detections,
    world: FloorLandmarks,
    noise: SightNoise,
    expected: float = 0.0,
) -> FrameEvidence:
    """Return the evidence of a frame for and against the believed pose.

    A detection that looks like several landmarks in its gate counts as here; one that no rigid motion of the others
    explains, or of impossible range, does not count.

    Args:
        matches: matches of the frame at the believed pose.
        cov: covariance of that pose, x, y (m), heading (rad), (3, 3) or larger.
        seen: landmarks detected in the frame.
        world: landmarks of the map.
        noise: standard deviations of range, bearing and descriptor.
        expected: landmarks in view there times the share that is recognised in this action; 0 = not known.
    """
    counts = matches.counts
    here = counts["matched"] + counts["surplus"] + counts["doubled"] + counts["ambiguous"]
    away = counts["far"] + counts["unlike"]
    alike = look_alikes(matches, seen, world, noise)
    many = (alike * gate_areas(cov, seen, noise) / world.area).tolist()
    chances = [1.0 - math.exp(-each) for each in many]  # numpy's own exponential depends on the processor
    found: tuple[list[float], list[float]] = ([], [])
    for fate, chance, count in zip(matches.fates.tolist(), chances, alike.tolist(), strict=True):
        if fate not in (INVALID, OUTLIER) and count > 0:
            found[fate in (FAR, UNLIKE)].append(chance)
    elsewhere = len(found[1])
    chosen = (tuple(found[0]), tuple(found[1])) if len(found[0]) == here else ((), ())
    return FrameEvidence(here, elsewhere, away - elsewhere, tuple(matches.nis.tolist()), expected, chosen)


def passed(state: LostState, dt: float, model: LostModel) -> LostState:
    """Return the state of the check `dt` s later without a frame: probabilities follow the rates, counts fade.

    `state`: before; `model`: rates and time constant.

    Raises:
        Refusal: dt is negative or not finite.
    """
    if not (math.isfinite(dt) and dt >= 0.0):
        raise Refusal("bad_time", f"dt is finite and >= 0 s, got {dt!r}", "dt")
    leave = 1.0 - math.exp(-model.displacement_rate * dt)
    vanish = 1.0 - math.exp(-model.leaving_rate * dt)
    back = 1.0 - math.exp(-model.recovery_rate * dt)
    dim = 1.0 - math.exp(-model.blinding_rate * dt)
    warp = 1.0 - math.exp(-model.misfit_rate * dt)
    displaced = state.displaced * (1.0 - back) + state.right * leave
    off_map = state.off_map * (1.0 - back) + state.right * vanish
    blind = state.blind * (1.0 - back) + state.right * dim
    misfit = state.misfit * (1.0 - back) + state.right * warp
    fade = math.exp(-dt / model.memory_s)
    recent = (state.recent[0] * fade, state.recent[1] * fade, state.recent[2] * fade)
    right = max(0.0, 1.0 - displaced - off_map - blind - misfit)
    total = state.echo[0]
    if total < 0.0:  # what echoes took from a displaced robot, the rate gives back
        given = displaced * state.right / max(state.displaced * right, 1e-300)
        total = min(0.0, total + math.log(max(1.0, given)))
    echo = (total, state.echo[1] + dt)
    return replace(
        state, right=right, displaced=displaced, off_map=off_map, blind=blind, misfit=misfit, recent=recent,
        missed=state.missed * fade, apart=state.apart + dt, echo=echo,
    )  # fmt: skip


def observed(state: LostState, frame: FrameEvidence, model: LostModel) -> LostState:
    """Return the state of the check whether the pose is lost after one more frame of detections.

    The logarithm of a likelihood ratio counts at most `model.most` nats 0.1 s after the last frame, `model.most_apart`
    nats after 1 s or more, and evenly between.

    Args:
        state: probabilities of the hypotheses before the frame, and counts.
        frame: detections of the frame, counted by what they show of the believed pose.
        model: shares, rates and limits of the check.
    """
    far = min(1.0, max(0.0, (state.apart - 0.1) / 0.9))
    most = model.most + far * (model.most_apart - model.most)
    usual = shares_of(state, model)
    odds = [share * misfit / right for share, misfit, right in zip(usual, model.misfit, model.right, strict=True)]
    whole = math.fsum(odds)
    strained = (odds[0] / whole, odds[1] / whole, odds[2] / whole)
    right = _log_likelihood(usual, frame) + _nis_logs(frame.nis, model.scale, model)
    misfit = _log_likelihood(strained, frame) + _nis_logs(frame.nis, model.misfit_scale, model)
    flat = -len(frame.nis) * math.log(model.gate)
    others = (_displaced_log(frame, model) + flat, _log_likelihood(model.off_map, frame) + flat, misfit)
    factors = [math.exp(max(-most, min(most, other - right))) for other in others]
    displaced, off_map, misfit = state.displaced * factors[0], state.off_map * factors[1], state.misfit * factors[2]
    count = frame.here + frame.elsewhere + frame.strange
    expected = model.trust * frame.expected
    blind = state.blind * (math.exp(min(most, expected)) if count == 0 else math.exp(-most))
    recent = (state.recent[0] + frame.here, state.recent[1] + frame.elsewhere, state.recent[2] + frame.strange)
    missed = state.missed + max(0.0, frame.expected - count)
    found = replace(
        state, displaced=displaced, off_map=off_map, blind=blind, misfit=misfit, recent=recent, missed=missed,
        apart=0.0, usual=_counted(state, frame, model),
    )  # fmt: skip
    return normalised(found)


def shares_of(state: LostState, model: LostModel) -> Shares:
    """Return the expected shares of detections here, elsewhere and strange if the believed pose is right.

    Here: a landmark in the gate looks like the detection; elsewhere: only landmarks out of it do; strange: none does.
    The last two are the model's shares, or less where detections of a right pose have shown less.
    """
    total = model.weight + math.fsum(state.usual)
    found = [(model.weight * share + count) / total for share, count in zip(model.right, state.usual, strict=True)]
    away = min(model.right[1], max(model.fewest[0], found[1]))
    strange = min(model.right[2], max(model.fewest[1], found[2]))
    return (1.0 - away - strange, away, strange)


def _counted(state: LostState, frame: FrameEvidence, model: LostModel) -> Shares:
    """Return `usual` of `LostState` after one more frame of detections; unchanged if the pose may be wrong."""
    if state.probability > model.sure:
        return state.usual
    here, away, strange = state.usual
    here, away, strange = here + frame.here, away + frame.elsewhere, strange + frame.strange
    keep = min(1.0, model.remembered / max(1.0, here + away + strange))
    return (keep * here, keep * away, keep * strange)


def echoed(
    state: LostState, distance: float, expected: tuple[float, float], slack: float, model: LostModel
) -> LostState:
    """Return the state of the check whether the pose is lost after one echo of the ranger.

    An echo less than `model.echo_s` after the last one that counted is ignored.

    Args:
        state: before the echo.
        distance: distance of the echo, or the end of the reach, m.
        expected: least and largest of it by the map at the believed pose, as far as its heading is known, m.
        slack: difference from these that still counts as agreement, m.
        model: shares of echoes that are as by the map, nearer, farther.
    """
    if state.echo[1] < model.echo_s:
        return state
    kind = 1 if distance < expected[0] - slack else 2 if distance > expected[1] + slack else 0
    ratio = math.log(model.echoes_displaced[kind] / model.echoes[kind])
    total = max(-model.echo_most, min(model.echo_most, state.echo[0] + ratio))
    changed = state.displaced * math.exp(total - state.echo[0])
    return normalised(replace(state, displaced=changed, echo=(total, 0.0)))


def normalised(state: LostState) -> LostState:
    """Return the state with probabilities that add up to 1."""
    total = state.right + state.displaced + state.off_map + state.blind + state.misfit
    return replace(
        state, right=state.right / total, displaced=state.displaced / total, off_map=state.off_map / total,
        blind=state.blind / total, misfit=state.misfit / total,
    )  # fmt: skip


def _displaced_log(frame: FrameEvidence, model: LostModel) -> float:
    """Return the log likelihood, nats, of the detections of a frame for a displaced robot."""
    if not frame.chances[0] and not frame.chances[1]:
        return _log_likelihood(model.displaced, frame)
    least, _, strange = model.displaced
    total = frame.strange * math.log(strange)
    for kind, chances in enumerate(frame.chances):
        for chance in chances:
            here = least + (model.whole - least) * chance
            total += math.log(1.0 - strange - here if kind else here)
    return total


def _log_likelihood(shares: Shares, frame: FrameEvidence) -> float:
    here, elsewhere, strange = (math.log(share) for share in shares)
    return frame.here * here + frame.elsewhere * elsewhere + frame.strange * strange


def _nis_logs(nis: tuple[float, ...], scale: float, model: LostModel) -> float:
    """Return the sum of the log densities of matches' normalised innovations squared in the gate, no unit.

    Each is within ln 3 of the uniform one. `scale`: mean of half of an innovation squared under the hypothesis.
    """
    s = 2.0 * scale
    whole, flat, most = -math.log(s * (1.0 - math.exp(-model.gate / s))), -math.log(model.gate), math.log(3.0)
    return math.fsum(flat + max(-most, min(most, whole - value / s - flat)) for value in nis)
