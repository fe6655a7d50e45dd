"""Simulated world of an episode as kernels: landmarks, motion with drift and noise, frames, walls, goal, belief.

The arrays of an episode are changed in place. The policy sees the belief and whether the robot is blocked; the truth
decides about walls, landmarks in view and the arrival at the goal, as in Osswald et al.
"""

import math

from surefoot.arrays import Array, Ints, Record
from surefoot.kernels.jit import row_kernel

from ..belief.ukf import DRIFT, NUISANCE, THETA, LandmarkSighting, X, Y, predict, update, wrap
from ..policy import arrays as slots
from ..policy.arrays import ModelTables
from .draws import Stream, below, normal_pair, seed, uniform
from .model import BEGAN, CELL, IN_VIEW, PITCH, ROLL, EpisodeRoom, EpisodeState, squares

FLOOR, BEGIN, STEP = 1, 2, 3  # purposes of random streams


@row_kernel
def scatter(scene: Record, rng: Stream, marks: Array, first: Ints) -> None:
    """Draw the landmarks of a floor into `marks` and `first`.

    Args:
        scene: record of the scene: walls (m), landmarks per m^2.
        rng: random stream of the floor, (4,) uint64, advanced.
        marks: written: x and y of landmarks, (M, 2) m, frame map, square by square of 0.25 m.
        first: written: index of the first landmark of each square, and the number at the end, (squares + 1,).
    """
    nx, ny = squares(scene)
    floor, count = math.exp(-scene.density * CELL * CELL), 0
    for ix in range(nx):
        for iy in range(ny):
            first[ix * ny + iy] = count
            product = uniform(rng)
            while product > floor and count < marks.shape[0]:
                marks[count, 0] = scene.x_min + (ix + uniform(rng)) * CELL
                marks[count, 1] = scene.y_min + (iy + uniform(rng)) * CELL
                product *= uniform(rng)
                if marks[count, 0] <= scene.x_max and marks[count, 1] <= scene.y_max:
                    count += 1
    first[nx * ny] = count


@row_kernel
def is_blocked(scene: Record, truth: Array) -> float:
    """Return 1.0 where a wall is closer ahead than the robot's radius and the look-ahead, else 0.0.

    Args:
        scene: record of the scene: walls, radius, look-ahead, m.
        truth: true x, y (m), heading (rad), frame map, and more, (7,).
    """
    x = truth[X] + scene.look_ahead * math.cos(truth[THETA])
    y = truth[Y] + scene.look_ahead * math.sin(truth[THETA])
    r = scene.radius
    free = scene.x_min + r <= x <= scene.x_max - r and scene.y_min + r <= y <= scene.y_max - r
    return 0.0 if free else 1.0


@row_kernel
def begin(scene: Record, run: int, episode: int, state: EpisodeState) -> None:
    """Begin an episode: floor, drift and true start are drawn into `state`, its belief is that of the start.

    Args:
        scene: record of the scene, SI units, angles in rad.
        run: seed of a series of episodes.
        episode: number of the episode; seed and number determine all draws.
        state: state of the episode, overwritten.
    """
    truth, mean, cov, rng, n = state.truth, state.mean, state.cov, state.rng, state.mean.size
    seed(rng, run, episode, FLOOR)
    scatter(scene, rng, state.marks, state.first)
    seed(rng, run, episode, BEGIN)
    mean[X], mean[Y], mean[THETA] = scene.start_x, scene.start_y, scene.start_yaw
    for i in range(n):
        if i > THETA:
            mean[i] = 0.0
        for j in range(n):
            cov[i, j] = 0.0
    cov[X, X] = cov[Y, Y] = scene.start_sd**2
    cov[THETA, THETA] = scene.start_yaw_sd**2
    if n > DRIFT:
        cov[DRIFT, DRIFT] = scene.drift_known**2
    for i in range(NUISANCE, n):
        cov[i, i] = scene.tilt_sd**2
    ex, ey = normal_pair(rng)
    eh, ed = normal_pair(rng)
    r = scene.radius
    truth[X] = min(max(mean[X] + scene.start_sd * ex, scene.x_min + r), scene.x_max - r)
    truth[Y] = min(max(mean[Y] + scene.start_sd * ey, scene.y_min + r), scene.y_max - r)
    truth[THETA] = wrap(mean[THETA] + scene.start_yaw_sd * eh)
    if scene.drift_normal > 0.0:
        truth[DRIFT] = scene.drift_size * ed
    else:
        truth[DRIFT] = scene.drift_size if ed > 0.0 else -scene.drift_size
    truth[BEGAN] = truth[DRIFT]
    truth[DRIFT] = drift_at(scene, truth[BEGAN], 0.0)
    tilt_a, tilt_b = normal_pair(rng)
    truth[ROLL], truth[PITCH] = scene.tilt_sd * tilt_a, scene.tilt_sd * tilt_b
    status = state.status
    status.time = status.stands = status.turns = status.outcome = status.steps = status.way = 0.0
    status.last, status.blocked = slots.NO_ACTION, is_blocked(scene, truth)
    copy_belief(mean, cov, state.ahead_mean, state.ahead_cov)


