"""Creation and renewal of the certificates and Zenoh settings in the security folder of a system."""

import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from surefoot.bus.certificates import AUTHORITY, Held, held, hosts_of, issue, make_authority
from surefoot.bus.endpoint import SETTINGS, security_folder
from surefoot.disk import whole
from surefoot.errors import SurefootError
from surefoot.lockstep.discover import service_class
from surefoot.lockstep.service import Service
from surefoot.services.supervisor.processes.compose import Compose

from .grants import ROUTER, Role, grants
from .settings import settings_of

AUTHORITY_DAYS = 3650
NAME = re.compile(r"[A-Za-z0-9:][A-Za-z0-9._:-]{0,62}")
"""Pattern that names of people and hosts must match in full, as they become file names and parts of certificates."""


class Membership(NamedTuple):
    """People who get a certificate in addition to the services of a system; hosts and validity of all certificates.

    Attributes:
        operators: names of people who may command.
        guests: names of people who may only read.
        hosts: names and addresses of the machines of the system, in addition to loopback.
        days: validity of the certificates, days.
    """

    operators: tuple[str, ...]
    guests: tuple[str, ...]
    hosts: tuple[str, ...]
    days: int


def make(services: Sequence[type[Service[Any]]], namespace: str, wanted: Membership) -> Path:
    """Write certificates and Zenoh settings of services and people to the security folder of a namespace; return it.

    A certificate authority is created unless the folder has one.

    Raises:
        SurefootError: `cryptography` is not installed, a name is malformed, a person has the name of a service, or a
            person is both operator and guest.
    """
    for field, given in wanted._asdict().items():
        for name in given if isinstance(given, tuple) else ():
            if not NAME.fullmatch(name):
                text = f"got {name!r}, allowed are letters, digits and . _ : - after a letter or digit"
                raise SurefootError("invalid", text, field)
    people = {**dict.fromkeys(wanted.operators, Role.OPERATOR), **dict.fromkeys(wanted.guests, Role.GUEST)}
    names = [ROUTER, *(service.name for service in services if service.name != ROUTER)]
    taken = sorted(set(people) & {*names, AUTHORITY})
    if taken:
        raise SurefootError("invalid", f"{', '.join(taken)}: is the name of a service; people need other names")
    both = sorted({*wanted.operators} & {*wanted.guests})
    if both:
        raise SurefootError("invalid", f"{', '.join(both)}: got operator and guest, allowed is one of them", "guests")
    folder = security_folder(namespace)
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not (folder / f"{AUTHORITY}.key").exists():
        make_authority(folder, namespace, AUTHORITY_DAYS)
    granted = grants(services, people)
    for identity in (*names, *people):
        issue(folder, identity, wanted.days, wanted.hosts)
        with whole(folder / f"{identity}{SETTINGS}") as part:
            content = settings_of(folder, identity, namespace, granted)
            part.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return folder


def classes(compose: Compose) -> list[type[Service[Any]]]:
    """Return the classes of a system's services (raises SurefootError: a service is not installed)."""
    found: list[type[Service[Any]]] = []
    for name in compose.services:
        try:
            found.append(service_class(name))
        except KeyError:
            text = f"service {name!r} of {compose.path} is no installed one, so what it may do is not known"
            raise SurefootError("invalid", text) from None
    return found


def renew(folder: Path, identities: Iterable[str], days: int) -> list[Held]:
    """Issue new certificates for `identities` (all if empty) by the folder's authority, for `days` days; return all."""
    known = {one.identity for one in held(folder)}
    for identity in tuple(identities) or tuple(sorted(known - {AUTHORITY})):
        if identity not in known or identity == AUTHORITY:
            there = ", ".join(sorted(known - {AUTHORITY})) or "none"
            raise SurefootError("invalid", f"{folder} holds no certificate of {identity!r}; there are {there}")
        issue(folder, identity, days, hosts_of(folder, identity))
    return held(folder)
