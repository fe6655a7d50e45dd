"""Coverage marks: record which refusals and recoveries of the runtime were executed in a run, by name.

A recovery that no run executes is not tested. Marks wrap methods of the runtime from outside, so that the runtime has
no code for them: each names a method, and which of its calls count.
"""

from collections.abc import Callable
from types import TracebackType
from typing import Any, NamedTuple, Self

from surefoot.lockstep.commands import Commands
from surefoot.lockstep.driver import DriverNode
from surefoot.lockstep.join import Join
from surefoot.lockstep.leader import Leader
from surefoot.lockstep.node import Node
from surefoot.services.walker.memory import MemoryFile


class Recovery(NamedTuple):
    """Recovery of the runtime from a fault: class, name of its method, and predicate of the calls that count."""

    owner: type[Any]
    method: str
    taken: Callable[[Any, tuple[Any, ...], Any], bool]
    """Predicate of a call (object, arguments, result): True if the call executed the recovery, else False."""


def _always(owner: Any, args: tuple[Any, ...], result: Any) -> bool:
    return True


def _true(owner: Any, args: tuple[Any, ...], result: Any) -> bool:
    return bool(result)


def _gives(reason: str) -> Callable[[Any, tuple[Any, ...], Any], bool]:
    return lambda owner, args, result: result == reason


def _counts(reason: str) -> Callable[[Any, tuple[Any, ...], Any], bool]:
    return lambda owner, args, result: args[0] == reason


def _leaves(service: Leader, args: tuple[Any, ...], result: Any) -> bool:
    return args[0] not in service.members


def _incomplete(join: Join, args: tuple[Any, ...], result: Any) -> bool:
    return result is not None and any(key not in result.messages for key in join._wanted(result.tick))


MARKS: dict[str, Recovery] = {
    "join drops a message of an earlier run": Recovery(Join, "offer", _gives("stale_epoch")),
    "join drops a message of a run not primed": Recovery(Join, "offer", _gives("epoch_ahead")),
    "join drops a message it has": Recovery(Join, "offer", _gives("duplicate")),
    "join gets a tick again": Recovery(Join, "offer", _gives("replay")),
    "join is not on the roster": Recovery(Join, "offer", _gives("not_on_roster")),
    "join takes a late tick without an input": Recovery(Join, "_take_paced", _incomplete),
    "node refuses a malformed message": Recovery(Node, "refuse", _counts("malformed")),
    "node refuses a process that is not bound": Recovery(Node, "refuse", _counts("unbound")),
    "node sends a tick's outputs again": Recovery(Node, "_replay", lambda node, a, _: (a[0], a[1]) in node._outbox),
    "node asks to join a run": Recovery(Node, "_ask_to_join", _always),
    "driver sends ticks again": Recovery(DriverNode, "_repeat", lambda node, args, result: bool(args[0])),
    "driver waits for the very command": Recovery(DriverNode, "_lacks_command", _true),
    "driver primes those who join": Recovery(DriverNode, "_admit_joiners", lambda node, args, _: bool(node._joining)),
    "driver refuses a command of another time": Recovery(DriverNode, "refuse", _counts("stale")),
    "driver holds the joints": Recovery(Commands, "lost", _true),
    "leader loses a member": Recovery(Leader, "drop", _always),
    "leader holds time for a lost member": Recovery(Leader, "drop", lambda leader, args, _: leader.state == "holding"),
    "leader goes on without a lost member": Recovery(Leader, "drop", _leaves),
    "leader gets a member back that was out of sight": Recovery(Leader, "on_back", _true),
    "leader lets a new process take over": Recovery(Leader, "rejoin", _true),
    "leader finds a silent member": Recovery(Leader, "slowest", _true),
    "leader gives a lost member up": Recovery(Leader, "give_up_waiting", _true),
    "walker goes on with a kept command": Recovery(MemoryFile, "recall", lambda file, args, result: result is not None),
}
"""Refusals and recoveries of the runtime whose execution `Marks` records, by name."""


class Marks:
    """Context manager that collects in `taken` the names of recoveries (`MARKS`) executed within it."""

    def __init__(self) -> None:
        self.taken: set[str] = set()
        self._originals: list[tuple[type[Any], str, Any]] = []

    def __enter__(self) -> Self:
        methods: dict[tuple[type[Any], str], dict[str, Recovery]] = {}
        for name, mark in MARKS.items():
            methods.setdefault((mark.owner, mark.method), {})[name] = mark
        for (owner, method), marks in methods.items():
            self._originals.append((owner, method, owner.__dict__.get(method)))
            setattr(owner, method, self._watched(getattr(owner, method), marks))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for owner, method, original in reversed(self._originals):
            if original is None:  # inherited
                delattr(owner, method)
            else:
                setattr(owner, method, original)
        self._originals.clear()

    def _watched(self, method: Callable[..., Any], marks: dict[str, Recovery]) -> Callable[..., Any]:
        waiting = dict(marks)

        def watched(owner: Any, *args: Any, **more: Any) -> Any:
            result = method(owner, *args, **more)
            for name in [name for name, mark in waiting.items() if mark.taken(owner, args, result)]:
                self.taken.add(name)
                del waiting[name]
            return result

        return watched
