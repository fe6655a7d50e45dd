"""Unfriendly participants: floods on each key and query, readers that never read, clients that come and go.

Ratios are of measurements made directly one after the other, because the machine may be busy with other work.
"""

import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from benchmarks.bench import Bench, table
from benchmarks.machine import Machine, Ticks, forget_peak, resident_mb, up
from surefoot.lab.statistics import middle_and_ends
from surefoot.lockstep.discover import service_class
from surefoot.record.recording import read_recording
from surefoot.schemas.topics import QUERIES, TOPICS
from tests.processes import running

BENCH = Bench("flood")

SERVICES = ("simulator", "estimator", "walker", "stability", "footholds", "recorder", "supervisor")
FLOOD_HZ = 50_000
SPAN_S = 3.0
ROUNDS, CLIENTS = 5, 200
READERS = ((8, "**"), (1, "*/*/@frame/*"), (8, "*/*/@frame/*"))
"""Subscribers that never read their messages: (number of subscribers, key expression) of each case."""
OUTPUTS = ("state/velocity", "state/gait", "cmd/joints")
"""Keys of outputs that the services in the loop publish in every tick, one per service, from which missed ticks are
counted."""

FLOODER = """
import json, sys, time, zenoh
address, verb, key, payload, rate, span = *sys.argv[1:5], float(sys.argv[5]), float(sys.argv[6])
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [address]}}))
with zenoh.open(config) as session:
    publisher = session.declare_publisher(key)
    asker = session.declare_querier(key, timeout=0.5)
    began = time.monotonic()
    count, now = 0, began
    while now - began < span:
        for _ in range(min(50, int(rate))):
            if verb == "put":
                publisher.put(payload)
            else:
                asker.get(handler=zenoh.handlers.RingChannel(1), payload=payload)
        count += min(50, int(rate))
        ahead = began + count / rate - time.monotonic()
        if ahead > 0.0:
            time.sleep(ahead)
        now = time.monotonic()
    print(count / (now - began), flush=True)
"""
READER = """
import json, sys, time, zenoh
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [sys.argv[1]]}}))
session = zenoh.open(config)
subscriber = session.declare_subscriber(sys.argv[2], zenoh.handlers.FifoChannel(1))
print("subscribed", flush=True)
time.sleep(600)
"""
FLAPPER = """
import json, sys, threading, time, zenoh
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [sys.argv[1]]}}))
session, number, end = zenoh.open(config), 0, time.monotonic() + float(sys.argv[3])
print(session.zid(), flush=True)
while time.monotonic() < end:
    number += 1
    session.liveliness().declare_token(f"{sys.argv[2]}/{number}").undeclare()
session.close()
"""
VISITOR = """
import json, sys, time, zenoh
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [sys.argv[1]]}}))
for _ in range(int(sys.argv[2])):
    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber(sys.argv[3] + "/state/velocity", zenoh.handlers.RingChannel(1))
"""


def keys() -> list[tuple[str, str, str]]:
    """Return the floods to test: verb (`put` or `get`), key and payload of each.

    Requests that change something are malformed, so they are refused; others ask for defaults, so they are computed.
    """
    services = [service_class(name) for name in SERVICES]
    observed = {topic.key for service in services for topic in service.observes}
    served = [query for query in QUERIES if any(query in service.serves for service in services)]
    return [
        *(("put", topic.key.replace("*", "walker"), "{") for topic in TOPICS if topic.key in observed),
        *(("get", query.key, "{" if query.acts else "{}") for query in served),
        ("get", "health/walker", "{}"),
        ("put", "of/stranger", "{"),
    ]