@row_kernel
def drift_at(scene: Record, began: float, way: float) -> float:
    """Return the drift, rad per m, after a distance, by the course that the scene names.

    Args:
        scene: record of the scene; course: 0 constant, 1 other sign from half of the way on, 2 none before half of the
            way, 3 evenly to the opposite; start and goal, m.
        began: drift at the start, rad per m.
        way: distance walked so far, m.
    """
    course = int(scene.course)
    dx, dy = scene.goal_x - scene.start_x, scene.goal_y - scene.start_y
    part = min(1.0, way / math.sqrt(dx * dx + dy * dy))
    if course == 1:
        return began if part < 0.5 else -began
    if course == 2:
        return 0.0 if part < 0.5 else began
    return began * (1.0 - 2.0 * part) if course == 3 else began


@row_kernel
def copy_belief(mean: Array, cov: Array, to_mean: Array, to_cov: Array) -> None:
    """Copy a belief, mean (n,), m and rad, and covariance (n, n), into `to_mean` (n,) and `to_cov` (n, n)."""
    for i in range(mean.size):
        to_mean[i] = mean[i]
        for j in range(mean.size):
            to_cov[i, j] = cov[i, j]


@row_kernel
def tilt_gain(range_: float, bearing: float, height: float, gain: Array) -> None:
    """Write how roll and pitch errors of a camera move the range and bearing at which it sees a landmark.

    A pitch error p shifts (x, y) in the robot's heading axes by p (height + x^2 / height, x y / height), a roll error q
    by q (x y / height, height + y^2 / height).

    Args:
        range_: distance of the landmark along the floor, m.
        bearing: bearing of the landmark, rad, left of the heading positive.
        height: height of the camera above the floor, m.
        gain: written, (2, 2): columns roll, pitch; rows range (m/rad), bearing (rad/rad).
    """
    c, s = math.cos(bearing), math.sin(bearing)
    along = height + range_ * range_ / height
    gain[0, 0], gain[0, 1] = s * along, c * along
    gain[1, 0], gain[1, 1] = c * height / range_, -s * height / range_


@row_kernel
def age_nuisances(mean: Array, cov: Array, keep: float, variance: float) -> None:
    """Predict the roll and pitch error common to sightings: z' = keep z + noise, in `mean` and `cov`, in place.

    Args:
        mean: belief, (n,): four states of pose and drift, then these errors (rad).
        cov: covariance of `mean`, (n, n).
        keep: share of an error that stays, 0 to 1.
        variance: variance of an error in the long run, rad^2.
    """
    n = mean.size
    for i in range(NUISANCE, n):
        mean[i] *= keep
        for j in range(n):
            cov[i, j] *= keep
            cov[j, i] *= keep
        cov[i, i] += (1.0 - keep * keep) * variance


