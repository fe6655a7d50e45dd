"""Scenarios: what happens in a run and what it must achieve, one TOML file each.

A step is a request to a service with a time: `do` names it, the other keys are the fields of that command
(`surefoot.schemas.cmd.WalkCommand`, `surefoot.schemas.sim.PushRequest`, ...), so nothing is listed twice. `[world]` is
`surefoot.schemas.sim.World`, `[limits]` holds limits of `limits.LIMITS`.
"""

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError, model_validator
from pydantic.json_schema import models_json_schema

from surefoot.bus.codec import first_complaint
from surefoot.files import FileError, find, read_text
from surefoot.lockstep.config import PREFIX
from surefoot.schemas import topics
from surefoot.schemas.base import Request
from surefoot.schemas.calibration import CalibrateRequest
from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.navigation import (
    CancelRequest,
    DockRequest,
    GotoRequest,
    PauseGoalRequest,
    ResumeGoalRequest,
    SetPoseRequest,
    WaypointsRequest,
)
from surefoot.schemas.rows import MOST_TICKS, Req
from surefoot.schemas.sim import FaultRequest, PlaceRequest, PushRequest, SetRequest, World
from surefoot.schemas.topics import Query
from surefoot.tables import FileModel, Number, Positive, Text, Whole, known_keys, refused, shown, unknown_key, validated

from .limits import Limits

Moment = Literal["ready", "walk_done", "goal_done"]
"""Event for which a step waits: `ready`: the walker stands and the estimator is initialised; `walk_done`: the last
walking command has ended; `goal_done`: the navigator's last goal has ended, reached or not."""
Policy = Literal["hold", "degrade", "fail"]

MAX_DURATION_S = 3600.0

COMMANDS: Mapping[str, tuple[Query[Any, Any], type[Request]]] = {
    "walk": (topics.CMD_WALK, WalkCommand),
    "turn": (topics.CMD_WALK, WalkCommand),
    "stand": (topics.CMD_WALK, WalkCommand),
    "stop": (topics.CMD_WALK, WalkCommand),
    "push": (topics.SIM_PUSH, PushRequest),
    "set": (topics.SIM_SET, SetRequest),
    "fault": (topics.SIM_FAULT, FaultRequest),
    "place": (topics.SIM_PLACE, PlaceRequest),
    "goto": (topics.NAVIGATOR_GOTO, GotoRequest),
    "waypoints": (topics.NAVIGATOR_WAYPOINTS, WaypointsRequest),
    "dock": (topics.NAVIGATOR_DOCK, DockRequest),
    "cancel": (topics.NAVIGATOR_CANCEL, CancelRequest),
    "pause": (topics.NAVIGATOR_PAUSE, PauseGoalRequest),
    "resume": (topics.NAVIGATOR_RESUME, ResumeGoalRequest),
    "set_pose": (topics.NAVIGATOR_SET_POSE, SetPoseRequest),
    "calibrate": (topics.STABILITY_CALIBRATE, CalibrateRequest),
}
"""Commands of a step, each with its query and the type of its request; beside them `kill` ends a service at once."""

WALKING = ("walk", "turn", "stop")
"""Commands whose end is the moment `walk_done`."""

GOALS = ("goto", "waypoints", "dock")
"""Commands whose end is the moment `goal_done`."""


_HEAD = ("do", "at_tick", "when", "after_s")
_FILE = ConfigDict(extra="forbid", defer_build=True, use_attribute_docstrings=True)


class ScenarioError(FileError):
    """Error of a scenario file that is missing or invalid."""


class Kill(FileModel):
    """Keys of the step `kill`, which ends the process of a service at once."""

    service: Text


