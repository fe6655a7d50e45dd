"""Trips of a value through the code: `python -m tests.trips` counts the stops between a request and its reply.

A stop is a pair of functions in two files, the first of which calls the second. Of a request every stop counts, from
its bytes to those of the reply; requests of every mode are answered. Of a command those count that take or return the
value on its way: the name, path or text of its file, what is made of it, the request that begins the run, and the
verdict. `surefoot run` is followed to its verdict, `surefoot up` until everything is ready. Operators such as `len` and
calls of compiled kernels, of arrays and of pydantic are none.
"""

import json
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager, suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import CodeType, FrameType
from typing import Any
from unittest.mock import patch

from surefoot.bus.codec import decode, encode
from surefoot.lab.cli.main import main
from surefoot.lab.report.judge import RunVerdict
from surefoot.lab.report.traces import Traces
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.reader import load_robot
from surefoot.schemas.sim import ResetRequest, World
from surefoot.schemas.stability import CheckRequest, RegionRequest
from surefoot.services.stability.answers import check_reply, region_reply
from surefoot.services.stability.workers import answered
from surefoot.services.supervisor.processes.compose import Compose, ComposeFile, ComposeService, ServiceTable
from surefoot.services.supervisor.processes.keep import StartOrder
from surefoot.services.supervisor.scenarios.director import Director
from surefoot.services.supervisor.scenarios.scenario import Scenario
from tests.ports import free_address

ROOT = Path(__file__).parents[1]
COUNTED = ("services", "surefoot/bus")
"""Folders whose functions are stops of a request."""
ROBOT = load_robot("ragno")
FEET = [
    {"position": place, "normal": [0.0, 0.0, 1.0], "mu": 0.6}
    for place in (foot_positions(ROBOT.model, ROBOT.neutral) - [0.0, 0.0, ROBOT.foot_radius]).tolist()
]
UNEVEN = [foot | {"normal": [0.1 * k, 0.2, 1.0]} for k, foot in enumerate(FEET)]
SPECIAL = [foot | {"mu": None if k else 0.0} for k, foot in enumerate(UNEVEN)]
"""One foot without friction, the others with unlimited."""
POSTURE = {"joints": ROBOT.neutral.tolist()}
PUSH, LEAN = {"acceleration": [0.5, 0.0, 0.0], "com_height_m": 0.1}, {"tilt_rad": 0.05, "com_height_m": 0.1}
REGIONS: list[dict[str, Any]] = [
    {"contacts": []}, {"contacts": FEET[:1]}, {"contacts": FEET[:2]}, {"contacts": UNEVEN}, {"contacts": SPECIAL},
    {"contacts": UNEVEN, "directions": 8, "certificates": True}, {"contacts": UNEVEN, **PUSH},
    {"contacts": UNEVEN, **LEAN}, {"contacts": FEET, "actuation": POSTURE},
]  # fmt: skip
MOVED = {"com": [0.0, 0.0], "movement": [0.02, 0.01, 0.0]}
CHECKS: list[dict[str, Any]] = [
    *(asked | MOVED for asked in REGIONS), {"contacts": FEET, "movement": MOVED["movement"], **POSTURE},
    {"contacts": UNEVEN, "gradient": True, "doubt": {"com_sd_m": 0.003, "normal_rad": 0.05}, **MOVED},
]  # fmt: skip
TRIPS: dict[str, tuple[type[RegionRequest | CheckRequest], Callable[[Any], Any], list[dict[str, Any]]]] = {
    "stability/region": (RegionRequest, lambda request: region_reply(request, ROBOT), REGIONS),
    "stability/check": (CheckRequest, lambda request: check_reply(request, ROBOT), CHECKS),
}


