"""Study of motion blur with rendered images: features of the floor that a walking camera loses against a standing one.

The camera turns at a rate whose image flow is that of a walk of the simulated Nao. Osswald et al. do not print the
exposure time; it is varied here.
"""

from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure

from surefoot.errors import SurefootError
from surefoot.lab.report.drawing import BLUE, GREEN, ORANGE, new_figure, write_figures
from surefoot.lab.report.findings import Finding
from surefoot.lab.statistics import wilson
from surefoot.lab.vision.blur import MatchCount, StillCamera, by_speed, map_by_grid, still_camera
from surefoot.lab.vision.replay import floor
from surefoot.services.vision.feature_map import FeatureMap

WALK_FLOW = 48.0
"""Median image flow of a walking Nao, px/s: 1.6 px in an exposure of 33 ms."""
LOSS = 0.8
"""Share of the features lost to motion blur that Osswald et al. report, 0 to 1."""
EXPOSURES = (0.033, 0.066, 0.1, 0.15, 0.2)
"""Exposure times of the images of the study, s."""
TRIALS = 12
TEXTURE = "parquet"


def kept(camera: StillCamera, world: FeatureMap, flow: float) -> list[MatchCount]:
    """Return the numbers of matched features in images whose floor moves by `flow`, px/s."""
    return by_speed(camera, world, [(0.0, flow / camera.optics.focal)], TRIALS)


class KeptFeatures(NamedTuple):
    """Numbers of features in view and recognised at one exposure time, standing and walking."""

    exposure: float
    """Exposure time of the images, s."""
    stands: tuple[int, int]
    """Numbers of features recognised and in view when the robot stands."""
    walks: tuple[int, int]

    @property
    def lost(self) -> float:
        """Share of the features recognised when standing that are not recognised when walking."""
        return 1.0 - self.walks[0] / max(1, self.stands[0])


def study() -> list[KeptFeatures]:
    """Return the recognised features at each exposure time (raises SurefootError: OpenCV is not installed)."""
    texture = floor(TEXTURE, 0)
    world = map_by_grid(still_camera(texture, 0.01), "orb", [0.1 * k for k in range(-2, 7)], (-0.2, 0.0, 0.2))
    found: list[KeptFeatures] = []
    for exposure in EXPOSURES:
        camera = still_camera(texture, exposure)
        counts = [
            (sum(each.matched for each in part), sum(each.in_view for each in part))
            for part in (kept(camera, world, 0.0), kept(camera, world, WALK_FLOW))
        ]
        found.append(KeptFeatures(exposure, *counts))
    return found


def reproduced(out: Path | None) -> tuple[list[Finding], tuple[Path, ...]]:
    """Return the rows of the study and the path of its figure; without OpenCV one row with the reason, and no figure.

    Args:
        out: folder of the figure, None = there is none.
    """
    what = f"features that walking loses, of those that standing matches, {TEXTURE}"
    try:
        found = study()
    except SurefootError as error:
        return [Finding("VI-D", what, f"{100 * LOSS:.0f} %", error.message)], ()
    rows: list[Finding] = []
    for each in found:
        low, high = wilson(min(each.stands), each.stands[1])
        rows.append(
            Finding(
                "VI-D", f"{what}, exposure {1e3 * each.exposure:.0f} ms", f"{100 * LOSS:.0f} % (light not printed)",
                f"{100 * each.lost:.0f} %; standing {100 * low:.0f} to {100 * high:.0f} % in view",
            )
        )  # fmt: skip
    return rows, write_figures({"pixels-standing-still": _figure}, found, out)


def _figure(found: list[KeptFeatures]) -> Figure:
    """Return a figure of the shares of landmarks in view that are recognised, standing and walking, with intervals."""
    figure = new_figure(6.4, 3.6)
    axes = figure.add_subplot(1, 1, 1)
    for name, color, part in (("standing", GREEN, "stands"), ("walking", BLUE, "walks")):
        counts = [getattr(each, part) for each in found]
        shares = [k / n for k, n in counts]
        ends = [wilson(min(k, n), n) for k, n in counts]
        below = [share - low for share, (low, _) in zip(shares, ends, strict=True)]
        above = [high - share for share, (_, high) in zip(shares, ends, strict=True)]
        at = [1e3 * each.exposure for each in found]
        axes.errorbar(at, shares, (below, above), color=color, marker="o", capsize=3, label=name)
    worst = [(1.0 - LOSS) * each.stands[0] / each.stands[1] for each in found]
    axes.plot([1e3 * each.exposure for each in found], worst, "--", color=ORANGE, label="loss of the paper, 80 %")
    axes.set_xlabel("exposure, ms")
    axes.set_ylabel("share recognised")
    axes.set_ylim(bottom=0.0)
    axes.set_title(f"What standing still keeps of the features, {TEXTURE}, from pixels", loc="left", fontsize=10)
    axes.legend(loc="upper right")
    return figure
