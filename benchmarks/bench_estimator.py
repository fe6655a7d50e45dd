"""The estimators against truth: the paper's biped (synthetic), two logs of humanoids, the simulated hexapod; and speed.

    python -m benchmarks.bench_estimator [--seeds 10] [--only synthetic humanoids hexapod speed]

rmse = rms length of the velocity error, cm/s. avg = error of the mean velocity along the track. Humanoid logs are read
from `../shared/data` and left out when they are not there. The hexapod walks closed-loop on the estimates.
"""

import argparse
import math
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.signal import savgol_filter

from surefoot.geometry.rotations import matrix_from_quat, yaw_from_quat
from surefoot.lab.papers.wawrzynski.replay import log_from_columns, replay, score, tilt_errors
from surefoot.lab.papers.wawrzynski.synthetic import KINDS, synthesize
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.estimator import Estimator
from surefoot.services.estimator.feet import FootMount, bare_mount
from surefoot.services.estimator.odometry import OdometryParams
from surefoot.services.estimator.params import EstimatorParams, paper_params
from surefoot.services.simulator.ground.terrain import make_terrain, observed_map
from surefoot.services.simulator.world import PhysicsWorld
from surefoot.services.walker.hexapod.gait import HexapodWalker
from surefoot.services.walker.interface import MotionCommand, WalkerInputs

DATA = Path(__file__).parents[2] / "shared" / "data"
NAMES = ("imu", "kinematics", "kinematics_gyro", "ekf")
PAPER = replace(paper_params(EstimatorParams()), remove_gyro_bias=True, refine_gyro_bias=True)


def synthetic_row(kind: str, seed: int) -> list[float]:
    """rmse of the four in cm/s, |avg| in %, tilt in deg, of the paper's filter on one walk."""
    log = synthesize(KINDS[kind], seed)
    out = replay(log, Estimator(bare_mount(2), PAPER, OdometryParams()))
    scores = [score(log, out.v[name], 2.5) for name in NAMES]
    tilt = math.degrees(float(np.sqrt(np.mean(tilt_errors(log, out.g)[250:] ** 2))))
    return [*(100 * s.rmse for s in scores), 100 * abs(scores[-1].average), tilt]


def synthetic(seeds: int) -> None:
    """The paper's experiment."""
    print(
        f"synthetic biped, paper mode, mean of {seeds} seeds   (study: imu 51, K 4.4, KG 3.3, ekf 1.0; paper avg 8 %)"
    )
    print(f"{'':8}{'imu':>8}{'K':>8}{'KG':>8}{'ekf':>8}{'ekf/KG':>8}{'avg %':>8}{'tilt':>8}")
    with ProcessPoolExecutor() as pool:
        for kind in KINDS:
            rows = np.mean(list(pool.map(partial(synthetic_row, kind), range(seeds))), axis=0)
            ratio = rows[3] / rows[2]
            print(f"{kind:8}" + "".join(f"{x:8.2f}" for x in (*rows[:4], ratio, *rows[4:])))


