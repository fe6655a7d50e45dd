"""Recorded inputs of services, and what the services make of them again.

A recording is made by a short run in one process (`python -m tests.replay.cases`). It holds, for each service, what
came to it in order: resets, ticks with their inputs, requests, and the replies to its own calls. Numbers are rounded
and images thinned, so the reference does not come from that run but from a replay of these inputs.
"""

import argparse
import base64
import json
import lzma
import math
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from surefoot.errors import CallError, Refusal
from surefoot.lab.runs import local
from surefoot.lab.vision.blur import map_by_grid, still_camera
from surefoot.lab.vision.replay import floor
from surefoot.lockstep.discover import service_class
from surefoot.lockstep.join import TickInputs
from surefoot.schemas import topics
from surefoot.schemas.base import Bulk, BulkRequest, Wire
from surefoot.schemas.hw import CameraImage, DepthImage, Tick
from surefoot.schemas.navigation import SetPoseRequest
from surefoot.schemas.sim import FaultRequest
from surefoot.schemas.topics import STATE_ELEVATION, STATE_LANDMARKS
from surefoot.services.supervisor.scenarios.scenario import Step, find_scenario, load_scenario
from surefoot.services.vision.feature_map import save

FOLDER = Path(__file__).parent / "data"
FLOOR = "tests/replay/data/floor.npz"
"""Map of features for the service vision, from the root of the project."""
SERVICES = ("estimator", "stability", "footholds", "walker", "navigator")
DIGITS = 6
"""Significant digits of recorded inputs."""
COARSE = {"covariance": 3, "pose_covariance": 3}
"""Significant digits of recorded fields with many numbers, by name."""
REFERENCE_DIGITS = 12
EVERY = 10
"""Every so many published messages of a key one is in the reference."""
SELDOM = {STATE_ELEVATION.key: 2, STATE_LANDMARKS.key: 1}
"""The same of keys that have few messages in a recording."""
THINNED, GREYS = 2, 0xE0
"""`THINNED`: of so many rows, and columns, of an image one is recorded; `GREYS`: recorded bits of a grey."""
MODELS: dict[str, type[Wire]] = {
    model.__name__: model
    for model in (
        *(row.model for row in topics.TOPICS), *(row.request for row in topics.QUERIES),
        *(row.reply for row in topics.QUERIES),
    )
}  # fmt: skip


class Case(NamedTuple):
    """A short run that is recorded."""

    name: str
    scenario: str
    seconds: float
    world: dict[str, Any]
    """Changes to the scenario's world."""
    services: tuple[str, ...] = SERVICES
    """Services that are recorded, as far as the scenario's system has them."""
    config: dict[str, dict[str, Any]] | None = None
    """Configuration of services, each in place of the scenario's."""
    steps: tuple[Step, ...] = ()
    """Steps beside those of the scenario."""


LOST = tuple((4.0 * np.eye(3)).ravel().tolist())
"""Covariance of a pose with which vision compares the whole map, (9,) m and rad."""
CASES = (
    Case("ragno", "ragno-goal", 3.2, {"map_profile": "exact"}),
    Case("ragno-steps", "rough-terrain", 2.8, {"terrain": "steps", "map_profile": "exact", "start": (0.2, 0.0, 0.0)}),
    Case("bioloid", "bioloid-walk", 3.0, {}),
    Case("nao", "nao-corridor", 3.2, {"map_profile": "exact"}),
    Case(
        "lupo", "slope", 3.2, {"amplitude": 0.22, "map_profile": "exact"}, config={"walker": {"period_s": 0.35}}
    ),
    Case("ragno-depth", "ragno-own-map", 2.04, {}, ("mapper",), {"mapper": {"cell_m": 0.03, "cells": 41}}),
    Case(
        "nao-images",
        "examples/vision/nao-eyes.toml",
        1.7,
        {},
        ("vision",),
        {"navigator": {"params": "nao-eyes", "landmarks": FLOOR}, "vision": {"map": FLOOR}},
        (
            Step("fault", at_tick=115, request=FaultRequest(kind="camera_dark", duration=0.2)),
            Step("set_pose", at_tick=145, request=SetPoseRequest(pose=(0.0, 0.0, 0.0), covariance=LOST)),
        ),
    ),
)  # fmt: skip


# -- text --------------------------------------------------------------------------------------------------------


