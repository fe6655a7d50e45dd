"""Compose files: a documented subset of the Compose Specification, the same file for `surefoot up` and for Docker.

Honoured: `name`, `services`, and per service `extends`, `command`, `environment`, `depends_on` (conditions
`service_started` and `service_healthy`), `healthcheck` (`test`, `interval`, `retries`, `start_period`, `disable`),
`restart`, `stop_grace_period`. Accepted because only a container engine has a use for them: `image`, `build`,
`network_mode`, `init`, and `healthcheck.timeout`. Keys that begin with `x-` are the user's own, as the specification
says. Every other key is refused by name: a file that asks for something must not be started without it.
"""

import os
import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, cast

import yaml

from surefoot.files import FileError, read_text
from surefoot.tables import Table, shown

from .extends import extended

CONTAINER_ONLY = ("image", "build", "network_mode", "init")

Condition = Literal["service_started", "service_healthy"]
Restart = Literal["no", "always", "on-failure", "unless-stopped"]

_NAME = re.compile(r"[a-z0-9][a-z0-9_-]*")
_DURATION = re.compile(r"(?:(\d+(?:\.\d+)?)h)?(?:(\d+(?:\.\d+)?)m)?(?:(\d+(?:\.\d+)?)s)?(?:(\d+(?:\.\d+)?)ms)?")


class ComposeError(FileError):
    """A compose file that cannot be used."""


@dataclass(frozen=True)
class HealthCheck:
    """When a service counts as unhealthy; the state itself comes over the bus (`health/<service>`, liveliness).

    Attributes:
        interval_s: wall time between two heartbeats that is still fine.
        retries: missed intervals after which the service is unhealthy.
        start_period_s: wall time a fresh process may take to become healthy.
    """

    interval_s: float = 1.0
    retries: int = 3
    start_period_s: float = 20.0


@dataclass(frozen=True)
class ComposeService:
    """One service of a compose file.

    Attributes:
        name: the key in the file; `surefoot-service <name>` is the default command.
        command: program and arguments.
        environment: variables set for the process, on top of the caller's own.
        depends_on: (service, condition) pairs that must hold before the start.
        healthcheck: None when disabled; then started counts as healthy.
        restart: what happens when the process ends by itself.
        max_restarts: upper bound given as `on-failure:<n>`, None for the reconciler's own.
        stop_grace_s: wall time between SIGTERM and SIGKILL.
    """

    name: str
    command: tuple[str, ...]
    environment: Mapping[str, str] = field(default_factory=dict)
    depends_on: tuple[tuple[str, Condition], ...] = ()
    healthcheck: HealthCheck | None = HealthCheck()
    restart: Restart = "no"
    max_restarts: int | None = None
    stop_grace_s: float = 2.0


@dataclass(frozen=True)
class Compose:
    """A validated compose file: its name and its services in dependency order."""

    name: str
    path: Path
    services: tuple[ComposeService, ...]

    @property
    def service_names(self) -> tuple[str, ...]:
        """Names in dependency order."""
        return tuple(service.name for service in self.services)

    @property
    def robot(self) -> str:
        """The robot the file is for, a name or a folder: what its services are told, else the caller's."""
        told = (s.environment["SUREFOOT_ROBOT"] for s in self.services if "SUREFOOT_ROBOT" in s.environment)
        return next(told, os.environ.get("SUREFOOT_ROBOT", "ragno"))

    def service(self, name: str) -> ComposeService:
        """Return the service of that name; KeyError when the file has none."""
        for service in self.services:
            if service.name == name:
                return service
        raise KeyError(name)


def load_compose(path: Path) -> Compose:
    """Read and validate a compose file.

    Raises:
        ComposeError: with code, field and a sentence; also for a file that is missing, too large or not YAML.
    """
    return parse_compose(read_text(path, ComposeError), path)


def parse_compose(text: str, path: Path = Path("compose.yaml")) -> Compose:
    """Validate the text of a compose file; see `load_compose`."""
    try:
        return _compose(text, path)
    except ComposeError as exc:
        exc.file = str(path)
        raise


