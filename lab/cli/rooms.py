"""Commands that the subfolders of `lab`, and the papers, add to the command line, each by its own `commands.py`."""

from importlib import import_module

import typer

from surefoot.disk import PACKAGE

INSTALL_PAPERS = "pip install ./papers"
"""Shell command that installs the optional `papers` package from a checkout of the repository."""


def room_modules() -> list[str]:
    """Return the modules below `surefoot.lab`, each with a typer `app`, that subfolders add to the command line."""
    return [f"{path.parent.name}.commands" for path in sorted(PACKAGE.glob("lab/*/commands.py"))]


def paper_commands() -> typer.Typer:
    """Return the typer `app` of the `papers` package, or a stand-in if it is not installed."""
    if (PACKAGE / "papers" / "commands.py").is_file():
        return import_module("surefoot.papers.commands").app
    return without_papers


without_papers = typer.Typer()


@without_papers.command("reproduce", context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
def reproduce(context: typer.Context) -> None:
    """Reproduce the figures and numbers of a paper (needs the `papers` package, which is not installed)."""
    from surefoot.errors import SurefootError

    from .output import use_json

    use_json("--json" in context.args)
    raise SurefootError(
        "not_installed", f"the papers are not installed; in a checkout of surefoot: {INSTALL_PAPERS}", "reproduce"
    )
