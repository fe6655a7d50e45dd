"""Endpoints of the router from the command line and the environment, and files of settings for secure endpoints."""

import os
import re
from collections.abc import Iterable
from pathlib import Path

from surefoot.errors import ConfigError
from surefoot.state import user_home

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
SETTINGS = ".json"
"""Suffix of the file with the Zenoh settings of an identity, in the folder of its robot's certificates."""
OPERATOR = "operator"
"""Identity whose certificate tools show at a secure endpoint, unless SUREFOOT_IDENTITY names another."""
_FORM = re.compile(r"(?:tcp|tls|ws)/(\[[0-9A-Fa-f:.]+\]|[^\s/:\[\]]+):(\d{1,5})([?#].*)?")
_NAMESPACE = re.compile(r"[^/*$#?]+(/[^/*$#?]+)*")
_SOURCE = re.compile(r",?\s+at /\S+\.rs:\d+")


def checked(source: str, endpoint: str, *, any_port: bool = False) -> str:
    """Return an endpoint unchanged after a check of its form (raises ConfigError that names ``source``).

    ``any_port``: port 0 is allowed, for a listener that no other process has to find.
    """
    match = _FORM.fullmatch(endpoint) if isinstance(endpoint, str) else None  # pyright: ignore[reportUnnecessaryIsInstance]
    if match is None or not (0 if any_port else 1) <= int(match.group(2)) <= 65535:
        raise ConfigError("invalid", f"{source}: got {endpoint!r}, expected tcp/<host>:<port 1-65535>", source)
    return endpoint


def from_environment(name: str) -> str | None:
    """Return the endpoint of an environment variable, checked; None where it is not set or empty."""
    return checked(name, os.environ[name]) if os.environ.get(name) else None


def checked_namespace(namespace: str) -> str:
    """Return the prefix of a robot's keys unchanged after a check of its form (raises ConfigError)."""
    if not _NAMESPACE.fullmatch(namespace):
        expected = "expected <fleet>/<robot> without *, $, # and ?"
        raise ConfigError("invalid", f"namespace: got {namespace!r}, {expected}", "namespace")
    return namespace


def to_listen(option: str | None = None) -> str:
    """Return the endpoint where a router listens: the option, else SUREFOOT_LISTEN, else the default.

    Raises:
        ConfigError: the text is no endpoint.
    """
    return checked("--listen", option) if option else from_environment("SUREFOOT_LISTEN") or DEFAULT_ENDPOINT


def to_connect() -> str:
    """Return the endpoint where the router is found: SUREFOOT_CONNECT, else SUREFOOT_LISTEN, else the default.

    A shell that has set SUREFOOT_LISTEN for ``surefoot up`` means the same router.

    Raises:
        ConfigError: the text is no endpoint.
    """
    return from_environment("SUREFOOT_CONNECT") or from_environment("SUREFOOT_LISTEN") or DEFAULT_ENDPOINT


def without_source(text: str) -> str:
    """Return an error message of the network library without the references to its source files."""
    return _SOURCE.sub("", text)


def is_secure(endpoints: Iterable[str]) -> bool:
    """Return whether one of the endpoints uses TLS and so needs certificates."""
    return any(endpoint.startswith("tls/") for endpoint in endpoints)


def secured(endpoint: str) -> str:
    """Return the TLS endpoint at the same host and port as an endpoint."""
    return f"tls/{endpoint.partition('/')[2]}"


def any_port(secure: bool) -> str:
    """Return the loopback endpoint with port 0, which lets the system choose the port; ``secure``: with TLS."""
    return f"{'tls' if secure else 'tcp'}/127.0.0.1:0"


def security_folder(namespace: str) -> Path:
    """Return the folder of a robot's certificates and settings: below SUREFOOT_SECURITY or the user's configuration."""
    given, base = os.environ.get("SUREFOOT_SECURITY", ""), os.environ.get("XDG_CONFIG_HOME", "")
    home = Path(base) if os.path.isabs(base) else user_home() / ".config"
    return (Path(given) if given else home / "surefoot" / "security") / namespace


def settings_file(namespace: str, identity: str) -> Path:
    """Return the path of the Zenoh settings of an identity (raises ConfigError that names the remedy: no such file)."""
    path = security_folder(namespace) / f"{identity or os.environ.get('SUREFOOT_IDENTITY') or OPERATOR}{SETTINGS}"
    if not path.is_file():
        text = f"no certificate of {path.stem!r} in {path.parent}; `surefoot security init` makes those of a system"
        raise ConfigError("not_found", text)
    return path
