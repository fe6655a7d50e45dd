"""Endpoints, mode and identity of a Zenoh session, and the Zenoh settings made from them."""

# pyright: reportUnknownMemberType=false

import json
import os
import resource
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import zenoh

from surefoot.bus.endpoint import DEFAULT_ENDPOINT, any_port, checked_namespace, is_secure, settings_file
from surefoot.bus.seals import given_secret
from surefoot.bus.sizes import MAX_BULK_BYTES
from surefoot.errors import ConfigError
from surefoot.state import secret_of

DEFAULT_FLEET = "surefoot"
RUNTIME = "ZENOH_RUNTIME"
"""Environment variable from which Zenoh takes its numbers of threads at the first session of a process."""
LEASE_MS = 3000
"""Time, ms, after which a link to a process from which nothing was received counts as lost; as long as the silence
after which the supervisor ends a process. A shorter one ends the links of a whole machine that is short of processors,
and Zenoh 1.10 then sometimes links processes again without what they had declared, for good."""
CONNECT_TIMEOUT_MS = 8000
QUEUE_BATCHES = 16
"""Largest number of batches (one frame, or 64 KiB of a map) that wait for the sending thread of a link, the most
that Zenoh allows. With its default of two the third message within 1 ms is dropped while that thread waits for a
processor."""
DROP_AFTER_US = 20_000
"""Longest wait of a message for room on a link, us; then it and those after it are dropped until there is room. Longer
than a busy machine delays a sending thread, too short to disturb a robot."""
CLOSE_FULL_US = 1_000_000
"""Time after which the router closes the link to a client that takes none of its replies, us. Zenoh gives a reply the
quality of service of its query, so that it may not be dropped, and all replies behind it wait meanwhile, those to other
clients too; its default is 5 s."""
MOST_PENDING, LEAST_PENDING, ACCEPT_MS = 4096, 512, 5000
"""`MOST_PENDING`: largest number of connections without a completed handshake, half of the descriptors that a process
may have, but `LEAST_PENDING` at least; `ACCEPT_MS`: time after which such a connection is closed, ms; with Zenoh's
defaults (100; 10 s) a hundred silent ones block all other connections."""
DESCRIPTORS = 2 * MOST_PENDING
"""Number of descriptors that the process of a router may have, if the system permits it."""
HANDSHAKE_MS = 60_000
"""Time after which a connection without a completed TLS handshake is closed, ms. After each that fails Zenoh 1.10
accepts nothing for 100 ms, so that with its default of 10 s a hundred silent connections block all others."""
ROUTER_READERS = 32
"""Number of threads that receive messages in the process of a router; more than Zenoh's two, as each frozen client
blocks one."""
MAX_MESSAGE_BYTES = MAX_BULK_BYTES + (8 << 20)
"""Largest message that a session reassembles, bytes: a request with the largest map, its header and attachment. Zenoh
drops a larger one on arrival; its default of 1 GiB let one client occupy as much memory in each process on the way."""
SHARED_FROM = 512
"""Smallest size of a message that travels by shared memory, bytes, if SUREFOOT_SHARED_MEMORY is 1."""


def shares_memory() -> bool:
    """Return whether processes of one host exchange messages by shared memory: SUREFOOT_SHARED_MEMORY is 1.

    Raises:
        ConfigError: another value than 1, 0 or nothing.
    """
    found = os.environ.get("SUREFOOT_SHARED_MEMORY", "")
    if found not in ("", "0", "1"):
        raise ConfigError("invalid", f"SUREFOOT_SHARED_MEMORY: got {found!r}, allowed: 1, 0", "SUREFOOT_SHARED_MEMORY")
    return found == "1"


@dataclass(frozen=True)
class ZenohOptions:
    """Mode, endpoints, namespace and identity with which a Zenoh session joins the network."""

    mode: str = "peer"
    """Mode of the Zenoh session: ``router`` (the supervisor), ``peer`` (services) or ``client`` (tools)."""
    connect: tuple[str, ...] = (DEFAULT_ENDPOINT,)
    listen: tuple[str, ...] = ()
    namespace: str = f"{DEFAULT_FLEET}/ragno"
    identity: str = ""
    """Service whose certificate the process shows at a secure endpoint; empty = the identity of tools."""
    secret: str = field(default="", repr=False)
    """Secret with which processes of this system make and check their names (see `seals`); empty = none."""
    services: tuple[str, ...] = ()
    """Names of the services of this system, whose liveliness tokens count; empty = they are not known, all count."""
    patience_ms: int = CONNECT_TIMEOUT_MS
    """Longest wait for the router when the session is opened, ms."""


def client_options(connect: str, namespace: str, patience_ms: int = CONNECT_TIMEOUT_MS) -> ZenohOptions:
    """Return the options of a client, with the secret of the environment, or that of the system if this user runs it.

    Args:
        connect: Zenoh endpoint of the router.
        namespace: prefix of the keys.
        patience_ms: longest wait for the router, ms.

    Raises:
        ConfigError: SUREFOOT_SECRET is no secret.
    """
    secret = given_secret() or secret_of(connect, namespace)
    return ZenohOptions("client", (connect,), namespace=namespace, secret=secret, patience_ms=patience_ms)


