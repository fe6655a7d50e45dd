"""Localisation in the map: odometry and frames of the camera feed the tracker, whose belief is checked."""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from surefoot.arrays import Array
from surefoot.schemas.hw import LandmarkDetections
from surefoot.schemas.navigation import PoseBelief
from surefoot.schemas.state import Odometry

from .belief.elsewhere import OtherPlaces
from .belief.gate import OUTLIER
from .belief.landmarks import FloorLandmarks
from .belief.lost import (
    Footprint,
    FrameEvidence,
    LostModel,
    LostState,
    echoed,
    evidence_of,
    in_view,
    normalised,
    observed,
    passed,
)
from .belief.matching import DetectionError, Detections, SightNoise
from .belief.moved import MovedLandmarks, Sight
from .belief.relocalise import Relocaliser, Relocation, between, placed
from .belief.strain import DISPLACED, STRAINED, MapStrain, turned_back
from .belief.tracker import Control, FrameResult, Motion, PoseTracker, StartUncertainty
from .belief.ukf import Pose, wrap
from .catalogue import errors_of
from .config import NavigatorConfig
from .goals import GaitView
from .messages import LostView, camera_words, pose_message
from .policy.arrays import PER_10CM
from .policy.params import NavigationModel

ODOMETRY_S = 0.1
"""Least interval between two odometry messages that the filter uses, s; messages between them are skipped."""
SMOOTH = 0.1
"""Weight, 0 to 1, of a new normalised innovation squared in its exponential running mean."""
RESTART_SD = (0.10, 0.15)
"""Standard deviations added to position, m, and heading, rad, after a restart of the service."""
WORK = 16_000
"""Work per tick of the search for a lost pose, in sightings compared with a pose or pairs tried: about 0.5 ms."""
WIDEN, WIDER, WIDENED_S = 0.5, 3.0, 10.0
"""`WIDEN`: probability of a misfit above which the belief is widened; `WIDER`: factor on its standard deviations then;
`WIDENED_S`: least time between two widenings, s."""
SUSPECTED_S, LOST_FRAMES, SLOWEST_S = 2.0, 2.5, 4.0
"""`SUSPECTED_S`: least time that a suspicion lasts after a frame, s; `LOST_FRAMES`: intervals between frames that it
lasts, if longer; `SLOWEST_S`: interval, s, from which on only `SUSPECTED_S` counts."""
SURE = 0.1
"""Probability of being lost below which landmarks seen at other places count as moved, not the robot."""
APART_S = 1.0
"""Least interval between two frames that are searched for another pose, s; landmarks of more frequent ones decide one
by one within a second. The first frame is always used."""
SINCE = 0.1
"""Standard deviation of the motion since a search began, as a part of the distance and of the turn, no unit."""
LATE_S, AHEAD_S = 0.2, 0.02
"""`LATE_S`: age above which a frame is refused, s: two camera periods; `AHEAD_S`: time ahead of the clock above which a
frame is refused, s: two ticks."""