@row_kernel
def _recognised(scene: Record, action: Record, state: EpisodeState, work: Array) -> int:
    """Write the landmarks that a frame recognises into the last column of `work`; return their number.

    Args:
        scene: record of the scene: walls, m.
        action: record of the action: sector in view (m, rad), probability that a landmark in it is recognised.
        state: state of the episode; its random stream advances.
        work: scratch, (128 or more, any); indices of landmarks are written.
    """
    truth, marks, first = state.truth, state.marks, state.first
    nx, ny = squares(scene)
    c, s = math.cos(truth[THETA]), math.sin(truth[THETA])
    at_x, at_y, half = truth[X] + action.box_at * c, truth[Y] + action.box_at * s, action.box_half
    ix0 = max(math.floor((at_x - half - scene.x_min) / CELL), 0)
    ix1 = min(math.floor((at_x + half - scene.x_min) / CELL), nx - 1)
    iy0 = max(math.floor((at_y - half - scene.y_min) / CELL), 0)
    iy1 = min(math.floor((at_y + half - scene.y_min) / CELL), ny - 1)
    near2, far2, cos_half = action.range_min**2, action.range_max**2, action.cos_half
    found, column = 0, work.shape[1] - 1
    if iy1 < iy0:
        return 0
    for ix in range(ix0, ix1 + 1):
        for k in range(first[ix * ny + iy0], first[ix * ny + iy1 + 1]):
            dx, dy = marks[k, 0] - truth[X], marks[k, 1] - truth[Y]
            r2 = dx * dx + dy * dy
            inside = near2 <= r2 <= far2 and c * dx + s * dy >= cos_half * math.sqrt(r2)
            if inside and found < IN_VIEW and uniform(state.rng) < action.match:
                work[found, column] = k
                found += 1
    return found


@row_kernel
def look(scene: Record, action: Record, state: EpisodeState, room: EpisodeRoom) -> int:
    """Take one camera frame: correct the belief with each landmark that is recognised; return their number.

    Args:
        scene: record of the scene: camera, most landmarks of a frame.
        action: record of the action: sector in view, noise of range (m) and bearing (rad).
        state: state of the episode; its belief and random stream change.
        room: scratch.
    """
    truth, mean, marks, rng = state.truth, state.mean, state.marks, state.rng
    gain, work, n = room.gain, room.work, state.mean.size
    found, column = _recognised(scene, action, state, work), work.shape[1] - 1
    used = min(found, int(scene.most))
    for i in range(used):
        if found > used:  # a random choice of them
            j = i + below(rng, found - i)
            swap = work[i, column]
            work[i, column] = work[j, column]
            work[j, column] = swap
        k = int(work[i, column])
        dx, dy = marks[k, 0] - truth[X], marks[k, 1] - truth[Y]
        r, b = math.sqrt(dx * dx + dy * dy), wrap(math.atan2(dy, dx) - truth[THETA])
        er, eb = normal_pair(rng)
        var_r = action.sd_range**2 + (action.sd_share * r) ** 2
        seen_r, seen_b = r + math.sqrt(var_r) * er, b + action.sd_bearing * eb
        if n > NUISANCE:
            tilt_gain(r, b, scene.height, gain)
            seen_r += gain[0, 0] * truth[ROLL] + gain[0, 1] * truth[PITCH]
            seen_b += gain[1, 0] * truth[ROLL] + gain[1, 1] * truth[PITCH]
        seen_r = max(seen_r, 0.01)
        if n > NUISANCE:
            px, py = marks[k, 0] - mean[X], marks[k, 1] - mean[Y]  # at the predicted place: the one seen is noisy
            near = max(math.sqrt(px * px + py * py), action.range_min)
            tilt_gain(near, math.atan2(py, px) - mean[THETA], scene.height, gain)
        seen = LandmarkSighting(marks[k, 0], marks[k, 1], seen_r, wrap(seen_b), var_r, action.sd_bearing**2)
        update(mean, state.cov, seen, gain, work)
    return used


