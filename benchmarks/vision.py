"""Vision: time of images and landmarks, what blur does, accuracy along recorded walks, repeating floors, blind cameras.

Recordings are runs of the Nao (`surefoot run nao-corridor`); their motion is seen again over other floors.
"""

import math
import time
from base64 import b64encode
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.bench import Bench, table, words_of
from surefoot.lab.statistics import wilson
from surefoot.lab.vision.blur import MatchCount, StillCamera, along, by_speed, map_by_grid, share, still_camera
from surefoot.lab.vision.replay import Published, RecordedMotion, TakenAt, WalkReplay, floor, images_of, read_motion
from surefoot.services.simulator.physics.faults import Fault
from surefoot.services.simulator.sensors.floors import Texture
from surefoot.services.vision.conditions import Greys
from surefoot.services.vision.eye import Eye
from surefoot.services.vision.feature_map import FeatureMap
from surefoot.services.vision.features import Extractor, Kind
from surefoot.services.vision.recognise import Believed
from surefoot.services.vision.view import greys

BENCH = Bench("vision")

TEXTURES = "random,carpet,tiles,parquet"
SPEEDS = ((0.0, 0.0), (0.055, 0.0), (0.0, 0.22), (0.055, 0.22), (0.1, 0.5), (0.2, 1.0))
"""Speed of the camera's base, m/s, and yaw rate, rad/s: standing, planned walk and turn of the Nao, and faster."""
CERTAIN = 0.1
"""Standard deviation of the position, m, below which a belief counts as certain."""
WRONG = 0.3
"""Error of the position, m, above which a certain belief counts as wrong."""
SOON = 1.0
"""Time after which a fault should be flagged at the latest, s."""


def grid_map(camera: StillCamera, kind: Kind = "orb", end: float = 0.9) -> FeatureMap:
    """Return the map of the floor features around a path along x, from x = -0.3 m to `end` m."""
    return map_by_grid(camera, kind, np.arange(-0.3, end + 0.05, 0.1).tolist(), (-0.25, 0.0, 0.25))


@BENCH.part(quick="--texture tiles --images 3")
def speed(*, texture: str = "parquet", images: int = 40) -> None:
    """Processor time of an image with eight parts of the exposure, and of its landmarks, by ORB and SIFT.

    Args:
        texture: name of the floor's texture.
        images: number of images.
    """
    camera = still_camera(floor(texture, 0))
    rows: list[tuple[object, ...]] = []
    for kind in ("orb", "sift"):
        world = grid_map(camera, kind, 0.3)
        eye = Eye(Extractor(kind, 250), world)
        belief = Believed(np.array([0.1, 0.0, 0.0]), np.diag([0.0025] * 3))
        taken, read, found = 0.0, 0.0, 0
        for k in range(images):
            began = time.process_time()
            image = camera.shot((0.1, 0.0, 0.0), 0.055, 0.1, k)
            between = time.process_time()
            found = len(eye.look(image, camera.base, belief).landmarks)
            taken, read = taken + between - began, read + time.process_time() - between
        rows.append((kind, len(world), found, 1e3 * taken / images, 1e3 * read / images, images / read))
    table("one thread, processor time", ("features", "map", "landmarks", "image ms", "landmarks ms", "images/s"), rows)


@BENCH.part(quick="--textures tiles --exposures 33 --trials 2")
def blur(
    *, textures: str = TEXTURES, exposures: str = "10,33,66,100", trials: int = 25, features: Kind = "orb"
) -> None:
    """Share of the landmarks in view that are recognised, against speed and exposure, maps from sharp images.

    Args:
        textures: names of floor textures, comma-separated.
        exposures: exposure times, ms, comma-separated.
        trials: images of each speed.
        features: kind of image features, orb or sift.
    """
    for name in words_of(textures):
        texture = floor(name, 0)
        world = grid_map(still_camera(texture, 0.01), features)
        rows: list[tuple[object, ...]] = []
        for exposure in words_of(exposures):
            camera = still_camera(texture, 1e-3 * float(exposure))
            for motion in SPEEDS:
                found = by_speed(camera, world, [motion], trials)
                pixels = float(np.mean([each.speed for each in found])) * 1e-3 * float(exposure)
                rows.append((exposure, *motion, pixels, *shares(found)))
        header = ("exposure ms", "m/s", "rad/s", "blur px", "share", "from", "to", "in view")
        table(f"{name}, {features}: {len(world)} features in the map", header, rows)


