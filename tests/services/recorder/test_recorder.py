"""The recorder: every tick whole, the hash of the run, and a disk that fails does not end the run."""

import errno
import json
import os
import re
from pathlib import Path
from typing import Any

import pytest

from surefoot.bus.codec import decode, encode
from surefoot.bus.interface import Delivery, Raw
from surefoot.lab.cli.system import _remarks  # pyright: ignore[reportPrivateUsage]
from surefoot.lab.runs.live import _unrecorded  # pyright: ignore[reportPrivateUsage]
from surefoot.lockstep import driver as driver_module
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.local import LocalSystem
from surefoot.record import chunks
from surefoot.record.check import check, sound_messages
from surefoot.record.recording import RecordingWriter, read_recording, recording_info
from surefoot.schemas import topics
from surefoot.schemas.base import Message
from surefoot.schemas.hw import Tick
from surefoot.schemas.system import Health, LogRecord, RecorderReply, RecorderRequest
from surefoot.schemas.terrain import HeightMapMessage
from surefoot.schemas.topics import Topic
from surefoot.services.recorder.config import RecorderConfig
from surefoot.services.recorder.service import JOINED, Recorder
from surefoot.services.supervisor.processes.status import health_row
from surefoot.version import VERSION
from tests.processes import full_disk
from tests.surefoot.toys import ToyDriver, ToyEstimator, ToyWalker

EXPECT = ("estimator", "walker", "recorder")


MAP = HeightMapMessage(rows=1, cols=1, cell=0.1, origin=(0.0, 0.0), version=1, data=b"\0" * 4)


class ToyRecorder(Recorder):
    """Joins what the toys publish; otherwise the real one."""

    inputs = (topics.HW_IMU, topics.STATE_VELOCITY, topics.STATE_GAIT, topics.CMD_JOINTS, topics.TERRAIN_MAP)


class MappedDriver(ToyDriver):
    """Starts at a place that the seed gives, and publishes a map."""

    outputs = (*ToyDriver.outputs, topics.TERRAIN_MAP)

    def __init__(self, seed: int) -> None:
        super().__init__()
        self.x = 0.001 * seed

    def latched(self) -> list[tuple[Topic[Any], Message]]:
        return [(topics.TERRAIN_MAP, MAP)]


def begun(path: Path | None, ticks: int = 30, seed: int = 0, order: tuple[int, ...] = (0, 1, 2, 3)) -> Any:
    """Start a run of the toys with a real recorder."""
    driver = MappedDriver(seed)
    recorder = ToyRecorder(RecorderConfig(path=None if path is None else str(path)))
    services = [driver, ToyEstimator(ServiceConfig()), ToyWalker(ServiceConfig()), recorder]
    system = LocalSystem([services[i] for i in order])
    begin(driver, ticks, seed)
    return system, driver


def record(path: Path | None, **run: Any) -> Any:
    """Run the toys with a real recorder to the end."""
    system, driver = begun(path, **run)
    finish(system, driver)
    return system, driver


def begin(driver: ToyDriver, ticks: int, seed: int = 0) -> None:
    driver.node.begin(EXPECT, "lockstep", 0.0, 1, "hold", seed)
    driver.node.leader.end_tick = ticks - 1


def finish(system: LocalSystem, driver: ToyDriver) -> None:
    leader = driver.node.leader
    system.run_until(lambda: leader.state == "ended" and leader.all_done())


def status(system: LocalSystem) -> RecorderReply:
    return system.bus.call(topics.RECORDER_STATUS, RecorderRequest())


