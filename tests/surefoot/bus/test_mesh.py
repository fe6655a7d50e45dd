"""Links that were lost are noticed at the second look, and made anew."""

import threading
from contextlib import suppress

import pytest
import zenoh

from surefoot.bus.asking import LIVE
from surefoot.bus.mesh import LOOKS, Mesh, linked_to, visible_to
from surefoot.bus.zenoh import ZenohBus
from tests.surefoot.net import WAIT_S, Net, wait_until


class Network:
    """Links and tokens that a test sets, and what is done about them; a process sees tokens of those it is linked to.

    Args:
        names: processes, one letter each.
        heals: whether an introduction links all.
    """

    def __init__(self, names: str, *, heals: bool = True) -> None:
        self.linked, self.alive, self.heals = set(names), set(names), heals
        self.asked, self.introduced = 0, 0
        self.unseen = set[str]()
        """Processes whose tokens do not come from the router in time."""
        self.mesh = Mesh(lambda: set(self.linked), lambda: self.alive & self.linked, self.ask, self.introduce)
        self.look()

    def ask(self) -> set[str]:
        self.asked += 1
        return self.alive - self.unseen

    def introduce(self, over: threading.Event) -> None:
        self.introduced += 1
        if self.heals:
            self.linked |= self.alive

    def look(self, times: int = 1) -> list[list[str]]:
        """Return the results of looks, whose threads have ended before the next."""
        found: list[list[str]] = []
        for _ in range(times):
            found.append([trouble.peer for trouble in self.mesh.look()])
            self.mesh.settle()
        return found


def test_a_whole_mesh_is_left_alone() -> None:
    network = Network("abc")
    network.linked |= {"x"}  # a session without a token comes, as one that introduces does
    assert network.look(3) == [[]] * 3
    network.linked -= {"x"}
    assert network.look(3) == [[]] * 3
    assert (network.asked, network.introduced) == (0, 0)


def test_a_lost_link_is_made_anew_at_the_second_look_and_named_at_the_third() -> None:
    network = Network("abc")
    network.linked -= {"b"}
    network.look()
    assert network.introduced == 0  # it may be on its way, or have ended
    assert network.look(5) == [[], ["b"], [], [], []]
    assert network.introduced == 1


def test_a_process_that_ended_is_asked_for_once_and_nobody_is_introduced() -> None:
    network = Network("abc")
    network.linked -= {"b"}
    network.alive -= {"b"}
    assert network.look(6) == [[]] * 6
    assert (network.asked, network.introduced) == (1, 0)


@pytest.mark.parametrize("unseen", ["abc", "bc"])
def test_a_router_that_is_starved_has_nobody_forgotten(unseen: str) -> None:
    network = Network("abc")
    network.linked -= {"b"}
    network.unseen = set(unseen)
    network.look(3)
    assert (network.asked, network.introduced) == (2, 0)
    network.unseen = set()
    network.look()
    assert network.linked == set("abc")


def test_a_process_that_ended_is_forgotten_though_another_shows_no_token() -> None:
    network = Network("abc", heals=False)
    network.linked -= {"b"}
    network.unseen = {"b", "c"}
    network.look(20)
    assert (network.asked, network.introduced) == (LOOKS, 0)


def test_a_link_that_stays_away_is_asked_for_until_it_is_back() -> None:
    network = Network("abc", heals=False)
    network.linked -= {"b"}
    assert network.look(5) == [[], [], ["b"], ["b"], ["b"]]
    assert network.introduced == 4
    network.heals = True
    assert network.look(4) == [["b"], ["b"], [], []]
    assert network.introduced == 5


def test_the_end_waits_for_no_introduction() -> None:
    linked, ended = {"a", "b"}, threading.Event()

    def introduce(over: threading.Event) -> None:
        assert over.wait(60.0)
        ended.set()

    mesh = Mesh(lambda: set(linked), lambda: {"a", "b"}, lambda: {"a", "b"}, introduce)
    for _ in range(2):
        mesh.look()
        mesh.settle()
        linked.discard("b")
    mesh.look()
    mesh.close()
    assert ended.is_set()


def test_over_the_network_a_peer_that_ends_has_nobody_introduced(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its end is the router's word: an introduction of all to all, for each death, leaves links behind."""
    introduced, asked = list[str](), list[set[str]]()
    alive = ZenohBus._alive

    def ask(bus: ZenohBus) -> set[str]:
        asked.append(alive(bus))
        return asked[-1]

    monkeypatch.setattr(ZenohBus, "_alive", ask)
    monkeypatch.setattr(ZenohBus, "_introduce", lambda bus, over: introduced.append(bus.new_instance()))
    first, second, third = (net.open() for _ in range(3))
    for name, bus in (("first", first), ("second", second), ("third", third)):
        bus.announce(name, bus.new_instance())
    names, left = {bus.new_instance() for bus in (second, third)}, {bus.new_instance() for bus in (first, second)}

    def known() -> bool:
        first._mesh._check(linked_to(first.session))
        return names <= first._mesh._known

    def ended() -> bool:
        with suppress(zenoh.ZError):  # the router took longer than a second
            return third.new_instance() not in linked_to(first.session) and alive(first) == left
        return False

    wait_until(known)
    first.look_at_links()
    first._mesh.settle()
    third.close()
    wait_until(ended)

    def looked() -> bool:
        first.look_at_links()
        first._mesh.settle()
        return bool(asked)

    wait_until(looked)
    assert asked[0] == left
    assert not introduced


def test_a_peer_sees_more_tokens_than_a_channel_of_zenoh_holds(net: Net) -> None:
    """Zenoh fills a channel of 256 replies within the call that requests them, before they can be read."""
    stranger, peer = net.open("client"), net.open("peer")
    for number in range(300):
        stranger.announce("estimator", f"{number}")
    found: list[set[str]] = []

    def look() -> bool:
        thread = threading.Thread(
            target=lambda: found.append(visible_to(peer.session, f"{LIVE}/*/*", 5.0)), daemon=True
        )
        thread.start()
        thread.join(WAIT_S)
        return len(found[-1]) == 300

    wait_until(look)
    assert found[-1] == {f"{number}" for number in range(300)}
