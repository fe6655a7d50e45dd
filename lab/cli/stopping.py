"""Emergency stop of several systems at once, with a result for each; imports only modules that load fast."""

import socket
import sys
import threading
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

from surefoot.bus.emergency import Stopper

from .running import RunningSystem

REASON, TIMEOUT_S = "surefoot stop", 3.0
SIMULATOR = "simulator"
"""Name of the driver service that can be reset to a new run; drivers of real robots cannot."""


class Stopped(NamedTuple):
    """Result of the emergency stop of one system.

    Attributes:
        system: name of the system, or its namespace if it runs on another machine.
        driver: name of the driver service that holds the joints; empty if no driver has confirmed.
        stopped: reason of the stop in force; empty if no driver has confirmed.
        tick: control tick from which on the stop was in force; -1 if no driver has confirmed.
        after_ms: wall time from the call to the confirmation, ms.
        detail: problem and remedy if no driver has confirmed, else empty.
    """

    system: str
    driver: str = ""
    stopped: str = ""
    tick: int = -1
    after_ms: float = 0.0
    detail: str = ""


def stop_all(systems: Sequence[RunningSystem], reason: str, timeout_s: float) -> list[Stopped]:
    """Stop systems in parallel; return the result for each, in the order of `systems`.

    `reason`: shown in logs and reports; `timeout_s`: longest wait for a driver's confirmation, s.
    """
    found: dict[int, Stopped] = {}
    began = time.monotonic()

    def work(place: int, system: RunningSystem) -> None:
        found[place] = _stop(system, reason, timeout_s, began)

    threads = [threading.Thread(target=work, args=item, daemon=True) for item in enumerate(systems)]
    for thread in threads[1:]:
        thread.start()
    work(0, systems[0])
    for thread in threads[1:]:
        thread.join()
    return [found[place] for place in range(len(systems))]


def _stop(system: RunningSystem, reason: str, timeout_s: float, began: float) -> Stopped:
    """Stop a system through its router, or, if the router fails to pass the stop on, through the services' ports."""
    problem = f"no system answers at {system.connect}"
    tried = False
    for ways in ((system.connect,), system.ports()):
        if not any(map(answers, ways)):
            continue
        tried = True
        try:
            stopper = Stopper(ways, system.namespace, system.secret())
            try:
                done = stopper.stop(reason, timeout_s)
            finally:
                stopper.close()
        except Exception as error:  # of the network library: whatever it is, the robot is not stopped
            problem = f"{', '.join(ways)} cannot be reached ({error})"
            continue
        if done is not None:
            after_ms = round(1e3 * (time.monotonic() - began), 1)
            return Stopped(system.name, done.driver, done.stopped, done.tick, after_ms)
        unwell = "; ".join(f"{name} {words}" for name, words in system.unwell().items())
        restarted = f" while services are being restarted ({unwell})" if unwell else ""
        problem = f"no driver has confirmed the stop within {timeout_s:g} s{restarted}"
    hint = "start one with `surefoot up`, or name another with --connect"
    remedy = ": cut the power of the servos" if tried else f"; {system.orphans() or hint}"
    return Stopped(system.name, detail=problem + remedy)


def answers(connect: str) -> bool:
    """Return False if a TCP or TLS endpoint accepts no connection within 2 s; True if it does, and for other kinds."""
    kind, _, place = connect.partition("/")
    host, _, port = place.rpartition(":")
    if kind not in ("tcp", "tls") or not port.isdigit():
        return True
    try:
        address: Any = host.strip("[]").encode()  # bytes: no codec for international names is imported
        socket.create_connection((address, int(port)), timeout=2.0).close()
    except OSError:
        return False
    return True


def report(found: Sequence[Stopped], *, json: bool) -> int:
    """Write the results of a stop; return the exit code: 0 = all systems confirmed, 1 = at least one did not."""
    if json:
        import json as jsonlib

        sys.stdout.write(jsonlib.dumps({"systems": [one._asdict() for one in found]}, indent=1) + "\n")
    for one in () if json else found:
        if one.driver:
            text = f"{one.system}: stopped, {one.driver} holds the joints since tick {one.tick} or before"
            sys.stdout.write(f"{text} ({one.stopped})\n")
        else:
            sys.stderr.write(f"surefoot: {one.system}: {one.detail}\n")
    for driver in () if json else dict.fromkeys(one.driver for one in found if one.driver):
        by = "`surefoot sim reset`" if driver == SIMULATOR else f"the robot's own driver, {driver}"
        sys.stdout.write(f"commands are refused until a new run begins, by {by}\n")
    return 0 if all(one.driver for one in found) else 1
