"""Binding of one of several processes to a service: names that the supervisor's secret seals, newer ones, strangers."""

import pickle
from itertools import permutations

import pytest

from surefoot.bus.codec import encode
from surefoot.bus.frame import Frame, FramePart, pack
from surefoot.bus.interface import Life, Stamp
from surefoot.bus.memory import MemoryBus
from surefoot.bus.seals import born_ms
from surefoot.errors import Refusal
from surefoot.lockstep.binding import MOST_TRIED, Bindings
from surefoot.schemas.hw import Tick
from surefoot.schemas.topics import CMD_JOINTS, HW_IMU, HW_TICK, TICK_NS
from tests.surefoot.expect import expect_error
from tests.surefoot.lockstep.node_bench import IMU, Bench


def born(service: str, instance: str) -> int:
    """Return the number in a name ``<service>@<number>``, as if it were sealed at that time."""
    name, _, number = instance.partition("@")
    return int(number) if number and name == service else 0


class Table(Bindings):
    """Bindings of a system whose processes have sealed names."""

    def __init__(self) -> None:
        super().__init__(born)

    def comes(self, service: str, instance: str) -> bool:
        """A process shows its token and proves its links; return whether it is bound."""
        self.on_life(Life(service, instance, True))
        return self.bind(service, instance)

    def goes(self, service: str, instance: str) -> None:
        self.on_life(Life(service, instance, False))


def test_a_token_shown_before_a_crash_wins_nothing_after_it() -> None:
    table = Table()
    assert table.comes("walker", "walker@5")
    assert not table.comes("walker", "stranger")
    table.goes("walker", "walker@5")
    assert not table.bind("walker", "stranger")
    assert not table.comes("walker", "quick stranger")
    assert "stranger" not in table.candidates("walker")
    assert table.comes("walker", "walker@9")
    assert table.bound["walker"] == "walker@9"


def test_a_sealed_process_displaces_a_stranger_that_was_first() -> None:
    table = Table()
    assert table.comes("walker", "stranger")
    assert table.on_life(Life("walker", "walker@5", True)) == "stranger"
    assert table.candidates("walker") == ("walker@5", "stranger")
    assert table.bind("walker", "walker@5")
    assert table.candidates("walker") == ("walker@5",)
    assert not table.bind("walker", "stranger")


def test_the_copied_token_of_an_older_process_holds_no_place() -> None:
    table = Table()
    assert table.comes("walker", "walker@5")
    assert table.comes("walker", "walker@9")  # while a copy of the older one's token is still there
    assert not table.bind("walker", "walker@5")
    table.goes("walker", "walker@9")
    assert not table.bind("walker", "walker@5")
    assert table.comes("walker", "walker@9")  # its link came back


def test_the_seal_of_another_service_counts_for_nothing() -> None:
    table = Table()
    assert table.comes("walker", "walker@5")
    table.goes("walker", "walker@5")
    assert not table.comes("walker", "estimator@9")


@pytest.mark.parametrize("order", [*permutations((("driver", "sim@5"), ("sim", "sim@5")))])
def test_a_driver_is_sealed_by_the_name_of_its_service(order: tuple[tuple[str, str], ...]) -> None:
    table = Table()
    for service, instance in order:
        table.comes(service, instance)
    for service, instance in order:
        assert table.bind(service, instance)
    table.comes("walker", "walker@7")
    assert not table.comes("driver", "walker@7"), "the copied name of a newer process drives nothing"
    for service, instance in order:
        table.goes(service, instance)
    assert not table.comes("driver", "stranger")
    table.comes("sim", "sim@9")
    assert table.comes("driver", "sim@9")
    assert table.candidates("driver") == ("sim@9",)


def test_sealed_processes_are_tried_before_hundreds_of_strangers() -> None:
    table = Table()
    for number in range(100):
        table.on_life(Life("walker", f"stranger {number}", True))
    table.on_life(Life("walker", "walker@5", True))
    for number in range(100, 200):
        table.on_life(Life("walker", f"stranger {number}", True))
    for _ in range(5):
        tried = table.candidates("walker")
        assert tried[0] == "walker@5"
        assert len(tried) <= MOST_TRIED


def test_without_a_secret_the_first_stays_while_it_is_there() -> None:
    table = Bindings()
    for instance in ("first", "second"):
        table.on_life(Life("walker", instance, True))
    assert table.bind("walker", "first")
    assert not table.bind("walker", "second")
    table.on_life(Life("walker", "first", False))
    assert table.bind("walker", "second")


