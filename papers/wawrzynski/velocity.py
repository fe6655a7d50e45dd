"""Reproduction of Wawrzynski, Mozaryn & Klimaszewski, section VI: velocity of a walking Bioloid by four estimates."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from surefoot.lab.report.findings import Finding, Reproduction, fact
from surefoot.lab.statistics import interval

from .figures import draw
from .study import BRIEF, LOST, PAPER, Experiment, errata, run

TITLE = "Wawrzynski, Mozaryn & Klimaszewski, section VI: velocity of a walking Bioloid"
SYSTEM = "bioloid"
MOST_AVERAGE = 20.0  # %, of our EKF to the letter; the paper's one walk: 8.1 %
NOTES = (
    "The paper's walk is one, of a robot that learned to walk; ours are of a simulated Bioloid with a planned gait, "
    "perturbed masses and friction, half a degree of backlash, and an ADIS16365 with its turn-on bias of 3 deg/s.",
    "`paper` is the filter to the letter (one foot, ankle, latest gyro, six states), except that the mean gyro of the "
    "standstill is removed; the paper does not mention a bias, and with 3 deg/s nothing would be left to compare.",
    "`ekf` differs: both feet, their mean gyro since the last sample, a gyro bias learned again at every rest.",
    "Not printed: sigma_w, sigma_q, sigma_v, P0, the time without noise in double support, Table I (an image); ours "
    "are in `services/estimator/params.py`.",
    "Erratum (8): the printed p_i x z theta' has the wrong sign; z x p_i theta' is meant.",
    "Erratum (12): the printed w_i^z is the z axis of the IMU; that of the joint is meant.",
    "Erratum (26): the printed matrix is -df/db; harmless, for C enters P only as C C^T.",
    "Erratum (38): the factor 1/N is missing.",
    "Erratum (24): F leaves out the rotation; (28)-(30), which are executed, have it. Errata (20), (21): one equation.",
    "Noise is the rms of the error of v_x about its mean over 0.3 s. Before each walk the robot stands for 6 s, of "
    "which the mean gyro is taken; the paper does not state how long its robot stood. What is left of the bias decides "
    "(38), for the six states do not separate it from a tilt: the row with the first half second shows it.",
    "(38) is a mean along the body's axis; a walk that sways in yaw has another mean in the world (both are shown).",
)


def reproduce(out: Path | None, progress: Callable[[float, str], None] = lambda share, step: None) -> Reproduction:
    """Reproduce the velocity estimates of Wawrzynski et al.; write the figures into a folder when there is one.

    Args:
        out: folder of the figures, or None.
        progress: gets the share that is done, and its step in words.
    """
    done = run(progress=progress)
    return Reproduction(TITLE, tuple(findings(done)), draw(done, out), NOTES)


def findings(done: Sequence[Experiment]) -> list[Finding]:
    """Return the rows of the table of findings: the numbers of Wawrzynski et al. with the results here."""
    return [*_experiment(done), *_average(done), *_conclusions(done), *_beside(done), *_errata()]


def spread(values: Sequence[float], digits: int = 2) -> str:
    """Return the mean of some values and half of its 95 % interval as text."""
    low, high = interval(np.array(values))
    return f"{np.mean(values):.{digits}f} +- {0.5 * (high - low):.{digits}f}"


def _experiment(done: Sequence[Experiment]) -> list[Finding]:
    good = sum(one.ok for one in done)
    ways, times = [one.way for one in done], [one.duration for one in done]
    speed = [100 * one.average["paper"][1] for one in done]
    at = "VI"
    return [
        fact(at, "walks that end as planned", "1 of 1", f"{good} of {len(done)}", good == len(done), "all"),
        fact(at, "way, m", "about 1", spread(ways), bool(0.8 < np.mean(ways) < 1.2), "0.8 to 1.2"),
        fact(at, "duration, s", "about 28", spread(times, 1), bool(24.0 < np.mean(times) < 32.0), "24 to 32"),
        fact(at, "true mean velocity along x of the IMU, cm/s", "3.57", spread(speed),
             bool(3.0 < np.mean(speed) < 4.2), "3.0 to 4.2"),
    ]  # fmt: skip


def errors_38(done: Sequence[Experiment], name: str) -> list[float]:
    """Return the error of the mean velocity, equation (38) of Wawrzynski et al., of each walk, % of the true mean.

    `done`: the walks; `name`: estimator.
    """
    return [100.0 * (one.average[name][0] / one.average[name][1] - 1.0) for one in done]


def _average(done: Sequence[Experiment]) -> list[Finding]:
    rows: list[Finding] = []
    for name in PAPER[1:]:
        errors = np.abs(errors_38(done, name))
        estimated = [100 * one.average[name][0] for one in done]
        if name == "paper":
            rows.append(fact("(38)", "estimated mean velocity, EKF, cm/s", "3.28", spread(estimated)))
        printed = "8.1" if name == "paper" else ""
        limit = (bool(errors.mean() <= MOST_AVERAGE), f"<= {MOST_AVERAGE:g}") if name == "paper" else (None, "")
        rows.append(
            fact("(38)", f"error of the mean velocity, {name}, |%|", printed, spread(errors.tolist(), 1), *limit)
        )
    brief = np.abs(errors_38(done, BRIEF))
    rows.append(
        fact("(38)", "... with the mean gyro of the first half second only, |%|", "", spread(brief.tolist(), 1))
    )
    errors = np.abs(errors_38(done, "paper"))
    rows.append(
        fact("(38)", "median and largest of our walks, |%|", "", f"{np.median(errors):.1f}, {errors.max():.1f}")
    )
    share = np.mean(errors <= 8.1)
    rows.append(fact("(38)", "share of our walks with at most the paper's error", "", f"{share:.2f}"))
    return rows


def _noise(done: Sequence[Experiment], name: str) -> list[float]:
    return [100 * one.noise[name] for one in done]


def _conclusions(done: Sequence[Experiment]) -> list[Finding]:
    lost = [one.lost_after for one in done]
    k, kg, ekf = (np.array(_noise(done, name)) for name in ("kinematics", "kinematics_gyro", "paper"))
    k_exact, kg_exact = (np.array(_noise(done, f"{name}, exact")) for name in ("kinematics", "kinematics_gyro"))
    apart = [100 * one.apart for one in done]
    final = [100 * float(np.linalg.norm((one.tracks["imu"].v - one.log.v)[one.walking][-1])) for one in done]
    at = "VI, Fig. 3"
    return [
        fact(at, f"IMU alone: off by more than {100 * LOST:.2f} cm/s for good after, s", "several seconds",
             spread(lost, 1), bool(max(lost) < 15.0), "every walk < 15"),
        fact(at, "IMU alone: error at the end, cm/s", "useless", spread(final, 0), bool(min(final) > 100 * LOST),
             f"every walk > {100 * LOST:.2f}"),
        fact(at, "kinematics: noise of v_x, cm/s", "very noisy", spread(k.tolist())),
        fact(at, "... share of its power made by encoder steps and play of the joints, %", "because of encoders",
             spread((100.0 * (1.0 - (k_exact / k) ** 2)).tolist(), 0)),
        fact(at, "kinematics with gyro: the same share, %", "",
             spread((100.0 * (1.0 - (kg_exact / kg) ** 2)).tolist(), 0), bool(kg_exact.mean() < 0.7 * kg.mean()),
             "> 50"),
        fact(at, "kinematics with gyro against without: rms difference of v_x, cm/s", "significant difference",
             spread(apart), bool(np.mean(apart) > 0.5), "> 0.5"),
        fact(at, "kinematics with gyro: noise of v_x, cm/s", "", spread(kg.tolist())),
        fact(at, "EKF: noise of v_x, cm/s", "", spread(ekf.tolist())),
        fact(at, "EKF / kinematics with gyro: noise", "significantly reduced", spread((ekf / kg).tolist()),
             bool((ekf / kg).max() <= 0.4), "every walk <= 0.40"),
    ]  # fmt: skip


def _beside(done: Sequence[Experiment]) -> list[Finding]:
    rows: list[Finding] = []
    for name in done[0].scores:
        scores = [one.scores[name] for one in done]
        rmse, drift = [100 * s.rmse for s in scores], [100 * s.drift for s in scores]
        share = [s.percent for s in scores]
        rows.append(fact("beside", f"{name}: velocity error, rms, cm/s", "", spread(rmse)))
        rows.append(fact("beside", f"{name}: |mean error| along the track in the world, %", "", spread(share, 1)))
        rows.append(fact("beside", f"{name}: drift, cm/s", "", spread(drift)))
    return rows


def _errata() -> list[Finding]:
    found = errata()
    pairs = (
        ("(8)", "m/s", found.velocity_printed, found.velocity),
        ("(12)", "rad/s", found.rate_printed, found.rate),
    )  # fmt: skip
    return [
        fact(where, f"printed / corrected: largest error, {unit}", "", f"{printed:.2g} / {right:.1e}",
             right < 1e-6 < 1e-2 < printed, "corrected < 1e-6 < printed")
        for where, unit, printed, right in pairs
    ]  # fmt: skip