def rounded(value: Any, digits: int) -> Any:
    """Return plain JSON values with numbers of so many significant digits."""
    if isinstance(value, float):
        return float(f"{value:.{digits}g}") if math.isfinite(value) else value
    if isinstance(value, dict):
        return {key: rounded(part, digits) for key, part in value.items()}
    return [rounded(part, digits) for part in value] if isinstance(value, list | tuple) else value


def packed(model: Wire, digits: int = DIGITS) -> list[Any]:
    """Return a model as plain values: name, fields, raw bytes."""
    raw = base64.b64encode(model.data).decode() if isinstance(model, Bulk | BulkRequest) else None
    return [type(model).__name__, rounded(model.model_dump(mode="json"), digits), raw]


def unpacked(item: list[Any]) -> Any:
    """Return the model that `packed` took apart."""
    name, fields, raw = item
    model: Any = MODELS[name].model_validate_json(json.dumps(fields))
    return model if raw is None else model.model_copy(update={"data": base64.b64decode(raw)})


def thinned(message: Any) -> Any:
    """Return an image as of a camera of half the resolution, with 8 greys; any other message as it is."""
    if not isinstance(message, CameraImage | DepthImage):
        return message
    name, kind = ("pixels", "u1") if isinstance(message, CameraImage) else ("depths", "<f4")
    whole = np.frombuffer(base64.b64decode(getattr(message, name)), kind).reshape(message.height, message.width)
    kept = np.ascontiguousarray(whole[::THINNED, ::THINNED])
    kept = kept & GREYS if kind == "u1" else kept
    center = tuple((place - 0.5) / THINNED + 0.5 for place in message.center)  # of a pixel's middle
    fields = {name: base64.b64encode(kept.tobytes()).decode(), "focal": message.focal / THINNED, "center": center}
    return message.model_copy(update=fields | {"width": kept.shape[1], "height": kept.shape[0]})


def read(path: Path) -> list[Any]:
    return [json.loads(line) for line in lzma.decompress(path.read_bytes()).decode().splitlines()]


def write(path: Path, rows: list[Any]) -> None:
    """Write rows as JSON lines; equal rows give equal bytes."""
    path.parent.mkdir(exist_ok=True)
    text = "".join(json.dumps(row, separators=(",", ":")) + "\n" for row in rows)
    path.write_bytes(lzma.compress(text.encode(), preset=9 | lzma.PRESET_EXTREME))


# -- record ------------------------------------------------------------------------------------------------------


class Tap:
    """Writes down what comes to the services of a run; a message that several get is written once."""

    def __init__(self) -> None:
        self.rows: list[Any] = []
        self._known: dict[int, tuple[int, Any]] = {}

    def number(self, message: Any) -> int:
        if id(message) not in self._known:
            self._known[id(message)] = len(self._known), message  # kept, so that no other gets its id
            name, fields, raw = packed(thinned(message))
            coarse = {key: rounded(fields[key], COARSE[key]) for key in COARSE.keys() & fields.keys()}
            self.rows.append(["message", name, fields | coarse, raw])
        return self._known[id(message)][0]

    def on(self, service: Any) -> None:
        """Follow a service from its start."""
        name = service.name
        self.rows.append(["service", name, service.config.model_dump(mode="json")])
        reset, tick, call, handle = service.on_reset, service.on_tick, service.call, service.handle

        def on_reset() -> None:
            self.rows.append(["reset", name])
            reset()

        def on_tick(inputs: TickInputs) -> None:
            numbers = {key: self.number(message) for key, message in inputs.messages.items()}
            self.rows.append(["tick", name, rounded(inputs.tick.model_dump(mode="json"), DIGITS), numbers, inputs.late])
            tick(inputs)

        def asked(query: Any, request: Any, timeout_s: float | None = None) -> Any:
            try:
                reply = call(query, request, timeout_s)
            except CallError as error:
                self.rows.append(["reply", name, None, [error.code, error.message]])
                raise
            self.rows.append(["reply", name, packed(reply), None])
            return reply

        def handled(query: Any, handler: Callable[[Any], Any]) -> None:
            def answer(request: Any) -> Any:
                self.rows.append(["request", name, query.key, packed(request)])
                return handler(request)

            handle(query, answer)

        service.on_reset, service.on_tick, service.call, service.handle = on_reset, on_tick, asked, handled


