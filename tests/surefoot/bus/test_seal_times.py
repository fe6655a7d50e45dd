"""Windows of seal times: a message counts once in whatever order it comes, and a long time after others never."""

from hypothesis import given
from hypothesis import strategies as st

from surefoot.bus.guard import Guard, Sealed
from surefoot.bus.seal_times import LATE_MESSAGES, LATE_NS, SealTimes
from surefoot.bus.seals import sealed_name, with_seal, without_seal

SECRET = "c0ffee" * 5 + "00"
STEP_NS = 1_000_000


def taken(window: SealTimes, time_ns: int) -> str:
    """Return the fault of a message as a reader finds it, which adds all but repeated ones."""
    code = window.fault(time_ns)
    if code != "replayed":
        window.add(time_ns)
    return code


@given(st.lists(st.integers(1, 40), min_size=1, max_size=120))
def test_each_time_counts_once_in_any_order(times: list[int]) -> None:
    window, known = SealTimes(), set[int]()
    for time in times:
        code = taken(window, time * STEP_NS)
        if not known or time > max(known):
            assert code == ""
        elif time in known or time < min(known):
            assert code == "replayed"
        else:
            assert code == "late"
        if code != "replayed":
            known.add(time)


@given(st.lists(st.integers(1, 1000), min_size=LATE_MESSAGES, max_size=600))
def test_no_time_counts_twice_however_many_come(times: list[int]) -> None:
    window, taken_once = SealTimes(), list[int]()
    for time in times:
        if taken(window, time) != "replayed":
            taken_once.append(time)
    assert len(taken_once) == len(set(taken_once))


def test_a_late_time_is_within_some_messages_and_a_second() -> None:
    window = SealTimes()
    for number in range(1, 4 * LATE_MESSAGES):
        assert taken(window, 2 * number * STEP_NS) == ""
    newest = window.newest // STEP_NS
    assert window.fault((newest - 2 * LATE_MESSAGES + 3) * STEP_NS) == "late"
    assert window.fault((newest - 2 * LATE_MESSAGES + 1) * STEP_NS) == "replayed"
    slow = SealTimes()
    for number in (0, 2, 4):
        slow.add(1 + number * LATE_NS // 4)
    assert slow.fault(1 + LATE_NS // 4) == "late"
    slow.add(1 + 2 * LATE_NS)
    assert slow.fault(LATE_NS) == "replayed"
    assert slow.fault(1 + LATE_NS) == "replayed", "it was taken"
    assert slow.fault(2 + LATE_NS) == "late"


def test_a_report_that_was_overtaken_is_late_and_one_that_comes_again_is_forged() -> None:
    guard, key = Guard(SECRET), "@tick/walker"
    guard.on_token("walker", sealed_name(SECRET, "walker"))
    first, second, third = (Sealed(key, b"{}", *without_seal(with_seal(SECRET, key, b"{}", None))) for _ in range(3))
    assert [guard.passes("walker", one) for one in (first, third, second)] == [True, True, False]
    assert (guard.late(), guard.forged()) == ([(key, 1)], [])
    assert not guard.passes("walker", second)
    assert (guard.late(), guard.forged()) == ([], [(key, 1)])


def test_before_the_first_message_no_time_is_late() -> None:
    assert SealTimes().fault(0) == "replayed"
    assert SealTimes().fault(1) == ""
