"""Stability service over Zenoh: latency compared with raw Zenoh queries, load by eight clients, start-up time."""

import json
import multiprocessing
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
import zenoh
from zenoh.handlers import Callback

from benchmarks.bench import Bench, goal, table
from surefoot.bus.codec import decode, encode
from surefoot.bus.pour import keep_thread_state
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.robot.reader import load_robot
from surefoot.schemas.base import Request
from surefoot.schemas.stability import CheckRequest, Contact, RegionRequest
from surefoot.schemas.topics import STABILITY_CHECK, STABILITY_REGION, STABILITY_WHATIF, Query
from surefoot.schemas.whatif import WhatifRequest
from surefoot.services.stability.answers import check_reply, region_reply, whatif_reply
from tests.ports import free_address

BENCH = Bench("queries")

NAMESPACE = "surefoot/bench"
CLIENTS, KINDS, SETS = 8, 3, 40
RAW = "bench/raw"
Asked = list[tuple[Query[Any, Any], Request]]


def requests() -> Asked:
    """Return typical requests of a walking robot: check, region, what-if over stances of three to six feet."""
    rng = np.random.default_rng(0)
    out: Asked = []
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


def answers(asked: Asked) -> list[bytes]:
    """Return the replies that the service has to give, computed here."""
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
    """Client that sends raw queries over Zenoh with the settings of our own client."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.querier = session.declare_querier(
            key, target=zenoh.QueryTarget.BEST_MATCHING, consolidation=zenoh.ConsolidationMode.NONE, timeout=5.0,
            congestion_control=zenoh.CongestionControl.BLOCK, priority=zenoh.Priority.INTERACTIVE_HIGH, express=True,
        )  # fmt: skip

    def ask(self, payload: bytes) -> bytes | None:
        """Send a payload as a query and return the first reply, None if there is none."""
        replies: SimpleQueue[bytes | None] = SimpleQueue()

        def take(reply: zenoh.Reply) -> None:
            keep_thread_state()
            replies.put(None if reply.ok is None else reply.ok.payload.to_bytes())

        self.querier.get(Callback(take, indirect=False), payload=payload)
        try:
            return replies.get(timeout=6.0)
        except Empty:
            return None


def serve_raw(router: str, ready: Any, stop: Any, sizes: dict[str, bytes]) -> None:
    """Answer raw queries with bytes of the sizes of real replies, in a process of its own."""
    bus = ZenohBus(ZenohOptions("peer", (router,), (), NAMESPACE))
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


def client(router: str, number: int, count: int, go: Any, out: Any) -> None:
    """Run one client of the load: send queries, compare every reply, and report the wrong and lost ones."""
    bus = ZenohBus(ZenohOptions("peer", (router,), (), NAMESPACE))
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


def start(router: str) -> tuple[subprocess.Popen[bytes], float, float]:
    """Start the service; return the process, the time to its first right answer and that of its imports, s."""
    bus = ZenohBus(ZenohOptions("peer", (router,), (), NAMESPACE))
    asker, (query, request) = Asker(bus.session, STABILITY_CHECK.key), requests()[0]
    payload, expected = encode(request)[0], json.loads(answers([(query, request)])[0])
    began = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import numpy, numba, zenoh, pydantic"], check=True)
    bare = time.perf_counter() - began
    command = [sys.executable, "-m", "surefoot.services.stability", "--connect", router, "--namespace", NAMESPACE]
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


def pairs(router: str, count: int, asked: Asked) -> None:
    """Print p50 and p99 of a query: raw Zenoh, ours, and typed, ended by the first or by the owner's answer."""
    bus = ZenohBus(ZenohOptions("peer", (router,), (), NAMESPACE))
    rows: list[tuple[object, ...]] = []
    for kind in range(KINDS):
        chosen = asked[kind::KINDS]
        query, name = chosen[0][0], chosen[0][0].key.rsplit("/", 1)[1]
        payloads = [encode(r)[0] for _, r in chosen]
        mine, raw = Asker(bus.session, query.key), Asker(bus.session, f"{RAW}/{name}")
        times: dict[str, list[float]] = {"raw": [], "ours": [], "first": [], "owner": []}
        for i in range(count + 50):
            payload, request = payloads[i % SETS], chosen[i % SETS][1]
            marks = [time.perf_counter()]
            raw.ask(payload)
            marks.append(time.perf_counter())
            mine.ask(payload)
            marks.append(time.perf_counter())
            decode(query.reply, mine.ask(encode(request)[0]) or b"")
            marks.append(time.perf_counter())
            bus.call(query, request)
            marks.append(time.perf_counter())
            if i >= 50:
                for what, (began, end) in zip(times, pairwise(marks), strict=True):
                    times[what].append(end - began)
        p50, p99 = ({k: 1e6 * float(np.quantile(v, q)) for k, v in times.items()} for q in (0.5, 0.99))
        for q, found, most in (("p50", p50, 2.5), ("p99", p99, 5.0)):
            ratios = (found["ours"] / found["raw"], f"<= {most:g}", found["owner"] / found["first"], "<= 1.1")
            rows.append((f"{name}, {q}", *found.values(), *ratios))
    bus.close()
    header = ("query", "raw", "ours", "first", "owner", "ours / raw", "goal", "owner / first", "goal")
    table("one query in turn: raw Zenoh, ours, typed with the first answer, with the owner's, us", header, rows)


