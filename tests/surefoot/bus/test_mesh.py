"""Links that were lost are noticed at the second look, and made anew once at a time."""

from surefoot.bus.mesh import Mesh


class Network:
    """Links and tokens that a test sets, and what is done about them."""

    def __init__(self, linked: str, visible: str) -> None:
        self.linked, self.visible, self.introduced = set(linked), set(visible), 0

    def introduce(self) -> None:
        self.introduced += 1
        self.linked |= self.visible

    def mesh(self) -> Mesh:
        return Mesh(lambda: set(self.linked), lambda: set(self.visible), self.introduce)


def look(mesh: Mesh) -> list[str]:
    """Return the result of a look whose thread has ended before the next."""
    found = mesh.look()
    mesh.close()
    return found


def test_a_whole_mesh_is_looked_at_once_and_left_alone() -> None:
    network = Network("abc", "abc")
    mesh = network.mesh()
    assert [look(mesh) for _ in range(5)] == [[]] * 5
    network.visible |= {"d"}  # a process that is not linked yet: its own look, or its coming, tells of it
    assert look(mesh) == []
    assert network.introduced == 0


def test_a_lost_link_is_made_anew_at_the_second_look_and_named_at_the_third() -> None:
    network = Network("abc", "abc")
    mesh = network.mesh()
    look(mesh)
    network.linked -= {"b"}
    look(mesh)
    assert network.introduced == 0  # it may be on its way
    look(mesh)
    assert network.introduced == 1
    assert [look(mesh) for _ in range(4)] == [["b"], [], [], []]
    assert network.introduced == 1


def test_a_process_that_ended_is_not_missed() -> None:
    network = Network("abc", "abc")
    mesh = network.mesh()
    look(mesh)
    network.linked -= {"b"}
    network.visible -= {"b"}
    assert [look(mesh) for _ in range(4)] == [[]] * 4
    assert network.introduced == 0


def test_a_link_that_stays_away_is_asked_for_at_every_look() -> None:
    network = Network("ac", "abc")
    mesh = Mesh(lambda: set("ac"), lambda: set("abc"), lambda: setattr(network, "introduced", network.introduced + 1))
    assert [look(mesh) for _ in range(5)] == [[], [], ["b"], ["b"], ["b"]]
    assert network.introduced == 4
