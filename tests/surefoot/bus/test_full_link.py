"""A client whose link is full of replies that it does not read: others get theirs once the router closes the link."""

import subprocess
import sys

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


def test_a_client_that_does_not_read_its_replies_holds_others_for_a_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before, the router waited 5 s for room on the full link, and other clients got no answer meanwhile."""
    monkeypatch.setattr(options, "CLOSE_FULL_US", options.CLOSE_FULL_US // 4)
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
            assert all(answered() for _ in range(20))
        finally:
            stuck.kill()
            stuck.wait()
            stuck.stdout.close()
    net.close()
