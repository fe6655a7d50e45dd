"""Scenarios: what happens in a run and what it must achieve, one TOML file each.

A step is a command of the wire with a time: `do` names it, the other keys are the fields of that command
(`surefoot.schemas.cmd.WalkCommand`, `surefoot.schemas.sim.PushRequest`, ...), so nothing is listed twice. `[world]` is
`surefoot.schemas.sim.World`, `[limits]` holds limits of `limits.LIMITS`.
"""

import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar, cast

from pydantic import ValidationError

from surefoot.bus.codec import first_complaint
from surefoot.files import FileError, find, read_text
from surefoot.lockstep.config import PREFIX
from surefoot.nearest import did_you_mean
from surefoot.schemas.base import Request
from surefoot.schemas.calibration import CalibrateRequest
from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.navigation import CancelRequest, GotoRequest, SetPoseRequest, WaypointsRequest
from surefoot.schemas.sim import FaultRequest, PlaceRequest, PushRequest, SetRequest, World
from surefoot.schemas.topics import (
    CMD_WALK,
    NAVIGATOR_CANCEL,
    NAVIGATOR_GOTO,
    NAVIGATOR_SET_POSE,
    NAVIGATOR_WAYPOINTS,
    SIM_FAULT,
    SIM_PLACE,
    SIM_PUSH,
    SIM_SET,
    STABILITY_CALIBRATE,
    TICK_S,
    Query,
)
from surefoot.tables import Table

from .limits import LIMITS

M = TypeVar("M", bound=Request)

Moment = Literal["ready", "walk_done", "goal_done"]
Policy = Literal["hold", "degrade", "fail"]
MOMENTS: tuple[Moment, ...] = ("ready", "walk_done", "goal_done")
"""ready: the walker stands and the estimator is initialised; walk_done: the last walking command has ended; goal_done:
the last goal of the navigator has ended, however it did."""

MAX_DURATION_S = 3600.0
_NAME = re.compile(r"[a-z0-9][a-z0-9-]*")

COMMANDS: Mapping[str, tuple[Query[Any, Any], type[Request]]] = {
    "walk": (CMD_WALK, WalkCommand),
    "turn": (CMD_WALK, WalkCommand),
    "stand": (CMD_WALK, WalkCommand),
    "stop": (CMD_WALK, WalkCommand),
    "push": (SIM_PUSH, PushRequest),
    "set": (SIM_SET, SetRequest),
    "fault": (SIM_FAULT, FaultRequest),
    "place": (SIM_PLACE, PlaceRequest),
    "goto": (NAVIGATOR_GOTO, GotoRequest),
    "waypoints": (NAVIGATOR_WAYPOINTS, WaypointsRequest),
    "cancel": (NAVIGATOR_CANCEL, CancelRequest),
    "set_pose": (NAVIGATOR_SET_POSE, SetPoseRequest),
    "calibrate": (STABILITY_CALIBRATE, CalibrateRequest),
}
"""What a step can do, with the query that carries it. `kill` is the supervisor's own: it ends a service at once."""

WALKING = ("walk", "turn", "stop")
"""Steps that end with the moment `walk_done`."""

GOALS = ("goto", "waypoints")
"""Steps that end with the moment `goal_done`."""


class ScenarioError(FileError):
    """A scenario file that cannot be used."""


@dataclass(frozen=True)
class Step:
    """One thing that happens in a run.

    Attributes:
        do: a key of `COMMANDS`, or `kill`.
        at_tick: control tick it takes effect in; None when it waits for a moment.
        when: moment it waits for; None when it has a tick.
        after_s: simulated time between the moment and the step, s.
        request: the command, without `at_tick`; None for `kill`.
        service: name of the service that `kill` ends.
    """

    do: str
    at_tick: int | None = None
    when: Moment | None = None
    after_s: float = 0.0
    request: Request | None = None
    service: str = ""


@dataclass(frozen=True)
class Scenario:
    """A validated scenario.

    Attributes:
        name: as in `surefoot run <name>`.
        description: one sentence.
        compose: name or path of the compose file.
        seed: of everything random, unless the caller gives another.
        world: terrain, map profile, friction and sensor profile of the simulator.
        actuation_delay_ticks: 0 = strict lockstep.
        policy: what the simulator does when a member dies.
        max_duration_s: simulated time after which the run is ended, s.
        settle_s: simulated time between the end of the last step and the end of the run, s.
        config: by service, fields of its configuration and their values.
        steps: in the order of the file.
        limits: acceptance, by name of `LIMITS`.
    """

    name: str
    description: str
    compose: str = "ragno"
    seed: int = 0
    world: World = field(default_factory=World)
    actuation_delay_ticks: int = 1
    policy: Policy = "hold"
    max_duration_s: float = 60.0
    settle_s: float = 0.5
    config: Mapping[str, Mapping[str, Any]] = field(default_factory=dict[str, Mapping[str, Any]])
    steps: tuple[Step, ...] = ()
    limits: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def environment(self) -> dict[str, str]:
        """The variables that carry `config` to the services: SUREFOOT_<SERVICE>_<FIELD>, values as TOML."""
        return {
            f"{PREFIX}{service.upper()}_{name.upper()}": json.dumps(value)
            for service, fields in self.config.items()
            for name, value in fields.items()
        }

    @property
    def max_ticks(self) -> int:
        """Control ticks after which the run is ended."""
        return max(1, round(self.max_duration_s / TICK_S))