KEY = "@frame/walker"


def frame(instance: str, secret: str) -> Frame:
    part = FramePart(CMD_JOINTS.key, b"{}", Stamp(5, 1, 0, 0))
    return Frame("walker", {CMD_JOINTS.key: CMD_JOINTS}, *pack([part], instance, secret, KEY), "s", KEY)


def test_a_frame_in_the_sealed_name_of_another_is_forged() -> None:
    table = Table()
    table.comes("walker", "walker@5")
    table.check_seal(frame("walker@5", "s"))
    table.check_seal(frame("stranger", ""))  # refused as that of a process that is not bound
    for secret in ("", "another"):
        with expect_error(Refusal, "forged", text="in the name of 'walker@5'"):
            table.check_seal(frame("walker@5", secret))


def test_a_frame_counts_once_and_none_of_an_earlier_time() -> None:
    table = Table()
    table.comes("walker", "walker@5")
    first, second = frame("walker@5", "s"), frame("walker@5", "s")
    table.check_seal(second)
    for replay in (first, second, first):
        with expect_error(Refusal, "replayed", text="in the name of 'walker@5'"):
            table.check_seal(replay)
    with expect_error(Refusal, "forged"):
        table.check_seal(frame("walker@5", "another"))
    table.check_seal(frame("walker@5", "s"))


def test_a_frame_that_later_ones_overtook_is_late_and_counts_once_too() -> None:
    table = Table()
    table.comes("walker", "walker@5")
    first, second, third = (frame("walker@5", "s") for _ in range(3))
    for one in (first, third):
        assert table.check_seal(one)
    assert not table.check_seal(second)
    for replay in (first, second, third):
        with expect_error(Refusal, "replayed"):
            table.check_seal(replay)


def test_ticks_of_the_driver_that_come_in_another_order_are_done_in_theirs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(MemoryBus, "born_ms", lambda bus, service, instance: born(service, instance))
    bench = Bench()
    for service in ("sim", "driver"):
        bench.node.handle(Life(service, "sim@5", True))
    prime, again, *ticks = (driven(tick) for tick in (-1, -1, 0, 1, 2, 3))
    for one in (prime, ticks[0], ticks[2], ticks[1], again, ticks[3]):
        bench.node.handle(one)
        bench.node.pump()
    assert (bench.subject.ticks, bench.node.refused) == ([0, 1, 2, 3], {"late": 2})
    bench.node.handle(ticks[1])
    assert bench.node.refused == {"late": 2, "replayed": 1}


def driven(tick: int) -> Frame:
    """Return a sealed frame of the driver: manifest and inertial sample of a tick; -1: prime."""
    stamp = Stamp(tick, 1, max(0, tick) * TICK_NS, max(0, tick))
    messages = [(HW_TICK, Tick(roster=("estimator",), roster_version=1, due=(HW_IMU.key,), mode="lockstep"))]
    messages += [(HW_IMU, IMU)] if tick >= 0 else []
    parts = [
        FramePart(topic.key, encode(one.stamped(stamp.stamp_ns, tick, 1, stamp.seq, "driver"))[0], stamp)
        for topic, one in messages
    ]
    wanted = {HW_TICK.key: HW_TICK, HW_IMU.key: HW_IMU}
    return Frame("driver", wanted, *pack(parts, "sim@5", "s", "@frame/driver"), "s", "@frame/driver")


def test_a_name_that_is_not_ascii_ends_nothing() -> None:
    table = Bindings(lambda service, instance: born_ms("5ea1" * 8, service, instance))
    odd = Frame("estimator", {}, b"[]", b"f000000000000000" + b"\xff" * 16 + b";state/velocity,0,-1,1,0,0")
    table.on_life(Life("estimator", odd.instance, True))
    table.check_seal(odd)
    assert table.candidates("estimator") == (odd.instance,)


def test_names_of_processes_that_are_gone_cost_no_memory() -> None:
    bindings = Bindings()
    bindings.on_life(Life("walker", "a", True))
    size = len(pickle.dumps(bindings.__dict__ | {"_born_ms": None}))
    for number in range(1000):
        for alive in (True, False, False):
            bindings.on_life(Life(f"none{number}", "b", alive))
    assert len(pickle.dumps(bindings.__dict__ | {"_born_ms": None})) == size
    assert bindings.visible("walker", "a")