def _compose(text: str, path: Path) -> Compose:
    top = Table(_content(text), error=ComposeError)
    name = _name(top, "name", top.text("name") if top.has("name") else path.stem)
    raw = top.raw("services")
    if isinstance(raw, Mapping):
        raw = extended(cast("Mapping[str, Any]", raw), path, _read, ComposeError)
    tables = Table(raw, "services", ComposeError).items()
    services = [_service(table, _name(top, "services", key)) for key, table in tables]
    if not services:
        raise top.refuse("missing", "services", "names no service")
    _close(top)
    _check_robot(services)
    return Compose(name, path, _in_order(services))


def _check_robot(services: list[ComposeService]) -> None:
    """Refuse services that are told of different robots: they would misread each other."""
    told = [(s.name, s.environment["SUREFOOT_ROBOT"]) for s in services if "SUREFOOT_ROBOT" in s.environment]
    for name, robot in told:
        if robot != told[0][1]:
            said = f"got {robot!r}, but {told[0][0]} has {told[0][1]!r}: the services of a system are of one robot"
            raise ComposeError("value", f"services.{name}.environment.SUREFOOT_ROBOT", said)


def _read(path: Path) -> object:
    return _content(read_text(path, ComposeError))


def _content(text: str) -> object:
    try:
        return yaml.load(text, Loader=_UniqueKeyLoader)
    except (yaml.YAMLError, RecursionError, ValueError) as exc:
        mark = getattr(exc, "problem_mark", None)
        line = f"line {mark.line + 1}: " if mark is not None else ""
        problem = getattr(exc, "problem", None) or "cannot be parsed"
        raise ComposeError("syntax", "file", f"is not YAML: {line}{problem}") from exc


def _name(table: Table, key: str, name: object) -> str:
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise table.refuse("value", key, f"got the name {shown(name)}, allowed are small letters, digits, '-' and '_'")
    return name


def _service(table: Table, name: str) -> ComposeService:
    for key in CONTAINER_ONLY:
        table.has(key)
    restart, max_restarts = _restart(table)
    service = ComposeService(
        name=name,
        command=_command(table, name),
        environment=_environment(table),
        depends_on=_depends_on(table),
        healthcheck=_healthcheck(table, name),
        restart=restart,
        max_restarts=max_restarts,
        stop_grace_s=_duration(table, "stop_grace_period", 2.0),
    )
    _close(table)
    return service


def _command(table: Table, name: str) -> tuple[str, ...]:
    value = _raw(table, "command", ["surefoot-service", name])
    try:
        words = shlex.split(value) if isinstance(value, str) else value
    except ValueError as exc:
        raise table.refuse("value", "command", f"cannot be split into words: {exc}") from exc
    if not isinstance(words, list) or not words or not all(isinstance(word, str) for word in words):
        raise table.refuse("type", "command", f"expected a text or a list of texts, got {shown(value)}")
    return tuple(words)


def _environment(table: Table) -> dict[str, str]:
    value = _raw(table, "environment", {})
    if isinstance(value, list):
        for item in value:
            if not isinstance(item, str) or "=" not in item:
                raise table.refuse("type", "environment", f"expected NAME=value, got {shown(item)}")
        value = dict(item.split("=", 1) for item in value)
    variables = Table(value, table.field("environment"), ComposeError)
    result: dict[str, str] = {}
    names = variables.keys()
    for key in names:
        text = variables.raw(key)
        if isinstance(text, bool) or not isinstance(text, str | int | float):
            raise variables.refuse("type", key, f"expected a text or a number, got {text!r}; put it in quotes")
        result[key] = str(text)
    return result