@dataclass(frozen=True)
class Step:
    """One step of a scenario: a command or a kill, and when it happens."""

    __pydantic_config__ = _FILE

    do: Literal[(*COMMANDS, "kill")]  # pyright: ignore[reportInvalidTypeForm] - a key of COMMANDS, or kill
    """Action of the step: a command, or `kill` of a service."""
    at_tick: Annotated[Whole, Field(ge=0, le=MOST_TICKS)] | None = None
    """Control tick in which the step takes effect; null = it waits for a moment."""
    when: Moment | None = None
    """Moment for which the step waits; null = it has a tick."""
    after_s: Annotated[Number, Field(ge=0.0, le=MAX_DURATION_S)] = 0.0
    """Simulated time between the moment and the step, s."""
    request: Request | None = None
    """Command of the step without its `at_tick`; null for `kill`."""
    service: str = ""
    """Name of the service that `kill` ends; empty for a command."""

    @model_validator(mode="before")
    @classmethod
    def _with_request(cls, table: Any) -> Any:
        """Return the table of a step with its command built from the keys that are not the step's own."""
        do = table.get("do") if isinstance(table, Mapping) else None
        if not isinstance(do, str) or do not in (*COMMANDS, "kill"):
            return table
        if ("at_tick" in table) == ("when" in table):
            raise refused("missing", "a step needs either `at_tick` or `when`, and not both", "at_tick")
        head = {name: table[name] for name in _HEAD if name in table}
        fields = {name: value for name, value in table.items() if name not in _HEAD}
        if do == "kill":
            return {**head, **Kill.model_validate(fields).model_dump()}
        query, model = COMMANDS[do]
        if query is topics.CMD_WALK:
            if "action" in fields:
                raise refused("unknown_key", "is not known here; `do` states what happens", "action")
            fields["action"] = do
        return {**head, "request": on_wire(model, fields)}

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.after_s and self.when is None:
            raise refused("value", "goes with `when` only; with `at_tick` the time is known", "after_s")
        return self


def on_wire(model: type[Req], fields: Mapping[str, Any]) -> Req:
    """Return a message of class `model` with the fields of a table; its first error is raised as one of the file."""
    try:
        return model.model_validate(fields)
    except ValidationError as exc:
        first = first_complaint(exc)
        where = ".".join(str(part) for part in first["loc"])
        if first["type"] == "extra_forbidden":
            inside, key = first["loc"][:-1], str(first["loc"][-1])
            known = [name for name in known_keys(model, inside) if inside or name not in ("at_tick", "action")]
            raise refused("unknown_key", unknown_key(key, known), where) from exc
        code = "missing" if first["type"] == "missing" else "value"
        got = "" if code == "missing" else f" (got {str(first.get('input'))[:80]!r})"
        raise refused(code, f"{first['msg']}{got}", where) from exc


def _setting(value: Any) -> Any:
    for each in value if isinstance(value, list) else (value,):
        if not isinstance(each, str | int | float | bool):
            raise refused("type", f"expected text, a number, a flag, or a list of these, got {shown(value)}")
    return value


Plain = str | float | bool
Setting = Annotated[Any, BeforeValidator(_setting, json_schema_input_type=Plain | list[Plain])]
WireWorld = Annotated[
    World, BeforeValidator(lambda table: on_wire(World, table) if isinstance(table, Mapping) else table)
]


