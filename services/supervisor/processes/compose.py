"""Compose files: a documented subset of the Compose Specification, the same file for `surefoot up` and for Docker.

Honoured: `name`, `services`, and per service `extends`, `command`, `environment`, `depends_on` (conditions
`service_started` and `service_healthy`), `healthcheck` (`test`, `interval`, `retries`, `start_period`, `disable`),
`restart`, `stop_grace_period`. Accepted because only a container engine has a use for them: `image`, `build`,
`network_mode`, `init`, and `healthcheck.timeout`. Keys that begin with `x-` are the user's own, as in the
specification. Every other key is refused by name: a system is not started without something that its file asks for.
"""

import os
import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import yaml
from pydantic import BeforeValidator, ConfigDict, Field, WithJsonSchema, model_validator

from surefoot.files import FileError, find, read_text
from surefoot.tables import FileModel, Text, Whole, refused, shown, validated

from .extends import Extends, extended

Condition = Literal["service_started", "service_healthy"]
Restart = Literal["no", "always", "on-failure", "unless-stopped"]

IN_FOLDER = ("system.yaml", "compose.yaml")
"""Names of a compose file in a folder that is named instead of the file, in the order in which they are looked for."""
_DURATION = re.compile(r"(?:(\d+(?:\.\d+)?)h)?(?:(\d+(?:\.\d+)?)m)?(?:(\d+(?:\.\d+)?)s)?(?:(\d+(?:\.\d+)?)ms)?")
_RESTART = re.compile(r"(no|always|on-failure|unless-stopped)|on-failure:(1000|[1-9][0-9]{0,2})")


class ComposeError(FileError):
    """Error of a compose file that is missing, invalid or requires something that is not supported."""


def _seconds(value: object) -> float:
    """Return a duration such as `1m30s`, `500ms` or `2s` in seconds."""
    match = _DURATION.fullmatch(value) if isinstance(value, str) and value else None
    if match is None:
        raise refused("value", f"expected a duration such as 500ms, 2s or 1m30s, got {shown(value)}")
    hours, minutes, seconds, millis = (float(part or 0) for part in match.groups())
    return 3600 * hours + 60 * minutes + seconds + millis / 1000


def _words(value: object) -> tuple[str, ...]:
    """Return the words of a command: a list as it is, a text split as a shell does."""
    try:
        words = shlex.split(value) if isinstance(value, str) else value
    except ValueError as exc:
        raise refused("value", f"cannot be split into words: {exc}") from exc
    if not isinstance(words, list) or not words or not all(isinstance(word, str) for word in words):
        raise refused("type", f"expected a text or a list of texts, got {shown(value)}")
    return tuple(words)


def _restart(value: object) -> str:
    value = "no" if value is False else value  # YAML 1.1 reads a bare `no` as false
    if not isinstance(value, str) or not _RESTART.fullmatch(value):
        allowed = "no, always, on-failure, on-failure:<n>, unless-stopped"
        raise refused("value", f"got {shown(value)}, allowed are {allowed}")
    return value


def _variables(value: object) -> object:
    """Return the map form of a list of NAME=value, every value as text."""
    if isinstance(value, list):
        for item in value:
            if not isinstance(item, str) or "=" not in item:
                raise refused("type", f"expected NAME=value, got {shown(item)}")
        value = dict(item.split("=", 1) for item in value)
    for key, text in value.items() if isinstance(value, Mapping) else ():
        if isinstance(text, bool) or not isinstance(text, str | int | float):
            raise refused("type", f"expected a text or a number, got {text!r}; put it in quotes", str(key))
    return {key: str(text) for key, text in value.items()} if isinstance(value, Mapping) else value


def _needs(value: object) -> object:
    """Return the map form of a list of services, each with the condition `service_started`."""
    if not isinstance(value, list):
        return value
    for item in value:
        if not isinstance(item, str):
            raise refused("type", f"expected names of services, got {shown(item)}")
    return {item: {"condition": "service_started"} for item in value}


Words = Annotated[tuple[str, ...], BeforeValidator(_words, json_schema_input_type=str | list[str])]
Seconds = Annotated[float, BeforeValidator(_seconds, json_schema_input_type=str)]
ServiceName = Annotated[str, Field(pattern="^[a-z0-9][a-z0-9_-]*$")]
ContainerOnly = Annotated[Any, Field(description="for container engines only")]


class ComposeModel(FileModel):
    """Base of tables of a compose file in which keys that begin with `x-` are the user's own and ignored."""

    model_config = ConfigDict(json_schema_extra={"patternProperties": {"^x-": {}}}, use_attribute_docstrings=True)

    @model_validator(mode="before")
    @classmethod
    def _without_own_keys(cls, table: Any) -> Any:
        own = isinstance(table, Mapping)
        return {key: table[key] for key in table if not str(key).startswith("x-")} if own else table


