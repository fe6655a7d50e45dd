"""Connections that never send a byte keep no client out, and take no descriptor that others need."""

import resource
import socket
from contextlib import ExitStack

import pytest

from surefoot.bus import options
from surefoot.bus.options import DESCRIPTORS, LEAST_PENDING, MOST_PENDING, client_options, zenoh_config
from surefoot.bus.zenoh import ZenohBus
from tests.surefoot.net import Net

SILENT = LEAST_PENDING + 100
PATIENCE_MS = 2000


@pytest.mark.skipif(resource.getrlimit(resource.RLIMIT_NOFILE)[1] < DESCRIPTORS, reason="few descriptors permitted")
def test_a_client_gets_in_beside_hundreds_of_silent_connections() -> None:
    net = Net()
    host, port = net.address.partition("/")[2].split(":")
    with ExitStack() as stack:
        for _ in range(SILENT):
            stack.enter_context(socket.create_connection((host, int(port))))
        ZenohBus(client_options(net.address, net.namespace, PATIENCE_MS)).close()
    net.close()


@pytest.mark.parametrize(
    ("soft", "hard", "raised", "pending"),
    [
        (256, 1024, 1024, LEAST_PENDING),
        (1024, 4096, 4096, 2048),
        (1024, resource.RLIM_INFINITY, DESCRIPTORS, MOST_PENDING),
        (1 << 20, 1 << 20, 1 << 20, MOST_PENDING),
    ],
)
def test_connections_that_wait_take_half_of_the_descriptors(
    soft: int, hard: int, raised: int, pending: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits = [(soft, hard)]
    monkeypatch.setattr(options.resource, "getrlimit", lambda kind: limits[-1])
    monkeypatch.setattr(options.resource, "setrlimit", lambda kind, given: limits.append(given))
    router = options.ZenohOptions("router", (), ("tcp/127.0.0.1:0",))
    with options.reading_threads(router):
        config = zenoh_config(router)
    assert limits[-1] == (raised, hard)
    assert config.get_json("transport/unicast/accept_pending") == f"{pending}"
