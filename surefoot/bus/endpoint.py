"""Where the router is: endpoints as the command line and the environment give them."""

import os
import re
from collections.abc import Mapping

from surefoot.errors import ConfigError

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
_FORM = re.compile(r"(?:tcp|tls|ws)/(\[[0-9A-Fa-f:.]+\]|[^\s/:\[\]]+):(\d{1,5})([?#].*)?")
_NAMESPACE = re.compile(r"[^/*$#?]+(/[^/*$#?]+)*")
_SOURCE = re.compile(r",?\s+at /\S+\.rs:\d+")


def checked(source: str, endpoint: str, *, any_port: bool = False) -> str:
    """The endpoint itself (raises ConfigError naming ``source``, what came and the form expected).

    ``any_port``: port 0 will do, for a listener that no other process has to find.
    """
    match = _FORM.fullmatch(endpoint)
    if match is None or not (0 if any_port else 1) <= int(match.group(2)) <= 65535:
        raise ConfigError("invalid", f"{source}: got {endpoint!r}, expected tcp/<host>:<port 1-65535>", source)
    return endpoint


def from_environment(names: tuple[str, ...], environ: Mapping[str, str] | None = None) -> str | None:
    """The first of these variables that is set and not empty, checked; None when there is none."""
    environ = os.environ if environ is None else environ
    return next((checked(name, environ[name]) for name in names if environ.get(name)), None)


def checked_namespace(namespace: str) -> str:
    """The prefix of a robot's keys itself (raises ConfigError naming what came and the form expected)."""
    if not _NAMESPACE.fullmatch(namespace):
        expected = "expected <fleet>/<robot> without *, $, # and ?"
        raise ConfigError("invalid", f"namespace: got {namespace!r}, {expected}", "namespace")
    return namespace


def to_listen(option: str | None = None) -> str:
    """Where a router listens: ``--listen``, else SUREFOOT_LISTEN, else the default (raises ConfigError)."""
    return checked("--listen", option) if option else from_environment(("SUREFOOT_LISTEN",)) or DEFAULT_ENDPOINT


def to_connect() -> str:
    """Where clients and services find the router: SUREFOOT_CONNECT, SUREFOOT_LISTEN, the default (raises ConfigError).

    Who has set SUREFOOT_LISTEN for ``surefoot up`` means the same router in the same shell.
    """
    return from_environment(("SUREFOOT_CONNECT", "SUREFOOT_LISTEN")) or DEFAULT_ENDPOINT


def without_source(text: str) -> str:
    """A message of the network library without the places in its own source code."""
    return _SOURCE.sub("", text)
