"""Damaged messages to a running system: a client that publishes and requests what the schemas do not allow.

Run by `benchmarks.fuzz` as a program beside the system. In its own name it sends anything: values of the schemas, whole
or damaged, under every key. In the name of a process of the system, read from its token of liveliness, it sends what no
reader may take: bodies that the decoder refuses below a good header, damaged frames, frames of another epoch. What
every client may do is left out: requests that change the run, and the emergency stop.
"""

import json
import os
import sys
import time
from collections import Counter
from collections.abc import Callable
from random import Random
from typing import Any

import zenoh

from benchmarks.fuzz_inputs import Drawer, drawn, spoil
from surefoot.bus.codec import decode, json_schema
from surefoot.bus.frame import FramePart, pack
from surefoot.bus.interface import Stamp
from surefoot.bus.publish import BATCH, FRAME, apart, participants_key
from surefoot.bus.seals import VARIABLE, with_seal
from surefoot.errors import SurefootError
from surefoot.schemas.base import Bulk, BulkRequest, Wire
from surefoot.schemas.topics import CMD_ESTOP, QUERIES, TOPICS, Query, Topic

STRANGER = "00ff00ff00ff00ff"
ODD_HEADER = (0, 1, -1, 2**63, 10**30)
SECRET = os.environ.get(VARIABLE, "")
"""Secret of the system, where it has one: then most inputs are sealed, so that they get past the seals."""
WAIT_S = 0.002
"""Longest wait for the answer to a query, s; an answer after that is ignored."""
BLOCK = 50
"""Number of inputs that are sent between two checks of the rate."""
KINDS = ("topic", "participant", "frame", "batch", "query", "participant query", "token")
SHARES = (4, 3, 4, 2, 0.1, 0.1, 0.05)


