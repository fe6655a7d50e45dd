"""Section VI of Wawrzynski et al. in simulation: Bioloid walks 1 m in about 28 s, every estimator runs on its log."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.recorded import log_of_columns
from surefoot.lab.estimation.scores import Score, score
from surefoot.lab.estimation.track import Track, names, track
from surefoot.lab.estimation.walks import SCENARIOS, run_walk
from surefoot.lab.pools import worker_processes
from surefoot.record.columns import Columns
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.feet.mount import feet_in_imu, foot_mount
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario

from .chain import chain_angles, chain_from_robot, descend

SEEDS = range(12)
PAPER = ("imu", "kinematics", "kinematics_gyro", "paper")
"""Names of the four velocity estimates of Fig. 3 of Wawrzynski et al."""
BRIEF = "paper, bias of half a second"
AT_LEAST = 0.01  # m/s, of base_link over 2 s: it walks
MEAN_S = 2.0
SMOOTH_S = 0.3
REST_S = 6.0
"""Time of standing before the walk, s; it decides the error (38) of Wawrzynski et al., as the mean gyro over 0.5 s
leaves a bias of 1e-3 rad/s."""
LOST = 0.0357  # m/s: an estimate that is off by the walking speed is useless


@dataclass(frozen=True, eq=False)
class Experiment:
    """Results of all estimators on one walk.

    Attributes:
        seed: of the run.
        ok: True if the run met the limits of its scenario.
        log: sensor samples and truth.
        walking: flags of the inertial rows of the walk, (n,).
        tracks: estimates by name.
        scores: errors over the walk, by name.
        average: mean velocity along the IMU's x axis by equation (38) and the true one, m/s, by name.
        noise: rms of the error of v_x about its mean over 0.3 s, m/s, by name; `kinematics, exact` with exact encoders.
        lost_after: s from the start of the estimate until the IMU alone is off by the walking speed for good.
        apart: rms difference of v_x by kinematics with and without gyro, m/s.
    """

    seed: int
    ok: bool
    log: Log
    walking: NDArray[np.bool_]
    tracks: Mapping[str, Track]
    scores: Mapping[str, Score]
    average: Mapping[str, tuple[float, float]]
    noise: Mapping[str, float]
    lost_after: float
    apart: float

    @property
    def duration(self) -> float:
        """Time from the first to the last step, s."""
        return float(np.ptp(self.log.seconds[self.walking]))

    @property
    def way(self) -> float:
        """Distance from the begin to the end of the walk, m."""
        at = self.log.position[self.walking]
        return float(np.hypot(*(at[-1] - at[0])[:2]))


def estimators() -> tuple[str, ...]:
    """Return the names of the compared estimators: the four of Wawrzynski et al., and those of this project."""
    return (*PAPER, "ekf", *(("best",) if "best" in names() else ()))


def experiment(seed: int, rest_s: float = REST_S) -> Experiment:
    """Simulate a walk of a seed, after standing for `rest_s` s, and return the results of all estimators."""
    scenario = load_scenario(find_scenario(SCENARIOS["bioloid"]))
    first, *others = scenario.steps
    scenario = replace(scenario, steps=(replace(first, after_s=first.after_s + rest_s), *others))
    columns, robot, ok = run_walk(scenario, seed)
    return evaluate(seed, ok, columns, robot)


def evaluate(seed: int, ok: bool, columns: Columns, robot: str) -> Experiment:
    """Run every estimator over the recorded columns of a walk, and return the results; `ok`: the run passed."""
    log = log_of_columns(f"bioloid {seed}", columns, load_robot(robot))
    walking = _walking(log)
    rows = np.flatnonzero(walking)
    t = log.seconds
    log = replace(log, begin_s=float(t[rows[0]]), end_s=float(t[-1] - t[rows[-1]]))
    tracks = {name: track(name, log) for name in estimators()}
    exact = with_exact_encoders(log, columns)
    seen = tracks | {f"{name}, exact": track(name, exact) for name in ("kinematics", "kinematics_gyro")}
    noise = {name: roughness((one.v - log.v)[walking, 0], log) for name, one in seen.items()}
    off = np.linalg.norm(tracks["imu"].v - log.v, axis=1)
    started = int(np.argmax(tracks["imu"].flags["initialised"]))
    inside = np.flatnonzero(off < LOST)
    lost = float(t[inside[-1]] - t[started]) if inside.size else 0.0
    apart = tracks["kinematics_gyro"].v[walking, 0] - tracks["kinematics"].v[walking, 0]
    true = float(log.v[walking, 0].mean())
    average = {name: float(one.v[walking, 0].mean()) for name, one in tracks.items()}
    average[BRIEF] = float(track("paper", log, refine_gyro_bias=False).v[walking, 0].mean())
    return Experiment(
        seed, ok, log, walking, tracks, {name: score(log, one) for name, one in tracks.items()},
        {name: (mean, true) for name, mean in average.items()}, noise, lost,
        float(np.sqrt(np.mean(apart**2))),
    )  # fmt: skip


def _walking(log: Log) -> NDArray[np.bool_]:
    """Return a flag for each inertial row (n,), true from the first to the last row at which the robot advances."""
    rows = round(MEAN_S / float(np.median(np.diff(log.seconds))))
    at = log.position
    ahead = np.zeros(len(at))
    ahead[rows // 2 : len(at) - rows + rows // 2] = np.hypot(*(at[rows:] - at[:-rows])[:, :2].T) / MEAN_S
    moves = np.flatnonzero(ahead > AT_LEAST)
    out = np.zeros(len(at), dtype=np.bool_)
    out[moves[0] : moves[-1] + 1] = True
    return out


def roughness(x: Array, log: Log) -> float:
    """Return the rms of an error (n,) about its running mean over 0.3 s, m/s: noise without drift."""
    rows = max(3, round(SMOOTH_S / float(np.median(np.diff(log.seconds)))))
    mean = np.convolve(x, np.ones(rows) / rows, mode="valid")
    first = rows // 2
    return float(np.sqrt(np.mean((x[first : first + len(mean)] - mean) ** 2)))


def with_exact_encoders(log: Log, columns: Columns) -> Log:
    """Return the log that ideal encoders (no steps, zero errors or play of the joints) would have made."""
    stamps = columns["base_stamp_ns"]
    true = np.stack([np.interp(log.foot_ns, stamps, q) for q in columns["base_joints"].T], axis=1)
    assert log.robot is not None
    mount = foot_mount(log.robot)
    seen = [feet_in_imu(mount, q) for q in true]
    position, rot = (np.ascontiguousarray([pair[i] for pair in seen]) for i in range(2))
    return replace(log, foot_position=position, foot_rot=rot)


def run(
    seeds: Iterable[int] = SEEDS, progress: Callable[[float, str], None] = lambda share, step: None
) -> list[Experiment]:
    """Simulate and evaluate a walk for each seed, as many at a time as there are cores; return the experiments."""
    wanted, done = list(seeds), list[Experiment]()
    with worker_processes() as pool:
        for one in pool.map(partial(experiment), wanted):
            done.append(one)
            progress(len(done) / len(wanted), f"seed {one.seed}: {one.way:.2f} m in {one.duration:.1f} s")
    return done


@dataclass(frozen=True)
class Errata:
    """Largest errors of the printed and the corrected equations (8) and (12) of Wawrzynski et al., m/s and rad/s.

    They are taken over drawn postures of a leg.
    """

    velocity_printed: float  # m/s
    velocity: float
    rate_printed: float  # rad/s
    rate: float


def errata(draws: int = 200, step: float = 1e-6) -> Errata:
    """Return how far equations (8) and (12) of Wawrzynski et al., printed and corrected, are from differences.

    The differences are those of positions and orientations of a leg of Bioloid over a small step, s; `draws`: postures.
    """
    rng, chain = np.random.default_rng(0), chain_from_robot(load_robot("bioloid"), 0)
    robot = load_robot("bioloid")
    worst = np.zeros(4)
    for _ in range(draws):
        q, rate = rng.uniform(robot.joint_lower, robot.joint_upper) * 0.5, rng.normal(size=robot.nj)
        theta, theta_rate, w = chain_angles(chain, q), chain_angles(chain, rate), rng.normal(size=3)
        state = descend(chain, theta, theta_rate, w)
        ahead, back = (descend(chain, theta + s * step * theta_rate, theta_rate, w) for s in (1.0, -1.0))
        true_v = (ahead.p_1 - back.p_1) / (2 * step)  # of the IMU in axes of the foot
        turned = (
            (ahead.imu_axes - back.imu_axes) @ state.imu_axes.T / (2 * step)
        )  # [rate of the IMU seen from the foot]
        of_foot = state.imu_axes @ w - np.array([turned[2, 1], turned[0, 2], turned[1, 0]])
        printed_v, printed_w = _as_printed(chain, theta, theta_rate, w)
        for i, (found, true) in enumerate(
            ((printed_v, true_v), (state.v_1, true_v), (printed_w, of_foot), (state.w_1, of_foot))
        ):
            worst[i] = max(worst[i], float(np.abs(found - true).max()))
    return Errata(*(float(x) for x in worst))


def _as_printed(chain, theta: Array, rate: Array, w: Array) -> tuple[Array, Array]:
    """Return velocity and turn rate, from the IMU to the foot, by (8) and (12) as Wawrzynski et al. print them.

    They print p_i x z theta' in (8), and the IMU's z axis w^z_i in (12).
    """
    p, v, axes = np.zeros(3), np.zeros(3), chain.imu_axes.copy()
    omega = axes @ w
    for i in range(theta.size - 1, -1, -1):
        c, s = np.cos(theta[i]), np.sin(theta[i])
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        rot = turn @ chain.rot[i]
        p = turn @ chain.shift[i] + rot @ p
        v = rot @ v + np.cross(p, [0.0, 0.0, rate[i]])
        axes = rot @ axes
        omega = rot @ omega - axes[:, 2] * rate[i]
    return v, omega