def test_every_message_of_every_tick_is_on_disk_once(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    system, _ = record(path)
    info = recording_info(path)
    for topic in (topics.HW_TICK, topics.HW_IMU, topics.STATE_VELOCITY, topics.STATE_GAIT, topics.CMD_JOINTS):
        assert info["topics"][topic.key] == 30
    assert info["metadata"]["run"]["seed"] == "0"
    reply = status(system)
    assert reply.finished
    assert reply.run_hash == info["metadata"]["surefoot"]["run_hash"]
    assert (reply.tick, reply.epoch, reply.path) == (29, 1, str(path))
    assert [m.message().tick for m in read_recording(path, ("hw/imu",))] == list(range(30))


def test_a_file_carries_the_facts_given_and_the_digest_of_each_key(tmp_path: Path) -> None:
    facts = {"run": {"scenario": "walk", "robot": "lupo"}, "scenario": {"json": "{}"}}
    files = []
    for about, seed in ((json.dumps(facts), 0), ("no JSON", 0), ("", 1)):
        files.append(tmp_path / f"run{len(files)}.mcap")
        driver = MappedDriver(seed)
        recorder = ToyRecorder(RecorderConfig(path=str(files[-1]), about=about))
        system = LocalSystem([driver, ToyEstimator(ServiceConfig()), ToyWalker(ServiceConfig()), recorder])
        begin(driver, 5, seed)
        finish(system, driver)
    found = [recording_info(file)["metadata"] for file in files]
    assert found[0]["run"] == {**facts["run"], "epoch": "1", "seed": "0", "version": VERSION}
    assert found[0]["scenario"] == facts["scenario"]
    assert found[1]["about"] == {"unreadable": "no JSON"}
    assert found[1]["run"]["robot"] == "ragno"
    assert set(found[0]["hashes"]) == {"hw/imu", "state/velocity", "state/gait", "cmd/joints", "terrain/map"}
    assert float(found[0]["surefoot"]["wall_s"]) > 0.0
    assert found[0]["hashes"] == found[1]["hashes"]
    same = {key for key, digest in found[2]["hashes"].items() if digest == found[0]["hashes"][key]}
    assert same == {"terrain/map"}


def test_same_seed_same_hash_whatever_the_order_and_the_file(tmp_path: Path) -> None:
    reference = status(record(None)[0]).run_hash
    assert len(reference) == 64
    for order in ((3, 2, 1, 0), (1, 3, 0, 2)):
        assert status(record(None, order=order)[0]).run_hash == reference
    assert status(record(tmp_path / "x.mcap")[0]).run_hash == reference
    assert status(record(None, seed=1)[0]).run_hash != reference
    assert status(record(None, ticks=29)[0]).run_hash != reference


def test_the_map_is_kept_and_hashed_once_however_often_it_is_published(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    system, driver = begun(path)
    for tick in (5, 15):
        system.run_until(lambda tick=tick: driver.node.leader.tick > tick)
        driver.node._tell_latched()
    finish(system, driver)
    assert recording_info(path)["topics"]["terrain/map"] == 1
    assert status(system).run_hash == status(record(None)[0]).run_hash


def test_a_map_of_the_coming_epoch_that_is_early_belongs_to_its_own_run() -> None:
    system, driver = record(None, ticks=10)
    first = status(system).run_hash
    driver.x = 0.0
    early = MAP.relabelled(0, 0, 2, 0, "simulator")
    system.nodes[3].handle(Delivery(topics.TERRAIN_MAP, early, None, None, driver.node.instance))  # before its prime
    begin(driver, 10)
    finish(system, driver)
    second = status(system)
    again, other = record(None, ticks=10)
    other.x = 0.0
    begin(other, 10)
    finish(again, other)
    assert second.run_hash == status(again).run_hash != first


@pytest.mark.parametrize("damaged", [None, b"\0" * 3, "body"])
def test_a_map_that_is_lost_comes_again_and_changes_no_hash(
    damaged: bytes | str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A recorder that began a run without it, or with one that has a good header only, would give another hash."""
    monkeypatch.setattr(driver_module, "SILENCE_S", 1e-6)
    system, driver = begun(None)
    node, lost = system.nodes[3], list[Delivery]()
    handle = node.handle

    def lose_one(item: Any) -> None:
        if isinstance(item, Delivery) and item.key == topics.TERRAIN_MAP.key and not item.prime and not lost:
            lost.append(item)
            if damaged is not None:
                header = item.raw().attachment if damaged == "body" else None
                handle(Delivery(topics.TERRAIN_MAP, None, Raw(b"\0" * 3, header, ""), None, item.sender))
                assert node.refused["malformed"] + node.refused["invalid"] == 1
            return
        handle(item)

    monkeypatch.setattr(node, "handle", lose_one)
    finish(system, driver)
    assert lost
    assert driver.node.leader.tick == 29
    assert status(system).run_hash == status(record(None)[0]).run_hash


def test_a_driver_that_counts_its_epochs_from_one_again_has_its_map_recorded() -> None:
    recorder = ToyRecorder(RecorderConfig(path=None))
    LocalSystem([MappedDriver(0), recorder])
    terrain = Delivery(topics.TERRAIN_MAP, MAP.stamped(0, 0, 1, 0, "driver"), None, None, "driver")
    last = Tick(tick=0, epoch=1, roster=("recorder",), due=(), mode="paced", roster_version=1, end=True)
    found = list[tuple[int, str]]()
    for _ in range(2):
        recorder.on_reset()
        recorder.on_tick(TickInputs(last, {topics.TERRAIN_MAP.key: terrain}))
        reply = recorder.status(RecorderRequest())
        found.append((reply.messages, reply.run_hash))
    assert found[0] == found[1]
    assert found[0][0] == 1


def test_no_hash_before_the_end() -> None:
    system, driver = begun(None)
    system.run_until(lambda: driver.node.leader.tick > 10)
    assert status(system).run_hash == ""
    assert not status(system).finished


def test_a_second_epoch_is_a_second_file(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    system, driver = record(path, ticks=10)
    driver.x = 0.0
    begin(driver, 20)
    finish(system, driver)
    assert recording_info(path)["topics"]["hw/imu"] == 10
    assert recording_info(tmp_path / "run-2.mcap")["topics"]["hw/imu"] == 20
    assert status(system).path.endswith("run-2.mcap")


def test_a_run_that_is_cut_off_has_its_file_closed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    system, driver = begun(path)
    system.run_until(lambda: driver.node.leader.tick > 10)
    system.close()
    assert 5 < recording_info(path)["topics"]["hw/imu"] < 30


@pytest.mark.parametrize("kind", ["folder", "file in the way"])
def test_a_path_that_cannot_be_written_is_logged_and_the_run_goes_on(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "x" / "run.mcap"
    if kind == "folder":
        path.mkdir(parents=True)
    else:
        (tmp_path / "x").write_text("")
    logged: list[LogRecord] = []
    system, driver = begun(path)
    system.bus.subscribe(topics.LOG, lambda delivery: logged.append(delivery.message()))  # type: ignore[arg-type]
    finish(system, driver)
    assert status(system).run_hash == status(record(None)[0]).run_hash
    assert status(system).path == ""
    errors = [line.text for line in logged if line.level == "error"]
    assert len(errors) == 1
    assert str(path) in errors[0]


def test_a_disk_that_is_full_in_a_run_is_in_health_and_status_until_the_next_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, system, driver = tmp_path / "run.mcap", *begun(tmp_path / "run.mcap")
    write = RecordingWriter.write

    def on_full(writer: Any, topic: Any, header: Any, raw: Any) -> None:
        if driver.node.leader.tick >= 10:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(writer, topic, header, raw)

    monkeypatch.setattr(RecordingWriter, "write", on_full)
    recorder = system.nodes[3]
    assert recorder.health().trouble == ""
    finish(system, driver)
    found = status(system)
    wanted = rf"nothing is recorded from tick \d+ on: {re.escape(str(path))}: No space left on device"
    assert re.fullmatch(wanted, found.trouble)
    assert recorder.health().trouble == found.trouble
    assert found.finished
    assert _unrecorded(path, found)[1:] == [found.trouble]
    assert _remarks({"detail": "", **health_row(recorder.health())}).startswith(found.trouble)
    monkeypatch.setattr(RecordingWriter, "write", write)
    driver.x = 0.0
    begin(driver, 10)
    finish(system, driver)
    assert status(system).trouble == recorder.health().trouble == ""
    assert _unrecorded(path, status(system)) == []


def test_all_before_the_tick_that_a_full_disk_names_is_in_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(chunks, "CHUNK_BYTES", 4_000)
    whole, part = tmp_path / "whole.mcap", tmp_path / "part.mcap"
    record(whole, ticks=60)
    named = set[int]()
    for tenths in (4, 5, 6, 7, 8, 9):
        system, driver = begun(part, ticks=60)
        with full_disk(whole.stat().st_size * tenths // 10):
            finish(system, driver)
        lost = int(status(system).trouble.split()[5])
        found = check(part)
        ticks: dict[str, list[int]] = {"hw/tick": [], "hw/imu": []}
        for one in sound_messages(part, found.pieces):
            if (key := found.channels[one.channel]) in ticks:
                ticks[key].append(json.loads(bytes(one.data))["tick"])
        assert ticks["hw/tick"][:lost] == ticks["hw/imu"][:lost] == list(range(lost))
        named.add(lost)
    assert len(named) > 2


def test_a_path_that_is_no_utf8_is_written_and_reported(tmp_path: Path) -> None:
    system, _ = record(tmp_path / "b\udcff.mcap")
    assert recording_info(tmp_path / "b\udcff.mcap")["topics"]["hw/imu"] == 30
    assert decode(RecorderReply, encode(status(system))[0]).path.endswith("b\\udcff.mcap")


def test_everything_deterministic_is_joined() -> None:
    assert {topics.HW_IMU, topics.STATE_VELOCITY, topics.STATE_GAIT, topics.CMD_JOINTS} <= set(JOINED)
    assert all(topic.deterministic for topic in JOINED)
    assert HeightMapMessage not in {topic.model for topic in JOINED}  # latched: comes beside the ticks


def test_a_recorder_started_again_in_a_run_leaves_what_the_killed_one_wrote(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    record(path)
    written = path.read_bytes()
    again = ToyRecorder(RecorderConfig(path=str(path)))
    again.on_start()
    again.on_reset()
    for tick in (12, 13):
        again.on_tick(
            TickInputs(Tick(tick=tick, epoch=1, roster=EXPECT, roster_version=1, due=(), mode="lockstep"), {})
        )
    again.on_stop()
    assert path.read_bytes() == written
    assert [found.message().tick for found in read_recording(tmp_path / "run-2.mcap")] == [12, 13]


def test_a_file_carries_the_hash_of_the_configuration_of_each_service(tmp_path: Path) -> None:
    path, driver = tmp_path / "run.mcap", MappedDriver(0)
    recorder = ToyRecorder(RecorderConfig(path=str(path)))
    estimator = ToyEstimator(ServiceConfig())
    system = LocalSystem([driver, estimator, ToyWalker(ServiceConfig()), recorder])
    begin(driver, 5)
    strangers = [(f"stranger{number}", "c") for number in range(1000)]
    for name, digest in (("walker", "c"), ("estimator", "a" * 64), *strangers, ("walker", "b" * 64)):
        recorder.on_message(
            topics.HEALTH,
            Health(stamp_ns=0, source=name, service=name, instance="i", state="running", pid=1, config_hash=digest),
        )
    finish(system, driver)
    stated = json.loads(recording_info(path)["metadata"]["surefoot"]["configuration"])
    assert (stated["estimator"], stated["walker"]) == ("a" * 64, "b" * 64)
    assert len(stated) == 64
