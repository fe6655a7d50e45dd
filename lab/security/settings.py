"""Zenoh settings of an identity: certificate, mutual TLS, and access rules from the grants, equal for all identities.

A rule applies to the process at the other end of a link, identified by the common name of its certificate: messages
accepted from it (ingress) and messages sent to it (egress). Messages that no rule allows are dropped.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from surefoot.bus.certificates import AUTHORITY

from .grants import ROUTER, Grant, Verb, areas, limits

_INGRESS = {
    Verb.PUBLISH: ("put",),
    Verb.READ: ("declare_subscriber",),
    Verb.ASK: ("query",),
    Verb.SERVE: ("declare_queryable", "reply"),
    Verb.SHOW: ("liveliness_token",),
    Verb.WATCH: ("liveliness_query", "declare_liveliness_subscriber"),
}
_EGRESS = {
    Verb.READ: ("put",),
    Verb.SERVE: ("query",),
    Verb.ASK: ("reply",),
    Verb.WATCH: ("liveliness_token",),
}
_DECLARED = ("declare_subscriber", "declare_queryable", "liveliness_query", "declare_liveliness_subscriber")
"""Zenoh declarations that are sent to every identity, since a publisher that receives none does not publish."""
_ALL = ("put", "delete", "query", "reply", "liveliness_token", *_DECLARED)


def settings_of(folder: Path, identity: str, namespace: str, granted: Sequence[Grant]) -> dict[str, Any]:
    """Return the Zenoh settings of an identity, with its private key and certificate in `folder`, as a JSON object."""
    key, certificate = str(folder / f"{identity}.key"), str(folder / f"{identity}.pem")
    return {
        "transport": {
            "link": {
                "protocols": ["tls"],
                "tls": {
                    "root_ca_certificate": str(folder / f"{AUTHORITY}.pem"),
                    "enable_mtls": True,
                    "verify_name_on_connect": True,
                    "close_link_on_expiration": False,  # a robot that walks is not stopped by a date; doctor warns
                    "listen_private_key": key,
                    "listen_certificate": certificate,
                    "connect_private_key": key,
                    "connect_certificate": certificate,
                },
            }
        },
        "access_control": access_control(namespace, granted),
        "low_pass_filter": [
            {
                "id": f"most-{size}",
                "flows": ["ingress"],
                "messages": ["put", "query", "reply"],
                "key_exprs": _under(namespace, keys),
                "size_limit": size,
            }
            for size, keys in limits().items()
        ],
    }


def access_control(namespace: str, granted: Sequence[Grant]) -> dict[str, Any]:
    """Return the Zenoh access rules of a system: messages that a process accepts from and sends to each identity."""
    everything = _under(namespace, areas(granted))
    rules = [
        _rule("everything", _ALL, ("ingress", "egress"), everything),
        _rule("declared", _DECLARED, ("egress",), everything),
    ]
    policies = [{"rules": ["everything"], "subjects": [ROUTER]}]
    identities = sorted({grant.identity for grant in granted})
    for identity in identities:
        made = ["declared"]
        for flow, verbs in (("ingress", _INGRESS), ("egress", _EGRESS)):
            for verb, messages in verbs.items():
                keys = [grant.key for grant in granted if (grant.identity, grant.verb) == (identity, verb)]
                if keys:
                    made.append(f"{identity}-{verb.value}-{flow}")
                    rules.append(_rule(made[-1], messages, (flow,), _under(namespace, keys)))
        policies.append({"rules": made, "subjects": [identity]})
    subjects = [{"id": name, "cert_common_names": [name]} for name in (ROUTER, *identities)]
    return {
        "enabled": True, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies,
    }  # fmt: skip


def _rule(name: str, messages: Iterable[str], flows: Iterable[str], keys: list[str]) -> dict[str, Any]:
    return {"id": name, "messages": list(messages), "flows": list(flows), "permission": "allow", "key_exprs": keys}


def _under(namespace: str, keys: Iterable[str]) -> list[str]:
    return [f"{namespace}/{key}" for key in keys]
