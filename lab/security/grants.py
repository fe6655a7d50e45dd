"""Grants: rights of each service and person on the keys of the bus, by the topics and the services' declarations.

The owner of a topic publishes it, its reader subscribes to it, the caller of a query sends it, its server answers;
nothing else is granted. Keys are relative to the namespace of the robot; ``*`` stands for one word.
"""

from collections.abc import Iterable, Iterator
from enum import Enum
from typing import Any, NamedTuple

from surefoot.bus.asking import LIVE, STARTS
from surefoot.bus.codec import MAX_BULK_BYTES, MAX_JSON_BYTES
from surefoot.bus.frame import MAX_FRAME_BYTES
from surefoot.bus.publish import BATCH, FRAME, apart, participants_key
from surefoot.lockstep.driver import Driver
from surefoot.lockstep.join import DRIVER, Delayed
from surefoot.lockstep.service import Service
from surefoot.schemas import topics
from surefoot.schemas.base import Bulk, BulkRequest
from surefoot.schemas.topics import Query, Topic

ROUTER = "supervisor"
"""Identity of the router, which forwards messages of all clients, so that peers accept every key from it."""
TOKENS = f"{LIVE}/*/*", f"{STARTS}/*/*"


class Verb(Enum):
    """Kind of use of a bus key that a grant allows."""

    PUBLISH = "publish"
    READ = "read"
    ASK = "ask"
    SERVE = "serve"
    SHOW = "show"  # its liveliness token
    WATCH = "watch"  # the tokens of others


class Role(Enum):
    """Role of a person, which sets the keys of the bus that the person may read, request and publish."""

    OPERATOR = "operator"  # reads every topic, sends every query, stops the robot
    GUEST = "guest"  # reads every topic, sends the queries that change nothing


class Grant(NamedTuple):
    """Permission of the holder of a certificate (`identity`) for one kind of use of a bus key."""

    identity: str
    verb: Verb
    key: str


def grants(services: Iterable[type[Service[Any]]], people: dict[str, Role]) -> tuple[Grant, ...]:
    """Return the grants of services and people (role by name), without those of the router, which may do all."""
    found = [Grant(service.name, *one) for service in services if service.name != ROUTER for one in _of(service)]
    found += [Grant(name, *one) for name, role in people.items() for one in _of_role(role)]
    return tuple(dict.fromkeys(found))


def _of(service: type[Service[Any]]) -> Iterator[tuple[Verb, str]]:
    drives = issubclass(service, Driver)
    for owner in (service.name, DRIVER) if drives else (service.name,):
        yield Verb.PUBLISH, FRAME.format(owner)
        yield Verb.PUBLISH, BATCH.format(owner)
        yield Verb.SHOW, f"{LIVE}/{owner}/*"
    yield Verb.SHOW, f"{STARTS}/{service.name}/*"
    yield from ((Verb.WATCH, tokens) for tokens in TOKENS)
    own = (*service.outputs, *(family.of(service.name) for family in (topics.TICK_DONE, topics.HEALTH, topics.LOG)))
    for topic in (*own, topics.HW_TICK) if drives else own:
        yield Verb.PUBLISH, topic.key
        if apart(topic):
            yield Verb.PUBLISH, participants_key(topic, "*")
    inputs = [item.topic if isinstance(item, Delayed) else item for item in service.inputs]
    for topic in (topics.TICK_DONE, topics.CMD_JOINTS) if drives else (topics.HW_TICK, *inputs):
        for family in (BATCH, FRAME) if service.batched else (FRAME,):  # footholds takes single ticks with an own map
            yield Verb.READ, family.format(topic.owner) if topic.framed else participants_key(topic, "*")
    for topic in service.observes:
        yield Verb.READ, participants_key(topic, "*") if apart(topic) else topic.key
    for query in (
        *service.serves,
        *(family.of(service.name) for family in (topics.HEALTH_GET, topics.CONFIG_GET, topics.CONFIGURE)),
    ):
        yield Verb.SERVE, query.key
        yield Verb.SERVE, participants_key(query, "*")
    for query in (*service.calls, topics.SIM_JOIN):
        yield Verb.ASK, participants_key(query, "*")
    yield Verb.ASK, topics.SIM_JOIN.key  # of participants in other languages


def _of_role(role: Role) -> Iterator[tuple[Verb, str]]:
    yield from ((Verb.WATCH, tokens) for tokens in TOKENS)
    for topic in topics.TOPICS:
        yield Verb.READ, topic.key
    for query in topics.QUERIES:
        if role is Role.OPERATOR or not query.acts:
            yield Verb.ASK, query.key
    if role is Role.OPERATOR:
        yield Verb.PUBLISH, topics.CMD_ESTOP.key


def areas(granted: Iterable[Grant]) -> tuple[str, ...]:
    """Return key expressions that cover all granted keys: `**`, and `word/**` for each first word with a leading @."""
    words = {grant.key.partition("/")[0] for grant in granted}
    return ("**", *sorted(f"{word}/**" for word in words if word.startswith("@")))


def limits() -> dict[int, tuple[str, ...]]:
    """Return the key expressions to which each limit on the payload size applies, by limit in bytes."""
    found: dict[int, list[str]] = {MAX_FRAME_BYTES: [FRAME.format("*"), BATCH.format("*")]}
    rows: list[Topic[Any] | Query[Any, Any]] = [*topics.TOPICS, *topics.QUERIES]
    bulky = {row.key for row in rows if any(issubclass(model, (Bulk, BulkRequest)) for model in _models(row))}
    for row in rows:
        keys = found.setdefault(MAX_BULK_BYTES if row.key in bulky else MAX_JSON_BYTES, [])
        keys += [row.key, participants_key(row, "*")]
    return {size: tuple(dict.fromkeys(keys)) for size, keys in found.items()}


def _models(row: Topic[Any] | Query[Any, Any]) -> tuple[type[Any], ...]:
    return (row.model,) if isinstance(row, Topic) else (row.request, row.reply)
