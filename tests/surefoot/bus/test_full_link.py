"""A client whose link is full of replies that it does not read: others get theirs once the router closes the link."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from zenoh.handlers import RingChannel

from surefoot.bus import options
from surefoot.bus.interface import Incoming
from surefoot.schemas.system import Health, HealthReply, HealthRequest
from surefoot.schemas.topics import HEALTH_GET
from tests.surefoot.net import Net, wait_until

QUERY = HEALTH_GET.of("walker")
ASKED, REPLY_BYTES, ANSWER_S = 6000, 15_000, 3.0
STUCK = """
import json, os, signal, sys, zenoh
from zenoh.handlers import RingChannel
config = {"mode": "client", "connect": {"endpoints": [sys.argv[1]]}, "scouting": {"multicast": {"enabled": False}}}
session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
for _ in range(int(sys.argv[3])):
    session.get(sys.argv[2], RingChannel(1), timeout=60.0, congestion_control=zenoh.CongestionControl.BLOCK)
print("asked", flush=True)
os.kill(os.getpid(), signal.SIGSTOP)
"""


@contextmanager
def beside_a_full_link(close_us: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], bool]]:
    """Give a function that asks the peer for its health beside a stopped client full of replies: was it answered?"""
    monkeypatch.setattr(options, "CLOSE_FULL_US", close_us)
    net = Net()
    answer = HealthReply(health=Health(service="walker", instance="x" * REPLY_BYTES, state="running", pid=1))
    peer = net.open("peer")

    def serve(incoming: Incoming) -> None:
        incoming.reply(answer)

    peer.serve(QUERY, lambda incoming: None, serve, "walker")
    key = f"{net.namespace}/@{QUERY.key}/walker"  # of participants: none of its answers is left out
    with net.plain() as other:

        def answered() -> bool:
            payload = HealthRequest().model_dump_json()
            return any(reply.ok for reply in other.get(key, RingChannel(1), payload=payload, timeout=ANSWER_S))

        wait_until(answered)
        stuck = subprocess.Popen([sys.executable, "-c", STUCK, net.address, key, f"{ASKED}"], stdout=subprocess.PIPE)
        try:
            assert stuck.stdout is not None
            assert stuck.stdout.readline() == b"asked\n"
            yield answered
        finally:
            stuck.kill()
            stuck.wait()
            stuck.stdout.close()
    net.close()


def test_a_client_that_does_not_read_its_replies_holds_others_for_a_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    """The router closes the full link; from then on every request of others is answered."""
    with beside_a_full_link(options.CLOSE_FULL_US // 4, monkeypatch) as answered:
        wait_until(lambda: all(answered() for _ in range(20)))  # the first ones may come before the link is full


def test_others_wait_for_as_long_as_the_full_link_is_open(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a link that is never closed others get nothing: it is the closing that helps them."""
    with beside_a_full_link(60 * options.CLOSE_FULL_US, monkeypatch) as answered:
        wait_until(lambda: not answered())
        assert not answered()