SYSTEM = "services: {simulator: {environment: {SUREFOOT_ROBOT: ragno}}}"
SCENARIO = """
description = "Five ticks of a system that is its simulator"
compose = "journey.yaml"
max_duration_s = 0.05
step = [{do = "kill", service = "simulator", at_tick = 1000}]
limits = {no_fall = true}
"""
FILES = {"journey.yaml": SYSTEM, "outing.toml": SCENARIO}
NAMES = {"journey", "journey.yaml", "outing", "outing.toml", *FILES.values()}
"""Names, paths and texts of the files that commands follow."""
VALUES = (
    Compose, ComposeFile, ComposeService, Director, ResetRequest, RunVerdict, Scenario, ServiceTable, StartOrder,
    Traces, World,
)  # fmt: skip
COMMANDS = {"run": (["run", "outing.toml"], "judge"), "up": (["up", "journey.yaml"], "_show_up")}
"""Words of each command, and the function with whose return its trip ends."""


@cache
def place(code: CodeType) -> tuple[str, str]:
    """Return the file and the function of code; what is defined in a function is part of it."""
    path = Path(code.co_filename).resolve()
    ours = path.is_relative_to(ROOT) and not path.is_relative_to(ROOT / ".venv")
    return str(path.relative_to(ROOT)) if ours else "", code.co_qualname.partition(".<locals>")[0]


def between(frame: FrameType) -> tuple[str, str]:
    """Return the stop of a call as text, empty if it is none, and the file that is called."""
    if frame.f_back is None:
        return "", ""
    (caller, by), (file, function) = place(frame.f_back.f_code), place(frame.f_code)
    other = caller and file and caller != file and not function.endswith("__") and function != "<module>"
    return f"{caller}:{by} -> {file}:{function}" if other else "", file


def of_request(name: str) -> list[str]:
    """Return the stops of a request."""
    model, reply, requests = TRIPS[name]
    found: dict[str, None] = {}

    def called(frame: FrameType, event: str, _: Any) -> None:
        stop, file = between(frame) if event == "call" else ("", "")
        if stop and file.startswith(COUNTED):
            found.setdefault(stop)

    handler, bodies = answered(reply), [json.dumps(request).encode() for request in requests]
    for _ in range(2):  # what is loaded or compiled by a first answer is no stop
        found.clear()
        for body in bodies:
            with profiled(called):
                encode(handler(decode(model, body)))
    return list(found)


def of_command(name: str) -> list[str]:
    """Return the stops of a command, which starts processes; its output is dropped."""
    words, last = COMMANDS[name]
    found: dict[str, None] = {}

    def called(frame: FrameType, event: str, result: Any) -> None:
        code, stop = frame.f_code, between(frame)[0] if event in ("call", "return") else ""
        if stop:
            taken = [frame.f_locals.get(each) for each in code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]]
            if any(map(is_followed, [*taken, result])):
                found.setdefault(stop)
        if event == "return" and code.co_name == last:
            sys.setprofile(None)
            os.kill(os.getpid(), signal.SIGTERM)  # the trip is over

    handler = signal.getsignal(signal.SIGTERM)
    with (
        TemporaryDirectory() as folder, chdir(folder), open(os.devnull, "w") as nowhere,
        patch.object(sys, "stdout", nowhere), patch.object(sys, "stderr", nowhere),
        patch.dict(os.environ, XDG_STATE_HOME=folder), suppress(SystemExit),
    ):  # fmt: skip
        for file, text in FILES.items():
            Path(file).write_text(text)
        with profiled(called):
            main([*words, "--listen", free_address()])
    signal.signal(signal.SIGTERM, handler)
    return list(found)


def is_followed(value: Any) -> bool:
    """Report whether a value is one that commands follow."""
    return isinstance(value, VALUES) or (isinstance(value, str | Path) and str(value) in NAMES)


@contextmanager
def profiled(called: Callable[[FrameType, str, Any], None]) -> Iterator[None]:
    """Let `called` see every call and return of this thread."""
    sys.setprofile(called)
    try:
        yield
    finally:
        sys.setprofile(None)


def stops(name: str) -> list[str]:
    """Return the stops of a trip, each as `file:function -> file:function`."""
    return of_request(name) if name in TRIPS else of_command(name)


if __name__ == "__main__":
    for trip in (*TRIPS, *COMMANDS):
        every = stops(trip)
        sys.stdout.write(f"{trip}: {len(every)} stops\n")
        if "-v" in sys.argv:
            sys.stdout.write("".join(f"  {stop}\n" for stop in every))