def _depends_on(table: Table) -> tuple[tuple[str, Condition], ...]:
    value = _raw(table, "depends_on", {})
    if isinstance(value, list):
        for item in value:
            if not isinstance(item, str):
                raise table.refuse("type", "depends_on", f"expected names of services, got {shown(item)}")
        return tuple((item, "service_started") for item in value)
    result: list[tuple[str, Condition]] = []
    for key, entry in Table(value, table.field("depends_on"), ComposeError).items():
        condition = entry.text("condition", allowed=("service_started", "service_healthy"))
        entry.close()
        result.append((key, "service_healthy" if condition == "service_healthy" else "service_started"))
    return tuple(result)


def _healthcheck(table: Table, name: str) -> HealthCheck | None:
    if not table.has("healthcheck"):
        return HealthCheck()
    check = table.table("healthcheck")
    disabled = check.flag("disable", default=False)
    test = _raw(check, "test", ["CMD", "surefoot", "health", name])
    words = ["CMD", *shlex.split(test)] if isinstance(test, str) else test
    disabled = disabled or words == ["NONE"]
    if not disabled and words != ["CMD", "surefoot", "health", name]:
        raise check.refuse("value", "test", f"got {test!r}, allowed is [CMD, surefoot, health, {name}]")
    check.has("timeout")
    default = HealthCheck()
    result = HealthCheck(
        interval_s=_duration(check, "interval", default.interval_s),
        retries=check.integer("retries", at_least=1, at_most=1000) if check.has("retries") else default.retries,
        start_period_s=_duration(check, "start_period", default.start_period_s),
    )
    check.close()
    return None if disabled else result


def _restart(table: Table) -> tuple[Restart, int | None]:
    value = _raw(table, "restart", "no")
    if isinstance(value, str) and value.startswith("on-failure:"):
        count = value.removeprefix("on-failure:")
        if count.isdecimal() and 1 <= int(count) <= 1000:
            return "on-failure", int(count)
    match value:
        case False | "no":  # YAML 1.1 reads a bare `no` as false
            return "no", None
        case "always" | "on-failure" | "unless-stopped":
            return value, None
        case _:
            allowed = "no, always, on-failure, on-failure:<n>, unless-stopped"
            raise table.refuse("value", "restart", f"got {shown(value)}, allowed are {allowed}")


def _duration(table: Table, key: str, default: float) -> float:
    """Read `1m30s`, `500ms` or `2s` as seconds."""
    if not table.has(key):
        return default
    value = table.raw(key)
    match = _DURATION.fullmatch(value) if isinstance(value, str) and value else None
    if match is None:
        raise table.refuse("value", key, f"expected a duration such as 500ms, 2s or 1m30s, got {shown(value)}")
    hours, minutes, seconds, millis = (float(part or 0) for part in match.groups())
    return 3600 * hours + 60 * minutes + seconds + millis / 1000


def _raw(table: Table, key: str, default: Any) -> Any:
    return table.raw(key) if table.has(key) else default


def _close(table: Table) -> None:
    """Refuse unknown keys, except the user's own (`x-...`)."""
    keys = table.keys()
    for key in keys:
        if key.startswith("x-"):
            table.has(key)
    table.close()


def _in_order(services: list[ComposeService]) -> tuple[ComposeService, ...]:
    """Sort by dependency, otherwise in the order of the file; refuse unknown names and cycles."""
    names = [service.name for service in services]
    for service in services:
        for needed, _ in service.depends_on:
            if needed not in names:
                where = f"services.{service.name}.depends_on"
                raise ComposeError("unknown_name", where, f"got {needed!r}, the file has {', '.join(names)}")
    ordered: list[ComposeService] = []
    while len(ordered) < len(services):
        placed = {service.name for service in ordered}
        free = [s for s in services if s.name not in placed and all(need in placed for need, _ in s.depends_on)]
        if not free:
            left = [name for name in names if name not in placed]
            where = f"services.{left[0]}.depends_on"
            raise ComposeError("value", where, f"these services wait for each other: {', '.join(left)}")
        ordered += free
    return tuple(ordered)


class _UniqueKeyLoader(yaml.SafeLoader):
    """The safe loader, but a key given twice is an error instead of a silent overwrite."""

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
