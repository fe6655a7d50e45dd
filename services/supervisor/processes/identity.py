"""Identity of processes by id and start time, and their end: SIGTERM, then SIGKILL.

A later process under the same id is never taken for an earlier one, and only processes that a supervisor of this
project started are signalled. The module imports little, for the import delays `surefoot stop`.
"""

import os
import select
import signal
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple


class Identity(NamedTuple):
    """Identity of a process, different from that of every other process of this boot and of others.

    Attributes:
        pid: process id (of the group leader: its group has the same number).
        started: start time in clock ticks since boot, as reported by the kernel.
        boot: identity of the boot; start times of another boot mean nothing.
    """

    pid: int
    started: int
    boot: str

    def alive(self) -> bool:
        """Return True if the process of this id and start time still runs (a zombie does not)."""
        return identify(self.pid) == self

    def signal_group(self, number: signal.Signals) -> bool:
        """Signal the process and its children; return False when it is gone or another process has its id.

        A supervisor that a script has started leads no process group: it alone is signalled, and ends its children.
        """
        if not self.alive():
            return False
        try:
            if os.getpgid(self.pid) == self.pid:
                os.killpg(self.pid, number)
            else:
                os.kill(self.pid, number)
        except (ProcessLookupError, PermissionError):
            return False
        return True


def identify(pid: int) -> Identity | None:
    """Return the identity of a running process, None when there is none of that id."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    except OSError:
        return None
    fields = stat.rpartition(")")[2].split()  # the name before ')' may contain anything
    state, started = fields[0], int(fields[19])
    return None if state in ("Z", "X") else Identity(pid, started, boot)


def end(identity: Identity, grace_s: float = 2.0) -> bool:
    """End a process that an earlier supervisor started, no child of this one: SIGTERM, then SIGKILL after `grace_s`.

    Returns:
        True when it is gone, False when it could not be ended.
    """
    for number, patience_s in ((signal.SIGTERM, grace_s), (signal.SIGKILL, 1.0)):
        if not identity.signal_group(number):
            return not identity.alive()
        if _gone_within(identity, patience_s):
            return True
    return False


def _gone_within(identity: Identity, patience_s: float) -> bool:
    """Return True if a process that is no child of this one ends within `patience_s` of wall time."""
    await_end((identity.pid,), patience_s)
    return not identity.alive()


def await_end(pids: Iterable[int], patience_s: float) -> bool:
    """Wait until one of several processes has ended, at most `patience_s`; return False if none has a pidfd.

    A child that has ended counts until its parent has asked for its exit code; one that is gone altogether does not.
    """
    handles: list[int] = []
    try:
        for pid in pids:
            with suppress(OSError, AttributeError):  # it is gone, or this is no Linux
                handles.append(os.pidfd_open(pid))
        poller = select.poll()
        for handle in handles:
            poller.register(handle, select.POLLIN)
        if handles:
            poller.poll(patience_s * 1000)
        return bool(handles)
    finally:
        for handle in handles:
            os.close(handle)
