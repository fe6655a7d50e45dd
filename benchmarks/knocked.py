"""Bipeds that a push knocks over, some faster than their gyro can measure: how they lie by estimate and truth."""

import math

import numpy as np

from benchmarks.bench import Bench, numbers_of, table
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.lab.statistics import middle_and_ends
from surefoot.lab.studies import seeds_of
from surefoot.services.estimator.inputs.check import ACC_SIGN, UNIT_WORDS
from tests.services.walker.biped.biped_plant import Plant

BENCH = Bench("knocked")
PUSH_S = 0.2  # s
LOOKS_S = (3.0, 8.0)  # s after the push
OFF = math.radians(5.0)


@BENCH.part("--forces 60 --seeds 0:1")
def over(robot: str = "bioloid", /, *, forces: str = "30,35,40,45,50,60", seeds: str = "0:2") -> None:
    """Error of the tilt 3 and 8 s after the push, and for how long it was above 5 deg under flags that are all true.

    Args:
        robot: bioloid or nao.
        forces: level forces of the push of 0.2 s, N, comma-separated; its direction turns by 63 deg per seed.
        seeds: seeds of the world.
    """
    rows: list[tuple[object, ...]] = []
    for force in numbers_of(forces):
        errors: list[list[float]] = [[] for _ in LOOKS_S]
        silent, known, accused = list[float](), 0, 0
        for seed in seeds_of(seeds):
            plant = Plant(robot, seed=seed).stand()
            way = 1.1 * seed
            plant.world.push((force * math.sin(way), force * math.cos(way), 0.0), PUSH_S)
            wrong, unit, found = 0, False, list[float]()
            for _ in range(round(100.0 * LOOKS_S[-1])):
                plant.tick()
                estimate, truth = plant.estimator.estimate(), plant.world.truth()
                up = matrix_from_quat(np.array(truth.quat_wxyz))[2]
                lean = math.acos(math.cos(estimate.roll) * math.cos(estimate.pitch))
                found.append(abs(lean - math.acos(max(-1.0, min(float(up[2]), 1.0)))))
                well = estimate.inputs_ok and estimate.filter_ok and estimate.sensors_ok
                wrong += well and found[-1] > OFF
                unit = unit or any(UNIT_WORDS[ACC_SIGN] in reason for reason in estimate.reasons)
            for k, look in enumerate(LOOKS_S):
                errors[k].append(math.degrees(found[round(100.0 * look) - 1]))
            silent.append(0.01 * wrong)
            known += plant.out is not None and plant.out.reason.startswith("fallen")
            accused += unit
        looks = [f"{sum(e > math.degrees(OFF) for e in found)}, {max(found):.1f}" for found in errors]
        rows.append((force, len(silent), *looks, middle_and_ends(silent), known, accused))
    header = ("push N", "runs", "off after 3 s, most deg", "after 8 s", "off in silence, s", "fallen", "sign refused")
    table(f"{robot}, seeds {seeds}", header, rows)
