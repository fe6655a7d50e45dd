"""Checks of `surefoot doctor`, one function each; a check that raises an exception is reported as failed."""

import os
import platform
import re
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

Grade = Literal["PASS", "WARN", "FAIL"]

MIN_PYTHON = (3, 11)
MIN_STEPS_PER_S = 20_000.0  # of a hexapod on a plane; below it the demo is slower than about 4x real time
MAX_JITTER_MS = 5.0  # p99 of a 1 ms sleep; above it paced runs stutter
MAX_ROUND_TRIP_US = 2000.0  # of an empty query on loopback
SOON_DAYS = 30  # a certificate that ends within so many days is named


@dataclass(frozen=True)
class Diagnosis:
    """Result of one check of this machine: grade (PASS, WARN, FAIL), subject, finding, and remedy."""

    grade: Grade
    what: str
    found: str
    remedy: str = ""


def examine() -> list[Diagnosis]:
    """Return the results of all checks of this machine, quick ones first."""
    findings: list[Diagnosis] = []
    for check in CHECKS:
        try:
            findings.append(check())
        except Exception as error:  # any fault of this machine is a finding
            name = check.__name__.strip("_").replace("_", " ")
            findings.append(Diagnosis("FAIL", name, f"{type(error).__name__}: {error}", "see the message"))
    return findings


def _python() -> Diagnosis:
    found = platform.python_version()
    if sys.version_info < MIN_PYTHON:
        return Diagnosis("FAIL", "Python", found, "install Python 3.11 or newer")
    return Diagnosis("PASS", "Python", f"{found} on {platform.system()} {platform.machine()}, {os.cpu_count()} cores")


def _packages() -> Diagnosis:
    missing, old = [], []
    try:
        needed = metadata.requires("surefoot") or []
    except metadata.PackageNotFoundError:
        return Diagnosis("WARN", "packages", "surefoot is not installed, it runs from a folder", "pip install -e .")
    core = [line for line in needed if "extra ==" not in line]
    for line in core:
        match = re.match(r"([\w.-]+)\s*(?:>=\s*([\d.]+))?", line)
        if match is None:
            continue
        name, least = match.group(1), match.group(2)
        try:
            version = metadata.version(name)
        except metadata.PackageNotFoundError:
            missing.append(name)
            continue
        if least and _numbers(version) < _numbers(least):
            old.append(f"{name} {version} < {least}")
    if missing or old:
        return Diagnosis(
            "FAIL", "packages", f"missing: {missing}; too old: {old}", "make setup, or pip install surefoot"
        )
    return Diagnosis("PASS", "packages", f"all {len(core)} requirements are met")


def _kernels() -> Diagnosis:
    from .warming import DEFAULT_SYSTEM, is_cold, jobs_of, systems_of

    if is_cold(jobs_of(systems_of([DEFAULT_SYSTEM]))):
        return Diagnosis("WARN", "kernels", "not compiled yet", "surefoot warm")
    return Diagnosis("PASS", "kernels", "compiled")


def _port() -> Diagnosis:
    from surefoot.bus.endpoint import to_connect, to_listen
    from surefoot.errors import ConfigError
    from surefoot.services.supervisor.processes.ports import owner_of, port_of

    try:
        endpoint, _ = to_listen(), to_connect()
    except ConfigError as error:
        return Diagnosis("FAIL", "port", error.message, f"correct or unset {error.field}")
    port = port_of(endpoint)
    owner = owner_of(port) if port is not None else ""
    if owner:
        return Diagnosis(
            "WARN", "port", f"{endpoint} is taken by {owner}", "fine if that is your system; else --listen"
        )
    return Diagnosis("PASS", "port", f"{endpoint} is free")


def _exposure() -> Diagnosis:
    """Check that no system listens beyond loopback without certificates; a warning lists those that do."""
    from surefoot.bus.endpoint import is_secure, to_listen
    from surefoot.services.supervisor.processes.ports import ports_of
    from surefoot.services.supervisor.processes.rundir import run_folders

    found = [] if is_secure((to_listen(),)) or _is_loopback(to_listen()) else [f"{to_listen()} (to be)"]
    for folder in run_folders():
        endpoint = folder.endpoint(orphaned=True)
        if endpoint is not None and not is_secure((endpoint.connect,)):
            supervisor = folder.supervisor()
            pids = [one.pid for one in (*folder.processes().values(), *([supervisor] if supervisor else []))]
            found += [f"{folder.name}: port {port}" for pid in pids for port in ports_of(pid, beyond_loopback=True)]
    if found:
        what = f"open beyond loopback without certificates: {', '.join(found)}"
        return Diagnosis("WARN", "exposure", what, "surefoot security init, surefoot up --secure")
    return Diagnosis("PASS", "exposure", "nothing is open beyond loopback without certificates")


def _certificates() -> Diagnosis:
    """Check that no certificate ends within `SOON_DAYS` days; a warning lists those that do."""
    from surefoot.bus.certificates import held
    from surefoot.bus.endpoint import security_folder

    folders = {path.parent for path in security_folder("").rglob("ca.pem")}
    found = [(folder.name, one) for folder in sorted(folders) for one in held(folder)]
    ending = [f"{one.identity} of {robot} in {one.days} days" for robot, one in found if one.days < SOON_DAYS]
    if ending:
        return Diagnosis("WARN", "certificates", f"end: {', '.join(ending)}", "surefoot security renew, then restart")
    return Diagnosis("PASS", "certificates", f"{len(found)}, none ends within {SOON_DAYS} days" if found else "none")


