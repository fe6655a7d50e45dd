"""Reproduction of Walas & Belter (2011), section 4: static stability, all figures and numbers."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from surefoot.geometry.constants import GRAVITY
from surefoot.lab.report.findings import Finding, Reproduction, at_most, fact
from surefoot.robot.reader import load_robot
from surefoot.services.stability.sensing.pressure import PressureSensor

from . import messor as walas_messor
from . import ragno as walas_ragno
from . import stand as walas_stand
from .figures import draw
from .study import StabilityStudy

TITLE = "Walas & Belter (2011), section 4: static stability"
TRUE_FACTOR = 0.6356 / walas_stand.DATA_SHEET
SEEDS = (0, 1, 2)
NOTES = (
    "The paper prints no friction, heights or scales for Fig. 17: the slope's geometry and the table are chosen here "
    "(feet at 12.6/2.9/0 cm, trunk at 12 cm); GSM with the shipped CoM offset of 1.2 cm.",
    "4.7 calls 0.752 Nm/A a gain; 20/26.59 is a correction without unit, so the constant is 0.845 x 0.752 = 0.636.",
    "4.7 divides the trunk's way by the CoM's. Feet and legs stay behind (75 % of Messor's mass): the CoM moves 6 cm "
    "when the trunk moves 10, so the printed rule does not give the motors' constant. Nor does it with the CoM's way, "
    "because (30) leaves the legs' weight out. The fit of all equations of rest does.",
    "The measured CoM of Fig. 24, (-4.47, 1.07) cm, carries the sensors' errors of that day and is no target.",
    "The characteristic of Fig. 18 is printed without numbers; ours is a typical sensor of that kind.",
)


def study(progress: Callable[[float, str], None] = lambda share, step: None) -> StabilityStudy:
    """Run all experiments of Walas & Belter, section 4, and return the results; takes about half a minute."""
    ragno, messor = load_robot("ragno"), load_robot("messor")
    progress(0.0, "Ragno: displacement of the CoM, slope")
    postures = walas_ragno.postures(ragno)
    slopes = tuple(walas_ragno.slope(ragno, mu) for mu in walas_ragno.SLOPE_TABLE)
    progress(0.1, "Messor: calibration by moving the trunk 10 cm to either side")
    sweep = walas_messor.sweep(messor)
    progress(0.4, "Messor: standing level and tilted")
    standing = walas_messor.standing(messor, sweep.calibration.common)
    errors = tuple(walas_messor.com_errors(messor, seed) for seed in SEEDS)
    small = tuple(walas_messor.com_errors(ragno, seed) for seed in SEEDS[:1])
    progress(0.8, "Messor: tripod gait")
    gait = walas_messor.gait(messor, sweep.calibration.common)
    return StabilityStudy(ragno, messor, postures, slopes, PressureSensor(), sweep, standing, gait, errors, small)


def findings(s: StabilityStudy) -> tuple[Finding, ...]:
    """Return a row for every number of Walas & Belter, section 4, with the result here, in its order."""
    rows = walas_ragno.figure_15(s.ragno, s.postures)
    rows += walas_ragno.figure_17(s.slopes)
    rows += _extended(s)
    rows += _forces(s)
    rows += _calibration(s)
    return tuple(rows)


def _extended(s: StabilityStudy) -> list[Finding]:
    measured = s.demo.com + np.array([0.010, 0.0])  # as if a load had moved the CoM by 1 cm
    now, then = walas_ragno.extended_check(s.demo, measured)
    value = float("nan") if now.value is None else 100.0 * now.value
    return [
        fact(
            "4.6, Fig. 21",
            "margin now / GSM after, CoM measured 1 cm ahead, mu 0.45, cm",
            "",
            f"{value:.2f} / {walas_ragno.gsm(then):.2f}",
            abs(walas_ragno.gsm(then) - walas_ragno.gsm(s.demo.corrected) + 1.0) < 1e-6,
            "1 cm less than by kinematics",
        ),
        walas_ragno.consistency(s.slopes, s.ragno.mass * GRAVITY),
    ]


def _forces(s: StabilityStudy) -> list[Finding]:
    sensor, g = s.sensor, s.gait
    error = sensor.linearity_error()
    peak, weight = float(g.true.max()), s.messor.mass * GRAVITY
    loaded = g.true > 0.05 * weight
    ours, printed = (float(np.sqrt(np.mean((f - g.true)[loaded] ** 2))) for f in (g.measured, g.printed))
    least, most = sensor.least / GRAVITY, sensor.most / GRAVITY
    return [
        fact("4.5, Fig. 18", "range taken as linear, kg", "0.5-2", f"{least:g}-{most:g}"),
        fact("4.5, Fig. 18", "largest error of the straight line in it, N", "", f"{error:.2f}"),
        fact("4.5, Fig. 20", "tripod gait: largest force at the tip, N (weight 35.7 N)", "", f"{peak:.1f}"),
        fact("4.5, Fig. 20", "force of a standing leg from currents, RMS error, (30) as printed / ours, N", "",
             f"{printed:.2f} / {ours:.2f}", ours < printed, "ours smaller"),
    ]  # fmt: skip


def _calibration(s: StabilityStudy) -> list[Finding]:
    w, fit = s.sweep, s.sweep.calibration
    trunk = w.ways(np.array([r.trunk for r in w.readings]))
    way, read = w.ways(w.true), w.ways(w.printed)
    exact = max(float(e.exact.max()) for e in (*s.errors, *s.small_errors))
    noisy = max(float(e.noisy.max()) for e in s.errors)
    fused = max(float(e.fused.max()) for e in s.errors)
    along = 1e3 * float(np.linalg.norm(w.gain_free - w.true, axis=1).max())
    gain_row = at_most(
        "4.7", f"factor by the fit of this project, error against {TRUE_FACTOR:.4f}, %",
        100.0 * abs(fit.common / TRUE_FACTOR - 1.0), 1.0, form=".2f",
    )  # fmt: skip
    centre = s.standing.measured
    middle = float(np.linalg.norm(centre - s.standing.feet[:, :2].mean(axis=0)))
    return [
        fact("4.7, Figs 22, 23", "way of the trunk forward / backward, cm", "10 / 10", _both(trunk)),
        fact("4.7, Figs 22, 23", "way of the CoM, true, cm", "10 / 10 taken", _both(way)),
        fact("4.7, Figs 22, 23", "way of the CoM by (30), (31) and 0.845 Nm/A, cm", "15.27 / 11.32", _both(read)),
        fact("4.7", "factor of the motors by the printed rule, trunk's way / CoM's way", "0.752",
             f"{w.gain_by_trunk:.3f} / {w.gain_by_com:.3f}"),
        fact("4.7", "factor by the fit of this project (constant in Nm/A)", "0.752",
             f"{fit.common:.4f} +- {fit.common_sd:.4f} ({walas_stand.DATA_SHEET * fit.common:.4f})"),
        gain_row,
        at_most("4.4 (31)", "CoM from forces, torques 30 % off, no noise, worst, mm", 1e3 * exact, 1.0, form=".2f"),
        at_most("4.4 (31)", "the same with noise, level and tilted, currents alone, mm", 1e3 * noisy, 3.0, form=".2f"),
        at_most("4.5", "the same, currents fused with pressure sensors, mm", 1e3 * fused, 3.0, form=".2f"),
        at_most("4.7, Figs 22, 23", "CoM along the calibration, gain-free, worst error, mm", along, 3.0, form=".2f"),
        fact("4.7, Fig. 24", "measured CoM (paper: from its own frame), cm", "(-4.47, 1.07)",
             f"({100 * centre[0]:.2f}, {100 * centre[1]:.2f})"),
        at_most("4.7, Fig. 24", 'distance from the middle of the feet, mm ("in the middle of the convex hull")',
                1e3 * middle, 10.0, form=".2f"),
    ]  # fmt: skip


def _both(ways: tuple[float, float]) -> str:
    return f"{100.0 * ways[0]:.2f} / {100.0 * ways[1]:.2f}"


def reproduce(out: Path | None, progress: Callable[[float, str], None] = lambda share, step: None) -> Reproduction:
    """Repeat the results of Walas & Belter on static stability; figures go into the folder `out`, if there is one."""
    done = study(progress)
    return Reproduction(TITLE, findings(done), draw(done, out), NOTES)
