"""A robot that ships with the project trots, flies and hops by somebody else's command; the services watch it."""

import math
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from benchmarks.trotting import GAITS, measured, watch
from surefoot.lab.cli.main import main
from surefoot.lab.footholds.campaign import read
from surefoot.record.recording import read_recording
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import Imu
from surefoot.schemas.topics import HW_IMU, STATE_STABILITY
from surefoot.services.footholds.learning.fit import LearnOptions, candidates, learn
from surefoot.services.footholds.learning.samples import gather

ROBOT = "lupo"


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    recording = tmp_path_factory.mktemp("trot") / "flight.mcap"
    watch(ROBOT, 0, recording, 4.0, **GAITS["flying"])
    return recording


def test_velocity_heading_and_health_beside_a_trot_that_flies(flight: Path) -> None:
    found = measured(ROBOT, flight)
    assert not found.fell
    assert found.speed > 0.2
    assert found.airborne > 0.05
    assert found.velocity < 0.05
    assert found.heading < 1.0
    assert found.false_falls == 0


def test_without_support_stability_still_answers(flight: Path) -> None:
    """No foot down: no region and no margin; two feet: a segment, outside of which the margin is negative."""
    seen = [item.message() for item in read_recording(flight, (STATE_STABILITY.key,))]
    seen = [message for message in seen if message.com_planned is not None]
    for message in seen:
        feet = sum(message.stance)
        assert message.status == {0: "infeasible", 1: "point", 2: "segment"}.get(feet, "ok"), feet
        assert (message.margin_planned is None) == (feet == 0)
        if feet in (1, 2):
            assert message.margin_planned <= 0.0
    assert {sum(message.stance) for message in seen} >= {0, 1, 2, 4}


def test_slip_of_foreign_trots_is_learned_from(flight: Path, tmp_path: Path) -> None:
    watch(ROBOT, 1, other := tmp_path / "trot.mcap", 3.0)
    out = tmp_path / "samples.jsonl"
    with pytest.raises(SystemExit) as ended:
        main(["footholds", "gather", str(flight), str(other), "-o", str(out)])
    assert not ended.value.code
    found, trials, _ = read(out)
    robot = load_robot(ROBOT)
    assert set(trials) == {"flight", "trot"}
    assert {sample.robot for sample in found} == {ROBOT}
    assert {sample.leg for sample in found} == set(range(robot.nlegs))
    kept = gather(found)
    strokes = [sample.length for sample in kept.kept if sample.trial == "flight"]
    assert 0.03 < float(np.median(strokes)) < 0.15  # of 0.11 m that are planned
    model = learn(kept, LearnOptions(title="foreign", candidates=candidates(1), folds=2))
    assert model.conditions.robot == ROBOT
    assert model.name == f"foreign/{len(kept)}"


def test_a_hop_is_no_fall(tmp_path: Path) -> None:
    """The accelerometer shows no weight for more than a tenth of a second, and nothing falls."""
    recording = tmp_path / "hop.mcap"
    watch(ROBOT, 0, recording, 3.0, together=True, speed=0.0, duty=0.3, leap_m=0.08, period_s=0.5)
    found = measured(ROBOT, recording)
    light, longest = 0, 0
    for item in read_recording(recording, (HW_IMU.key,)):
        light = light + 1 if math.hypot(*cast(Imu, item.message()).acc) < 3.0 else 0
        longest = max(longest, light)
    assert longest > 12  # ticks
    assert not found.fell
    assert found.false_falls == 0
