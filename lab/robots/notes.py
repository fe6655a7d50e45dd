"""Notes of an import, `import.json`: names of a robot's parts in the file that it was made of."""

import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from surefoot.robot.description import RobotError
from surefoot.tables import FileModel, Text, Vector, Whole, validated

FILE, SOURCE = "import.json", "source.xml"
"""File names in the folder of an imported robot: `FILE`: notes of the import; `SOURCE`: XML of the robot."""
Mark = tuple[Literal["body", "site", "geom"], Annotated[Whole, Field(ge=0)], Annotated[Whole, Field(ge=-1, le=1)]]


class FootNote(FileModel):
    """Foot in the imported file: its body and the points that form it, m, relative to the joint's body."""

    body: Text
    centre: Annotated[Mark, Field(strict=False)] | None
    spheres: list[Annotated[Mark, Field(strict=False)]]
    anchor: Vector


class ImportNotes(FileModel):
    """Notes of an import: names of a robot's parts in its file, and what was found, assumed and missing, in words."""

    trunk: Text
    joints: dict[str, Text]
    shared: dict[str, Text]
    feet: dict[str, FootNote]
    found: list[str]
    assumed: list[str]
    missing: list[str]


def read_text(folder: Path, name: str) -> str:
    """Return a text file of a robot's folder (raises RobotError: it is missing, cannot be read or is no text)."""
    try:
        return (folder / name).read_text(encoding="utf-8")
    except FileNotFoundError:
        needed = f"is not in {folder.name}: a robot made of a file has {FILE} and {SOURCE}"
        raise RobotError("missing", name, needed) from None
    except UnicodeDecodeError as error:
        raise RobotError("syntax", name, f"is no text in UTF-8: byte {error.start} is wrong") from None
    except OSError as error:
        raise RobotError("value", name, f"cannot be read: {error.strerror}") from None


def read_notes(folder: Path) -> ImportNotes:
    """Return the notes of an imported robot: its parts in the imported file, and what was found, assumed and missing.

    Raises:
        RobotError: they are not in the folder, or cannot be used.
    """
    text = read_text(folder, FILE)
    try:
        content: Any = json.loads(text)
    except ValueError as error:
        raise RobotError("syntax", FILE, f"is not valid JSON: {error}") from None
    except RecursionError:
        raise RobotError("syntax", FILE, "is not valid JSON: it is nested too deeply") from None
    return validated(ImportNotes, content, RobotError, FILE)
