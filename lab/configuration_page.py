"""Generator of the page docs/configuration.md, which lists all parameters of all services, and of the gaits.

Run by `python -m surefoot.lab.configuration_page > docs/configuration.md`.
"""

import json
import sys
from typing import Any, get_args

from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from surefoot.files import PACKAGE
from surefoot.lockstep.config import PREFIX
from surefoot.lockstep.discover import own_service_names, service_class
from surefoot.services.supervisor.processes.compose import load_compose
from surefoot.services.supervisor.scenarios.scenario import load_scenario
from surefoot.services.walker.biped.params import BipedParams
from surefoot.services.walker.legged.params import WalkerParams

from .topics_page import table

ROOT = PACKAGE.parent

_HEAD = """# Configuration
Generated from the `Config` of each service; do not edit. After a change of one:
`python -m surefoot.lab.configuration_page > docs/configuration.md`.

A parameter gets its value from, the later the stronger:
1. the default below;
2. a TOML file with one table per service: `surefoot-service walker --config my.toml`;
3. the environment: `SUREFOOT_<SERVICE>_<FIELD>` for one service, `SUREFOOT_<FIELD>` for every service that has it. A
   compose file sets variables in `environment`, a scenario in `[config.<service>]`; that of the compose file is the
   stronger one;
4. the command line of the service: `surefoot-service walker --set stride_m=0.05`.

Values are read as TOML where they can be (numbers, booleans, lists), else as text. A wrong value is refused before
anything starts. Numbers of a robot are in its `robot.toml`, those of a run in its scenario: `surefoot schema file
robot`, `surefoot schema file scenario`; numbers of a gait are at the end of this page. The last column names the files
of `compose/` and `scenarios/` that set the parameter.

A parameter that is live can be changed while its service runs, between two ticks: `surefoot param set SERVICE PARAMETER
VALUE`. It lasts until the service ends; a recording holds the change as a line of the log, and a repeat of that run
differs from there on.
"""
_COLUMNS = ("parameter", "default", "allowed", "unit and meaning", "set in")
_GAITS = {"four or six legs": WalkerParams, "two legs": BipedParams}
_GAIT = """## Gait of robots with {}
Table `[gait]` of `robot.toml`. A parameter without a default must stand there; other names are refused.

"""
_SIGNS = {"ge": ">=", "gt": ">", "le": "<=", "lt": "<"}


def page() -> str:
    """Return the page docs/configuration.md as Markdown: every parameter of every service."""
    used, parts = _used(), [_HEAD]
    for service in own_service_names():
        kind = service_class(service).Config
        fields: dict[str, FieldInfo] = kind.model_fields
        rows = [
            (
                f"`{name}`",
                _default(field),
                _allowed(field, name in kind.live),
                field.description or "",
                _files(used, service, name),
            )
            for name, field in fields.items()
        ]
        parts.append(f"## {service}\n`SUREFOOT_{service.upper()}_<PARAMETER>`\n\n{table(_COLUMNS, rows)}")
    for legs, model in _GAITS.items():
        rows = [
            (f"`{name}`", _default(field), _allowed(field, False), field.description or "")
            for name, field in model.model_fields.items()
            if field.annotation in (float, int)
        ]
        parts.append(_GAIT.format(legs) + table(_COLUMNS[:-1], rows))
    return "\n".join(parts)


def _default(field: FieldInfo) -> str:
    default = field.get_default(call_default_factory=True)
    return "" if default is PydanticUndefined else f"`{json.dumps(default)}`"


def _allowed(field: FieldInfo, live: bool) -> str:
    """Return the allowed values of a parameter as text: type, range or words, null, and `live` if `live`."""
    limits = [f"{_SIGNS[name]} {value}" for part in field.metadata for name, value in _limits(part)]
    kinds = get_args(field.annotation)
    words = [f"`{kind}`" for kind in kinds if isinstance(kind, str)]
    types = [kind.__name__ for kind in kinds or (field.annotation,) if isinstance(kind, type)]
    null = ["null"] if "NoneType" in types else []
    plain = [name for name in types if name != "NoneType"] if not words else []
    return ", ".join([*plain, *words, *limits, *null, *["live"] * live])


def _limits(part: Any) -> list[tuple[str, float]]:
    return [(name, getattr(part, name)) for name in _SIGNS if hasattr(part, name)]


def _used() -> dict[tuple[str, str], set[str]]:
    """Return the names of the scenario and compose files that set each parameter, by (service, parameter)."""
    found: dict[tuple[str, str], set[str]] = {}
    for path in sorted((ROOT / "scenarios").glob("*.toml")):
        for service, fields in load_scenario(path).config.items():
            for name in fields:
                found.setdefault((service, name), set()).add(path.stem)
    for path in sorted((ROOT / "compose").glob("*.yaml")):
        for service in load_compose(path).services.values():
            for variable in service.environment:
                name = variable.removeprefix(PREFIX).lower().removeprefix(f"{service.name}_")
                found.setdefault((service.name, name), set()).add(path.name)
    return found


def _files(used: dict[tuple[str, str], set[str]], service: str, name: str) -> str:
    return ", ".join(sorted(used.get((service, name), ())))


if __name__ == "__main__":
    sys.stdout.write(page())