class HealthCheck(FileModel):
    """Table `healthcheck` of a service: times after which it counts as unhealthy, by its heartbeats on the bus."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    test: Annotated[Any, WithJsonSchema({"type": ["string", "array"]})] = None
    """Probe command of a container engine, [CMD, surefoot, health, <service>]; [NONE] disables the check."""
    disable: bool = False
    """True: health is not checked, the service counts as healthy once started; false: its heartbeats count."""
    interval_s: Seconds = Field(default=1.0, validation_alias="interval")
    """Largest wall time between two heartbeats of a healthy service, s."""
    timeout: ContainerOnly = None
    retries: Annotated[Whole, Field(ge=1, le=1000)] = 3
    """Number of missed intervals in a row after which the service is unhealthy."""
    start_period_s: Seconds = Field(default=20.0, validation_alias="start_period")
    """Wall time that a new process may take to become healthy, s."""


WATCHED = HealthCheck()
"""Health check of a service whose file has none."""


class Need(FileModel):
    """Condition that a service has to meet before the start of another, an entry of `depends_on`."""

    condition: Condition


class ServiceTable(ComposeModel):
    """Table of a service in a compose file, as it was written."""

    extends: Text | Extends = ""
    """Service of this file, or of another one, whose content this service begins with."""
    command: Words = ()
    """Program and arguments; default: surefoot-service <name>."""
    environment: Annotated[
        dict[str, str], BeforeValidator(_variables, json_schema_input_type=dict[str, str | float] | list[str])
    ] = Field({})
    """Environment variables of the process, on top of the caller's own."""
    depends_on: Annotated[
        dict[str, Need], BeforeValidator(_needs, json_schema_input_type=dict[str, Need] | list[str])
    ] = Field({})
    """Services that must have started, or be healthy, before this one starts."""
    healthcheck: HealthCheck = WATCHED
    restart: Annotated[str, BeforeValidator(_restart, json_schema_input_type=str | Literal[False])] = "no"
    """Reaction to an end of the process: no, always, on-failure, on-failure:<n> (n restarts), unless-stopped."""
    stop_grace_s: Seconds = Field(default=2.0, validation_alias="stop_grace_period")
    """Wall time between SIGTERM and SIGKILL, s."""
    image: ContainerOnly = None
    build: ContainerOnly = None
    network_mode: ContainerOnly = None
    init: ContainerOnly = None


class ComposeFile(ComposeModel):
    """Content of a compose file, `compose/<name>.yaml`: name of the system, and its services."""

    name: ServiceName = Field("", description="name of the system [that of the file]")
    services: dict[ServiceName, ServiceTable]


@dataclass(frozen=True)
class ComposeService:
    """One service of a compose file.

    Attributes:
        name: the key in the file; `surefoot-service <name>` is the default command.
        command: program and arguments.
        environment: variables set for the process, on top of the caller's own.
        depends_on: (service, condition) pairs that must hold before the start.
        healthcheck: None when disabled; then started counts as healthy.
        restart: reaction to an end of the process without a request.
        max_restarts: upper bound given as `on-failure:<n>`, None for the reconciler's own.
        stop_grace_s: wall time between SIGTERM and SIGKILL, s.
    """

    name: str
    command: tuple[str, ...]
    environment: Mapping[str, str] = field(default_factory=dict)
    depends_on: tuple[tuple[str, Condition], ...] = ()
    healthcheck: HealthCheck | None = WATCHED
    restart: Restart = "no"
    max_restarts: int | None = None
    stop_grace_s: float = 2.0


@dataclass(frozen=True)
class Compose:
    """A validated compose file.

    Attributes:
        name: name of the system.
        path: path of the file.
        services: services by name, in dependency order.
        robot: name or folder of the robot that the file is for: SUREFOOT_ROBOT of its services, else of the caller.
    """

    name: str
    path: Path
    services: Mapping[str, ComposeService]
    robot: str

    def of_robot(self, robot: str) -> "Compose":
        """Return a copy of the system with `robot`, a name or a folder, set for all services and as its name."""
        every = self.services.items()
        services = {n: replace(s, environment={**s.environment, "SUREFOOT_ROBOT": robot}) for n, s in every}
        return Compose(Path(robot).name, self.path, services, robot)


def load_compose(name: str | Path) -> Compose:
    """Read and validate a compose file given by name or path, or as the folder in which one of `IN_FOLDER` lies.

    Raises:
        ComposeError: with code, field and a sentence; also for a file that is missing, too large or not YAML.
    """
    folder = Path(name)
    if len(folder.parts) != 1 or os.sep in str(name) or folder.name == "..":  # a path, not the name of a system
        path = _in_folder(folder) if folder.is_dir() else folder
    else:
        path = find("compose", str(name), ".yaml", ComposeError)
    return parse_compose(read_text(path, ComposeError), path)