class Fuzzer:
    """Draws inputs and sends them by a session.

    Args:
        session: client of the router.
        namespace: prefix of the robot's keys.
        seed: seed of the inputs.
    """

    def __init__(self, session: zenoh.Session, namespace: str, seed: int) -> None:
        self.session, self.namespace, self.random = session, namespace, Random(seed)
        self.sent: Counter[str] = Counter()
        """Number of inputs sent, by kind."""
        self.codes: Counter[str] = Counter()
        """Number of refusals that answered queries, by code."""
        self._drawers: dict[str, Drawer] = {}
        self._framed = {topic.key: topic for topic in TOPICS if topic.framed}
        self._owners = sorted({topic.owner for topic in self._framed.values()})
        self._ways: dict[str, Callable[[], None]] = dict(
            zip(
                KINDS,
                (self._topic, self._to_participants, self._frame, self._batch, self._query, self._as_one, self._token),
                strict=True,
            )
        )
        self.look()

    def look(self) -> None:
        """Find the process of each service from the liveliness tokens on the network."""
        self.processes: dict[str, str] = {}
        for reply in self.session.liveliness().get(f"{self.namespace}/alive/*/*", timeout=2.0):
            if reply.ok is not None:
                service, instance = str(reply.ok.key_expr).rsplit("/", 2)[1:]
                if instance != STRANGER:
                    self.processes[service] = instance

    def send(self) -> None:
        """Draw one input and send it to a service."""
        kind = self.random.choices(KINDS, SHARES)[0]
        self._ways[kind]()
        self.sent[kind] += 1

    def _drawn(self, model: type[Wire]) -> bytes:
        name = model.__name__
        if name not in self._drawers:
            self._drawers[name] = Drawer(json_schema(model), self.random)
        return drawn(self._drawers[name], self.random)

    def _parts(self, model: type[Wire]) -> tuple[bytes, bytes | None]:
        """Return payload and attachment of a random message; the body of an array has a random length."""
        data = self._drawn(model)
        return (self.random.randbytes(self.random.randint(1, 64)), data) if _is_bulk(model) else (data, None)

    def _refused(self, model: type[Wire]) -> tuple[bytes, bytes | None]:
        """Return payload and attachment of a message of a model that the decoder refuses."""
        for _ in range(20):
            payload, attachment = self._parts(model)
            if not _is_taken(model, payload, attachment):
                return payload, attachment
        return b"{", None

    def _put(self, key: str, payload: bytes, attachment: bytes | None) -> None:
        self.session.put(f"{self.namespace}/{key}", payload, attachment=attachment)

    def _key(self, row: Topic[Any] | Query[Any, Any]) -> str:
        return row.key.replace("*", self.random.choice([*self.processes, "x"]))

    def _topic(self) -> None:
        topic = self.random.choice(TOPICS)
        make = self._refused if topic is CMD_ESTOP else self._parts
        self._put(self._key(topic), *make(topic.model))

    def _to_participants(self) -> None:
        topic = self.random.choice([topic for topic in TOPICS if apart(topic)])
        owner = self.processes.get(topic.owner, STRANGER)
        key = participants_key(topic, owner).replace("*", self.random.choice([*self.processes, "x"]))
        payload, attachment = self._refused(topic.model)
        self._put(key, payload, with_seal(SECRET, key, payload, attachment) if SECRET else attachment)

    def _frame(self) -> None:
        self._framed_by(FRAME)

    def _batch(self) -> None:
        self._framed_by(BATCH)

    def _framed_by(self, family: str) -> None:
        """Publish a frame or batch; under the name of its owner only one that is cut off or of another epoch."""
        random, owner = self.random, self.random.choice(self._owners)
        known = [topic for topic in self._framed.values() if topic.owner == owner]
        own = owner in self.processes and random.random() < 0.5
        epoch = random.choice((-1, 0, 10**9)) if own else random.choice((*ODD_HEADER, 1, 2, 3))
        tick, stamp_ns, seq = (random.choice((*ODD_HEADER, random.randrange(1000))) for _ in range(3))
        stamp = Stamp(tick if tick >= 0 or not own else 0, epoch, stamp_ns, seq)
        parts = [FramePart(topic.key, self._refused(topic.model)[0], stamp)
                 for topic in random.choices(known, k=random.randint(1, 4))]  # fmt: skip
        secret = SECRET if random.random() < 0.9 else ""
        payload, index = pack(
            parts, self.processes[owner] if own else random.choice((STRANGER, "", "x" * 5000)), secret
        )
        if not own and random.random() < 0.5:
            payload, index = random.choice(((spoil(payload, random), index), (payload, spoil(index, random))))
        elif own and random.random() < 0.5:
            payload = payload[: random.randrange(len(payload))]
        self._put(family.format(owner), payload, index)

    def _query(self) -> None:
        query = self.random.choice(QUERIES)
        self._ask(self._key(query), query)

    def _as_one(self) -> None:
        query = self.random.choice(QUERIES)
        service = self.random.choice([*self.processes, "x"]) if query.owner == "*" else query.owner
        key = participants_key(query, self.processes.get(service, STRANGER)).replace("*", service)
        self._ask(key, query)

    def _ask(self, key: str, query: Query[Any, Any]) -> None:
        """Send a query that the decoder refuses, and count the codes of immediate refusals."""
        payload, attachment = self._refused(query.request)
        for reply in self.session.get(
            f"{self.namespace}/{key}", payload=payload, attachment=attachment, timeout=WAIT_S
        ):
            if reply.err is not None:
                self._answered(reply.err.payload.to_bytes())

    def _answered(self, payload: bytes) -> None:
        try:
            self.codes[str(json.loads(payload)["code"])] += 1
        except (ValueError, KeyError, TypeError):
            self.codes["network"] += 1  # the router's note of a time-out

    def _token(self) -> None:
        """Declare the liveliness token of an unknown participant for a moment."""
        family = self.random.choice(("alive", "starts", "alive/driver", "x"))
        name = self.random.choice([*self.processes, "x", "walker/walker"])
        token = self.session.liveliness().declare_token(f"{self.namespace}/{family}/{name}/{STRANGER}")
        token.undeclare()


def _is_bulk(model: type[Wire]) -> bool:
    return issubclass(model, Bulk | BulkRequest)


def _is_taken(model: type[Wire], payload: bytes, attachment: bytes | None) -> bool:
    try:
        decode(model, payload, attachment)
    except SurefootError:
        return False
    return True


def main(address: str, namespace: str, seed: str, count: str, rate: str) -> None:
    """Send random inputs to a running system and print their counts as a line of JSON.

    `address`: endpoint of its router; `namespace`: prefix of its keys; `count`: inputs; `rate`: inputs per s.
    """
    settings = {"mode": "client", "connect": {"endpoints": [address]}}
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
        fuzzer, began, sent = Fuzzer(session, namespace, int(seed)), time.monotonic(), 0
        while sent < int(count):
            for _ in range(BLOCK):
                fuzzer.send()
            sent += BLOCK
            time.sleep(max(0.0, began + sent / float(rate) - time.monotonic()))
        print(json.dumps({"sent": fuzzer.sent, "codes": fuzzer.codes, "s": time.monotonic() - began}), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
