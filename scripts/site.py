"""Pages that the site has besides those of docs/: README, examples, changes, and the library from its docstrings.

A hook of mkdocs, which calls the functions by their names.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
MADE = {"index.md": "README.md", "examples.md": "examples/README.md", "changes.md": "CHANGELOG.md"}
"""Page of the site: file of the repository."""
PARTS = ("stability", "estimation", "terrain", "navigation", "robots", "bags", "simulation", "client", "errors")
LINK = re.compile(r'(!?)\[([^\]]*)\]\(([^)\s]+)( "[^"]*")?\)')


def library() -> str:
    """Return the page of the library: a directive for each of its modules."""
    entries = "\n\n".join(f"::: surefoot.{part}" for part in PARTS)
    return f"# Library\n`import surefoot`, numpy in and out.\n\n{entries}\n"


def moved(text: str, folder: str) -> str:
    """Return a text of the repository's `folder` for the top of the site.

    Links to pages of the site lead there; of links to other files the words are left.
    """
    places = {source: page for page, source in MADE.items()}

    def link(match: re.Match[str]) -> str:
        sign, words, target, title = match.groups(default="")
        if "://" in target or target.startswith("#"):
            return match[0]
        path, hash_, anchor = target.partition("#")
        source = (Path(folder) / path).as_posix()
        place = places.get(source) or (source.removeprefix("docs/") if source.startswith("docs/") else "")
        return f"{sign}[{words}]({place}{hash_}{anchor}{title})" if place else f"`{words}`"

    return LINK.sub(link, text)


def on_files(files: Files, config: Any) -> Files:
    """Add the pages to those that mkdocs has found."""
    texts: dict[str, Callable[[], str]] = {"library.md": library}
    for page, source in MADE.items():
        file = ROOT / source
        folder = "" if file.parent == ROOT else file.parent.name
        texts[page] = lambda file=file, folder=folder: moved(file.read_text(encoding="utf-8"), folder)
    for page, text in texts.items():
        files.append(File.generated(config, page, content=text()))
    return files
