"""Queries over Zenoh, of which only the answer of the service that owns the query is accepted.

A query goes to every process that serves its key, so that a process which answers first, wrongly or never delays no
answer. The owner is identified by its session: Zenoh names the session of each answer, and the liveliness token of a
service ends with the name of its session. In a system with a secret (see `seals`) this name may be copied, and the
answer itself is sealed: it counts if its seal holds, for the query that was sent.
"""
# pyright: reportUnknownMemberType=false

import secrets
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from queue import Empty, SimpleQueue
from typing import Any

import zenoh
from zenoh.handlers import Callback

from surefoot.bus.codec import encoding_of
from surefoot.bus.interface import two_owners
from surefoot.bus.mesh import tokens_of, visible_to
from surefoot.bus.pour import keep_thread_state
from surefoot.bus.publish import participants_key
from surefoot.bus.seals import ASKED, Asked, born_ms, new_digits, without_seal
from surefoot.bus.tokens import LIVE, STARTS
from surefoot.errors import CallError
from surefoot.schemas.topics import HEALTH_GET, Query

TOKENS_S = 0.5
"""Limit on the wait for the liveliness tokens of a service, s; they usually come within a millisecond."""
MEANWHILE_S = 0.5
"""Interval of the calls of `meanwhile` during the wait for an answer, s."""
MOST_OF_ONE, MOST_NAMES = 4, 64
"""`MOST_OF_ONE`: number of unsealed answers to one query that are kept of each process, as an owner answers once;
`MOST_NAMES`: number of processes from which on all further ones count as one."""
MOST_REFUSED = 1024
"""Number of pairs of key and process whose refused answers are counted apart; those of further pairs under no name."""


class Answered:
    """Answers to one query: threads of Zenoh add them, the sender of the query takes them; few are kept at a time.

    An answer with the right seal is kept always. Of others `MOST_OF_ONE` of each process are kept, so that a process
    which answers without end costs no memory.

    Args:
        asked: the query that was sent.
        secret: secret of the system; empty = no answer is sealed.
    """

    def __init__(self, asked: Asked, secret: str) -> None:
        self._asked, self._secret, self._open = asked, secret, True
        self._kept = SimpleQueue[tuple[zenoh.Reply, bool] | None]()
        self._counts: Counter[str] = Counter()

    def put(self, reply: zenoh.Reply) -> None:
        """Add an answer; it is dropped after `close`, or if its process has sent too many without the right seal."""
        if not self._open:
            return
        if _sealed(reply, self._asked, self._secret):
            self._kept.put((reply, True))
            return
        by = _replier(reply)
        name = by if by in self._counts or len(self._counts) < MOST_NAMES else ""
        self._counts[name] += 1
        if self._counts[name] <= MOST_OF_ONE:
            self._kept.put((reply, False))

    def end(self) -> None:
        """Record that no further answer can come."""
        self._kept.put(None)

    def close(self) -> None:
        """Drop all answers that come from now on."""
        self._open = False

    def until(self, deadline: float, meanwhile: Callable[[], Any] | None) -> Iterator[tuple[zenoh.Reply, bool]]:
        """Iterate over the answers, each with whether it has the right seal, until `deadline` or until none can come.

        Args:
            deadline: time at which the wait ends, by the monotonic clock, s.
            meanwhile: called every ``MEANWHILE_S`` of the wait.
        """
        while (left := deadline - time.monotonic()) > 0.0:  # also if answers that do not count come without end
            try:
                found = self._kept.get(timeout=left if meanwhile is None else min(left, MEANWHILE_S))
            except Empty:
                if meanwhile is not None and left > MEANWHILE_S:
                    meanwhile()
                continue
            if found is None:
                return
            yield found


