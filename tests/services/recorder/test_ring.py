"""The last seconds of a run: kept in memory, written on a fall, a stop and a request, a file each."""

import json
from pathlib import Path
from typing import Any

import pytest

from surefoot.bus.interface import Raw
from surefoot.errors import CallError
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.local import LocalSystem
from surefoot.record.recording import SUMMARY, open_readable, read_recording, recording_info
from surefoot.schemas.base import Header
from surefoot.schemas.system import SaveRequest
from surefoot.schemas.topics import HW_IMU, RECORDER_SAVE, SIM_STATUS, SIM_TRUTH, STATE_VELOCITY, TERRAIN_MAP
from surefoot.services.recorder.config import RecorderConfig
from surefoot.services.recorder.outputs import LastSeconds, WholeRun, output_of
from tests.services.recorder.test_recorder import EXPECT, MappedDriver, ToyRecorder
from tests.surefoot.toys import ToyEstimator, ToyWalker

RING_S = 0.5
UPRIGHT, LYING = [0.0, 0.0, 9.81], [9.81, 0.0, 0.1]


@pytest.fixture
def ring(tmp_path: Path) -> LastSeconds:
    config = RecorderConfig(path=str(tmp_path / "run.mcap"), ring_s=RING_S, about=about(tmp_path))
    found = output_of(config, lambda: {"wall_s": "2.5"})
    assert isinstance(found, LastSeconds)
    found.begin(1, 7, begun=False)
    return found


def about(folder: Path) -> str:
    (folder / "robot.toml").write_text("name = 'x'")
    places = {"robot.toml": str(folder / "robot.toml"), "gone.json": str(folder / "gone.json")}
    return json.dumps({"run": {"system": "ragno"}, "files": places})


def put(ring: LastSeconds, topic: Any, tick: int, attachment: bytes | None = None, **content: Any) -> None:
    header = Header(stamp_ns=tick * 10**7, tick=tick, epoch=1, seq=tick, source="x")
    ring.write(topic, header, Raw(json.dumps(content, separators=(",", ":")).encode(), attachment, ""), tick)


def walk(ring: LastSeconds, begin: int, end: int, **truth: Any) -> None:
    for tick in range(begin, end):
        put(ring, HW_IMU, tick)
        put(ring, SIM_TRUTH, tick, fallen=False, **truth)


def written(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob("*.mcap"))


def test_a_fall_writes_the_last_seconds_with_map_files_and_facts(ring: LastSeconds, tmp_path: Path) -> None:
    put(ring, TERRAIN_MAP, 0, b'{"rows":1}')
    walk(ring, 0, 300)
    assert written(tmp_path) == []
    put(ring, SIM_TRUTH, 300, fallen=True)
    put(ring, SIM_TRUTH, 301, fallen=True)  # still the same fall
    assert written(tmp_path) == ["run-fall.mcap"]
    path = tmp_path / "run-fall.mcap"
    ticks = [item.stamp_ns // 10**7 for item in read_recording(path, ("hw/imu",))]
    assert ticks == list(range(251, 300))
    assert [item.stamp_ns for item in read_recording(path, ("terrain/map",))] == [0]
    assert recording_info(path)["metadata"][SUMMARY] == {"wall_s": "2.5"}
    run = recording_info(path)["metadata"]["run"]
    assert (run["reason"], run["ring_s"], run["seed"], run["system"]) == ("fall", "0.5", "7", "ragno")
    assert "No such file" in run["not attached: gone.json"]
    assert open_readable(path).found.attachments == {"robot.toml": b"name = 'x'"}


def test_each_event_has_a_file_of_its_own(ring: LastSeconds, tmp_path: Path) -> None:
    walk(ring, 0, 20)
    put(ring, SIM_STATUS, 20, stopped="")
    for tick in (20, 21):
        put(ring, SIM_STATUS, tick, stopped="operator")
    put(ring, SIM_STATUS, 22, stopped="")
    put(ring, SIM_STATUS, 23, stopped="operator")
    assert ring.save("request") == (str(tmp_path / "run-request.mcap"), 45)
    assert ring.save("request")[0].endswith("run-request-2.mcap")
    assert written(tmp_path) == ["run-request-2.mcap", "run-request.mcap", "run-stop-2.mcap", "run-stop.mcap"]


def test_without_truth_the_tilt_by_the_estimator_reports_a_fall(ring: LastSeconds, tmp_path: Path) -> None:
    for tick in range(40):
        put(ring, STATE_VELOCITY, tick, g_up=UPRIGHT)
    put(ring, STATE_VELOCITY, 40, g_up=[0.0, 0.0, 0.0])  # it does not know the direction yet
    assert written(tmp_path) == []
    put(ring, STATE_VELOCITY, 50, g_up=LYING)
    assert written(tmp_path) == ["run-fall.mcap"]


def test_memory_is_bounded_and_an_epoch_begins_empty(ring: LastSeconds) -> None:
    walk(ring, 0, 2000)
    assert len(ring._ring) == 2 * round(RING_S / 0.01)
    ring.begin(1, 7, begun=True)
    assert ring._ring
    ring.begin(2, 7, begun=False)
    assert not ring._ring


def test_a_request_over_the_bus_and_its_refusals(tmp_path: Path) -> None:
    recorder = ToyRecorder(RecorderConfig(path=str(tmp_path / "run.mcap"), ring_s=0.1))
    driver = MappedDriver(0)
    system = LocalSystem([driver, ToyEstimator(ServiceConfig()), ToyWalker(ServiceConfig()), recorder])
    driver.node.begin(EXPECT, "lockstep", 0.0, 1, "hold", 0)
    driver.node.leader.end_tick = 40
    system.run_until(lambda: driver.node.leader.state == "ended" and driver.node.leader.all_done())
    recorder._configs["walker"] = "ab12"  # stated in its health
    reply = system.bus.call(RECORDER_SAVE, SaveRequest(reason="near_miss"))
    assert written(tmp_path) == ["run-near_miss.mcap"]
    ticks = {item.message().tick for item in read_recording(Path(reply.path), ("hw/imu",))}
    assert ticks == set(range(31, 41))
    assert [item.key for item in read_recording(Path(reply.path), ("terrain/map",))] == ["terrain/map"]
    summary = recording_info(Path(reply.path))["metadata"][SUMMARY]
    assert float(summary["wall_s"]) > 0.0
    assert summary["last_tick"] == "40"
    assert json.loads(summary["configuration"]) == {"walker": "ab12"}
    recorder._output = WholeRun(RecorderConfig(), tmp_path / "whole.mcap")
    with pytest.raises(CallError, match="ring_s is 0"):
        system.bus.call(RECORDER_SAVE, SaveRequest())
    recorder._output = None
    with pytest.raises(CallError, match="path is empty"):
        system.bus.call(RECORDER_SAVE, SaveRequest())
    system.close()
