"""Trips of a value through the code: `python -m tests.trips` counts the stops between a request and its reply.

A stop is a pair of functions in two files, the first of which calls the second while a request is answered, from its
bytes to those of the reply. Requests of every mode are answered; operators such as `len` and calls of compiled kernels,
of arrays and of pydantic are none.
"""

import json
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from surefoot.bus.codec import decode, encode
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.reader import load_robot
from surefoot.schemas.stability import CheckRequest, RegionRequest
from surefoot.services.stability.answers import check_reply, region_reply
from surefoot.services.stability.workers import answered

ROOT = Path(__file__).parents[1]
COUNTED = ("services", "surefoot/bus")
"""Folders whose functions are stops."""
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


@cache
def place(code: CodeType) -> tuple[str, str]:
    """Return the file and the function of code; what is defined in a function is part of it."""
    path = Path(code.co_filename).resolve()
    return str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else "", code.co_qualname.partition(".<locals>")[0]


def stops(name: str) -> list[str]:
    """Return the stops of a trip, each as `file:function -> file:function`."""
    model, reply, requests = TRIPS[name]
    found: dict[str, None] = {}

    def called(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_back is not None:
            (caller, by), (file, function) = place(frame.f_back.f_code), place(frame.f_code)
            if caller and file.startswith(COUNTED) and caller != file and not function.endswith("__"):
                found.setdefault(f"{caller}:{by} -> {file}:{function}")

    handler, bodies = answered(reply), [json.dumps(request).encode() for request in requests]
    for _ in range(2):  # what is loaded or compiled by a first answer is no stop
        found.clear()
        for body in bodies:
            sys.setprofile(called)
            try:
                encode(handler(decode(model, body)))
            finally:
                sys.setprofile(None)
    return list(found)


if __name__ == "__main__":
    for trip in TRIPS:
        every = stops(trip)
        sys.stdout.write(f"{trip}: {len(every)} stops\n")
        if "-v" in sys.argv:
            sys.stdout.write("".join(f"  {stop}\n" for stop in every))
