"""Systems that run on this machine, and selection of those that a command applies to."""

import os
from contextlib import suppress
from typing import NamedTuple

from surefoot.errors import ConfigError
from surefoot.services.supervisor.processes.rundir import RunFolder, run_folders, unreadable

WELL = "healthy"


class RunningSystem(NamedTuple):
    """Running system that a command can reach.

    Attributes:
        name: name of the system, or its namespace if it runs on another machine.
        connect: Zenoh endpoint of the system's router.
        namespace: prefix of the system's keys.
        folder: run folder of the system; None if it runs on another machine.
    """

    name: str
    connect: str
    namespace: str
    folder: RunFolder | None = None

    def unwell(self) -> dict[str, str]:
        """Return the services of the system that are not healthy: service name to state and reason."""
        rows = [] if self.folder is None else self.folder.read_rows()
        unwell = [row for row in rows if row.get("state") != WELL]
        return {row["service"]: f"{row['state']}{': ' + row['detail'] if row.get('detail') else ''}" for row in unwell}

    def ports(self) -> tuple[str, ...]:
        """Return the Zenoh endpoints that the services listen on, by which the driver is reached without the router."""
        from surefoot.services.supervisor.processes.ports import ports_of

        processes = {} if self.folder is None else self.folder.processes()
        kind = self.connect.partition("/")[0]
        return tuple(f"{kind}/127.0.0.1:{port}" for found in processes.values() for port in ports_of(found.pid))

    def secret(self) -> str:
        """Return the secret of the system, if this user runs it or the environment has it; empty if neither."""
        from surefoot.state import secret_of

        if found := secret_of(self.connect, self.namespace):
            return found
        from surefoot.bus.seals import given_secret

        with suppress(ConfigError):  # one that cannot be used must not prevent a stop
            return given_secret()
        return ""

    @property
    def robot(self) -> str | None:
        """Name or folder of the robot that the system was started with; None if the system runs on another machine."""
        place = None if self.folder is None else self.folder.endpoint(orphaned=True)
        return None if place is None else place.robot or None

    def orphans(self) -> str:
        """Return a hint on services on this machine that run without their supervisor, or on run folders that this
        user cannot read; empty if there are none.
        """
        return next((folder.orphaned for folder in run_folders() if folder.orphans()), "") or unreadable()


def systems(
    connect: str | None = None, namespace: str | None = None, system: str | None = None, *, orphaned: bool = False
) -> tuple[RunningSystem, ...]:
    """Return the systems that a command applies to: those on this machine that match, else the default system.

    Args:
        connect: endpoint, None = SUREFOOT_CONNECT or any.
        namespace: prefix of keys, None = SUREFOOT_NAMESPACE or any.
        system: name of a system on this machine, None = any.
        orphaned: True: also systems whose services run without their supervisor; False: not those.

    Raises:
        ConfigError: the address is no endpoint, or no system of that name runs.
    """
    from surefoot.bus.endpoint import checked, from_environment, to_listen

    connect = checked("--connect", connect) if connect else from_environment("SUREFOOT_CONNECT")
    namespace = namespace or os.environ.get("SUREFOOT_NAMESPACE")
    found = [
        RunningSystem(folder.name, place.connect, place.namespace, folder)
        for folder in run_folders()
        if (place := folder.endpoint(orphaned=orphaned)) is not None
    ]
    if system is not None:
        named = tuple(one for one in found if one.name == system)
        if not named:
            running = ", ".join(one.name for one in found) or "none"
            raise ConfigError("absent", f"no system {system!r} runs here; running: {running}", "system")
        return named
    fitting = tuple(o for o in found if connect in (None, o.connect) and namespace in (None, o.namespace))
    if fitting:
        return fitting
    robot = os.path.basename(os.path.normpath(os.environ.get("SUREFOOT_ROBOT", "ragno")))  # a name, or a folder
    prefix = namespace or f"surefoot/{robot}"
    return (RunningSystem(prefix, connect or to_listen(), prefix),)


def only_one(found: tuple[RunningSystem, ...], how: str) -> RunningSystem:
    """Return the only system of `found`; of several, the one at the endpoint in SUREFOOT_LISTEN.

    Raises:
        ConfigError: several are left; the text names them and ``how`` to choose one.
    """
    if len(found) > 1:
        from surefoot.bus.endpoint import from_environment

        here = from_environment("SUREFOOT_LISTEN")
        found = tuple(one for one in found if one.connect == here) or found
    if len(found) > 1:
        names = ", ".join(f"{one.name} ({one.namespace} at {one.connect})" for one in found)
        raise ConfigError("ambiguous", f"{len(found)} systems run: {names}; choose one with {how}", "system")
    return next(iter(found))
