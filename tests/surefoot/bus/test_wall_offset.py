"""Stamps of ROS 2 messages stay those of the wall clock when that is set, or when a run was paused; and the wall clock
is read nowhere else than where a person or another program reads the time."""

import re
from pathlib import Path

import pytest

import surefoot
from surefoot.bus import ros2
from surefoot.bus.ros2 import FIRM_TICKS, JUMP_NS, WallOffset
from surefoot.schemas.topics import TICK_NS

SECOND = 10**9
HOUR = 3600 * SECOND

READERS = {
    "surefoot/logline.py": "the time of a line of a log",
    "surefoot/bus/certificates.py": "the days that a certificate is valid",
    "surefoot/bus/ros2.py": "stamps for ROS 2",
}
"""Modules of runtime and services that read the wall clock, and for what."""


class Wall:
    """Wall clock of a test, which a run of one tick each 10 ms reads with a delay."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.ns, self.stamp, self._offset = 1_000 * HOUR, 0, WallOffset()
        monkeypatch.setattr(ros2.time, "time_ns", lambda: self.ns)

    def ticks(self, number: int, delay_ns: int = 0) -> int:
        """Do ticks, and return how far the last stamp is behind the wall clock of its tick, ns."""
        made = 0
        for _ in range(number):
            self.stamp += TICK_NS
            self.ns += TICK_NS
            at, self.ns = self.ns, self.ns + delay_ns
            made = self.stamp + self._offset.measure(self.stamp)
            self.ns = at
        return self.ns - made


@pytest.mark.parametrize("jump", [HOUR, 10 * SECOND, 2 * JUMP_NS, -HOUR, -10 * SECOND])
def test_stamps_follow_a_wall_clock_that_is_set_forward_or_back(monkeypatch: pytest.MonkeyPatch, jump: int) -> None:
    wall = Wall(monkeypatch)
    assert wall.ticks(250) == 0
    wall.ns += jump  # a pause of the run is the same
    assert abs(wall.ticks(2 * FIRM_TICKS)) <= TICK_NS
    assert abs(wall.ticks(1000)) <= TICK_NS


def test_ticks_that_are_late_on_a_busy_machine_move_no_stamp(monkeypatch: pytest.MonkeyPatch) -> None:
    wall = Wall(monkeypatch)
    wall.ticks(250)
    for _ in range(40):  # 0.95 s late of each second
        wall.ticks(95, 10 * JUMP_NS)
        assert abs(wall.ticks(5)) <= TICK_NS // 100


def test_runtime_and_services_read_the_wall_clock_for_persons_and_other_programs_only() -> None:
    root = Path(surefoot.__file__).parents[1]
    places = ("surefoot/*.py", "surefoot/bus/*.py", "surefoot/lockstep/**/*.py", "services/**/*.py")
    read = re.compile(r"\b(time\.(time|time_ns|localtime)\(|CLOCK_REALTIME|(datetime|date)\.(now|utcnow|today)\()")
    files = [path for place in places for path in root.glob(place)]
    assert len(files) > 200
    assert {str(path.relative_to(root)) for path in files if read.search(path.read_text("utf-8"))} == set(READERS)
