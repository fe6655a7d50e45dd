"""The stability service over Zenoh: queries beside raw Zenoh ones, load by eight clients, and the time of a start.

python -m benchmarks.bench_stability_service [--queries 5000] [--pairs 1500]

Service, raw queryable and clients are processes of their own on loopback, joined by a router. A raw query carries the
same request and reply bytes and computes nothing. Targets: p50 <= 2.5x and p99 <= 5x a raw query, interleaved in one
run; 5000 queries from 8 clients at once without one wrong or lost answer; start to first answer < 1.2 s when warm.
"""

import argparse
import json
import multiprocessing
import os
import statistics
import subprocess
import sys
import time
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
import zenoh

from surefoot.bus.codec import encode
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.robot.reader import load_robot
from surefoot.schemas.base import Request
from surefoot.schemas.stability import CheckRequest, Contact, RegionRequest
from surefoot.schemas.topics import STABILITY_CHECK, STABILITY_REGION, STABILITY_WHATIF, Query
from surefoot.schemas.whatif import WhatifRequest
from surefoot.services.stability.answers import check_reply, region_reply, whatif_reply

ROUTER, NAMESPACE = "tcp/127.0.0.1:17463", "surefoot/bench"
CLIENTS, KINDS, SETS = 8, 3, 40
RAW = "bench/raw"


def requests() -> list[tuple[Query[Any, Any], Request]]:
    """Questions of a walking robot: check, region, what-if over stances of three to six feet."""
    rng = np.random.default_rng(0)
    out: list[tuple[Query[Any, Any], Request]] = []
    for _ in range(SETS):
        n = int(rng.integers(3, 7))
        around = 2.0 * np.pi * (np.arange(n) + rng.uniform(-0.2, 0.2, n)) / n
        p = np.column_stack((0.17 * np.cos(around), 0.15 * np.sin(around), rng.uniform(-0.03, 0.03, n)))
        s, h = np.radians(rng.uniform(0.0, 20.0, n)), rng.uniform(0.0, 2.0 * np.pi, n)
        v = np.column_stack((np.sin(s) * np.cos(h), np.sin(s) * np.sin(h), np.cos(s)))
        contacts = tuple(
            Contact(position=tuple(a), normal=tuple(b), mu=0.6) for a, b in zip(p.tolist(), v.tolist(), strict=True)
        )
        com = (0.01, -0.01)
        check = CheckRequest(contacts=contacts, com=com, movement=(0.03, 0.0, 0.0), polygons=False)
        out.append((STABILITY_CHECK, check))
        out.append((STABILITY_REGION, RegionRequest(contacts=contacts, directions=16)))
        out.append((STABILITY_WHATIF, WhatifRequest(contacts=contacts, com=com)))
    return out


def answers(asked: list[tuple[Query[Any, Any], Request]]) -> list[bytes]:
    """What the service has to say, computed here."""
    robot, out = load_robot("ragno"), list[bytes]()
    for query, request in asked:
        reply: Any
        if query is STABILITY_CHECK:
            reply = check_reply(request, robot)  # type: ignore[arg-type]
        elif query is STABILITY_REGION:
            reply = region_reply(request, robot)  # type: ignore[arg-type]
        else:
            reply = whatif_reply(request)  # type: ignore[arg-type]
        out.append(encode(reply)[0])
    return out


