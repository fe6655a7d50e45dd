"""Rules by which an answer is believed, with replies and tokens in an order that no network can be made to keep."""

import time
import weakref
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from surefoot.bus import asking
from surefoot.bus.asking import MOST_NAMES, MOST_OF_ONE, Answered, Asking
from surefoot.bus.seals import Asked
from surefoot.errors import CallError
from surefoot.schemas.topics import HEALTH_GET, STABILITY_REGION
from tests.surefoot.expect import expect_error

SECRET = "0123456789abcdef" * 2
ROUTER = ""
"""Replier of a note that the router itself writes."""


class Zbytes(SimpleNamespace):
    """Bytes as Zenoh hands them over."""

    def __init__(self, content: bytes) -> None:
        super().__init__(to_bytes=lambda: content)


class Querier(SimpleNamespace):
    """Querier that can be referred to weakly, so that its end is noticed."""


class Network:
    """Session whose queries get the given repliers, in their order, and whose tokens are those given.

    Attributes:
        tokens: processes that show a token, by its first two words.
        repliers: processes that answer the next query.
        ends: the network notes that all have answered.
    """

    def __init__(self) -> None:
        self.tokens: dict[str, tuple[str, ...]] = {}
        self.repliers: Sequence[str] = ()
        self.ends = self.matching = True
        self.given: list[Any] = []
        self.queriers: list[str] = []
        """Keys of the queriers that are declared at present."""

    def liveliness(self) -> Any:
        def get(key: str, handler: Any, timeout: float) -> None:
            for process in self.tokens.get(key.removesuffix("/*"), ()):
                handler.callback(SimpleNamespace(ok=SimpleNamespace(key_expr=f"x/{process}")))
            handler.drop()

        return SimpleNamespace(get=get)

    def declare_querier(self, key: str, **_: Any) -> Any:
        querier = Querier(get=self._get, matching_status=SimpleNamespace(matching=self.matching))
        self.queriers.append(key)
        weakref.finalize(querier, self.queriers.remove, key)
        return querier

    def _get(self, *, handler: Any, **_: Any) -> None:
        names = [SimpleNamespace(zid=by) if by else None for by in self.repliers]
        self.given = [SimpleNamespace(replier_id=name, number=number) for number, name in enumerate(names)]
        for reply in self.given:
            handler.callback(reply)
        if self.ends:
            handler.drop()

    def answers(self, client: Asking, *repliers: str, meanwhile: Callable[[], Any] | None = None, to: str = "") -> Any:
        """Return the number of the reply that is taken of those of these processes."""
        self.repliers = repliers
        reply: Any = client.ask(STABILITY_REGION, 0.05, b"", None, instance=to, meanwhile=meanwhile)
        return reply.number


@pytest.fixture
def network(monkeypatch: pytest.MonkeyPatch) -> Network:
    monkeypatch.setattr(asking, "keep_thread_state", lambda: None)
    monkeypatch.setattr(asking, "MEANWHILE_S", 0.01)
    return Network()


@pytest.fixture
def client(network: Network) -> Asking:
    session: Any = network
    return Asking(session, "surefoot/ragno")


def shows(network: Network, *processes: str) -> None:
    network.tokens["alive/stability"] = processes


def test_another_that_shows_the_owners_token_is_refused_by_who_knows_the_owner(
    network: Network, client: Asking
) -> None:
    shows(network, "real")
    assert network.answers(client, "real") == 0
    shows(network, "real", "other")
    assert network.answers(client, "other", "real") == 1
    with expect_error(CallError, "timeout", text="'other' was refused, which is not stability"):
        network.answers(client, "other")
    assert client.refused == {(STABILITY_REGION.key, "other"): 2}


def test_an_owner_that_took_the_place_of_the_known_one_is_believed(network: Network, client: Asking) -> None:
    shows(network, "real")
    assert network.answers(client, "real") == 0
    shows(network, "next")
    assert network.answers(client, "next") == 0


def test_a_note_of_the_router_is_no_answer_and_of_no_stranger(network: Network, client: Asking) -> None:
    shows(network, "real")
    assert network.answers(client, ROUTER, "real") == 1
    with expect_error(CallError, "timeout"):
        network.answers(client, ROUTER)
    assert not client.refused