@dataclass(frozen=True)
class Scenario:
    """A validated scenario, and the keys of its file."""

    __pydantic_config__ = _FILE

    name: Annotated[Text, Field(pattern="^[a-z0-9][a-z0-9-]*$")]
    """Name of the scenario, by which `surefoot run <name>` finds it; default: name of the file."""
    description: Text
    """Purpose of the scenario in one sentence."""
    compose: Text = "ragno"
    """Name or path of the compose file of the system to run."""
    robot: Text | None = None
    """Name or folder of the robot; default: that of the compose file."""
    seed: Annotated[Whole, Field(ge=0, lt=2**31)] = 0
    """Seed of all random numbers of the run, unless the caller gives another."""
    world: WireWorld = field(default_factory=World)
    """World that the simulator builds: terrain, map profile, friction and sensor profile."""
    actuation_delay_ticks: Annotated[Whole, Field(ge=0, le=5)] = 1
    """Number of control ticks between a command and its effect in the simulator; 0 = strict lockstep."""
    policy: Policy = "hold"
    """Reaction of the simulator when a service that takes part in lockstep dies."""
    max_duration_s: Annotated[Positive, Field(le=MAX_DURATION_S)] = 60.0
    """Simulated time after which the run is ended whatever its state, s."""
    settle_s: Annotated[Number, Field(ge=0.0, le=60.0)] = 0.5
    """Simulated time between the end of the last step and the end of the run, s."""
    config: Mapping[str, dict[str, Setting]] = field(default_factory=dict[str, dict[str, Any]])
    """Configuration of services: values of fields, by service and field."""
    steps: Annotated[tuple[Step, ...], Field(alias="step", min_length=1)] = ()
    """Steps of the run in the order of the file."""
    limits: Limits = field(default_factory=dict[str, float])
    """Acceptance limits of the run by name, in the unit that the name ends with; 0.0 for a limit that is a flag."""

    @model_validator(mode="after")
    def _no_step_twice(self) -> Self:
        """Refuse a command that comes twice for one tick: the second would count as the first sent again."""
        for number, step in enumerate(self.steps):
            if step.at_tick is not None and step in self.steps[:number]:
                raise refused(
                    "value", f"step {number + 1} is the same as an earlier one; give one of another tick", "step"
                )
        return self

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
        """Number of control ticks after which the run is ended."""
        return max(1, round(self.max_duration_s / topics.TICK_S))


def scenario_schema() -> dict[str, Any]:
    """Return the JSON Schema of a scenario file; a step has its own fields beside those of its command."""
    schema, steps = TypeAdapter(Scenario).json_schema(), TypeAdapter(Step).json_schema()["properties"]
    models: dict[str, Any] = {name: model for name, (_, model) in COMMANDS.items()} | {"kill": Kill}
    _, shared = models_json_schema([(model, "validation") for model in {*models.values()}])
    either: list[dict[str, Any]] = []
    for do, model in models.items():
        wire = shared["$defs"][model.__name__]
        set_by_do = ("action",) if model is WalkCommand else ()
        fields = {name: field for name, field in wire["properties"].items() if name not in set_by_do}
        head = {**{name: steps[name] for name in _HEAD}, "do": {"const": do}}
        required = ["do", *(name for name in wire.get("required", ()) if name not in set_by_do)]
        either.append({"properties": fields | head, "required": required, "additionalProperties": False})
    schema["properties"]["step"] = {"type": "array", "minItems": 1, "items": {"type": "object", "oneOf": either}}
    schema["required"] = ["description"]
    schema["$defs"] |= shared["$defs"]
    return schema


def find_scenario(name: str) -> Path:
    """Return the path of a scenario given by name or path; ScenarioError when there is none."""
    return find("scenarios", name, ".toml", ScenarioError)


def load_scenario(name: str | Path) -> Scenario:
    """Read and validate a scenario file given by name or path.

    Raises:
        ScenarioError: with code, field and a sentence.
    """
    path = find("scenarios", str(name), ".toml", ScenarioError)
    return parse_scenario(read_text(path, ScenarioError), path)


def parse_scenario(text: str, path: Path = Path("scenario.toml")) -> Scenario:
    """Return the validated scenario of the text of a scenario file; `path` is its place, for errors.

    Raises:
        ScenarioError: with code, field and a sentence.
    """
    try:
        try:
            content = tomllib.loads(text)
        except (tomllib.TOMLDecodeError, RecursionError) as exc:
            raise ScenarioError("syntax", "file", f"is not TOML: {exc}") from exc
        return scenario_of(content, path.stem)
    except ScenarioError as exc:
        exc.file = str(path)
        raise


def scenario_of(content: Mapping[str, Any], name: str = "scenario") -> Scenario:
    """Return the validated scenario of the keys of a scenario file, named `name` unless a key states another name.

    Raises:
        ScenarioError: with code, field and a sentence.
    """
    return validated(Scenario, {"name": name, **content}, ScenarioError)
