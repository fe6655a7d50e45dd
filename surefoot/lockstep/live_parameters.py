"""Queries that return the configuration of a service, and change its live parameters between two ticks."""

from typing import Any

from surefoot.lockstep.config import changed, config_reply
from surefoot.lockstep.service import Service
from surefoot.schemas.system import ConfigReply, ConfigRequest, ConfigureRequest
from surefoot.schemas.topics import CONFIG_GET, CONFIGURE, Query


def config_queries(service: Service[Any]) -> tuple[Query[Any, Any], ...]:
    """Register the handlers of the two queries about the configuration of a service, and return the queries.

    Both run between ticks, so that no tick uses two values. A recording holds a change only as a line of the log, so
    a repetition of the run does not make the change and differs from that tick on.
    """

    def get(_: ConfigRequest) -> ConfigReply:
        return config_reply(service.config)

    def configure(request: ConfigureRequest) -> ConfigReply:
        before = service.config
        service.config = changed(before, service.name, request.values)
        service.on_config()
        for name in request.values:
            service.log("info", f"parameter {name}: {getattr(before, name)!r} -> {getattr(service.config, name)!r}")
        return config_reply(service.config)

    queries = CONFIG_GET.of(service.name), CONFIGURE.of(service.name)
    service.handlers |= {query.key: handler for query, handler in zip(queries, (get, configure), strict=True)}
    return queries