class Asker:
    """Raw queries with the settings of our own client."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.querier = session.declare_querier(
            key, target=zenoh.QueryTarget.BEST_MATCHING, consolidation=zenoh.ConsolidationMode.NONE, timeout=5.0,
            congestion_control=zenoh.CongestionControl.BLOCK, priority=zenoh.Priority.INTERACTIVE_HIGH, express=True,
        )  # fmt: skip

    def ask(self, payload: bytes) -> bytes | None:
        """The first reply, None if there is none."""
        replies: SimpleQueue[bytes | None] = SimpleQueue()

        def take(reply: zenoh.Reply) -> None:
            replies.put(None if reply.ok is None else reply.ok.payload.to_bytes())

        self.querier.get(take, payload=payload)
        try:
            return replies.get(timeout=6.0)
        except Empty:
            return None


def serve_raw(ready: Any, stop: Any, sizes: dict[str, bytes]) -> None:
    """Another process that answers with bytes of the right size."""
    bus = ZenohBus(ZenohOptions("peer", (ROUTER,), (), NAMESPACE))
    work: SimpleQueue[zenoh.Query | None] = SimpleQueue()
    kept = [bus.session.declare_queryable(f"{RAW}/{name}", work.put, complete=True) for name in sizes]
    ready.set()
    while not stop.is_set():
        try:
            asked = work.get(timeout=0.2)
        except Empty:
            continue
        if asked is not None:
            asked.reply(asked.key_expr, sizes[str(asked.key_expr).rsplit("/", 1)[1]])
            asked.drop()
    del kept
    bus.close()


def client(number: int, count: int, go: Any, out: Any) -> None:
    """One of the clients of the load: asks, compares every answer, says what it saw."""
    bus = ZenohBus(ZenohOptions("peer", (ROUTER,), (), NAMESPACE))
    asked = requests()
    expected = [json.loads(a) for a in answers(asked)]
    payloads = [encode(request)[0] for _, request in asked]
    askers = {q.key: Asker(bus.session, q.key) for q, _ in asked[:KINDS]}
    for k in range(KINDS):
        askers[asked[k][0].key].ask(payloads[k])
    out.put(("ready", number))
    go.wait()
    wrong = lost = 0
    times: list[float] = []
    for i in range(count):
        k = (i * CLIENTS + number) % len(asked)
        began = time.perf_counter()
        reply = askers[asked[k][0].key].ask(payloads[k])
        times.append(time.perf_counter() - began)
        lost += reply is None
        wrong += reply is not None and json.loads(reply) != expected[k]
    out.put((wrong, lost, times))
    bus.close()


def start() -> tuple[subprocess.Popen[bytes], float, float]:
    """Start the service; seconds to its first right answer, and of that the time the interpreter needs for nothing."""
    bus = ZenohBus(ZenohOptions("peer", (ROUTER,), (), NAMESPACE))
    asker, (query, request) = Asker(bus.session, STABILITY_CHECK.key), requests()[0]
    payload, expected = encode(request)[0], json.loads(answers([(query, request)])[0])
    began = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import numpy, numba, zenoh, pydantic"], check=True)
    bare = time.perf_counter() - began
    command = [sys.executable, "-m", "surefoot.services.stability", "--connect", ROUTER, "--namespace", NAMESPACE]
    began = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=dict(os.environ))
    while time.perf_counter() - began < 120.0:
        status: Any = asker.querier.matching_status
        if status.matching:
            reply = asker.ask(payload)
            if reply is not None and json.loads(reply) == expected:
                break
        time.sleep(0.002)
    took = time.perf_counter() - began
    bus.close()
    return process, took, bare


def pairs(count: int, asked: list[tuple[Query[Any, Any], Request]]) -> dict[str, float]:
    """Single queries, ours and raw in turn; prints p50 and p99 and returns the ratios."""
    bus = ZenohBus(ZenohOptions("peer", (ROUTER,), (), NAMESPACE))
    ratios: dict[str, float] = {}
    for kind in range(KINDS):
        chosen = asked[kind::KINDS]
        query, name = chosen[0][0], chosen[0][0].key.rsplit("/", 1)[1]
        payloads = [encode(r)[0] for _, r in chosen]
        mine, raw = Asker(bus.session, query.key), Asker(bus.session, f"{RAW}/{name}")
        times: dict[str, list[float]] = {"raw": [], "ours": [], "typed": []}
        for i in range(count + 50):
            payload, request = payloads[i % SETS], chosen[i % SETS][1]
            began = time.perf_counter()
            raw.ask(payload)
            middle = time.perf_counter()
            mine.ask(payload)
            later = time.perf_counter()
            bus.call(query, request)
            end = time.perf_counter()
            if i >= 50:
                times["raw"].append(middle - began)
                times["ours"].append(later - middle)
                times["typed"].append(end - later)
        p50 = {k: 1e6 * statistics.median(v) for k, v in times.items()}
        p99 = {k: 1e6 * float(np.quantile(v, 0.99)) for k, v in times.items()}
        ratios[f"{name} p50"], ratios[f"{name} p99"] = p50["ours"] / p50["raw"], p99["ours"] / p99["raw"]
        print(
            f"  {name:<8} p50 raw {p50['raw']:6.0f} us, ours {p50['ours']:6.0f}, typed client {p50['typed']:6.0f}"
            f" | p99 raw {p99['raw']:6.0f}, ours {p99['ours']:6.0f} | ratios p50 {ratios[f'{name} p50']:.2f},"
            f" p99 {ratios[f'{name} p99']:.2f}"
        )
    bus.close()
    return ratios


def load(queries: int) -> tuple[int, int]:
    """Eight clients at once; prints and returns wrong and lost answers."""
    context = multiprocessing.get_context("spawn")
    go, out = context.Event(), context.Queue()
    each = -(-queries // CLIENTS)
    clients = [context.Process(target=client, args=(i, each, go, out)) for i in range(CLIENTS)]
    for c in clients:
        c.start()
    for _ in clients:
        out.get(timeout=120.0)
    began = time.perf_counter()
    go.set()
    results = [out.get(timeout=300.0) for _ in clients]
    took = time.perf_counter() - began
    for c in clients:
        c.join(20.0)
    wrong, lost = sum(r[0] for r in results), sum(r[1] for r in results)
    times = 1e3 * np.concatenate([r[2] for r in results])
    print(
        f"  {each * CLIENTS} queries of {CLIENTS} clients at once in {took:.1f} s ({each * CLIENTS / took:.0f}/s): "
        f"{wrong} wrong, {lost} lost; p50 {np.median(times):.2f} ms, p99 {np.quantile(times, 0.99):.2f} ms"
    )
    return wrong, lost


def main() -> dict[str, float]:
    """Print all figures; returns them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--queries", type=int, default=5000, help="of all clients together")
    parser.add_argument("--pairs", type=int, default=1500, help="single queries of each kind")
    parser.add_argument("--starts", type=int, default=5, help="starts of the service")
    options, _ = parser.parse_known_args()
    router = ZenohBus(ZenohOptions("router", (), (ROUTER,), NAMESPACE))
    asked = requests()
    replies = answers(asked)
    sizes = {query.key.rsplit("/", 1)[1]: replies[k] for k, (query, _) in enumerate(asked[:KINDS])}
    context = multiprocessing.get_context("spawn")
    ready, stop = context.Event(), context.Event()
    raw = context.Process(target=serve_raw, args=(ready, stop, sizes))
    raw.start()
    figures: dict[str, float] = {}
    process = None
    try:
        ready.wait(60.0)
        took: list[float] = []
        for _ in range(options.starts):
            if process is not None:
                process.terminate()
                process.wait(20.0)
            process, seconds, bare = start()
            took.append(seconds)
        print(
            f"start to first answer, {options.starts} starts: best {min(took):.2f} s, "
            f"median {statistics.median(took):.2f} s (importing numpy, numba, zenoh, pydantic alone: {bare:.2f} s); "
            f"target < 1.2"
        )
        figures["start_s"] = min(took)
        print("one query, ours and raw Zenoh in turn; targets p50 <= 2.5, p99 <= 5")
        figures |= pairs(options.pairs, asked)
        print("load")
        wrong, lost = load(options.queries)
        figures |= {"wrong": wrong, "lost": lost}
    finally:
        stop.set()
        raw.join(10.0)
        if process is not None:
            process.terminate()
            process.wait(20.0)
        router.close()
    return figures


if __name__ == "__main__":
    main()