def _most_pending() -> int:
    """Return the largest number of connections without a completed handshake, from this process's descriptors."""
    return min(MOST_PENDING, max(LEAST_PENDING, resource.getrlimit(resource.RLIMIT_NOFILE)[0] // 2))


def _more_descriptors() -> None:
    """Raise the number of descriptors that this process may have to `DESCRIPTORS`, or as near as the system permits."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = DESCRIPTORS if hard == resource.RLIM_INFINITY else min(DESCRIPTORS, hard)
    if resource.RLIM_INFINITY != soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


@contextmanager
def reading_threads(endpoint: ZenohOptions) -> Generator[None]:
    """Context manager in which a session that opens as a router gets more reading threads; others keep Zenoh's number.

    It also raises the limit of open file descriptors for a router, as each connection of a client takes one.

    Zenoh reads the number of threads from the environment. A value that the user has set there is kept; otherwise the
    variable is removed at the end, so that processes started later do not inherit it.
    """
    if endpoint.mode != "router":
        yield
        return
    _more_descriptors()
    with threads_that_read(ROUTER_READERS):
        yield


@contextmanager
def threads_that_read(number: int) -> Generator[None]:
    """Give the first session of this process a number of threads to read; one that the user has set is kept.

    A process that reads one link all the time needs one: Zenoh's two wake each other.
    """
    if RUNTIME in os.environ:
        yield
        return
    os.environ[RUNTIME] = f"(rx: (worker_threads: {number}))"
    try:
        yield
    finally:
        del os.environ[RUNTIME]


def zenoh_config(endpoint: ZenohOptions, name: str = "") -> zenoh.Config:
    """Return the Zenoh settings of a session called ``name`` (32 hexadecimal digits, empty = Zenoh draws them).

    They switch off multicast and the start-up delay, let peers gossip, and detect a lost link within a second.
    """
    listen = endpoint.listen
    secure = is_secure((*endpoint.connect, *listen))
    if endpoint.mode == "peer" and not listen:
        listen = (any_port(secure),)  # a peer that does not listen gets no data from other peers
    settings: dict[str, Any] = {
        "mode": endpoint.mode,
        "namespace": checked_namespace(endpoint.namespace),
        "connect/endpoints": list(endpoint.connect) if endpoint.mode != "router" else [],
        "connect/timeout_ms": endpoint.patience_ms,
        "connect/exit_on_failure": endpoint.mode == "client",
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
        "listen/endpoints": [f"{one}#tls_handshake_timeout_ms={HANDSHAKE_MS}" if secure else one for one in listen],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": endpoint.mode != "client",
        "scouting/delay": 0,
        "transport/unicast/accept_pending": _most_pending(),
        "transport/unicast/accept_timeout": ACCEPT_MS,
        "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/queue/size/real_time": QUEUE_BATCHES,
        "transport/link/tx/queue/size/interactive_low": QUEUE_BATCHES,
        "transport/link/tx/queue/size/data": QUEUE_BATCHES,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": DROP_AFTER_US,
        # A segment of 16 MiB and two descriptors for each peer that large messages were exchanged with, and none of it
        # is given back when that peer is gone: 20 MB in every survivor for each restart. Therefore off by default.
        "transport/shared_memory/enabled": shares_memory(),
        "transport/shared_memory/transport_optimization/message_size_threshold": SHARED_FROM,
    }
    if endpoint.mode == "router":
        settings["transport/link/tx/queue/congestion_control/block/wait_before_close"] = CLOSE_FULL_US
    if endpoint.mode != "client":
        settings["scouting/gossip/autoconnect_strategy"] = {
            "peer": {"to_router": "always", "to_peer": "greater-zid"},
        }
    if name:
        settings["id"] = name
    config = zenoh.Config()
    if secure:
        config = zenoh.Config.from_file(str(settings_file(endpoint.namespace, endpoint.identity)))
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def why_not_open(endpoint: ZenohOptions, error: str = "") -> str:
    """Return an error message on why a session could not be opened and what to do; `error`: of the network library."""
    addresses: Sequence[str] = endpoint.listen if endpoint.mode == "router" else endpoint.connect
    where = ", ".join(addresses)
    if endpoint.mode == "router" and "in use" in error:
        return f"cannot listen on {where}: another router holds it (stop it, or choose another with --listen)"
    if endpoint.mode == "router":
        return f"cannot open a router on {where} for {endpoint.namespace!r}: {error}"
    why = f": {error}" if error and not error.startswith("Unable to connect") else ""
    return (
        f"no router answers at {where} (start one with `surefoot up`, or name another with --connect or "
        f"SUREFOOT_CONNECT){why}"
    )