def shares(found: list[MatchCount]) -> tuple[float, float, float, float]:
    """Return the share of the landmarks in view that were matched, its 95 % interval, and the mean number in view."""
    k, n = sum(each.matched for each in found), sum(each.in_view for each in found)
    return (share(found), *wilson(min(k, n), max(1, n)), n / max(1, len(found)))


def map_along(walk: RecordedMotion, name: str, seed: int) -> FeatureMap:
    """Return the map of a floor under a recorded walk, from a grid of known poses."""
    ends = np.array([walk.truth(tick) for tick in range(0, len(walk.ticks), 50) if "sim/truth" in walk.ticks[tick]])
    return grid_map(still_camera(floor(name, seed), 0.01), end=float(ends[:, 0].max()) + 0.2)


@BENCH.part()
def walk(*recordings: str, textures: str = TEXTURES, exposures: str = "33,66,100", seconds: float = math.inf) -> None:
    """Share of the landmarks in view that are recognised along recorded walks, by state of the gait.

    Args:
        recordings: MCAP files of the Nao.
        textures: names of floor textures, comma-separated.
        exposures: exposure times, ms, comma-separated.
        seconds: time of each recording that is used, from its begin, s.
    """
    walks = [read_motion(Path(path), seconds) for path in recordings]
    rows: list[tuple[object, ...]] = []
    for name in words_of(textures):
        worlds = [map_along(each, name, 0) for each in walks]
        for exposure in words_of(exposures):
            by: dict[str, list[MatchCount]] = {}
            for seed, (each, world) in enumerate(zip(walks, worlds, strict=True)):
                images = images_of(each, floor(name, 0), seed, 1e-3 * float(exposure))
                for kind, found in along(each, images, world).items():
                    by.setdefault(kind, []).extend(found)
            for kind, found in sorted(by.items()):
                pixels = float(np.median([each.speed for each in found])) * 1e-3 * float(exposure)
                rows.append((name, exposure, kind, len(found), pixels, *shares(found)))
    header = ("texture", "exposure ms", "gait", "images", "blur px", "share", "from", "to", "in view")
    table("recorded walks", header, rows)


@BENCH.part()
def pose(
    *recordings: str,
    textures: str = TEXTURES,
    runs: int = 1,
    params: str = "nao",
    exposure: float = 33.0,
    seconds: float = math.inf,
) -> None:
    """Error of the believed pose along recorded walks over floors of their own, vision and belief in the loop.

    Goals: standing at most 3 cm and 2 deg, walking 6 cm and 4 deg rms, NEES per degree of freedom .5 to 2.

    Args:
        recordings: MCAP files of the Nao.
        textures: names of floor textures, comma-separated.
        runs: floors of each texture and recording; their seeds begin at 100.
        params: model of the navigator.
        exposure: exposure time, ms.
        seconds: time of each recording that is used, from its begin, s.
    """
    rows: list[tuple[object, ...]] = []
    for name in words_of(textures):
        found: list[Published] = []
        for path in recordings:
            motion = read_motion(Path(path), seconds)
            for seed in range(100, 100 + runs):
                replay = WalkReplay(map_along(motion, name, seed), params, begin=(0.02, -0.02, 0.03))
                found += replay.run(motion, images_of(motion, floor(name, seed), seed, 1e-3 * exposure))
        for kind, states in (("stand", ("standing",)), ("walk", ("walking", "stopping", "turning"))):
            part = [each for each in found if each.gait in states and each.tick > 150]
            if part:
                errors = np.array([each.error for each in part])
                rms = np.sqrt(np.mean(errors**2, axis=0))
                nees, lost = float(np.mean([each.nees for each in part])), sum(each.lost for each in part)
                place, heading = 100.0 * math.hypot(rms[0], rms[1]), math.degrees(rms[2])
                rows.append((name, kind, len(part), place, heading, nees, lost))
    table(f"params {params}", ("texture", "gait", "samples", "rms cm", "rms deg", "NEES", "lost"), rows)


