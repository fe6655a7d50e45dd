"""Notes of a robot import, `import.json`: names that the robot's parts have in the imported file."""

import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from surefoot.files import read_regular
from surefoot.robot.description import RobotError
from surefoot.tables import FileModel, Text, Vector, Whole, validated

from .untrusted import MOST_BYTES

FILE, SOURCE = "import.json", "source.xml"
"""`FILE`: name of the notes of an import in the robot folder; `SOURCE`: name of the file with the imported XML."""
Mark = tuple[Literal["body", "site", "geom"], Annotated[Whole, Field(ge=0)], Annotated[Whole, Field(ge=-1, le=8)]]


class FootNote(FileModel):
    """Foot in the imported file: its body, its points, and `anchor` (3) m: origin of its link in the body's frame."""

    body: Text
    centre: Annotated[Mark, Field(strict=False)] | None
    spheres: list[Annotated[Mark, Field(strict=False)]]
    anchor: Vector


class MeshNote(FileModel):
    """Mesh for drawing: its file in the robot folder, and its place in the frame of a body of the source, m."""

    file: Text
    body: str
    position: Vector
    quat_wxyz: Annotated[tuple[float, float, float, float], Field(strict=False)]
    scale: Vector


class ImportNotes(FileModel):
    """Notes of a robot import: names of parts in the imported file; values found, assumed and missing, in words."""

    trunk: Text
    joints: dict[str, Text]
    shared: dict[str, Text]
    feet: dict[str, FootNote]
    found: list[str]
    assumed: list[str]
    missing: list[str]
    meshes: list[MeshNote] = Field(default_factory=list)


def read_text(folder: Path, name: str) -> str:
    """Return the content of a text file in a robot folder.

    Raises:
        RobotError: the file is missing or no text.
        FileError: it cannot be opened, is no regular file, or has more than `MOST_BYTES`.
    """
    if not (folder / name).exists():
        needed = f"is not in {folder.name}: a robot made of a file has {FILE} and {SOURCE}"
        raise RobotError("missing", name, needed)
    try:
        return read_regular(folder / name, MOST_BYTES).decode()
    except UnicodeDecodeError as error:
        raise RobotError("syntax", name, f"is no text in UTF-8: byte {error.start} is wrong") from None


def read_notes(folder: Path) -> ImportNotes:
    """Return the notes on a robot import: names in the imported file; values found, assumed and missing.

    Raises:
        RobotError: the notes are not in the folder, or cannot be used.
    """
    text = read_text(folder, FILE)
    try:
        content: Any = json.loads(text)
    except ValueError as error:
        raise RobotError("syntax", FILE, f"is not valid JSON: {error}") from None
    except RecursionError:
        raise RobotError("syntax", FILE, "is not valid JSON: it is nested too deeply") from None
    return validated(ImportNotes, content, RobotError, FILE)