def find_scenario(name: str) -> Path:
    """Return the path of a scenario given by name or path; ScenarioError when there is none."""
    return find("scenarios", name, ".toml", ScenarioError)


def load_scenario(path: Path) -> Scenario:
    """Read and validate a scenario file.

    Raises:
        ScenarioError: with code, field and a sentence.
    """
    return parse_scenario(read_text(path, ScenarioError), path)


def parse_scenario(text: str, path: Path = Path("scenario.toml")) -> Scenario:
    """Validate the text of a scenario file; see `load_scenario`."""
    try:
        try:
            content = tomllib.loads(text)
        except (tomllib.TOMLDecodeError, RecursionError) as exc:
            raise ScenarioError("syntax", "file", f"is not TOML: {exc}") from exc
        return _scenario(Table(content, error=ScenarioError), path.stem)
    except ScenarioError as exc:
        exc.file = str(path)
        raise


def _scenario(top: Table, stem: str) -> Scenario:
    default = Scenario(name=stem, description="")
    name = top.text("name") if top.has("name") else stem
    if not _NAME.fullmatch(name):
        raise top.refuse("value", "name", f"got {name!r}, allowed are small letters, digits and '-'")
    policies = ("hold", "degrade", "fail")
    policy = cast(Policy, top.text("policy", allowed=policies)) if top.has("policy") else default.policy
    delay = top.integer("actuation_delay_ticks", at_least=0, at_most=5) if top.has("actuation_delay_ticks") else 1
    scenario = Scenario(
        name=name,
        description=top.text("description"),
        compose=top.text("compose") if top.has("compose") else default.compose,
        seed=top.integer("seed", at_least=0, at_most=2**31 - 1) if top.has("seed") else default.seed,
        world=_world(top),
        actuation_delay_ticks=delay,
        policy=policy,
        max_duration_s=top.number("max_duration_s", default=60.0, above=0.0, at_most=MAX_DURATION_S),
        settle_s=top.number("settle_s", default=0.5, at_least=0.0, at_most=60.0),
        config=_config(top.table("config")) if top.has("config") else {},
        steps=tuple(_step(table) for table in top.tables("step")) if top.has("step") else (),
        limits=_limits(top.table("limits")) if top.has("limits") else {},
    )
    top.close()
    return scenario


def _world(top: Table) -> World:
    if not top.has("world"):
        return World()
    table = top.table("world")
    return _model(World, table, _rest(table))


def _config(table: Table) -> dict[str, Mapping[str, Any]]:
    """Read the tables `[config.<service>]`; each service judges its own fields when it starts."""
    result: dict[str, Mapping[str, Any]] = {}
    services = table.keys()
    for name in services:
        fields = _rest(table.table(name))
        for key, value in fields.items():
            if not isinstance(value, str | int | float | bool):
                raise table.refuse("type", f"{name}.{key}", f"expected text, a number or a flag, got {value!r}")
        result[name] = fields
    table.close()
    return result


def _limits(table: Table) -> dict[str, float]:
    result: dict[str, float] = {}
    for name in LIMITS:
        if not table.has(name):
            continue
        if LIMITS[name].yes_no:
            if table.flag(name, default=True):
                result[name] = 0.0
        else:
            result[name] = table.number(name)
    table.close()
    return result


def _step(table: Table) -> Step:
    do = table.text("do", allowed=(*COMMANDS, "kill"))
    at_tick = table.integer("at_tick", at_least=0, at_most=10**9) if table.has("at_tick") else None
    when = cast(Moment, table.text("when", allowed=MOMENTS)) if table.has("when") else None
    if (at_tick is None) == (when is None):
        raise table.refuse("missing", "at_tick", "a step needs either `at_tick` or `when`, and not both")
    after_s = table.number("after_s", default=0.0, at_least=0.0, at_most=MAX_DURATION_S)
    if after_s and when is None:
        raise table.refuse("value", "after_s", "goes with `when` only; with `at_tick` the time is known")
    if do == "kill":
        service = table.text("service")
        table.close()
        return Step(do, at_tick, when, after_s, service=service)
    query, model = COMMANDS[do]
    fields = _rest(table, "do", "at_tick", "when", "after_s")
    if query is CMD_WALK:
        if "action" in fields:
            raise table.refuse("unknown_key", "action", "is not known here; `do` says what happens")
        fields["action"] = do
    return Step(do, at_tick, when, after_s, _model(model, table, fields))


def _rest(table: Table, *but: str) -> dict[str, Any]:
    names = table.keys()
    return {name: table.raw(name) for name in names if name not in but}


def _model(model: type[M], table: Table, fields: Mapping[str, Any]) -> M:
    """Build a model of the wire from a table; pydantic's first complaint becomes ours."""
    known = [name for name in model.model_fields if name not in ("at_tick", "action")]
    try:
        return model.model_validate(fields)
    except ValidationError as exc:
        first = first_complaint(exc)
        where = ".".join(str(part) for part in first["loc"])
        if first["type"] == "extra_forbidden":
            hint = did_you_mean(where, known)
            raise table.refuse("unknown_key", where, f"is not known here{hint}; known are {', '.join(known)}") from exc
        code = "missing" if first["type"] == "missing" else "value"
        got = "" if code == "missing" else f" (got {str(first.get('input'))[:80]!r})"
        raise table.refuse(code, where, f"{first['msg']}{got}") from exc