@BENCH.part("--only of/stranger")
def floods(*, only: str = "") -> None:
    """Flood a running system: each observed key, each served query and an unknown key, up to 50 000 times a second.

    The system is that of `surefoot up ragno --rtf 1 --record`; another process publishes or requests. Printed are its
    messages per s, the ticks per s before, during and in the first second after the flood, the ticks that a service
    left out according to the recording, and the largest growth of a process.

    Args:
        only: text that the flooded keys contain; empty = all keys.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bag = folder / "run.mcap"
        spans: list[tuple[str, int, int]] = []
        with up(folder, "--rtf", "1", "--record", str(bag)) as machine, machine.session() as session:
            ticks = Ticks(session, machine.namespace)
            time.sleep(SPAN_S)
            for verb, key, payload in keys():
                if only in key:
                    spans.append((f"{verb} {key}", *_flood(machine, ticks, verb, key, payload)))
            spans.append(("no flood", *_flood(machine, ticks, "put", "of/stranger", "{", rate=1.0)))
            print(f"restarts: { {row['service']: row['restarts'] for row in machine.status()['services']} }")
        numbers: dict[str, set[int]] = {key: set() for key in ("hw/tick", *OUTPUTS)}
        for item in read_recording(bag, tuple(numbers)):
            numbers[item.key].add(item.message().tick)
        for what, first, last in spans:
            released = {tick for tick in numbers["hw/tick"] if first <= tick <= last}
            left = {key: len(released - numbers[key]) for key in OUTPUTS}
            print(f"{what}: {last - first + 1 - len(released)} of {last - first + 1} ticks lost, left out {left}")


@BENCH.part("--clients 2")
def flappers(*, clients: int = 2, word: str = "alive/walker", seconds: float = 6.0) -> None:
    """Clients show and take away liveliness tokens without a pause beside a running system.

    Printed are the ticks of each second, and how many of the clients the status names.

    Args:
        clients: number of clients, which begin at once.
        word: first words of the tokens' keys, after the namespace.
        seconds: wall time for which they do it.
    """
    with (
        tempfile.TemporaryDirectory() as name,
        up(Path(name)) as machine,
        machine.session() as session,
        ExitStack() as all_of,
    ):
        ticks = Ticks(session, machine.namespace)
        time.sleep(SPAN_S)
        began = time.monotonic()
        command = [sys.executable, "-c", FLAPPER, machine.address, f"{machine.namespace}/{word}", str(seconds)]
        some = [all_of.enter_context(running(command, stdout=subprocess.PIPE, text=True)) for _ in range(clients)]
        names = [one.stdout.readline().strip() for one in some if one.stdout]
        time.sleep(seconds + 1.0)
        rates = [ticks.rate(began + second, began + second + 1.0) for second in range(int(seconds))]
        status = str(machine.status())
    print(f"ticks/s in each second {[round(rate) for rate in rates]}")
    print(f"{sum(f'flooder {one}' in status for one in names)} of {clients} clients named")


def _flood(
    machine: Machine, ticks: Ticks, verb: str, key: str, payload: str, rate: float = FLOOD_HZ
) -> tuple[int, int]:
    """Flood one key at up to `rate` messages per s; return the first and the last control tick during the flood."""
    pids = machine.pids()
    for pid in pids.values():
        forget_peak(pid)
    held = {name: resident_mb(pid) for name, pid in pids.items()}
    before = time.monotonic()
    time.sleep(SPAN_S)
    began = time.monotonic()
    words = [machine.address, verb, f"{machine.namespace}/{key}", payload, str(rate), str(SPAN_S)]
    done = subprocess.run([sys.executable, "-c", FLOODER, *words], capture_output=True, text=True, check=True)
    ended = time.monotonic()
    time.sleep(1.5)
    base, during, after = (ticks.rate(*span) for span in ((before, began), (began, ended), (ended + 0.5, ended + 1.5)))
    gone = [name for name, pid in pids.items() if not Path(f"/proc/{pid}").exists()]
    grown = {name: resident_mb(pid, peak=True) - held[name] for name, pid in pids.items() if name not in gone}
    worst = max(grown, key=lambda name: grown[name])
    print(
        f"{verb} {key}: {float(done.stdout):.0f}/s for {SPAN_S:g} s; ticks/s {base:.1f} before, {during:.1f} during "
        f"({during / base:.2f}), {after:.1f} after; longest gap {max(ticks.gaps(began, ended)):.3f} s "
        f"(before {max(ticks.gaps(before, began)):.3f}); {worst} + {grown[worst]:.1f} MB; "
        f"ended: {', '.join(gone) or 'none'}",
        flush=True,
    )
    found = ticks.between(began, ended)
    return found[0][0], found[-1][0]


@BENCH.part()
def readers() -> None:
    """Print the times between ticks in lockstep, without and with stuck readers, and with short-lived clients.

    The system runs as fast as possible, alternately without and with subscribers that never read their messages (to
    `**` and to frames), and with 200 clients in all that join and leave. Times are taken by another client.
    """
    with tempfile.TemporaryDirectory() as name, up(Path(name)) as machine, machine.session() as session:
        _in_lockstep(machine)
        ticks = Ticks(session, machine.namespace)
        found: dict[str, list[tuple[float, float, float]]] = {"alone": []}
        time.sleep(SPAN_S)
        for _ in range(ROUNDS):
            found["alone"].append(_span(ticks))
            for count, key in READERS:
                with ExitStack() as stack:
                    for _ in range(count):
                        command = [sys.executable, "-c", READER, machine.address, key]
                        reader = stack.enter_context(running(command, stdout=subprocess.PIPE, text=True))
                        assert reader.stdout is not None
                        reader.stdout.readline()
                    found.setdefault(f"{count} readers of {key}", []).append(_span(ticks))
            visits = [sys.executable, "-c", VISITOR, machine.address, str(CLIENTS // ROUNDS), machine.namespace]
            with running(visits) as visitor:
                found.setdefault("visitors", []).append(_span(ticks))
                visitor.wait(60.0)
        shown: list[tuple[object, ...]] = []
        for what, rows in found.items():
            p99 = [row[1] / base[1] for row, base in zip(rows, found["alone"], strict=True)]
            shown.append(
                (
                    what, statistics.median(row[0] for row in rows), 1e3 * statistics.median(row[1] for row in rows),
                    middle_and_ends(p99, 2), max(row[2] for row in rows),
                )
            )  # fmt: skip
        print(f"restarts: { {row['service']: row['restarts'] for row in machine.status()['services']} }")
        table("ticks", ("beside", "ticks/s", "p99 ms", "p99 of its neighbour alone", "longest gap s"), shown)


def _span(ticks: Ticks) -> tuple[float, float, float]:
    """Return ticks per s, and the 99th percentile and the largest of the times between two ticks, s."""
    began = time.monotonic()
    time.sleep(SPAN_S)
    now = time.monotonic()
    gaps = ticks.gaps(began, now)
    return ticks.rate(began, now), gaps[int(0.99 * len(gaps))], gaps[-1]


def _in_lockstep(machine: Machine) -> None:
    """Begin a run in lockstep that is as fast as possible and does not end by itself."""
    done = machine.surefoot("call", "sim/reset", '{"keep": true, "mode": "lockstep"}')
    assert done.returncode == 0, done.stderr
