"""Samples of recorded walks are those of the robot that walked."""

import pytest

pytestmark = pytest.mark.usefixtures("apart")


def test_another_robots_recording_is_refused(complaint, recorded, tmp_path):
    out = tmp_path / "samples.jsonl"
    for other in ("messor", "nao"):
        shown = complaint("footholds", "gather", recorded, "--robot", other, "--out", out).splitlines()[-1]
        assert shown == f"surefoot: robot: got {other!r}, allowed is that of {recorded}: 'ragno'"
    assert not out.exists()


def test_the_robot_may_be_named_or_not(answer, recorded, tmp_path):
    files = [tmp_path / name for name in ("named.jsonl", "unnamed.jsonl")]
    answer("footholds", "gather", recorded, "--robot", "ragno", "--out", files[0])
    answer("footholds", "gather", recorded, "--out", files[1])
    assert files[0].read_text() == files[1].read_text() != ""
