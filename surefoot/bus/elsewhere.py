"""Search for other systems at the router of a client in whose system no service answers, for the error message."""
# pyright: reportUnknownMemberType=false

import json

import zenoh

from surefoot.bus.asking import LIVE, TOKENS_S
from surefoot.bus.endpoint import is_secure
from surefoot.bus.mesh import tokens_of
from surefoot.bus.options import ZenohOptions

JOIN_MS = 1000
"""Limit on the time to open a second session, which shows the services of all namespaces, ms."""


def others_running(session: zenoh.Session, options: ZenohOptions) -> str:
    """Return a text on the systems that run at a session's endpoint if no service lives in the session's namespace.

    The text is empty if services live there, or at a secure endpoint, where each namespace has certificates of its own.
    """
    if tokens_of(session, f"{LIVE}/*/*", TOKENS_S):
        return ""
    if is_secure(options.connect):
        return ""
    config = zenoh.Config()
    settings = {
        "mode": "client",
        "connect/endpoints": list(options.connect),
        "connect/timeout_ms": JOIN_MS,
        "scouting/multicast/enabled": False,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    try:
        with zenoh.open(config) as whole:
            found = {key.rsplit("/", 3)[0] for key in tokens_of(whole, f"**/{LIVE}/*/*", TOKENS_S)}
    except zenoh.ZError:
        return ""
    if not found:
        return "; no system runs at this router"
    return f"; running here: {', '.join(sorted(found))} (<fleet>/<robot>)"