@BENCH.part(quick="--places 2")
def anywhere(*, textures: str = "laminate,parquet,tiles", places: int = 50, features: Kind = "orb") -> None:
    """Count right, missing and wrong recognitions by a lost robot that stands at random places of the map.

    Args:
        textures: names of floor textures, comma-separated; the boards of laminate repeat.
        places: number of images on each texture.
        features: kind of image features, orb or sift.
    """
    rows: list[tuple[object, ...]] = []
    kinds = ("right", "none", "wrong")
    for name in words_of(textures):
        camera = still_camera(floor(name, 0))
        world, rng = grid_map(camera, features, 2.0), np.random.default_rng(7)
        counts = dict.fromkeys(kinds, 0)
        for k in range(places):
            at = (float(rng.uniform(0.0, 1.8)), float(rng.uniform(-0.25, 0.25)), float(rng.uniform(-0.3, 0.3)))
            seen = Eye(Extractor(features, 250), world).look(camera.shot(at, 0.0, 0.0, k), camera.base, None)
            c, s = math.cos(at[2]), math.sin(at[2])
            x, y = (
                at[0] + c * seen.places[:, 0] - s * seen.places[:, 1],
                at[1] + s * seen.places[:, 0] + c * seen.places[:, 1],
            )
            off = np.hypot(*(np.stack((x, y), axis=1) - world.positions[seen.landmarks]).T)
            counts["none" if not len(off) else "right" if np.median(off) < 0.05 else "wrong"] += 1
        rows.append((name, len(world), *counts.values()))
    table(f"{features}, {places} places", ("texture", "map", *kinds), rows)


FAULTS: dict[str, tuple[Fault, ...]] = {
    "none": (),
    **{
        kind: (Fault(f"camera_{kind}", 150, 100.0),) for kind in ("dark", "bright", "freeze", "repeat", "flip", "cover")
    },
    "late 1 s": (Fault("camera_late", 150, 100.0, value=100.0),),
    "zoom -10 %": (Fault("camera_zoom", 150, 100.0, value=-0.1),),
    "zoom +10 %": (Fault("camera_zoom", 150, 100.0, value=0.1),),
    "zoom -20 %": (Fault("camera_zoom", 150, 100.0, value=-0.2),),
    "zoom +20 %": (Fault("camera_zoom", 150, 100.0, value=0.2),),
    "other floor": (),
    "other texture": (),
    "mirrored": (),
    "half dirty": (),
    "torn": (),
}


def dirty(pixels: Greys) -> Greys:
    """Return greys (h, w) as through a lens whose right half is smeared and takes half the light.

    It is smeared over an eighth of the width.
    """
    half, width = pixels.shape[1] // 2, pixels.shape[1] // 16
    sums = np.cumsum(np.pad(pixels[:, half:].astype(np.float64), ((0, 0), (width, width)), mode="edge"), axis=1)
    smeared = (sums[:, 2 * width :] - sums[:, : -2 * width]) / (2.0 * width)
    return np.hstack((pixels[:, :half], (0.5 * smeared).astype(np.uint8)))


def torn(pixels: Greys) -> Greys:
    """Return greys (h, w) whose bands of rows, a sixth of the image each, came in another order."""
    return np.vstack([np.array_split(pixels, 6)[i] for i in (3, 0, 5, 2, 1, 4)])


SPOILT: dict[str, Callable[[Greys], Greys]] = {
    "mirrored": lambda pixels: pixels[:, ::-1], "half dirty": dirty, "torn": torn,
}  # fmt: skip
"""Functions that change greys (h, w) by a fault of the camera that the simulator does not have, by name of the
fault."""


def spoilt(images: Iterable[TakenAt | None], case: str, begin: int) -> Iterable[TakenAt | None]:
    """Yield images, of which those from tick `begin` on have the fault of a case of `SPOILT`."""
    for tick, taken in enumerate(images):
        if taken is None or tick < begin or case not in SPOILT:
            yield taken
            continue
        pixels = np.ascontiguousarray(SPOILT[case](greys(taken.image)))
        text = b64encode(pixels.tobytes()).decode()
        yield taken._replace(image=taken.image.model_copy(update={"pixels": text, "format": "gray8"}))