def load(router: str, queries: int) -> None:
    """Send queries from eight clients at once; print the numbers of wrong and lost answers, and the rate."""
    context = multiprocessing.get_context("spawn")
    go, out = context.Event(), context.Queue()
    each = -(-queries // CLIENTS)
    clients = [context.Process(target=client, args=(router, i, each, go, out)) for i in range(CLIENTS)]
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
        f"{each * CLIENTS} queries of {CLIENTS} clients at once in {took:.1f} s ({each * CLIENTS / took:.0f}/s): "
        f"{wrong} wrong, {lost} lost; p50 {np.median(times):.2f} ms, p99 {np.quantile(times, 0.99):.2f} ms"
    )


@contextmanager
def raw_server(router: str, asked: Asked) -> Iterator[None]:
    """Run, inside the context, the process that answers raw queries with bytes of real replies."""
    replies, context = answers(asked[:KINDS]), multiprocessing.get_context("spawn")
    sizes = {query.key.rsplit("/", 1)[1]: reply for (query, _), reply in zip(asked[:KINDS], replies, strict=True)}
    ready, stop = context.Event(), context.Event()
    process = context.Process(target=serve_raw, args=(router, ready, stop, sizes))
    process.start()
    try:
        ready.wait(60.0)
        yield
    finally:
        stop.set()
        process.join(10.0)


@BENCH.part("--queries 16 --singles 5 --starts 1")
def stability(*, queries: int = 5000, singles: int = 1500, starts: int = 5) -> None:
    """Print latency of stability queries beside raw Zenoh ones, wrong answers under load, and start-up time.

    Service, raw queryable and clients are processes of their own on loopback, joined by a router. A raw query carries
    the same request and reply bytes and computes nothing. Goals: p50 at most 2.5 and p99 at most 5 of a raw query,
    interleaved in one run; 5000 queries from 8 clients at once without one wrong or lost answer; start to first answer
    in less than 1.2 s when warm.

    Args:
        queries: number of queries of all clients together.
        singles: single queries of each kind.
        starts: number of starts of the service.
    """
    router, asked = free_address(), requests()
    process, took, bare = None, list[float](), 0.0
    hub = ZenohBus(ZenohOptions("router", (), (router,), NAMESPACE))
    try:
        with raw_server(router, asked):
            for _ in range(starts):
                _end(process)
                process, seconds, bare = start(router)
                took.append(seconds)
            goal("start to first answer, best", min(took), "<=", 1.2, "s")
            goal("start to first answer, median", statistics.median(took), unit="s")
            goal("importing numpy, numba, zenoh, pydantic alone", bare, unit="s")
            pairs(router, singles, asked)
            load(router, queries)
    finally:
        _end(process)
        hub.close()


def _end(process: "subprocess.Popen[bytes] | None") -> None:
    if process is not None:
        process.terminate()
        process.wait(20.0)