class Localiser:
    """Estimator of the robot's pose in the map, updated with messages from the bus.

    Args:
        config: start pose, m and rad, frame map, and what moves the belief: commands or odometry.
        model: numbers of the robot.
        log: takes level and text; None = nothing is logged.
    """

    def __init__(
        self, config: NavigatorConfig, model: NavigationModel, log: Callable[[str, str], None] | None = None
    ) -> None:
        self._log = log
        sight, share = model.sight, model.sight.standing_share
        noise = SightNoise(sight.range_sd, sight.range_sd_share, math.radians(sight.bearing_sd_deg))
        standing = noise.wider(share)
        start = StartUncertainty(
            model.filter.position_sd,
            math.radians(model.filter.heading_sd_deg),
            math.radians(model.drift.known_sd_deg) * PER_10CM if config.control == "commands" else 0.05,
        )
        shared = errors_of(model, sway=config.control == "commands")
        self.tracker = PoseTracker(start, noise, standing, shared)
        self.tracker.place((config.start_x, config.start_y, config.start_yaw))
        self.strain = self.tracker.strain = MapStrain(shared)
        self.camera_turn = (0.0, 0.0, 0.0)
        """Estimated pitch, roll and sideways turn of the camera from its stated mounting, rad; frames are turned back
        by it."""
        self._world: FloorLandmarks | None = None
        """Landmark map that the last frame was matched with; None = no frame yet."""
        self.control: Control = config.control
        self._odometry = model.odometry
        self._message: Odometry | None = None
        self.odom: Pose | None = None
        """Last odometry pose, x, y (m) and yaw (rad), frame odom; None = none received."""
        self._taken: Pose | None = None
        self._taken_at = 0.0
        self.matched, self.nis = 0, None
        self.refused = Counter[str]()
        """Number of refused camera frames by error code."""
        self._seen_at, self._interval = -math.inf, math.inf  # of the last frame, and from that before, s
        self.lost = LostView()
        self.footprint = Footprint(sight.range_min, sight.range_max, math.radians(sight.half_angle_deg))
        self.lost_model, self._suspect = LostModel(), model.conduct.suspect
        self._lost_state, self._lost_at = LostState(), 0.0
        self._shares = (_share(model, "walk"), _share(model, "stand"))
        self._relocaliser: Relocaliser | None = None
        self._found: Relocation | None = None
        self._moved: MovedLandmarks | None = None
        self._elsewhere: OtherPlaces | None = None
        self._widened_at = -math.inf
        self.relocated = 0
        """Number of times that a lost pose was found again."""

    def place(self, pose: Pose, cov: Array | None = None) -> None:
        """Restart the estimate at a stated pose; the estimated drift (heading error per metre walked) stays.

        `pose`: x, y (m), heading (rad), frame map; `cov`: its covariance, (3, 3); None = that of the start.
        """
        self._take_odometry(self._taken_at, force=True)
        self.tracker.place(pose, cov, keep_drift=True)
        self._trust()

    def _trust(self) -> None:
        self.nis = None
        self._lost_state, self.lost = LostState(), LostView()
        self._relocaliser = self._found = None
        if self._elsewhere is not None:
            self._elsewhere.begin()

    @property
    def map_from_odom(self) -> Pose:
        """Pose of frame odom in frame map, x, y (m) and heading (rad)."""
        return (0.0, 0.0, 0.0) if self.odom is None else between(self.tracker.pose, self.odom)

    def resume(self, pose: Pose, cov: Array, odom: Pose | None, now: Pose | None) -> None:
        """Continue from the belief before a restart, moved by the odometry since.

        Args:
            pose: believed x, y (m), heading (rad) then, frame map.
            cov: covariance of `pose`, (3, 3).
            odom, now: odometry then and now, x, y (m), heading (rad), frame odom; None = there was or is none.
        """
        if odom is not None and now is not None:
            pose = placed(between(pose, odom), now)
        self.odom = self._taken = now
        more = np.diag([RESTART_SD[0] ** 2, RESTART_SD[0] ** 2, RESTART_SD[1] ** 2])
        self.tracker.place(pose, cov + more)

    # -- odometry ----------------------------------------------------------------------------------------------

    def odometry(self, message: Odometry, now: float) -> None:
        """Update the pose by an odometry message at `now`, s; one that corrects the past moves odom, not the robot."""
        before, self._message = self._message, message
        was, self.odom = self.odom, (*message.position[:2], message.yaw)
        if self._taken is None:
            self._taken, self._taken_at = self.odom, now
        elif before is not None and was is not None and message.corrects(before):
            self._taken = placed(between(self.odom, was), self._taken)
        elif now - self._taken_at >= ODOMETRY_S - 1e-6:
            self._take_odometry(now)

    def _take_odometry(self, now: float, *, force: bool = False) -> None:
        if self.odom is None or self._taken is None or (self.odom == self._taken and not force):
            return
        before, after = self._taken, self.odom
        dt, self._taken, self._taken_at = max(0.0, now - self._taken_at), after, now
        if self.control == "commands":
            return
        dx, dy, turn = after[0] - before[0], after[1] - before[1], float(wrap(after[2] - before[2]))
        middle = before[2] + 0.5 * turn
        c, s = math.cos(middle), math.sin(middle)
        forward, left = c * dx + s * dy, c * dy - s * dx
        way, noise = math.hypot(dx, dy), self._odometry
        beside = noise.along**2 * way * 0.1 + noise.still**2 * dt
        self.tracker.move(
            Motion(
                forward, left, turn, abs(forward),
                along=beside,
                across=beside,
                heading=noise.turn**2 * way + noise.still_turn**2 * dt,
            )
        )  # fmt: skip

    # -- sight -------------------------------------------------------------------------------------------------

    def look(self, frame: LandmarkDetections, gait: GaitView, now: float, match: float | None = None) -> None:
        """Correct and check the believed pose with one frame of the camera.

        Args:
            frame: landmarks; its stamp is the end of the exposure.
            gait: state of the walker: a standing robot sees with less noise.
            now: simulated time, s.
            match: share of the landmarks in view that the action under way recognises; None = the least of the model.

        Raises:
            DetectionError: a frame that is late, of the future or a repetition, descriptors of another length than the
                map's, or of different lengths.
        """
        time, standing = frame.stamp_ns * 1e-9, gait.state == "standing"
        try:
            self._check_time(time, now)
            self._take_odometry(time)
            cov, world = self.tracker.cov.copy(), self.tracker.world
            if world is not self._world:  # what was found by another map holds no more
                self._world, self.camera_turn = world, (0.0, 0.0, 0.0)
                self._moved = None if world is None else MovedLandmarks(world)
                self._elsewhere = None if world is None else OtherPlaces(world, self.tracker.standing)
                self._lost_state = replace(self._lost_state, usual=LostState().usual)
                self.strain.begin()
            seen = turned_back(detections(frame), self.camera_turn, self.tracker.shared.height)
            noise = self.tracker.standing if standing else self.tracker.noise
            sight, sure = Sight(self.tracker.pose, cov, noise, time), self._lost_state.probability < SURE
            if world is not None and self._lost_state.probability < self.lost_model.threshold:
                self.strain.look(seen, world, sight.pose, cov, noise, time)
            found = self.tracker.look(seen, time, standing=standing, trusted=not self.lost.lost)
        except DetectionError as error:
            self.refused[error.code] += 1
            raise
        self.matched = found.matched
        if found.matched:
            self.nis = found.nis if self.nis is None else self.nis + SMOOTH * (found.nis - self.nis)
        if self._moved is not None and found.matches is not None:
            sure = sure and not self.lost.lost
            found = replace(found, matches=self._moved.left_out(found.matches, seen, sight, sure=sure))
        if self._elsewhere is not None and found.matches is not None and APART_S <= self._interval < math.inf:
            left = found.matches.fates != OUTLIER
            kept = Detections(seen.ranges[left], seen.bearings[left], seen.looks[left])
            if len(kept) and not self.lost.lost:
                self._elsewhere.look(kept, sight, self.tracker.pose)
        share = self._shares[standing] if standing or match is None else match
        self._check(seen, found, cov, time, share, standing=standing)
        self._turn_camera()

    def _turn_camera(self) -> None:
        """Turn the next frames back by the camera's turn if the landmarks show one; the belief is widened by it."""
        found = self.strain.sure_turn
        if found is not None:
            before = self.camera_turn
            self.camera_turn = (before[0] + found[0], before[1] + found[1], before[2] + found[2])
            self.tracker.loosen(math.hypot(found[0], found[1]), found[2])
            self.strain.begin()
            if self._log is not None:
                self._log("warning", camera_words(self.camera_turn))

    def _check_time(self, time: float, now: float) -> None:
        """Refuse a frame that is too old, in the future, or not newer than the last; its time: `time`, s.

        Raises:
            DetectionError: the frame is of the future, late, or was used before.
        """
        if time > now + AHEAD_S:
            raise DetectionError("future", f"a frame of {time:.3f} s came at {now:.3f} s", "stamp_ns")
        if time < now - LATE_S:
            text = f"a frame may be {LATE_S:g} s old, got one of {time:.3f} s at {now:.3f} s"
            raise DetectionError("late", text, "stamp_ns")
        if time <= self._seen_at:
            raise DetectionError("repeated", f"the frame of {time:.3f} s came again", "stamp_ns")
        self._interval, self._seen_at = time - self._seen_at, time

    def _check(
        self, seen: Detections, found: FrameResult, cov: Array, time: float, share: float, *, standing: bool
    ) -> None:
        """Check the belief by a frame; if it is wrong, search for the pose while the robot stands.

        Args:
            seen: detections of the frame.
            found: matches of the detections.
            cov: of the belief before the frame, x, y (m), heading (rad) first, (n, n).
            time: time of the frame, s.
            share: share of landmarks in view that are recognised, 0 to 1.
            standing: the robot stands.
        """
        world = self.tracker.world
        if world is None:
            return
        expected = share * in_view(world, self.tracker.pose, self.footprint)
        evidence = FrameEvidence(expected=expected)
        if found.matches is not None:
            noise = self.tracker.standing if standing else self.tracker.noise
            evidence = evidence_of(found.matches, cov, seen, world, noise, expected)
        state = passed(self._lost_state, max(0.0, time - self._lost_at), self.lost_model)
        self._lost_state, self._lost_at = observed(state, evidence, self.lost_model), time
        if self._lost_state.misfit > WIDEN and time - self._widened_at > WIDENED_S and not self.lost.lost:
            # a belief surer than its errors, until it does not fit even so
            self._widened_at = time
            self.tracker.widen(WIDER)
            self._lost_state = normalised(replace(self._lost_state, misfit=0.0))
        strain = self.strain
        strained, displaced = (strain.probabilities[case] for case in (STRAINED, DISPLACED))
        other = 0.0 if self._elsewhere is None else self._elsewhere.probability
        probability = 1.0 - (1.0 - self._lost_state.probability) * (1.0 - strained - displaced) * (1.0 - other)
        if probability >= self.lost_model.threshold or self.lost.lost:
            words = {
                self._lost_state.probability: self._lost_state.words,
                strained: strain.words,
                displaced: strain.way,
                other: "the landmarks seen of late lie together as at another place of the map",
            }
            reason = self._lost_state.reason(self.lost_model) or strain.reason or self.lost.reason
            reason = reason or words[max(words)]
            self.lost = LostView(lost=True, probability=max(probability, self.lost_model.threshold), reason=reason)
            if standing and len(seen) and strained < 0.5:  # else no pose fits the map
                self._remember(seen, world, time)
        else:
            suspected = probability - self._lost_state.blind > self._suspect
            stays = max(SUSPECTED_S, LOST_FRAMES * self._interval) if self._interval < SLOWEST_S else SUSPECTED_S
            until = time + stays if suspected else -math.inf
            self.lost = LostView(False, probability, self._lost_state.reason(self.lost_model), until)

    def echo(self, distance: float, expected: tuple[float, float], slack: float, now: float) -> None:
        """Check the believed pose with one echo of the ranger.

        Args:
            distance: distance of the echo, or the end of the reach, m.
            expected: least and largest of it by the map at the believed pose, as far as its heading is known, m.
            slack: difference from these that still counts as agreement, m.
            now: simulated time, s.
        """
        if self.tracker.world is None or self.lost.lost:
            return
        state = passed(self._lost_state, max(0.0, now - self._lost_at), self.lost_model)
        self._lost_state = echoed(state, distance, expected, slack, self.lost_model)
        self._lost_at = max(self._lost_at, now)

    def _remember(self, seen: Detections, world: FloorLandmarks, time: float) -> None:
        if self._relocaliser is None or self._relocaliser.world is not world:
            self._relocaliser = Relocaliser(world, self.tracker.standing)
        self._relocaliser.add(seen, self.tracker.pose, time)

    def search(self, *, standing: bool) -> None:
        """Do one tick's share of the search for a lost pose, if the robot stands; a pose found becomes the estimate."""
        relocaliser, here = self._relocaliser, self.tracker.pose
        if relocaliser is None or not standing or not self.lost.lost:
            return
        result = relocaliser.step(here, WORK)
        self._found = result or self._found
        if result is None or result.pose is None:
            return
        moved, cov = _relative(here, result.reference), result.covariance.copy()
        way = math.hypot(moved[0], moved[1])
        cov[[0, 1], [0, 1]] += way * way * (cov[2, 2] + SINCE**2)
        cov[2, 2] += (SINCE * moved[2]) ** 2
        self.tracker.place(placed(result.pose, moved), cov, keep_drift=True)
        self._trust()
        self.relocated += 1

    @property
    def alike(self) -> tuple[Pose, ...]:
        """Poses of a lost robot now that are about equally likely, x, y (m), heading (rad), frame map; empty = none."""
        if self._found is None or not self.lost.lost:
            return ()
        moved = _relative(self.tracker.pose, self._found.reference)
        return tuple(placed(pose, moved) for pose in self._found.alike)

    def message(self, now: float, *, ready: bool) -> PoseBelief:
        """Return the belief at `now`, s, as a message; `ready` = the estimator is calibrated, goals are accepted."""
        self._take_odometry(now)
        return pose_message(self.tracker, self.odom, self.control, self.matched, self.nis, self.lost, ready)