class Asking:
    """Sender of the queries of one Zenoh session; it remembers which process owns the queries of each service.

    Args:
        session: session of Zenoh.
        namespace: prefix of its keys, for error messages.
        secret: secret of the system; empty = answers need no seal.
    """

    def __init__(self, session: zenoh.Session, namespace: str, secret: str = "") -> None:
        self.refused: Counter[tuple[str, str]] = Counter()
        """Number of queries of which an answer was refused, as its process does not own the query, by key and process;
        an empty name stands for those beyond `MOST_REFUSED`."""
        self._session, self._namespace, self._secret = session, namespace, secret
        self._queriers: dict[tuple[str, bool, float], tuple[str, zenoh.Querier]] = {}
        """Zenoh key and querier by key of the query, whether a single process is asked, and timeout, s. A querier of a
        replaced process is dropped: all peers keep about a kilobyte for a key that only its owner declares."""
        self._owners: dict[str, str] = {}

    def ask(
        self,
        query: Query[Any, Any],
        timeout: float,
        payload: bytes,
        attachment: bytes | None,
        *,
        instance: str = "",
        meanwhile: Callable[[], Any] | None = None,
    ) -> zenoh.Reply:
        """Return the first answer of the process that owns a query; if that has a sealed name, the first sealed answer.

        Args:
            query: row of the table.
            timeout: limit on the wait, s; it holds also if the network loses the query.
            payload: encoded request.
            attachment: raw bytes that go with the payload; None = none.
            instance: process that shall answer; empty = the process with the liveliness token of the owner.
            meanwhile: called every ``MEANWHILE_S`` of the wait.

        Raises:
            CallError: absent or timeout, with the processes that answered without owning the query; ``second`` if two
                processes with the owner's token answer and neither was the owner before.
        """
        key = participants_key(query, instance) if instance else query.key
        querier = self._querier(query, key, timeout, instance)
        asked = Asked(key, new_digits() if self._secret else b"", payload, attachment)
        answered = Answered(asked, self._secret)
        _send(querier, encoding_of(query.request), asked, answered)
        deadline = time.monotonic() + timeout + 0.2
        strangers = set[str]()
        try:
            reply = self._chosen(query, instance, answered.until(deadline, meanwhile), strangers)
        finally:
            answered.close()
        if reply is None:
            raise self._unanswered(querier, query, timeout, strangers)
        return reply

    def _chosen(
        self, query: Query[Any, Any], instance: str, answers: Iterable[tuple[zenoh.Reply, bool]], strangers: set[str]
    ) -> zenoh.Reply | None:
        """Return the first of the answers that counts, None if none does; add the processes of others to `strangers`.

        Raises:
            CallError: ``second``, as `ask`.
        """
        owner, claims = instance or self._owners.get(query.owner, ""), dict[str, zenoh.Reply]()
        must_seal: bool | None = None
        for reply, sealed in answers:
            if sealed:
                return reply
            by = _replier(reply)
            if not by or by in claims or by in strangers:  # without a name: the router's note of a time-out
                continue
            if must_seal is None:
                must_seal = bool(self._secret) and self._is_sealed(query, instance)
            if by == owner and not must_seal:
                return reply
            if not instance and not must_seal and self._may_own(query, by):
                claims[by] = reply
                if self._owners.get(query.owner) == by:
                    return reply
                if len(claims) > 1:
                    raise two_owners(query, claims)
            else:
                strangers.add(by)
                self._refuse(query, by)
        return next(iter(claims.values()), None)

    def _refuse(self, query: Query[Any, Any], by: str) -> None:
        """Count a refused answer of a process to a query, from `MOST_REFUSED` pairs on without its name."""
        place = (query.key, by)
        known = place in self.refused or len(self.refused) < MOST_REFUSED
        self.refused[place if known else (query.key, "")] += 1

    def _is_sealed(self, query: Query[Any, Any], instance: str) -> bool:
        """Return whether the process `instance` (empty: any with the token of the query's owner) has a sealed name."""
        tokens = tokens_of(self._session, f"*/*/{instance or '*'}", TOKENS_S)
        shown = [key.split("/")[-2:] for key in tokens]
        sealed = {name for service, name in shown if born_ms(self._secret, service, name)}
        return any(name in sealed for service, name in shown if service == query.owner)

    def _may_own(self, query: Query[Any, Any], process: str) -> bool:
        """Return whether a process shows the token of a query's owner; the only one that does is kept as the owner."""
        tokens = visible_to(self._session, f"{LIVE}/{query.owner}/*", TOKENS_S)
        if not tokens and query.key.startswith(HEALTH_GET.key[:-1]):  # all that a service answers while it starts
            return process in visible_to(self._session, f"{STARTS}/{query.owner}/*", TOKENS_S)
        if process not in tokens or self._owners.get(query.owner) in tokens:
            return False
        if len(tokens) == 1:
            self._owners[query.owner] = process
        return True

    def _querier(self, query: Query[Any, Any], key: str, timeout: float, instance: str) -> zenoh.Querier:
        place = (query.key, bool(instance), timeout)
        before, querier = self._queriers.get(place, ("", None))
        if querier is None or before != key:
            encoding_of(query.reply)
            querier = self._session.declare_querier(
                key,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=timeout,
                congestion_control=zenoh.CongestionControl.BLOCK,
                priority=zenoh.Priority.INTERACTIVE_HIGH,
                express=True,
            )
            self._queriers[place] = key, querier
        return querier

    def _unanswered(
        self, querier: zenoh.Querier, query: Query[Any, Any], timeout: float, strangers: set[str]
    ) -> CallError:
        status: Any = querier.matching_status  # typed bool in the stubs
        if not status.matching:
            return CallError("absent", f"no service answers {query.key!r} in {self._namespace!r}")
        named = " and ".join(map(repr, sorted(strangers)))
        why = f"; an answer of {named} was refused, which is not {query.owner}, or only has its name"
        others = why if named else ""
        return CallError("timeout", f"{query.key!r} did not answer within {timeout:g} s{others}")


def plain_attachment(answer: zenoh.Sample) -> bytes | None:
    """Return the attachment of an answer to a query without its seal; None if the answer has no attachment."""
    attachment = answer.attachment
    return None if attachment is None else without_seal(attachment.to_bytes())[0]


def _send(querier: zenoh.Querier, encoding: str, asked: Asked, answered: Answered) -> None:
    """Send a query whose answers are added to `answered`."""

    def on_reply(reply: zenoh.Reply) -> None:
        keep_thread_state()
        answered.put(reply)

    querier.get(
        handler=Callback(on_reply, answered.end, indirect=False),
        payload=asked.payload,
        encoding=encoding,
        attachment=asked.attachment,
        parameters=f"{ASKED}={asked.digits.decode()}" if asked.digits else None,
    )


def _sealed(reply: zenoh.Reply, asked: Asked, secret: str) -> bool:
    """Return whether an answer carries the seal that only a process with the secret can make for this query."""
    if not asked.digits:
        return False
    if reply.ok is None:
        error = reply.err
        given = b"" if error is None else str(error.encoding).rpartition(";")[2].encode()
        payload = b"" if error is None else error.payload.to_bytes()
        return error is not None and secrets.compare_digest(given, asked.seal(secret, payload, None, failed=True))
    sealed = reply.ok.attachment
    attachment, digits, seal = without_seal(None if sealed is None else sealed.to_bytes())
    if digits != asked.digits:
        return False
    return secrets.compare_digest(digits + b":" + seal, asked.seal(secret, reply.ok.payload.to_bytes(), attachment))


def _replier(reply: zenoh.Reply) -> str:
    """Return the name of the session that answered; empty = the router itself answered."""
    by = reply.replier_id
    return "" if by is None else str(by.zid)
