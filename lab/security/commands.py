"""Commands `surefoot security init|renew|show`: certificates and access rules of a system."""

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer

from ..cli.output import Json, use_json, write, write_json, write_table
from ..cli.progress import Progress

if TYPE_CHECKING:
    from surefoot.bus.certificates import Held
    from surefoot.services.supervisor.processes.compose import Compose

app = typer.Typer(name="security", help="Certificates of a system's processes and people.", no_args_is_help=True)
System = Annotated[str, typer.Argument(help="Name of a compose file or its path.")]
Days = Annotated[int, typer.Option(min=1, max=3650, help="Days until the certificates end.")]


@app.command()
def init(
    system: System = "ragno",
    operator: Annotated[list[str] | None, typer.Option(help="Who may command; several allowed [operator].")] = None,
    guest: Annotated[list[str] | None, typer.Option(help="Who may look; several allowed [guest].")] = None,
    host: Annotated[list[str] | None, typer.Option(help="Name or address beside loopback; several allowed.")] = None,
    days: Days = 365,
    json: Json = False,
) -> None:
    """Make a private authority, a certificate for each service and person, and the Zenoh settings of each."""
    use_json(json)
    with Progress(f"certificates of {system}", "those that were made are kept; the same command makes all anew"):
        from surefoot.bus.certificates import held

        from .made import Membership, classes, make

        compose = _load(system)
        people = tuple(operator or ["operator"]), tuple(guest or ["guest"])
        folder = make(classes(compose), _namespace(compose), Membership(*people, tuple(host or ()), days))
        found = held(folder)
    if json:
        write_json({"folder": str(folder), "identities": [one.identity for one in found]})
        return
    write(f"{folder}: certificates of {', '.join(one.identity for one in found)}")
    write(f"start the system with `surefoot up {quote(system)} --secure`; keep {folder / 'ca.key'} to yourself")


@app.command()
def renew(
    identity: Annotated[list[str] | None, typer.Argument(help="Services and people [all].")] = None,
    system: Annotated[str, typer.Option(help="Name of a compose file or its path.")] = "ragno",
    days: Days = 365,
    json: Json = False,
) -> None:
    """Issue certificates anew under the same authority; a service uses its own from its next start on."""
    from .made import renew as renewed

    use_json(json)
    _show(renewed(_folder(system), identity or (), days), json=json)


@app.command()
def show(
    system: System = "ragno",
    grants: Annotated[bool, typer.Option("--grants", help="Show what each may do on which key.")] = False,
    json: Json = False,
) -> None:
    """Show the certificates of a system and when they end."""
    from surefoot.bus.certificates import held

    from .grants import Role
    from .grants import grants as granted
    from .made import classes

    use_json(json)
    if not grants:
        _show(held(_folder(system)), json=json)
        return
    found = granted(classes(_load(system)), {role.value: role for role in Role})
    if json:
        write_json([{"identity": one.identity, "verb": one.verb.value, "key": one.key} for one in found])
        return
    write_table(("identity", "verb", "key"), [(one.identity, one.verb.value, one.key) for one in found])


def _show(found: "list[Held]", *, json: bool) -> None:
    from surefoot.errors import SurefootError

    if not found:
        raise SurefootError("not_found", "there are no certificates; `surefoot security init` makes those of a system")
    rows = [(one.identity, one.until.date().isoformat(), one.days) for one in found]
    if json:
        write_json([{"identity": name, "until": until, "days": days} for name, until, days in rows])
    else:
        write_table(("identity", "until", "days"), rows, right=(2,))


def _load(system: str) -> "Compose":
    from surefoot.services.supervisor.processes.compose import load_compose

    return load_compose(system)


def _namespace(compose: "Compose") -> str:
    from surefoot.services.supervisor.processes.session import namespace_of

    return namespace_of(compose.robot)


def _folder(system: str) -> Path:
    from surefoot.bus.endpoint import security_folder

    return security_folder(_namespace(_load(system)))
