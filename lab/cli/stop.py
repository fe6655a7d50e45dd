"""`surefoot stop`: the emergency stop. The system stays up; the robot holds its joints."""

import time
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.lab.cli.connect import client
from surefoot.lab.cli.output import Connect, Json, Namespace, use_json, write, write_json

if TYPE_CHECKING:
    from surefoot.bus.interface import Delivery
    from surefoot.client import Client
    from surefoot.schemas.sim import SimStatus

AGAIN_S = 0.1  # s wall, a stop that nobody has confirmed is repeated


def stop(
    reason: Annotated[str, typer.Option(help="Why; it stands in logs and in the report.")] = "surefoot stop",
    timeout: Annotated[float, typer.Option(min=0.1, help="Repeat it so many s until the driver confirms.")] = 3.0,
    connect: Connect = None,
    namespace: Namespace = None,
    json: Json = False,
) -> None:
    """Emergency stop: the robot holds its joints until the next reset. Exit code 1: the driver did not confirm."""
    use_json(json)
    began = time.monotonic()
    with client(connect, namespace) as robot:
        status = _stop(robot, reason, timeout)
    after_ms = round(1e3 * (time.monotonic() - began), 1)
    if json:
        write_json({"driver": status.source, "stopped": status.stopped, "tick": status.tick, "after_ms": after_ms})
        return
    write(f"stopped: {status.source} holds the joints since tick {status.tick} or before ({status.stopped})")
    write("commands are refused until the next `sim/reset`: `surefoot down` and `up`, or `surefoot call sim/reset`")


def _stop(robot: "Client", reason: str, timeout_s: float) -> "SimStatus":
    """Ask until the driver says that a stop is in force.

    Raises:
        CallError: it did not within `timeout_s` of wall time.
    """
    from surefoot.errors import CallError, Refusal
    from surefoot.schemas.hw import EmergencyStop
    from surefoot.schemas.sim import SimStatus
    from surefoot.schemas.topics import CMD_ESTOP, SIM_STATUS

    heard: SimpleQueue[Delivery] = SimpleQueue()
    robot.subscribe(SIM_STATUS, heard.put)
    publisher = robot.bus.publisher(CMD_ESTOP)
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        publisher.put(EmergencyStop(source="operator", reason=reason))
        try:
            delivery = heard.get(timeout=AGAIN_S)
            status = None if delivery.prime else delivery.message()
        except (Empty, Refusal):
            continue
        if isinstance(status, SimStatus) and status.stopped:
            return status
    raise CallError("timeout", f"no driver has confirmed the stop within {timeout_s:g} s: cut the power of the servos")
