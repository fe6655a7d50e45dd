"""The blur study from pixels: features of the floor that a walking camera loses, and those that a standing one keeps.

The camera turns at the rate that moves its image as a walk of the simulated Nao does. How long the light makes the
exposure is not printed; the exposure is what varies here.
"""

from surefoot.errors import SurefootError
from surefoot.lab.report.findings import Finding
from surefoot.lab.statistics import wilson
from surefoot.lab.vision.blur import MatchCount, StillCamera, by_speed, map_by_grid, still_camera
from surefoot.lab.vision.replay import floor
from surefoot.services.vision.feature_map import FeatureMap

WALK_FLOW = 48.0
"""px/s, median image flow of a walking Nao: 1.6 px in an exposure of 33 ms."""
LOSS = 0.8
"""Share of the features that the paper's blur takes away."""
EXPOSURES = (0.033, 0.066, 0.1, 0.15, 0.2)
"""Exposure times of the images of the study, s."""
TRIALS = 12
TEXTURE = "parquet"


def kept(camera: StillCamera, world: FeatureMap, flow: float) -> list[MatchCount]:
    """Return the matches of images whose floor moves by `flow`, px/s."""
    return by_speed(camera, world, [(0.0, flow / camera.optics.focal)], TRIALS)


def findings() -> list[Finding]:
    """Return the rows of the study; one row with the reason where OpenCV is not installed."""
    what = f"features that walking loses, of those that standing matches, {TEXTURE}"
    try:
        return _findings(what)
    except SurefootError as error:
        return [Finding("VI-D", what, f"{100 * LOSS:.0f} %", error.message)]


def _findings(what: str) -> list[Finding]:
    texture = floor(TEXTURE, 0)
    world = map_by_grid(still_camera(texture, 0.01), "orb", [0.1 * k for k in range(-2, 7)], (-0.2, 0.0, 0.2))
    rows: list[Finding] = []
    for exposure in EXPOSURES:
        camera = still_camera(texture, exposure)
        still, moving = kept(camera, world, 0.0), kept(camera, world, WALK_FLOW)
        stands, n = (sum(getattr(each, name) for each in still) for name in ("matched", "in_view"))
        walks = sum(each.matched for each in moving)
        low, high = wilson(min(stands, n), n)
        rows.append(
            Finding(
                "VI-D", f"{what}, exposure {1e3 * exposure:.0f} ms", f"{100 * LOSS:.0f} % (light not printed)",
                f"{100 * (1 - walks / max(1, stands)):.0f} %; standing {100 * low:.0f} to {100 * high:.0f} % in view",
            )
        )  # fmt: skip
    return rows