def _in_folder(folder: Path) -> Path:
    """Return the compose file in a folder, by the names of `IN_FOLDER` (raises ComposeError: there is none)."""
    found = next((folder / name for name in IN_FOLDER if (folder / name).is_file()), None)
    if found is None:
        others = ", ".join(sorted(path.name for path in folder.glob("*.yaml"))[:5])
        hint = f"; name the file: {others}" if others else ""
        raise ComposeError("not_found", "file", f"is a folder without {' or '.join(IN_FOLDER)}{hint}", str(folder))
    return found


def parse_compose(text: str, path: Path = Path("compose.yaml")) -> Compose:
    """Return the validated system of the text of a compose file; `path` is its place, for errors and other files.

    Raises:
        ComposeError: with code, field and a sentence.
    """
    try:
        content = _content(text)
        if isinstance(content, Mapping):
            named = {"name": path.stem, **cast("Mapping[str, Any]", content)}
            content = extended(named, path, lambda other: _content(read_text(other, ComposeError)), ComposeError)
        file = validated(ComposeFile, content, ComposeError)
        if not file.services:
            raise ComposeError("missing", "services", "names no service")
        services = [_service(name, table) for name, table in file.services.items()]
        return Compose(file.name, path, _in_order(services), _robot(services))
    except ComposeError as exc:
        exc.file = str(path)
        raise


def _service(name: str, table: ServiceTable) -> ComposeService:
    check, probe = table.healthcheck, ["CMD", "surefoot", "health", name]
    test = ["CMD", *check.test.split()] if isinstance(check.test, str) else check.test
    disabled = check.disable or test == ["NONE"]
    if not disabled and test is not None and test != probe:
        where = f"services.{name}.healthcheck.test"
        raise ComposeError("value", where, f"got {shown(check.test)}, allowed is [{', '.join(probe)}]")
    restart, _, restarts = table.restart.partition(":")
    return ComposeService(
        name=name,
        command=table.command or ("surefoot-service", name),
        environment=table.environment,
        depends_on=tuple((service, need.condition) for service, need in table.depends_on.items()),
        healthcheck=None if disabled else check,
        restart=restart,  # pyright: ignore[reportArgumentType] - one of them, by its pattern
        max_restarts=int(restarts) if restarts else None,
        stop_grace_s=table.stop_grace_s,
    )


def _robot(services: list[ComposeService]) -> str:
    """Return the robot of all services; refuse services with different robots: they would misread each other."""
    given = [(s.name, s.environment["SUREFOOT_ROBOT"]) for s in services if "SUREFOOT_ROBOT" in s.environment]
    for name, robot in given:
        if robot != given[0][1]:
            text = f"got {robot!r}, but {given[0][0]} has {given[0][1]!r}: the services of a system are of one robot"
            raise ComposeError("value", f"services.{name}.environment.SUREFOOT_ROBOT", text)
    return given[0][1] if given else os.environ.get("SUREFOOT_ROBOT", "ragno")


def _in_order(services: list[ComposeService]) -> dict[str, ComposeService]:
    """Return the services sorted by dependency, otherwise in the order of the file; refuse unknown names and cycles."""
    names = [service.name for service in services]
    for service in services:
        for needed, _ in service.depends_on:
            if needed not in names:
                where = f"services.{service.name}.depends_on"
                raise ComposeError("unknown_name", where, f"got {needed!r}, the file has {', '.join(names)}")
    ordered: dict[str, ComposeService] = {}
    while len(ordered) < len(services):
        free = [s for s in services if s.name not in ordered and all(need in ordered for need, _ in s.depends_on)]
        if not free:
            left = [name for name in names if name not in ordered]
            where = f"services.{left[0]}.depends_on"
            raise ComposeError("value", where, f"these services wait for each other: {', '.join(left)}")
        ordered |= {service.name: service for service in free}
    return ordered


def _content(text: str) -> object:
    try:
        return yaml.load(text, Loader=_UniqueKeyLoader)
    except (yaml.YAMLError, RecursionError, ValueError) as exc:
        mark = getattr(exc, "problem_mark", None)
        line = f"line {mark.line + 1}: " if mark is not None else ""
        problem = getattr(exc, "problem", None) or "cannot be parsed"
        raise ComposeError("syntax", "file", f"is not YAML: {line}{problem}") from exc


class _UniqueKeyLoader(yaml.SafeLoader):
    """Safe YAML loader that refuses a key given twice instead of overwriting its first value."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge" or not isinstance(key_node, yaml.ScalarNode):
                continue
            if key_node.value in seen:
                problem = f"key {key_node.value!r} is given twice"
                raise yaml.constructor.ConstructorError(None, None, problem, key_node.start_mark)
            seen.add(key_node.value)
        return super().construct_mapping(node, deep)
