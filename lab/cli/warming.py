"""Compile the numeric kernels of a system ahead of time, once per installation and version.

Each service rehearses: it calls every kernel that it uses (see `surefoot.lockstep.service`), so that only kernels
used by the robot and its services are compiled.
"""

import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from queue import Empty, Queue
from subprocess import PIPE
from tempfile import TemporaryFile
from typing import Any, NamedTuple

from surefoot.errors import SurefootError
from surefoot.files import PACKAGE, find, names
from surefoot.kernels.processor import processor
from surefoot.services.supervisor.processes.compose import Compose, ComposeError, load_compose
from surefoot.services.supervisor.processes.ports import refuse_taken
from surefoot.services.supervisor.processes.process import busy_s
from surefoot.state import user_home

from .progress import Progress

DEFAULT_SYSTEM = "ragno"
BROUGHT = PACKAGE / "kernels" / "brought.txt"
"""File with the names of compilation jobs whose kernels were installed with the wheel, separated by white space."""
ORDER = ("estimator", "stability", "walker", "footholds", "simulator")
"""Services in order of compilation, others last; one process compiles stability and walker, which share code."""

COSTS_S = {
    "estimator": 134.0,
    "stability": 51.0,
    "walker": 16.0,
    "footholds": 12.0,
    "simulator": 5.0,
    "navigator": 37.0,
}
OTHER_S = 10.0
"""Processor time to compile the kernels of a service that is absent from `COSTS_S`, on a slow core, s."""


@dataclass(frozen=True, slots=True)
class Job:
    """Compilation job: kernels of one service, or of all services of a system (separated by spaces), with one robot."""

    service: str
    robot: str
    rare: bool = False
    """True: also compile kernels that only rare queries need; False: only those of regular operation."""

    @property
    def name(self) -> str:
        """Name of the compilation job, unique for sources, versions of numba and Python, processor, service, robot."""
        robot = hashlib.sha256(self.robot.encode()).hexdigest()[:12]
        return f"{signature()}-{self.service.replace(' ', '+')}-{robot}{'-rare' * self.rare}"

    @property
    def stamp(self) -> Path:
        """File that marks the compilation job as done in this installation: a line (path, hash) per kernel file."""
        return _stamps() / hashlib.sha256(str(PACKAGE).encode()).hexdigest()[:12] / self.name


@dataclass(frozen=True, slots=True)
class Warmed:
    """Result of a compilation job: kernels that a service uses, and the effort to compile them."""

    service: str
    robot: str
    kernels: int
    """Number of compiled functions that Python calls directly; each includes the code of the functions it calls."""
    compiled: int
    """Number of functions compiled because the cache lacked them, including those that kernels and numba call."""
    seconds: float
    files: dict[str, str] = field(default_factory=dict[str, str], repr=False)
    """Hash of the sources from which each kernel cache file was compiled, by path of the file."""

    def row(self) -> dict[str, Any]:
        """Return the result as a row of the table that `surefoot warm` prints."""
        return {name: value for name, value in asdict(self).items() if name != "files"}


def jobs_of(systems: Iterable[Compose], rare: bool = False) -> tuple[Job, ...]:
    """Return the compilation jobs of systems, one per service with kernels and robot, in the order of `ORDER`.

    `rare`: True: the jobs include kernels that only rare queries need; False: only kernels of regular operation.

    Raises:
        RobotError: a system names a robot that is not there.
    """
    from surefoot.lockstep.discover import service_class, service_names
    from surefoot.lockstep.service import Service
    from surefoot.robot.reader import load_robot

    known = service_names()
    kept: list[Job] = []
    for system in systems:
        load_robot(system.robot)
        for name in system.services:
            if name in known and service_class(name).rehearse is not Service.rehearse:
                kept.append(Job(name, system.robot, rare))
    rank = {name: place for place, name in enumerate(ORDER)}
    return tuple(sorted(dict.fromkeys(kept), key=lambda job: rank.get(job.service, len(rank))))


def systems_of(named: Iterable[str]) -> list[Compose]:
    """Return the systems of these names or compose file paths (raises ComposeError: a file is absent or invalid)."""
    return [load_compose(find("compose", name, ".yaml", ComposeError)) for name in named]


def all_systems() -> list[Compose]:
    """Return every system (compose file) of the installation."""
    return systems_of(names("compose", ".yaml"))


