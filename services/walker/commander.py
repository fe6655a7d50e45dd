"""Walk commands of a run: obeyed at once, in a stated tick, or as orders of the navigator; stored for a restart."""

import dataclasses
from collections.abc import Callable

from surefoot.errors import Refusal
from surefoot.schemas.cmd import WalkCommand, WalkReply
from surefoot.schemas.navigation import MotionOrder

from .gait import Gait
from .interface import CommandReply, MotionCommand
from .memory import MemoryFile
from .orders import TakenOrder


class Commander:
    """Receiver of the commands of `cmd/walk` for a gait, which stores them in a file for a restart.

    Args:
        gait: gait that obeys the commands.
        memory: file for the state from which a restarted walker resumes.
        log: function that logs a text at a level.
    """

    def __init__(self, gait: Gait, memory: MemoryFile, log: Callable[[str, str], None]) -> None:
        self.gait, self._memory, self._log = gait, memory, log
        self.order = TakenOrder()
        self.stopped = ""
        """Reason of an emergency stop, in words; empty = none. Only a new run releases the stop."""
        self.refused = ""
        """Reason why a planned command was refused in this tick, in words; empty = none was."""
        self._planned: list[tuple[int, int, WalkCommand]] = []  # tick, number, command
        self._tick, self._epoch = -1, 0

    def walk(self, request: WalkCommand) -> WalkReply:
        """Accept or refuse a command and return the reply; one with ``at_tick`` waits for that tick."""
        if self.stopped and request.action != "stop":
            return self._refused()
        if request.at_tick is None:
            reply = self._command(request)
            self.keep()
            return reply
        if request.at_tick <= self._tick:
            reason = f"at_tick {request.at_tick} has passed; the next tick is {self._tick + 1}"
            raise Refusal("late", reason, "at_tick")
        refusal = self.gait.never(_command_of(request))
        if refusal is not None:
            return _reply(refusal)
        number = self.gait.walk_id + len(self._planned) + 1
        self._planned.append((request.at_tick, number, request))
        self.keep()
        return WalkReply(accepted=True, id=number)

    def begin(self, epoch: int, tick: int) -> None:
        """Begin a tick: in the first one resume what an earlier process stored; then carry out the due commands."""
        first, self._epoch, self._tick = self._tick < 0, epoch, tick
        if first and tick > 0:
            self._recall()
        elif first:
            self._memory.forget()
        self.refused = ""
        for item in [item for item in self._planned if item[0] <= tick]:
            self._planned.remove(item)
            reply = self._command(item[2])
            if not reply.accepted:
                self._log("warning", f"command {item[1]} ({item[2].action}) refused in its tick: {reply.reason}")
                self.refused = reply.reason

    def obey(self, order: MotionOrder) -> None:
        """Carry out an order of the navigator in this tick; a repeated order is ignored.

        The walker does not correct its steps by such a walk: the navigator estimates drift itself.
        """
        taken, self.order = self.order, self.order.after(order)
        if self.order.number == taken.number or order.command is None:
            return
        reason = "at_tick does not go with an order"
        if order.command.at_tick is None:
            reason = self._command(order.command, learn=False).reason
        self.order = dataclasses.replace(self.order, refused=reason)
        if reason:
            self._log("warning", f"order {order.number} ({order.command.action}) refused: {reason}")

    def keep(self) -> None:
        """Write the state from which a restarted walker resumes to the file; before the first tick do nothing."""
        if self._memory.path is None or self._tick < 0:
            return
        planned = tuple(item[2].model_dump() for item in self._planned)
        kept = dataclasses.replace(self.gait.kept(), planned=planned, order=self.order.number)
        self._memory.keep(self._epoch, self._tick, kept)
        self._report()

    def _report(self) -> None:
        if self._memory.problem:
            self._log("warning", self._memory.problem)
            self._memory.problem = ""

    def _recall(self) -> None:
        kept = self._memory.recall(self._epoch, self._tick)
        self._report()
        if kept is None:
            self.order = TakenOrder(known=False)
            return
        self.order = TakenOrder(kept.order)
        self.gait.resume(kept)
        for number, item in enumerate(kept.planned, kept.walk_id + 1):
            request = WalkCommand.model_validate(item)
            self._planned.append((request.at_tick or self._tick, number, request))
        what = "goes on with its command" if kept.command else "no command"
        self._log("info", f"started again in tick {self._tick}: {what}")

    def _command(self, request: WalkCommand, learn: bool = True) -> WalkReply:
        if self.stopped and request.action != "stop":
            return self._refused()  # planned before the stop
        return _reply(self.gait.command(dataclasses.replace(_command_of(request), learn=learn)))

    def _refused(self) -> WalkReply:
        reason = f"an emergency stop is in force ({self.stopped}) until a new run begins"
        return WalkReply(accepted=False, id=0, code="stopped", reason=reason)


def _command_of(r: WalkCommand) -> MotionCommand:
    return MotionCommand(r.action, r.distance, r.velocity, r.angle, r.gait, r.duration, r.shift)


def _reply(r: CommandReply) -> WalkReply:
    return WalkReply(accepted=r.accepted, id=r.walk_id, code=r.code, field=r.field, reason=r.reason)
