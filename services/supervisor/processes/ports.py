"""Process that listens on a TCP port, from the kernel's socket tables and the open files of the user's processes."""

import contextlib
import errno
import os
import re
import socket
from pathlib import Path

from surefoot.bus.options import ZenohOptions, why_not_open
from surefoot.errors import BusError

_LISTEN = "0A"  # state of a listening socket in /proc/net/tcp
_LOOPBACK = re.compile(r"(0{16}FFFF0000)?.{6}7F|0{24}01000000")
"""Pattern of a loopback address in the kernel's socket tables (its byte order): 127.x.y.z, also in IPv6, and ::1."""


def port_of(endpoint: str) -> int | None:
    """Return the port of an endpoint such as `tcp/127.0.0.1:7447`; None if it has none."""
    match = re.fullmatch(r"\w+/.*:(\d+)", endpoint)
    return int(match.group(1)) if match else None


def owner_of(port: int) -> str:
    """Return the process that listens on a port, as `process 4711 (surefoot up ragno)`; empty if there is none."""
    inodes = {f"socket:[{inode}]" for inode, found in _listening().items() if found == port}
    if not inodes:
        return ""
    for process in Path("/proc").glob("[0-9]*"):
        if inodes & _sockets(process):
            return f"process {process.name} ({_command(process)})"
    return "a process of another user"


def refuse_taken(endpoint: str, advice: str = "stop it, or choose another endpoint with --listen") -> None:
    """Raise BusError `busy` with the owner's name when a process listens on the port of an endpoint."""
    port = port_of(endpoint)
    owner = owner_of(port) if port else ""
    if owner:
        raise BusError("busy", f"{endpoint} is taken by {owner}; {advice}")


def refuse_in_use(endpoint: str) -> None:
    """Raise BusError where a router could not listen on a TCP or TLS endpoint because its port is in use.

    The port is bound for a moment, without listening. Another failure, as of an unknown host, is left to the router.

    Raises:
        BusError: `busy` with the owner's name, or `no_bus` where no process listens there, yet one has bound the port.
    """
    kind, _, place = endpoint.partition("/")
    host, port = place.rpartition(":")[0].strip("[]"), port_of(endpoint)
    if kind not in ("tcp", "tls") or port is None:
        return
    try:
        family, _, _, _, address = socket.getaddrinfo(host.encode(), port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the router: not while a link of it closes
            probe.bind(address)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            refuse_taken(endpoint)
            raise BusError("no_bus", why_not_open(ZenohOptions("router", (), (endpoint,)), "in use")) from None


def ports_of(pid: int, *, beyond_loopback: bool = False) -> tuple[int, ...]:
    """Return the TCP ports a process of this user listens on; `beyond_loopback`: only those other hosts reach."""
    sockets, found = _sockets(Path(f"/proc/{pid}")), _listening(beyond_loopback=beyond_loopback)
    return tuple(sorted(port for inode, port in found.items() if f"socket:[{inode}]" in sockets))


def _listening(*, beyond_loopback: bool = False) -> dict[str, int]:
    """Return the listening TCP ports by inode of the socket; `beyond_loopback`: only those other hosts reach."""
    ports: dict[str, int] = {}
    for table in ("tcp", "tcp6"):
        try:
            lines = Path(f"/proc/net/{table}").read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        for line in lines:
            fields = line.split()
            address, _, port = fields[1].rpartition(":")
            if fields[3] == _LISTEN and not (beyond_loopback and _LOOPBACK.fullmatch(address)):
                ports[fields[9]] = int(port, 16)
    return ports


def _sockets(process: Path) -> set[str]:
    """Return the open files of a process as the kernel names them; none if it has ended or is of another user."""
    links: set[str] = set()
    try:
        for entry in os.scandir(process / "fd"):
            with contextlib.suppress(OSError):  # closed meanwhile
                links.add(os.readlink(entry.path))
    except OSError:
        return set()
    return links


def _command(process: Path) -> str:
    try:
        words = (process / "cmdline").read_bytes().decode("utf-8", "replace").split("\0")
    except OSError:
        return "unknown"
    named = " ".join(Path(word).name if i < 2 else word for i, word in enumerate(words) if word)
    return " ".join(named.split())[:80]  # one line, whatever its words hold