@cache
def signature() -> str:
    """Return a hash of all that compiled code depends on: sources, versions of Python and numba, processor."""
    from importlib.metadata import version

    digest = hashlib.sha256(f"{sys.implementation.cache_tag}|{version('numba')}|{processor()}".encode())
    sources = {path for folder in (PACKAGE, PACKAGE / "services") for path in folder.rglob("*.py")}
    for path in sorted(sources):
        if path.relative_to(PACKAGE).parts[0] in ("lab", "papers"):  # no service needs their kernels
            continue
        content = path.read_bytes()
        if b"kernel" in content:
            digest.update(content)
    return digest.hexdigest()


def is_cold(jobs: Iterable[Job]) -> bool:
    """Return True if kernels of any of the jobs still have to be compiled, False if all are in the cache."""
    brought = BROUGHT.read_text().split() if BROUGHT.exists() else ()
    return not all(any(each.name in brought or _holds(each.stamp) for each in _either(job)) for job in jobs)


def _either(job: Job) -> tuple[Job, Job]:
    """Return the job itself and its variant with `rare` kernels, whose kernels include all of the job."""
    return job, replace(job, rare=True)


def _holds(stamp: Path) -> bool:
    """Return True if the stamp file of a compile job exists and each kernel file in it still holds its listed hash.

    Kernel files can be removed or compiled again from other sources while the stamp file of the job remains: False.
    """
    lines = _lines(stamp)
    try:
        return lines is not None and all(
            hashed.encode() in Path(path).read_bytes() for path, _, hashed in (line.rpartition("|") for line in lines)
        )
    except (OSError, ValueError):  # a file that is gone, a path that is none
        return False


def _lines(stamp: Path) -> list[str] | None:
    """Return the lines of a job's stamp file; None if the file is missing or cannot be read."""
    try:
        return stamp.read_text(errors="replace").splitlines()
    except OSError:
        return None


def warm_if_cold(system: Compose, listen: str | None, notify: Callable[[str], None]) -> None:
    """Compile the kernels of a system unless they are in the cache; `notify` is called with progress lines.

    Raises:
        BusError: the endpoint to listen on is taken, which is checked before the work.
        ConfigError: SUREFOOT_SECRET is no secret, which is checked before the work too, for a system to be started.
    """
    whole = Job(" ".join(system.services), system.robot)
    if not is_cold([whole]):  # to find the services with kernels imports them all, a second of processor time
        return
    jobs = jobs_of([system])
    if is_cold(jobs):
        if listen is not None:
            from surefoot.bus.seals import given_secret

            given_secret()
            refuse_taken(listen)
        warm(jobs, notify)
    _mark({whole: [line for job in jobs for each in _either(job) for line in _lines(each.stamp) or ()]}, notify)


def warm(jobs: tuple[Job, ...], notify: Callable[[str], None] = lambda text: None) -> list[Warmed]:
    """Compile the kernels of jobs in parallel processes, and return the result of each job.

    A service rehearses: it calls each of its kernels once. A process takes several services in turn, so that numba
    compiles its own helpers once per process. Jobs of one service with several robots run one by one.
    """
    progress = _WarmProgress(jobs, notify)
    found: list[Warmed] = []

    def work(worker: _Worker, todo: Queue[Job]) -> None:
        with suppress(Empty):
            while True:
                job = todo.get_nowait()
                progress.begins(worker.pid, job)
                found.append(worker.ask(job))
                progress.another(worker.pid, job)

    width = min(os.cpu_count() or 1, len({job.service for job in jobs}))
    with ExitStack() as stack:
        stack.enter_context(progress)
        workers = [stack.enter_context(_worker()) for _ in range(width)]
        pool = stack.enter_context(ThreadPoolExecutor(max_workers=max(1, width)))
        for turn in _turns(jobs):
            todo: Queue[Job] = Queue()
            for job in turn:
                todo.put(job)
            list(pool.map(lambda worker, todo=todo: work(worker, todo), workers))
    files = {(each.service, each.robot): each.files for each in found}
    _mark({job: ["|".join(each) for each in files[job.service, job.robot].items()] for job in jobs}, notify)
    place = {(job.service, job.robot): i for i, job in enumerate(jobs)}
    return sorted(found, key=lambda each: place[each.service, each.robot])


def _mark(done: dict[Job, list[str]], notify: Callable[[str], None]) -> None:
    """Write the stamp files of finished jobs, with the paths and hashes of their kernel files."""
    try:
        for job, lines in done.items():
            job.stamp.parent.mkdir(parents=True, exist_ok=True)
            job.stamp.write_text("".join(f"{line}\n" for line in sorted(set(lines))))
    except OSError as error:
        notify(f"  nothing can be kept in {_stamps()}: {error.strerror}; kernels are compiled again at each start")