def _share(model: NavigationModel, kind: str) -> float:
    """Return the least share of landmarks in view that a frame recognises in actions of a kind; 0 = no action."""
    return min((action.match for action in model.actions.values() if action.kind == kind), default=0.0)


def _relative(pose: Pose, here: Pose) -> Pose:
    """Return a pose, x, y (m) and heading (rad), as seen from another pose `here` of the same frame."""
    c, s = math.cos(here[2]), math.sin(here[2])
    dx, dy = pose[0] - here[0], pose[1] - here[1]
    return (c * dx + s * dy, c * dy - s * dx, float(wrap(pose[2] - here[2])))


def detections(frame: LandmarkDetections) -> Detections:
    """Return a frame's landmarks as arrays: ranges (m), bearings (rad) from base_link, descriptors.

    Raises:
        DetectionError: descriptors of different lengths.
    """
    marks = frame.landmarks
    lengths = {len(mark.descriptor) for mark in marks}
    if len(lengths) > 1:
        raise DetectionError(
            "bad_descriptor", f"all descriptors of a frame have one length, got {sorted(lengths)}", "descriptor"
        )
    k = lengths.pop() if lengths else 0
    return Detections(
        np.array([mark.range for mark in marks], dtype=np.float64),
        np.array([mark.bearing for mark in marks], dtype=np.float64),
        np.array([mark.descriptor for mark in marks], dtype=np.float64).reshape(len(marks), k),
    )