def _is_loopback(endpoint: str) -> bool:
    host = endpoint.partition("/")[2].rpartition(":")[0].strip("[]")
    return host in ("localhost", "::1") or host.startswith("127.")


def _run_folders() -> Diagnosis:
    from surefoot.services.supervisor.processes.rundir import run_folders
    from surefoot.state import state_home

    stale = [folder.name for folder in run_folders() if not folder.held() and folder.processes()]
    running = [folder.name for folder in run_folders() if folder.held()]
    if stale:
        return Diagnosis("WARN", "run folders", f"processes left behind by {', '.join(stale)}", "surefoot down")
    home = state_home()
    parent = next(path for path in (home, *home.parents) if path.exists())
    if not os.access(parent, os.W_OK):
        return Diagnosis("FAIL", "run folders", f"{parent} cannot be written", "set XDG_STATE_HOME")
    return Diagnosis("PASS", "run folders", f"running: {', '.join(running) or 'none'}")


def _files() -> Diagnosis:
    from surefoot.files import find, names
    from surefoot.services.supervisor.processes.compose import ComposeError, load_compose
    from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario

    systems, scenarios = names("compose", ".yaml"), names("scenarios", ".toml")
    for name in systems:
        load_compose(find("compose", name, ".yaml", ComposeError))
    for name in scenarios:
        load_scenario(find_scenario(name))
    if not systems or not scenarios:
        return Diagnosis("FAIL", "files", "no compose files or no scenarios", "install the package again")
    return Diagnosis("PASS", "files", f"{len(systems)} systems, {len(scenarios)} scenarios")


def _timer() -> Diagnosis:
    late = []
    for _ in range(200):
        began = time.perf_counter()
        time.sleep(0.001)
        late.append(1000.0 * (time.perf_counter() - began) - 1.0)
    worst = sorted(late)[197]
    grade: Grade = "PASS" if worst <= MAX_JITTER_MS else "WARN"
    remedy = "" if grade == "PASS" else "paced runs will stutter; lockstep does not mind"
    return Diagnosis(grade, "timer", f"a sleep of 1 ms is {worst:.2f} ms late (99 %)", remedy)


def _zenoh() -> Diagnosis:
    import socket

    from surefoot.bus.zenoh import ZenohBus, ZenohOptions
    from surefoot.schemas.system import Health, HealthReply
    from surefoot.schemas.system import HealthRequest as Request
    from surefoot.schemas.topics import HEALTH_GET

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    query = HEALTH_GET.of("doctor")
    reply = HealthReply(health=Health(service="doctor", instance="x", state="ready", pid=os.getpid()))
    router = ZenohBus(ZenohOptions("router", (), (endpoint,), "doctor/self"))
    try:
        router.serve(query, lambda incoming: incoming.reply(reply))
        router.announce("doctor", router.new_instance())
        asker = ZenohBus(ZenohOptions("client", (endpoint,), (), "doctor/self"))
        try:
            times = []
            for _ in range(100):
                began = time.perf_counter()
                asker.call(query, Request(), 2.0)
                times.append(1e6 * (time.perf_counter() - began))
        finally:
            asker.close()
    finally:
        router.close()
    median = sorted(times)[50]
    grade: Grade = "PASS" if median <= MAX_ROUND_TRIP_US else "WARN"
    return Diagnosis(
        grade, "Zenoh", f"a query takes {median:.0f} us", "" if grade == "PASS" else "is the machine busy?"
    )


def _simulator() -> Diagnosis:
    import mujoco

    from surefoot.robot.reader import load_robot
    from surefoot.services.simulator.physics.model import build_model

    step = mujoco.mj_step  # pyright: ignore[reportAttributeAccessIssue]  # from the compiled part
    model, _ = build_model(load_robot("ragno"))
    data = mujoco.MjData(model)  # pyright: ignore[reportAttributeAccessIssue]
    step(model, data, nstep=200)
    began = time.process_time()
    step(model, data, nstep=2000)
    rate = 2000.0 / max(time.process_time() - began, 1e-6)
    grade: Grade = "PASS" if rate >= MIN_STEPS_PER_S else "WARN"
    remedy = "" if grade == "PASS" else "the machine is slow or busy: expect a low real-time factor"
    return Diagnosis(grade, "MuJoCo", f"{mujoco.__version__}, {rate:.0f} steps per CPU second", remedy)


def _display() -> Diagnosis:
    has = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    gl = any(Path(folder).glob("libEGL.so*") for folder in ("/usr/lib/x86_64-linux-gnu", "/usr/lib", "/usr/lib64"))
    return Diagnosis(
        "PASS", "graphics", f"display: {'yes' if has else 'no'}, EGL: {'yes' if gl else 'no'} (not needed)"
    )


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version)[:3])


CHECKS: tuple[Callable[[], Diagnosis], ...] = (
    _python,
    _packages,
    _files,
    _kernels,
    _run_folders,
    _port,
    _exposure,
    _certificates,
    _timer,
    _zenoh,
    _simulator,
    _display,
)
