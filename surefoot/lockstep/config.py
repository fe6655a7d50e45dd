"""Configuration: defaults in the model, then a TOML file, then the environment, then the command line.

``SUREFOOT_<SERVICE>_<FIELD>`` sets one field of one service, ``SUREFOOT_<FIELD>`` (robot, ...) one of all services that
have it. Values are read as TOML where they can be (numbers, booleans, lists), else as text.
"""

import hashlib
import json
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from surefoot.bus.codec import refusal_of
from surefoot.disk import regular_size
from surefoot.errors import ConfigError
from surefoot.schemas.base import Strict
from surefoot.schemas.system import ConfigReply, ServiceParameter

PREFIX = "SUREFOOT_"


class ServiceConfig(Strict):
    """Base of the configurations of services, with the fields that every service has."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    live: ClassVar[tuple[str, ...]] = ()
    """Names of the parameters of the service that may be changed while it runs; others need a restart."""

    robot: str = Field(default="ragno", description="name of a robot description, or path of its folder")


C = TypeVar("C", bound=BaseModel)
S = TypeVar("S", bound=ServiceConfig)


def load_config(
    model: type[C],
    service: str,
    file: Path | None = None,
    environ: Mapping[str, str] | None = None,
    overrides: Iterable[str] = (),
) -> C:
    """Return the validated configuration of a service.

    Args:
        model: configuration model of the service.
        service: name of the service; the TOML file holds one table per service.
        file: TOML file, or None.
        environ: the environment, or None for an empty one.
        overrides: ``field=value`` strings, which override all other sources.

    Raises:
        ConfigError: names the source, the field, the received value and what is allowed.
    """
    values: dict[str, Any] = {}
    if file is not None:
        values.update(_from_file(model, service, file))
    values.update(_from_environment(model, service, environ or {}))
    for item in overrides:
        field, sign, value = item.partition("=")
        if not sign:
            raise ConfigError("invalid", f"{item!r} is not of the form field=value")
        _known(model, field, f"{service}: command line")
        values[field] = value_of(value)
    return _validated(model, service, values)


def changed(config: S, service: str, values: Mapping[str, str]) -> S:
    """Return a copy of a configuration with new values of live parameters, which may change while a service runs.

    Raises:
        ConfigError: a parameter does not exist or is not live, or its value is not allowed.
    """
    model = type(config)
    for name in values:
        _known(model, name, service)
        if name not in model.live:
            text = f"{service}: {name!r} is read at the start only; live are: {', '.join(model.live) or 'none'}"
            raise ConfigError("not_live", text, name)
    given = {name: value_of(text) for name, text in values.items()}
    return _validated(model, service, {**config.model_dump(exclude_unset=True), **given})


def config_reply(config: ServiceConfig) -> ConfigReply:
    """Return the configuration of a service as a message."""
    values = config.model_dump(mode="json")
    rows = tuple(
        ServiceParameter(
            name=name, value=json.dumps(values[name]),
            default=json.dumps(field.get_default(call_default_factory=True)),
            live=name in config.live, meaning=field.description or "",
        )
        for name, field in type(config).model_fields.items()
    )  # fmt: skip
    return ConfigReply(parameters=rows, config_hash=config_hash(config))


def _validated(model: type[C], service: str, values: Mapping[str, Any]) -> C:
    try:
        return model.model_validate(values)
    except ValidationError as error:
        refusal = refusal_of(error, service)
        raise ConfigError(refusal.code, refusal.message, refusal.field) from None


def _from_file(model: type[BaseModel], service: str, file: Path) -> dict[str, Any]:
    try:
        regular_size(file)
        tables = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError("unreadable", f"{file}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ConfigError("malformed", f"{file}: {error}") from None
    table = tables.get(service, {})
    if not isinstance(table, dict):
        raise ConfigError("invalid", f"{file}: {service!r} must be a table, got {table!r}", service)
    values: dict[str, Any] = dict(table)  # pyright: ignore[reportUnknownArgumentType] - TOML tables have str keys
    for field in values:
        _known(model, field, f"{file}: [{service}]")
    return values


def _from_environment(model: type[BaseModel], service: str, environ: Mapping[str, str]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    own = f"{PREFIX}{service.upper()}_"
    for field in model.model_fields:
        for name in (f"{PREFIX}{field.upper()}", f"{own}{field.upper()}"):
            if name in environ:
                values[field] = value_of(environ[name])
    for name in environ:
        if name.startswith(own):
            _known(model, name[len(own) :].lower(), f"environment variable {name}")
    return values


def _known(model: type[BaseModel], field: str, where: str) -> None:
    if field not in model.model_fields:
        allowed = ", ".join(sorted(model.model_fields))
        raise ConfigError("unknown_key", f"{where}: unknown field {field!r}; known are {allowed}", field)


def value_of(text: str) -> Any:
    """Return the value of a text read as TOML, or the text itself if it is not TOML."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError):
        return text


def config_hash(config: BaseModel) -> str:
    """Return the sha256, hexadecimal, of a service's configuration as it is in effect."""
    content = json.dumps(config.model_dump(mode="json"))  # a path may hold bytes that are no UTF-8
    return hashlib.sha256(content.encode()).hexdigest()
