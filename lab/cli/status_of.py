"""Status of a system: rows of its supervisor, and live figures of the services that answer within two seconds or so."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from surefoot.errors import BusError, CallError, SurefootError
from surefoot.schemas.status import StatusRequest
from surefoot.schemas.system import Health, HealthRequest
from surefoot.schemas.topics import HEALTH_GET, SIM_STATUS_GET
from surefoot.services.supervisor.processes.status import health_row, time_row

from .connect import joined

if TYPE_CHECKING:
    from surefoot.client import Client
    from surefoot.services.supervisor.processes.rundir import Endpoint, RunFolder

ROUTER_MS = 2000
"""Longest wait for the router of a system, ms of wall time."""
ANSWER_S = 0.5
"""Longest wait for the answers of the services, all of which are asked at once, s of wall time."""
SUPERVISOR = "supervisor"


def status_of(folder: "RunFolder") -> dict[str, Any]:
    """Return the status of the system of a run folder, with live figures of the services that answer."""
    endpoint = folder.endpoint()
    content: dict[str, Any] = {"connect": "", "namespace": "", "services": folder.read_rows()}
    if orphans := folder.orphans():
        content["detail"] = folder.orphaned
        row = {"state": "orphaned", "restarts": 0, "detail": ""}
        content["services"] = [{"service": name, "pid": found.pid, **row} for name, found in orphans.items()]
    if endpoint is None:
        return content
    content |= {"connect": endpoint.connect, "namespace": endpoint.namespace}
    try:
        with joined(endpoint.connect, endpoint.namespace, ROUTER_MS) as robot:
            _add_figures(content, robot)
    except BusError as error:
        content["detail"] = _why_silent(folder, endpoint) if error.code == "no_bus" else error.message
    except SurefootError as error:
        content["detail"] = error.message
    return content


def _add_figures(content: dict[str, Any], robot: "Client") -> None:
    """Add the health of the services, what the supervisor refused, and the state of simulated time to a status."""
    names = [row["service"] for row in content["services"]]
    with ThreadPoolExecutor(len(names) + 2) as pool:
        asked = {name: pool.submit(_health, robot, name) for name in (*names, SUPERVISOR)}
        time = pool.submit(robot.bus.call, SIM_STATUS_GET, StatusRequest(), ANSWER_S)
    for row in content["services"]:
        try:
            row |= health_row(asked[row["service"]].result())
        except CallError as error:
            row["detail"] = row["detail"] or error.message
    with suppress(CallError):  # what it refuses or drops comes from clients, whose links end at its router
        content[SUPERVISOR] = asked[SUPERVISOR].result().model_dump(include={"refused", "dropped"})
    with suppress(CallError):  # the driver of a real robot has no simulated time
        content["time"] = time_row(time.result())


def _health(robot: "Client", service: str) -> Health:
    return robot.bus.call(HEALTH_GET.of(service), HealthRequest(), ANSWER_S).health


def _why_silent(folder: "RunFolder", endpoint: "Endpoint", state: Callable[[int], str] | None = None) -> str:
    """Return in words why the router of a system that runs does not answer, and what to do."""
    process = folder.supervisor()
    where = f"the router at {endpoint.connect} does not answer within {1e-3 * ROUTER_MS:g} s"
    seen = "; the rows above are the last that it wrote"
    if process is None:
        return where + seen
    if (state or _state)(process.pid) in "Tt":
        return f"{where}: its process {process.pid} is stopped (`kill -CONT {process.pid}` lets it go on){seen}"
    return f"{where}: its process {process.pid} is busy or flooded by clients (`top`, `ss -tnp`){seen}"


def _state(pid: int) -> str:
    """Return the letter of the kernel for the state of a process, `T` = stopped; `?` if it is gone."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except OSError:
        return "?"
