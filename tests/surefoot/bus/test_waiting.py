"""Bytes that wait on a connection are seen, their tokens are counted, and nothing is taken away."""

import random
import socket

import pytest

from surefoot.bus.waiting import Waiting, waiting_of

DECLARED = b"\x11\x00\xa5\x9c\x91\xa7_1\x00\x9e!\x08F\xbc\x0b\xbc\x0b"
ENDED = b"\x11\x00\xa5\x9d\x91\xa7_1\x00\x9e!\x08\x87\xbb\x0b_\x02\x00\x00"
OTHER_WAY = b"\x09\x00\xa5\x9e\x91\xa7_1\x00\x1e\x46\xbc\x0b\xbc\x0b"
KEY = b"\x29\x00\xa5\x9d\x91\xa7_1\x00\x9e!\x08 \xbc\x0b\x00\x1atest/net/alive/walker/1467"
"""Messages of a client of Zenoh 1.10, as they came over a connection."""


@pytest.mark.parametrize(
    ("data", "tokens", "other"),
    [
        ((DECLARED + KEY + ENDED) * 20, 40, False),
        (OTHER_WAY * 40, 0, False),
        (KEY * 40, 0, True),
        (random.Random(1).randbytes(60000), 0, True),
        (KEY, 0, False),
    ],
    ids=["tokens", "another-way", "keys", "noise", "little"],
)
def test_messages_of_tokens_are_counted(data: bytes, tokens: int, other: bool) -> None:
    seen = Waiting().plus(data)
    assert (seen.size, seen.tokens) == (len(data), tokens)
    assert seen.share == tokens / len(data)
    assert seen.other_than_tokens(256) is other


def test_what_waits_is_seen_of_the_connections_asked_for_and_not_taken_away() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        ends = [socket.create_connection(server.getsockname()) for _ in range(3)]
        here = [server.accept()[0] for _ in ends]
        names = ["{}:{}".format(*one.getsockname()) for one in ends]
        for one in ends[:2]:
            one.sendall(DECLARED)
        here[0].recv(1, socket.MSG_PEEK)
        assert waiting_of({names[0], names[2]}, 3) == {names[0]: Waiting(len(DECLARED), 1), names[2]: Waiting()}
        assert here[0].recv(100) == DECLARED
        for one in (*ends, *here):
            one.close()
