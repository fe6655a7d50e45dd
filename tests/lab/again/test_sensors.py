"""A recording without a scenario repeats from its sensor messages, to the bit; what was changed in it is found."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from surefoot.errors import SurefootError
from surefoot.lab.again.repeat import Verification, verify
from surefoot.lab.again.sensors import RecordedLog, without_scenario
from surefoot.lab.bags.fit import fitted
from surefoot.lab.bags.importing import record
from surefoot.lab.cli.main import main
from surefoot.record.recording import RecordingWriter, open_readable, read_recording, recording_info, topic_of
from surefoot.robot.reader import ROBOT_FILE, load_robot, robot_file
from surefoot.schemas.base import Header
from tests.lab.bags.sway import ROBOT, sway
from tests.lab.bags.test_bad_bags import log_of_rows
from tests.surefoot.expect import expect_error

Edit = Callable[[str, dict[str, Any]], dict[str, Any] | None]


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recording of a log, with a robot that exists only in the recording by now."""
    folder = tmp_path_factory.mktemp("sensors")
    own = folder / "own"
    own.mkdir()
    (own / ROBOT_FILE).write_bytes(robot_file(ROBOT).read_bytes())
    record(fitted(log_of_rows(sway().cut(slice(0, 400))), load_robot(own)), str(own), folder / "log.mcap")
    (own / ROBOT_FILE).unlink()
    return folder / "log.mcap"


def edited(source: Path, to: Path, edit: Edit, **run: str) -> Path:
    """Write a recording again with its messages as `edit` returns them (None = left out), and further facts."""
    metadata, found = recording_info(source)["metadata"], open_readable(source).found
    tables = {"versions": metadata["versions"]}
    writer = RecordingWriter(to, {**metadata["run"], **run}, tables, found.attachments)
    for item in read_recording(source):
        topic, raw = topic_of(item.key), item.raw()
        assert topic is not None
        content = json.loads(raw.payload)
        if (kept := edit(item.key, content)) is None:
            continue
        if kept is not content:
            raw = raw._replace(payload=json.dumps(kept, separators=(",", ":")).encode())
        head = Header(stamp_ns=item.stamp_ns, tick=content["tick"], epoch=1, seq=content["seq"], source="player")
        writer.write(topic, head, raw)
    writer.close(metadata["surefoot"], metadata["hashes"])
    return to


def shaken(key: str, m: dict[str, Any]) -> dict[str, Any]:
    return {**m, "gyro": [m["gyro"][0] + 1e-3, *m["gyro"][1:]]} if key == "hw/imu" and m["tick"] == 70 else m


def test_an_imported_log_repeats_to_the_bit_without_its_source(
    imported: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "again.mcap"
    with pytest.raises(SystemExit) as end:
        main(["verify", str(imported), "--json", "-o", str(out)])
    shown = json.loads(capsys.readouterr().out)
    assert end.value.code == 0, shown
    assert shown["same"]
    assert not shown["versions"]
    assert shown["recorded"] == shown["repeated"] == recording_info(imported)["metadata"]["surefoot"]["run_hash"]
    assert recording_info(out)["topics"] == recording_info(imported)["topics"]


def test_a_sensor_value_that_was_changed_is_found(
    imported: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = edited(imported, tmp_path / "shaken.mcap", shaken)
    with pytest.raises(SystemExit) as end:
        main(["verify", str(other)])
    shown = capsys.readouterr()
    assert end.value.code == 1
    assert "inputs (of the driver): hw/imu" in shown.out
    assert "state/velocity at tick 70, field " in shown.out
    assert "the run does not repeat" in shown.out
    assert "Traceback" not in shown.err


def test_a_run_of_a_robot_with_its_own_clock_is_compared_by_its_estimates(imported: Path, tmp_path: Path) -> None:
    paced = edited(imported, tmp_path / "paced.mcap", lambda _, m: m, mode="paced")
    log = RecordedLog.of(open_readable(paced))
    assert without_scenario(log.recording)
    assert "state/stability" not in log.compared
    assert verify(log).same
    late = edited(imported, tmp_path / "late.mcap", lambda k, m: None if (k, m["tick"]) == ("hw/imu", 60) else m)
    found = verify(RecordedLog.of(open_readable(late)))
    assert not found.same
    assert found.first is not None
    assert (found.first.key, found.first.tick) == ("state/velocity", 60)
    assert found.altered == ("hw/imu",)


def test_a_recording_without_estimates_is_refused(imported: Path, tmp_path: Path) -> None:
    bare = edited(imported, tmp_path / "bare.mcap", lambda k, m: None if k.startswith("state/") else m)
    with expect_error(SurefootError, "invalid", text="nothing can be repeated"):
        RecordedLog.of(open_readable(bare))


def test_two_absent_hashes_are_not_equal() -> None:
    """A recording without digests, whose repetition lacks one, too, has been compared with nothing."""
    found = Verification("", "", (), None, {})
    assert not found.repeats
    assert not found.same