def test_a_stranger_that_answers_often_is_counted_once_for_a_query(network: Network, client: Asking) -> None:
    shows(network, "real")
    assert network.answers(client, "stranger", "stranger", "real") == 2
    assert client.refused == {(STABILITY_REGION.key, "stranger"): 1}


def of(by: str) -> Any:
    """An answer of a process, with a content that has no seal."""
    return SimpleNamespace(
        replier_id=SimpleNamespace(zid=by), ok=SimpleNamespace(attachment=None, payload=Zbytes(b"{}")), err=None
    )


def test_answers_without_end_are_not_kept_and_displace_no_sealed_one() -> None:
    """As of a flood under the name of the owner, and under any number of names, before the owner answers."""
    asked = Asked(STABILITY_REGION.key, b"123", b"{}", None)
    answered = Answered(asked, SECRET)
    right = of("owner")
    right.ok.attachment = Zbytes(b"\n" + asked.seal(SECRET, b"{}", None))
    for number in range(5000):
        answered.put(of("owner"))
        answered.put(of(f"stranger{number}"))
    answered.put(right)
    answered.end()
    found = list(answered.until(time.monotonic() + 60.0, None))
    assert len(found) <= MOST_OF_ONE * (MOST_NAMES + 1) + 1
    assert [reply for reply, sealed in found if sealed] == [right]


def test_answers_after_the_end_of_the_wait_are_not_kept() -> None:
    answered = Answered(Asked(STABILITY_REGION.key, b"", b"{}", None), "")
    answered.close()
    answered.put(of("owner"))
    answered.end()
    assert not list(answered.until(time.monotonic() + 60.0, None))


def test_refused_answers_of_ever_new_processes_are_counted_in_a_bounded_table(
    network: Network, client: Asking, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(asking, "MOST_REFUSED", 3)
    shows(network, "real")
    for number in range(10):
        assert network.answers(client, f"stranger{number}", "real") == 1
    assert client.refused.total() == 10
    assert client.refused[STABILITY_REGION.key, ""] == 7


def test_the_first_answer_of_one_that_answers_often_is_taken(network: Network, client: Asking) -> None:
    shows(network, "one", "two")
    assert network.answers(client, "one", "one") == 0
    with expect_error(CallError, "second", text="'one' and 'two' both are stability"):
        network.answers(client, "one", "two")


def test_a_participant_takes_the_answer_of_the_process_it_names(network: Network, client: Asking) -> None:
    shows(network, "real", "other")
    assert network.answers(client, "other", "real", to="real") == 1
    assert client.refused == {(STABILITY_REGION.key, "other"): 1}


def test_a_querier_of_a_process_that_was_replaced_is_dropped(network: Network, client: Asking) -> None:
    for process in ("first", "second", "third"):
        assert network.answers(client, process, to=process) == 0
    network.tokens["alive/stability"] = ("third",)
    assert network.answers(client, "third") == 0
    assert network.queriers == ["@stability/region/third", "stability/region"]


def test_the_sign_of_a_start_is_believed_of_health_alone_and_while_there_is_no_token(
    network: Network, client: Asking
) -> None:
    network.tokens["starts/stability"] = ("starting",)
    with expect_error(CallError, "timeout"):
        network.answers(client, "starting")
    network.repliers = ("starting",)
    query = HEALTH_GET.of("stability")
    assert client.ask(query, 0.05, b"", None).replier_id is not None
    shows(network, "real")
    with expect_error(CallError, "timeout", text="'starting' was refused"):
        client.ask(query, 0.05, b"", None)


def test_a_network_that_forgets_the_query_ends_it_all_the_same(network: Network, client: Asking) -> None:
    network.ends, looks = False, list[int]()
    with expect_error(CallError, "timeout"):
        network.answers(client)
    with expect_error(CallError, "timeout"):
        network.answers(client, meanwhile=lambda: looks.append(1))
    assert looks


def test_a_query_that_reaches_no_server_is_absent(network: Network, client: Asking) -> None:
    network.matching = False
    with expect_error(CallError, "absent"):
        network.answers(client)
