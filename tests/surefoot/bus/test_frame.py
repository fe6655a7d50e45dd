"""Frames: what goes in comes out, by topic and in order, and what is no frame is refused."""

import json
import random
import re

import pytest

from surefoot.bus.frame import MAX_INDEX_BYTES, PRIME_BYTES, Frame, FramePart, pack
from surefoot.bus.interface import Stamp
from surefoot.errors import Refusal
from surefoot.schemas.topics import CMD_JOINTS, HW_IMU, HW_JOINTS, STATE_ODOMETRY, STATE_VELOCITY, TOPICS, Kind
from tests.surefoot.expect import expect_error

TAKEN = {topic.key: topic for topic in (HW_IMU, STATE_VELOCITY, CMD_JOINTS)}
KEYS = [topic.key for topic in (HW_IMU, HW_JOINTS, STATE_VELOCITY, STATE_ODOMETRY, CMD_JOINTS)]


def parts(seed: int, count: int) -> list[FramePart]:
    rng = random.Random(seed)
    made: list[FramePart] = []
    for _ in range(count):
        payload = json.dumps({"text": "[,]{};" * rng.randrange(4), "number": rng.random()}).encode()
        stamp = Stamp(rng.randrange(-1, 10**6), rng.randrange(9), rng.randrange(10**15), rng.randrange(10**6))
        made.append(FramePart(rng.choice(KEYS), rng.choice((b"", payload, payload, payload)), stamp))
    return made


@pytest.mark.parametrize("seed", range(30))
def test_what_is_taken_comes_out_as_it_was(seed: int) -> None:
    said = parts(seed, 1 + seed % 12)
    found = Frame("driver", TAKEN, *pack(said)).deliveries()
    expected = [part for part in said if part.key in TAKEN]
    assert [d.topic.key for d in found] == [part.key for part in expected]
    assert [d.raw().payload for d in found] == [part.payload for part in expected]
    assert [d.header() for d in found] == [part.stamp for part in expected]
    assert [d.prime for d in found] == [not part.payload for part in expected]


def test_payload_is_a_json_array_any_tool_can_read() -> None:
    said = parts(3, 8)
    assert json.loads(pack(said)[0]) == [json.loads(part.payload) for part in said if part.payload]


@pytest.mark.parametrize(
    ("payload", "index"),
    [
        (b"", b""),
        (b"[]", b""),
        (b"[]", b"\xff\xfe"),
        (b"[]", b"hw/imu"),
        (b"[]", b"hw/imu,0,0,1,0"),
        (b"[]", b"hw/imu,x,0,1,0,0"),
        (b"[{}]", b"hw/imu,3,0,1,0,0"),
        (b"[{},{}]", b"hw/imu,2,0,1,0,0"),
        (b"[{}]", b"hw/imu,2,0,1,0,0;hw/imu,-3,0,1,0,0"),
        (b"7" * 2_000_000, b"7" * 2_000_000),
    ],
)
def test_what_is_no_frame_is_refused(payload: bytes, index: bytes) -> None:
    with expect_error(Refusal, "malformed", text="frame") as caught:
        Frame("driver", TAKEN, payload, index).deliveries()
    assert len(caught.value.message) < 400


def test_keys_can_stand_in_an_index() -> None:
    for topic in TOPICS:
        assert re.fullmatch(r"[a-z0-9_/*]+", topic.key)


def test_framed_are_what_belongs_to_a_tick() -> None:
    for topic in TOPICS:
        periodic = topic.kind in (Kind.SAMPLE, Kind.STATE, Kind.COMMAND) or topic.key == "hw/tick"
        assert topic.framed == periodic


def test_a_frame_of_a_process_that_is_not_bound_is_refused_before_it_is_decoded() -> None:
    made = Frame("walker", TAKEN, b"[]", b"stranger;" + b";".join([b"cmd/joints,0,5,1,0,0"] * 1000))
    assert made.size > PRIME_BYTES
    with expect_error(Refusal, "unbound", text="by 'stranger', to which the walker is not bound"):
        made.deliveries(bound=False)
    assert len(made.deliveries()) == 1000
    few = Frame("walker", TAKEN, b"[]", b"stranger;cmd/joints,0,-1,0,0,0")
    assert [d.prime for d in few.deliveries(bound=False)] == [True]


def test_an_index_counts_in_the_size_of_a_frame_and_has_a_limit() -> None:
    index = b"walker;" + b";".join([b"cmd/joints,0,5,1,0,0"] * (MAX_INDEX_BYTES // 20))
    made = Frame("walker", TAKEN, b"[]", index)
    assert made.size == len(index) + 2
    with expect_error(Refusal, "too_large", text="index of "):
        made.deliveries()


SECRET = "5ea1" * 8


def sealed(seed: int = 0, count: int = 3, secret: str = SECRET, family: str = "@frame/walker") -> tuple[bytes, bytes]:
    return pack(parts(seed, count), "w", secret, family)


def taken(made: tuple[bytes, bytes], family: str = "@frame/walker") -> Frame:
    return Frame("walker", TAKEN, *made, SECRET, family)


@pytest.mark.parametrize("seed", range(5))
def test_a_sealed_frame_is_the_same_frame_with_a_seal(seed: int) -> None:
    plain, made = taken(pack(parts(seed, 5), "w")), taken(sealed(seed, 5))
    assert made.sealed
    assert not plain.sealed
    assert made.instance == plain.instance == "w"
    assert made.deliveries() == plain.deliveries()
    assert taken(sealed()).sealed_ns > made.sealed_ns > plain.sealed_ns == 0


def test_whatever_is_changed_in_a_sealed_frame_breaks_its_seal() -> None:
    payload, index = sealed()
    whole = payload + index
    for at in range(len(whole)):
        changed = whole[:at] + bytes([whole[at] ^ (1 + at % 255)]) + whole[at + 1 :]
        assert not taken((changed[: len(payload)], changed[len(payload) :])).sealed


@pytest.mark.parametrize("secret", ["", "0" * 32])
def test_without_the_secret_no_seal_is_made(secret: str) -> None:
    assert not taken(sealed(secret=secret)).sealed
    assert not Frame("walker", TAKEN, *sealed()).sealed


def test_a_seal_holds_under_its_own_key_only() -> None:
    assert not taken(sealed(), "@batch/walker").sealed
    assert not taken(sealed(), "@frame/estimator").sealed


@pytest.mark.parametrize("number", [b"", b"-1", b"x", b"\xff", b"9" * 30, b"1:2"])
def test_a_strange_time_is_no_seal(number: bytes) -> None:
    assert not taken((b"[]", b"w:" + number + b":" + b"0" * 16 + b";cmd/joints,0,-1,0,0,0")).sealed