def humanoids() -> None:
    """Two logs of others, 100/33 Hz, start from 30 rows."""
    base = EstimatorParams(
        sigma_w=0.01, sigma_q=0.09, standstill_samples=30, standstill_gyro_sd=0.05, standstill_acc_sd=0.5
    )
    print("\nhumanoid logs   (design note, paper mode: 5.60, -51 %, NEES 106; 0.74, drift 0.262, NEES 1.9)")
    print(f"{'':28}{'imu':>8}{'K':>8}{'KG':>8}{'ekf':>8}{'avg %':>8}{'drift':>8}{'NEES':>8}{'odometry':>10}")
    for name, window in (("icub3_gazebo_walk", 15), ("icub_real_com", 61)):
        if not (DATA / f"{name}.npz").exists():
            print(f"{name}: not there")
            continue
        columns = dict(np.load(DATA / f"{name}.npz"))
        d = columns["t"][1] - columns["t"][0]
        log = log_from_columns(columns, savgol_filter(columns["p"], window, 3, deriv=1, delta=d, axis=0))
        mount = FootMount(None, np.ascontiguousarray(log.rot[0].T), np.zeros(3), np.zeros(2))
        for mode, params in (("paper", replace(paper_params(base), remove_gyro_bias=True)), ("ours", base)):
            out = replay(log, Estimator(mount, params, OdometryParams()))
            scores = [score(log, out.v[one], 0.5) for one in NAMES]
            e = (out.v["ekf"] - log.v)[50:-10]
            nees = np.mean([x @ np.linalg.solve(p[3:, 3:], x) for x, p in zip(e, out.p[50:-10], strict=True)])
            gap = out.position[-1] - out.position[100] - log.position[-1] + log.position[100]
            print(
                f"{name + ', ' + mode:28}"
                + "".join(f"{100 * s.rmse:8.2f}" for s in scores)
                + f"{100 * scores[-1].average:8.1f}{100 * scores[-1].drift:8.3f}{nees:8.1f}"
                + f"{1e3 * math.hypot(gap[0], gap[1]):7.0f} mm"
            )


@dataclass
class Track:
    """One closed-loop walk: estimates minus truth, by tick."""

    reached: bool
    way: float  # m
    rmse: list[float]  # m/s, of the four
    tilt: np.ndarray  # deg
    position: np.ndarray  # (3,) m, at the end
    yaw: float  # deg, at the end
    nees: float  # of (x, y, z, yaw) at the end, 4 degrees of freedom


def hexapod_track(terrain: str, slope_sd: float, seed: int) -> Track:
    """Walk 1.5 m on the estimates; the actuation delay is one tick."""
    robot = load_robot("ragno")
    ground = make_terrain(terrain, seed)
    world, estimator = PhysicsWorld(robot, ground, seed), Estimator.for_robot(robot, start_slope_sd=slope_sd)
    walker = HexapodWalker(robot)
    walker.set_map(observed_map(ground, "noise", seed))
    begin, begin_yaw = world.truth().position.copy(), yaw_from_quat(world.truth().quat_wxyz)
    command, started, still = world.command.copy(), False, 0
    squares, tilts = [], []
    while world.tick < 9000 and still < 50:
        samples = world.samples
        touch = None
        if samples.imu is not None:
            estimator.on_imu(samples.imu.stamp_ns, samples.imu.gyro, samples.imu.acc)
        if samples.joints is not None and samples.contacts is not None:
            touch = np.array([any(foot) for foot in samples.contacts.touch])
            estimator.on_kinematics(samples.joints.stamp_ns, samples.joints.position, touch)
        e, pose, truth = estimator.estimate(), estimator.pose(), world.truth()
        out = walker.step(
            WalkerInputs(
                stamp=0.01 * world.tick,
                roll=e.roll,
                pitch=e.pitch,
                x=float(pose.position[0]),
                y=float(pose.position[1]),
                yaw=pose.yaw,
                estimate_stamp=1e-9 * e.stamp_ns,
                initialised=e.initialised,
                joints=None if touch is None else samples.joints.position,
                contacts=touch,
            )
        )
        rot = matrix_from_quat(truth.quat_wxyz)
        if world.tick >= 150:
            if not started:
                started = walker.command(MotionCommand("walk", distance=1.5)).accepted
            still = still + 1 if world.tick > 300 and out.state == "standing" else 0
            true_v = rot.T @ truth.velocity
            squares.append([np.sum((estimator.estimate(n).velocity - true_v) ** 2) for n in NAMES])
            up = e.g_up / np.linalg.norm(e.g_up)
            tilts.append(math.degrees(math.asin(min(1.0, float(np.linalg.norm(np.cross(up, rot[2])))))))
        world.step_tick(command)
        command = out.command if out.command is not None else command
        if truth.fallen:
            break
    error = pose.position - truth.position + begin - np.array([0.0, 0.0, begin[2]])
    error[2] = pose.position[2] - truth.position[2]
    yaw = (pose.yaw - (yaw_from_quat(truth.quat_wxyz) - begin_yaw) + math.pi) % (2 * math.pi) - math.pi
    e4 = np.append(error, yaw)
    way = float(np.hypot(*(truth.position - begin)[:2]))
    return Track(
        bool(way > 1.4 and not truth.fallen),
        way,
        np.sqrt(np.mean(squares, axis=0)).tolist(),
        np.array([np.sqrt(np.mean(np.square(tilts))), np.max(tilts)]),
        error,
        math.degrees(yaw),
        float(e4 @ np.linalg.solve(pose.covariance, e4)),
    )