@row_kernel
def move(scene: Record, action: Record, share: float, rng: Stream, truth: Array) -> None:
    """Move the true pose over a share of an action: `truth` is changed; walls bound its position.

    Args:
        scene: record of the scene: walls and radius of the robot, m.
        action: record of the action: distance (m), turn (rad), variances of the motion.
        share: part of the action, 0 to 1.
        rng: random stream of the motion noise, (4,) uint64, advanced.
        truth: true x, y (m), heading (rad), frame map, drift (rad per m) and more, (7,).
    """
    along_e, across_e = normal_pair(rng)
    heading_e, _ = normal_pair(rng)
    change = share * (action.turn + truth[DRIFT] * action.forward)
    middle = truth[THETA] + 0.5 * change
    along = share * action.forward + math.sqrt(share * action.var_along) * along_e
    across = math.sqrt(share * action.var_across) * across_e
    c, s, r = math.cos(middle), math.sin(middle), scene.radius
    truth[X] = min(max(truth[X] + along * c - across * s, scene.x_min + r), scene.x_max - r)
    truth[Y] = min(max(truth[Y] + along * s + across * c, scene.y_min + r), scene.y_max - r)
    truth[THETA] = wrap(truth[THETA] + change + math.sqrt(share * action.var_heading) * heading_e)


@row_kernel
def _frames_of(scene: Record, action: Record, state: EpisodeState, room: EpisodeRoom) -> None:
    """Simulate an action frame by frame: truth, belief and the belief at the next decision in `state` are changed.

    The latter lacks the frames that come after the decision: it is predicted over them instead.

    Args:
        scene: record of the scene, SI units, angles in rad.
        action: record of the action, SI units, angles in rad.
        state: state of the episode.
        room: scratch.
    """
    frames, late = int(action.frames), int(action.late)
    share, noise = 1.0 / frames, room.noise
    noise[0], noise[1] = share * action.var_along, share * action.var_across
    noise[2], noise[3] = share * action.filter_heading, share * action.var_drift
    still, mean, cov, truth = action.kind == slots.STAND, state.mean, state.cov, state.truth
    for f in range(frames):
        if late > 0 and f == frames - late:
            copy_belief(mean, cov, state.ahead_mean, state.ahead_cov)
        if not still:
            move(scene, action, share, state.rng, truth)
            way = share * action.forward
            predict(mean, cov, way, 0.0, share * action.turn, way, noise, room.work)
        if mean.size > NUISANCE:
            keep = action.tilt_keep
            ea, eb = normal_pair(state.rng)
            fresh = math.sqrt(1.0 - keep * keep) * scene.tilt_sd
            truth[ROLL], truth[PITCH] = keep * truth[ROLL] + fresh * ea, keep * truth[PITCH] + fresh * eb
            age_nuisances(mean, cov, keep, scene.tilt_sd**2)
        look(scene, action, state, room)
    if late == 0:
        copy_belief(mean, cov, state.ahead_mean, state.ahead_cov)
    elif not still:
        for i in range(4):
            noise[i] *= late
        way, turn = late * share * action.forward, late * share * action.turn
        predict(state.ahead_mean, state.ahead_cov, way, 0.0, turn, way, noise, room.work)


@row_kernel
def act(model: ModelTables, run: int, episode: int, chosen: int, state: EpisodeState, room: EpisodeRoom) -> float:
    """Simulate one action; return the reward, no unit: minus its seconds, or the bonus at the goal.

    Args:
        model: actions, scene, times of changes of kind.
        run: seed of the series of episodes.
        episode: number of the episode.
        chosen: index of the action.
        state: state of the episode, changed: truth, belief and counters are carried over the action.
        room: scratch.
    """
    scene, action, status = model.scene[0], model.actions[chosen], state.status
    state.truth[DRIFT] = drift_at(scene, state.truth[BEGAN], status.way)
    seed(state.rng, run, episode, STEP + int(status.steps))
    _frames_of(scene, action, state, room)
    kind, last = int(action.kind), int(status.last)
    before = slots.STAND if last < 0 else int(model.actions[last].kind)
    seconds = action.seconds + model.switching[before, kind]
    status.time += seconds
    status.way += action.forward
    status.last = chosen
    status.steps += 1.0
    status.stands = status.stands + 1.0 if kind == slots.STAND else 0.0
    status.turns = status.turns + 1.0 if kind == slots.TURNING else 0.0
    status.blocked = is_blocked(scene, state.truth)
    dx, dy = scene.goal_x - state.truth[X], scene.goal_y - state.truth[Y]
    if dx * dx + dy * dy < scene.goal_radius**2:
        status.outcome = slots.REACHED
        return scene.goal_reward
    status.outcome = slots.CUT_OFF if status.time >= scene.time_limit else slots.RUNNING
    return -seconds