class BlindRun(NamedTuple):
    """Result of one recorded walk with a camera that sees nothing useful."""

    wrong: int
    """Number of published poses that are certain, wrong and not reported as lost."""
    alarms: int
    """Number of messages with a flag before the fault begins."""
    time: float
    """Time from the beginning of the fault to the first flag, s; NaN = no flag."""
    sd: tuple[float, float]
    """Standard deviations of the position when the fault begins and at the end, m."""
    lost: bool
    """True if the robot counts as lost at the end of the run, else False."""


def blind_run(motion: RecordedMotion, replay: WalkReplay, case: str, shown: Texture, seed: int) -> BlindRun:
    """Return the result of a recorded walk with a case of a blind camera.

    Args:
        motion: motion of the robot.
        replay: map and model.
        case: key of `FAULTS`; another floor is there from the first image, other faults begin at 1.5 s.
        shown: the floor that is seen.
        seed: seed of the images' noise.
    """
    found = replay.run(motion, spoilt(images_of(motion, shown, seed, None, FAULTS[case]), case, 150))
    read = next((each.tick for each in found if each.seen.features), 0)  # the first image
    begin = read if case.startswith("other") else len(motion.ticks) if case == "none" else 150
    sds = [math.sqrt(each.covariance[0, 0] + each.covariance[1, 1]) for each in found]
    wrong = sum(
        sd < CERTAIN and math.hypot(*each.error[:2]) > WRONG and not each.lost
        for sd, each in zip(sds, found, strict=True)
    )  # fmt: skip
    flagged = [each.tick for each in found if each.seen.flags]
    time_s = next((0.01 * (tick - begin) for tick in flagged if tick >= begin), math.nan)
    at = min(len(sds) - 1, begin // 5)
    return BlindRun(wrong, sum(tick < begin for tick in flagged), time_s, (sds[at], sds[-1]), found[-1].lost)


@BENCH.part()
def blind(
    recording: str = "",
    /,
    *,
    texture: str = "parquet",
    floor_seed: int = 0,
    runs: int = 1,
    cases: str = ",".join(FAULTS),
    params: str = "nao-eyes",
    seconds: float = math.inf,
) -> None:
    """Replay a recorded walk with cameras that see nothing useful: count wrong certain poses, time until a flag.

    Goals: no certain pose that is wrong (sd below 10 cm, error above 30 cm, not lost), a flag within 1 s, no flag
    before anything is wrong.

    Args:
        recording: MCAP file of the Nao.
        texture: name of the floor's texture.
        floor_seed: seed of the floor that the map shows.
        runs: number of seeds of each case; the case `other floor` has another floor with each.
        cases: names of cases, comma-separated; of "none" every flag is a false alarm.
        params: model of the navigator.
        seconds: time of the recording that is used, from its begin, s.
    """
    motion = read_motion(Path(recording), seconds)
    replay = WalkReplay(map_along(motion, texture, floor_seed), params)
    rows: list[tuple[object, ...]] = []
    other = "tiles" if texture == "carpet" else "carpet"
    for case in words_of(cases):
        found: list[BlindRun] = []
        for seed in range(runs):
            number = floor_seed + (5 + seed if case == "other floor" else 0)
            found.append(
                blind_run(motion, replay, case, floor(other if case == "other texture" else texture, number), seed)
            )
        times, sds = np.array([each.time for each in found]), 100.0 * np.mean([each.sd for each in found], axis=0)
        alarms, lost = sum(each.alarms for each in found), sum(each.lost for each in found)
        wrong, soon = sum(each.wrong for each in found), int((times <= SOON).sum())
        rows.append((case, runs, wrong, alarms, soon, float(times.max()), *sds.tolist(), lost))
    header = ("case", "runs", "wrong certain", "false alarms", "flag in 1 s", "flag after s", "sd before cm",
              "sd at the end cm", "lost")  # fmt: skip
    table(f"{texture}, {0.01 * len(motion.ticks):.0f} s of motion", header, rows)