def hexapod(seeds: int) -> None:
    """Ragno, 1.5 m, ADIS16365 with turn-on biases of 3 deg/s and 16 mg (sigma), encoders of 0.29 deg."""
    print(f"\nhexapod walks 1.5 m closed-loop, rms over {seeds} seeds; `level` = start on stated level ground")
    print(
        f"{'':16}{'ok':>6}{'imu':>8}{'K':>7}{'KG':>7}{'ekf':>7}{'tilt':>7}{'max':>7}{'x,y mm':>8}{'%':>6}{'max %':>7}"
        f"{'z mm':>7}{'yaw':>7}{'NEES4':>7}"
    )
    with ProcessPoolExecutor() as pool:
        for terrain in ("flat", "demo"):
            for label, slope_sd in (("", math.inf), ("level", 0.003)):
                tracks = list(pool.map(partial(hexapod_track, terrain, slope_sd), range(seeds)))

                def rms(values: list[float]) -> float:
                    return float(np.sqrt(np.mean(np.square(values))))

                flat = [float(np.hypot(*t.position[:2])) for t in tracks]
                speeds = "".join(f"{100 * rms([t.rmse[k] for t in tracks]):{8 - (k > 0)}.2f}" for k in range(4))
                shares = [100 * d / t.way for d, t in zip(flat, tracks, strict=True)]
                print(
                    f"{terrain + ' ' + label:16}{sum(t.reached for t in tracks):6d}{speeds}"
                    f"{rms([t.tilt[0] for t in tracks]):7.2f}"
                    f"{max(t.tilt[1] for t in tracks):7.2f}{1e3 * rms(flat):8.1f}"
                    f"{rms(shares):6.2f}{max(shares):7.2f}{1e3 * rms([t.position[2] for t in tracks]):7.1f}"
                    f"{rms([t.yaw for t in tracks]):7.2f}{np.mean([t.nees for t in tracks]):7.1f}"
                )


def speed() -> None:
    """Time of a control tick with everything on."""
    robot, rng, ticks = load_robot("ragno"), np.random.default_rng(0), 3000
    w, q = 0.01 * rng.normal(size=(ticks, 3)), [0.0, 0.0, 9.81] + 0.05 * rng.normal(size=(ticks, 3))
    joints, touch = robot.neutral + 1e-3 * rng.normal(size=(ticks, robot.nj)), np.ones(6, dtype=bool)
    estimator, costs = Estimator.for_robot(robot), []
    for k in range(ticks):
        stamp, began = (k + 1) * 10_000_000, time.perf_counter()
        estimator.on_imu(stamp, w[k], q[k])
        if stamp // 33_000_000 > (stamp - 10_000_000) // 33_000_000:
            estimator.on_kinematics(stamp // 33_000_000 * 33_000_000, joints[k], touch)
        estimator.estimate()
        estimator.pose()
        costs.append(time.perf_counter() - began)
    mean, median = 1e6 * np.mean(costs[200:]), 1e6 * np.median(costs[200:])
    print(f"\nspeed\nall four estimators and odometry, a 10 ms tick: {mean:.0f} us mean, {median:.0f} us median")


def main(arguments: list[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--only", nargs="*", default=["synthetic", "humanoids", "hexapod", "speed"])
    args = parser.parse_args(arguments or [])
    if "synthetic" in args.only:
        synthetic(args.seeds)
    if "humanoids" in args.only:
        humanoids()
    if "hexapod" in args.only:
        hexapod(args.seeds)
    if "speed" in args.only:
        speed()


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