def record(case: Case) -> None:
    """Run a case, and write what came to its services."""
    scenario = load_scenario(find_scenario(case.scenario))
    world, config = scenario.world.model_copy(update=case.world), {**scenario.config, **(case.config or {})}
    tap, build = Tap(), local.build_services

    def tapped(*args: Any, **more: Any) -> Any:
        services = build(*args, **more)
        for service in services:
            if service.name in case.services:
                tap.on(service)
        return services

    local.build_services = tapped
    changed = replace(
        scenario, world=world, config=config, steps=(*scenario.steps, *case.steps), max_duration_s=case.seconds
    )
    try:
        local.run_local(changed, without=("recorder",))
    finally:
        local.build_services = build
    write(FOLDER / f"{case.name}.jsonl.xz", tap.rows)


def draw_floor() -> None:
    """Write the map of the floor of `nao-images` by a camera of the recorded resolution."""
    camera = still_camera(floor("parquet", 1), 0.01)
    optics = replace(
        camera.optics, width=camera.optics.width // THINNED, height=camera.optics.height // THINNED,
        focal=camera.optics.focal / THINNED,
    )  # fmt: skip
    save(map_by_grid(replace(camera, optics=optics), "orb", (-0.1, 0.05), (-0.1, 0.1)), FLOOR)


# -- replay ------------------------------------------------------------------------------------------------------


class Stage:
    """Runtime of a replayed service: keeps what it publishes, gives the recorded replies to its calls.

    Args:
        every: so many published messages of a key one is kept.
        digits: significant digits that are kept of numbers.
    """

    def __init__(self, every: int, digits: int) -> None:
        self.every, self.digits = every, digits
        self.published: list[list[Any]] = []
        self.replies: list[Any] = []
        self._count: dict[str, int] = {}

    def publish(self, topic: Any, message: Any, stamp_ns: int | None) -> None:
        count = self._count[topic.key] = self._count.get(topic.key, 0) + 1
        if count % min(self.every, SELDOM.get(topic.key, self.every)) == 0:
            self.published.append([topic.key, *packed(message, self.digits)])

    def call(self, query: Any, request: Any, timeout_s: float | None) -> Any:
        reply, error = self.replies.pop(0)
        if reply is None:
            raise CallError(*error)
        return unpacked(reply)

    def log(self, level: str, text: str) -> None:
        self.published.append(["log", level])


def replayed(case: str, name: str, every: int = EVERY, digits: int = REFERENCE_DIGITS) -> list[Any]:
    """Return what a service publishes and replies to its recorded inputs."""
    rows = read(FOLDER / f"{case}.jsonl.xz")
    messages = [row for row in rows if row[0] == "message"]
    made: dict[int, Any] = {}

    def message(number: int) -> Any:
        if number not in made:
            made[number] = unpacked(messages[number][1:])
        return made[number]

    mine = [row for row in rows if row[0] != "message" and row[1] == name]
    kind = service_class(name)
    service, stage = kind(kind.Config.model_validate(mine[0][2])), Stage(every, digits)
    stage.replies = [row[2:] for row in mine if row[0] == "reply"]
    service.attach(stage)
    service.on_start()
    for row in mine[1:]:
        if row[0] == "reset":
            service.on_reset()
        elif row[0] == "tick":
            tick = Tick.model_validate_json(json.dumps(row[2]))
            service.on_tick(TickInputs(tick, {key: message(n) for key, n in row[3].items()}, row[4]))
        elif row[0] == "request":
            try:
                reply = service.handlers[row[2]](unpacked(row[3]))
            except Refusal as refusal:
                stage.published.append([row[2], "refused", refusal.code, refusal.field])
                continue
            reply = reply.result() if isinstance(reply, Future) else reply
            stage.published.append([row[2], *packed(reply, digits)])
    service.on_stop()
    return stage.published


def recorded() -> Iterator[tuple[str, str]]:
    """Yield case and service of each recording."""
    for path in sorted(FOLDER.glob("*.jsonl.xz")):
        for row in read(path):
            if row[0] == "service":
                yield path.name.split(".")[0], row[1]


def reference(case: str, name: str) -> Path:
    return FOLDER / f"{case}-{name}.reference.xz"


def main() -> None:
    """Record all cases, or some by name, and write their references."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("cases", nargs="*", default=[case.name for case in CASES])
    wanted = parser.parse_args().cases
    for case in CASES:
        if case.name in wanted:
            if "vision" in case.services:
                draw_floor()
            record(case)
    for case, name in recorded():
        if case in wanted:
            write(reference(case, name), replayed(case, name))


if __name__ == "__main__":
    main()
