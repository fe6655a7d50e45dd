"""Samples of Zenoh become deliveries only if they are small enough and sealed by the service that their key names."""

from types import SimpleNamespace
from typing import Any

import pytest

from surefoot.bus.codec import encoding_of
from surefoot.bus.frame import MAX_FRAME_BYTES, MAX_INDEX_BYTES
from surefoot.bus.guard import Guard
from surefoot.bus.receive import Receiving, largest
from surefoot.bus.seals import sealed_name
from surefoot.schemas.hw import EmergencyStop
from surefoot.schemas.topics import CMD_ESTOP, HEALTH, SIM_STATUS

SECRET = "0123456789abcdef" * 2


class Bytes:
    """Content of a sample, as Zenoh hands it over."""

    def __init__(self, content: bytes) -> None:
        self.content = content

    def __len__(self) -> int:
        return len(self.content)

    def to_bytes(self) -> bytes:
        return self.content


def sample(key: str, payload: bytes, attachment: bytes | None = None) -> Any:
    return SimpleNamespace(
        key_expr=key, payload=Bytes(payload), attachment=None if attachment is None else Bytes(attachment),
        encoding=encoding_of(EmergencyStop), source_info=None,
    )  # fmt: skip


@pytest.fixture
def guard() -> Guard:
    return Guard(SECRET)


@pytest.fixture
def receiving(guard: Guard) -> Receiving:
    return Receiving(guard, SECRET)


@pytest.mark.parametrize("way", ["seen", "guarded"])
@pytest.mark.parametrize("beside", [0, 7])
def test_the_largest_message_passes_and_one_byte_more_is_dropped_and_counted(
    receiving: Receiving, way: str, beside: int
) -> None:
    take, most = getattr(receiving, way), largest(CMD_ESTOP.model)
    attachment = b" " * beside if beside else None
    assert take(CMD_ESTOP, sample(CMD_ESTOP.key, b" " * (most - beside), attachment)) is not None
    assert receiving.troubles() == []
    assert take(CMD_ESTOP, sample(CMD_ESTOP.key, b" " * (most + 1 - beside), attachment)) is None
    (trouble,) = receiving.troubles()
    assert (trouble.reason, trouble.peer, trouble.number) == ("too_large", CMD_ESTOP.key, 1)
    assert str(most + 1) in trouble.text


@pytest.mark.parametrize("beside", [0, 7])
def test_the_largest_frame_passes_and_one_byte_more_does_not(receiving: Receiving, beside: int) -> None:
    taken = list[Any]()
    take = receiving.to_frames("walker", "@frame/walker", {}, taken.append)
    most, index = MAX_FRAME_BYTES + MAX_INDEX_BYTES, b" " * beside if beside else None
    take(sample("@frame/walker", b" " * (most + 1 - beside), index))
    assert taken == []
    assert [one.peer for one in receiving.troubles()] == ["@frame/walker"]
    take(sample("@frame/walker", b" " * (most - beside), index))
    assert len(taken) == 1
    assert receiving.troubles() == []


def test_a_message_of_any_owner_names_the_service_of_its_key(receiving: Receiving, guard: Guard) -> None:
    taken = list[Any]()
    take = receiving.to_messages(HEALTH, taken.append)
    take(sample("health/walker", b'{"source":"recorder"}'))
    assert taken == []
    assert guard.forged() == [("health/*", 1)]
    take(sample("health/walker", b'{"source":"walker"}'))
    assert len(taken) == 1
    assert receiving.guarded(SIM_STATUS, sample(SIM_STATUS.key, b'{"source":"anyone"}')) is not None


def test_a_message_without_the_seal_of_a_sealed_service_is_dropped_and_counted(
    receiving: Receiving, guard: Guard
) -> None:
    message = sample("health/walker", b'{"source":"walker"}')
    assert receiving.guarded(HEALTH, message) is not None
    guard.on_token("walker", sealed_name(SECRET, "walker"))
    assert receiving.guarded(HEALTH, message) is None
    assert guard.forged() == [("health/walker", 1)]
    assert receiving.seen(HEALTH, message) is not None, "other observers get it"