def _turns(jobs: Iterable[Job]) -> list[list[Job]]:
    """Split jobs into groups, to be run one by one, so that no service occurs twice in a group; return the groups."""
    turns: list[list[Job]] = []
    for job in jobs:
        turn = next((turn for turn in turns if all(job.service != other.service for other in turn)), None)
        if turn is None:
            turns.append([job])
        else:
            turn.append(job)
    return turns


class _WarmProgress(Progress):
    """Progress lines of a compilation: finished share and time left from processor time, and each finished service."""

    def __init__(self, jobs: Iterable[Job], notify: Callable[[str], None]) -> None:
        super().__init__("compiling numeric kernels", "kernels that are done are kept", notify)
        self._jobs, self._done = tuple(jobs), list[Job]()
        self._running = dict[int, tuple[Job, float]]()
        count = len(self._jobs)
        notify(f"compiling numeric kernels: {count} services, takes half a minute or more, only this once")

    def begins(self, pid: int, job: Job) -> None:
        """Record that the worker process `pid` takes a job."""
        self._running[pid] = job, busy_s([pid])

    def another(self, pid: int, job: Job) -> None:
        """Record that the worker process `pid` finished a job, and report the number of finished jobs."""
        with self._lock:
            del self._running[pid]
            self._done.append(job)
            spent = self._clock() - self._began
            self._report(f"  {len(self._done)} of {len(self._jobs)} after {spent:.0f} s")

    def _write_due(self) -> None:
        with self._lock:
            done, late = sum(map(_cost_s, self._done)), bool(self._running)
            for pid, (job, before) in tuple(self._running.items()):
                spent = busy_s([pid]) - before
                late = late and spent > _cost_s(job)
                done += min(spent, 0.95 * _cost_s(job))
            # without a share the time spent is shown: a share that stands still has no time left
            self._share = 0.0 if late else max(0.0, done / sum(map(_cost_s, self._jobs)))
            self._step = f"{len(self._done)} of {len(self._jobs)} services{', longer than usual' if late else ''}"
        super()._write_due()


def _cost_s(job: Job) -> float:
    return COSTS_S.get(job.service, OTHER_S)


class _Worker(NamedTuple):
    """Worker process that compiles kernels of services: its process id, and a function that runs a job in it."""

    pid: int
    ask: Callable[[Job], Warmed]


@contextmanager
def _worker() -> Iterator[_Worker]:
    """Yield a worker process that compiles kernels; compilers are neither thread-safe nor small."""
    command = [sys.executable, "-m", "surefoot.lab.cli.warming"]
    with (
        TemporaryFile("w+") as errors,
        subprocess.Popen(command, stdin=PIPE, stdout=PIPE, stderr=errors, text=True) as process,
    ):
        assert process.stdin is not None
        assert process.stdout is not None
        put, take = process.stdin, process.stdout

        def ask(job: Job) -> Warmed:
            try:
                put.write(json.dumps(asdict(job)) + "\n")
                put.flush()
                answer = take.readline()
            except OSError:
                answer = ""
            if not answer:
                process.wait()
                errors.seek(0)
                words = errors.read().strip().splitlines()[-1:] or [f"exit code {process.returncode}"]
                raise SurefootError("warm", f"the kernels of {job.service} could not be compiled: {words[0]}")
            return Warmed(**json.loads(answer))

        try:
            yield _Worker(process.pid, ask)
        finally:
            put.close()


def _rehearse(job: Job) -> Warmed:
    from surefoot.kernels import jit
    from surefoot.kernels.compiling import COMPILING
    from surefoot.lockstep.config import load_config
    from surefoot.lockstep.discover import service_class
    from surefoot.robot.kinematics import forward
    from surefoot.robot.reader import load_robot

    jit.set_aside()
    began, before = time.monotonic(), COMPILING.done
    kind: Any = service_class(job.service)
    overrides = [f"robot={json.dumps(job.robot)}"]
    if "autostart" in kind.Config.model_fields:
        overrides.append("autostart=false")
    service = kind(load_config(kind.Config, job.service, None, None, overrides))
    service.on_start()
    service.rehearse()
    if job.rare:
        service.rehearse_rare()
    service.on_stop()
    robot = load_robot(job.robot)
    forward(robot.model, robot.neutral)  # reports and views call it, after or beside a run
    seconds = round(time.monotonic() - began, 3)
    return Warmed(job.service, job.robot, len(jit.loaded()), COMPILING.done - before, seconds, jit.kept_files())


def _main() -> None:
    for line in sys.stdin:
        answer = _rehearse(Job(**json.loads(line)))
        sys.stdout.write(json.dumps(asdict(answer)) + "\n")
        sys.stdout.flush()


def _stamps() -> Path:
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if os.path.isabs(base) else user_home() / ".cache") / "surefoot" / "warm"


if __name__ == "__main__":
    _main()
