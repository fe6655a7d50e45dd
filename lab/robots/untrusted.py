"""Checks of XML of unknown origin before another program reads it: size, declarations, and files that it names."""

import re
from pathlib import PurePosixPath, PureWindowsPath
from xml.etree import ElementTree

from surefoot.robot.description import RobotError
from surefoot.tables import shown

MOST_BYTES = 16 * 1024 * 1024
"""Largest size of a robot file with all that it includes, bytes; larger ones are refused (many geoms are 1 MB)."""
MOST_ELEMENTS, MOST_DEPTH = 50_000, 200
"""`MOST_ELEMENTS`: largest number of XML elements in a robot file; `MOST_DEPTH`: their largest depth."""
ENCODINGS = ("utf-8", "us-ascii", "ascii", "iso-8859-1", "latin-1", "windows-1252")
"""Encodings of a robot file; in each of them a declaration has the bytes of ASCII, by which it is found."""
OPENED = {
    "include": "a source whose included files are in place",
    "model": "one file; what works instead: the whole model as MuJoCo saves it (MjSpec.to_xml)",
    "flexcomp": "rigid bodies; remove it in a copy",
}
"""Allowed in the place of an MJCF element whose file MuJoCo opens while it reads the text, by tag."""


def parsed(content: bytes, field: str = "file") -> ElementTree.Element:
    """Return the root of an XML text; `field`: what an error names.

    Raises:
        RobotError: the text is no XML, is too large or too deep, or declares a document type or an entity.
    """
    if len(content) > MOST_BYTES:
        raise RobotError("value", field, f"got {len(content)} bytes, allowed are {MOST_BYTES}")
    declared = re.search(rb"<!\s*(DOCTYPE|ENTITY)", content)
    if declared:
        word = declared[1].decode()
        raise RobotError("value", field, f"got a {word} declaration, allowed is XML without DOCTYPE and ENTITY")
    if b"\0" in content:
        raise RobotError("syntax", field, "got bytes of zero, allowed is XML in UTF-8")
    encoding = re.match(rb"\s*<\?xml[^>]*encoding\s*=\s*[\"']([^\"']*)", content.removeprefix(b"\xef\xbb\xbf"))
    if encoding and (name := encoding[1].decode("latin-1").lower()) not in ENCODINGS:
        raise RobotError("value", field, f"got encoding {shown(name)}, allowed are {', '.join(ENCODINGS)}")
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise RobotError("syntax", field, f"got text that is no XML ({error}), allowed are MJCF and URDF") from None
    check_size(root)
    return root


def check_size(root: ElementTree.Element) -> None:
    """Raise RobotError if the XML has more than `MOST_ELEMENTS` elements, or nesting deeper than `MOST_DEPTH`."""
    level, depth, count = [root], 0, 0
    while level:
        depth, count = depth + 1, count + len(level)
        if depth > MOST_DEPTH or count > MOST_ELEMENTS:
            most = f"{MOST_DEPTH} levels of" if depth > MOST_DEPTH else str(MOST_ELEMENTS)
            raise RobotError("value", "file", f"got more than {most} elements, allowed are fewer")
        level = [child for element in level for child in element]


def check_files(root: ElementTree.Element) -> None:
    """Raise RobotError for a path that leaves the robot's folder, and for a file that MuJoCo would open.

    Absolute paths of the meshes of a URDF are accepted, since those are removed before MuJoCo reads the text.
    """
    for element in root.iter():
        for key, name in element.attrib.items():
            if not key.startswith("file"):
                continue
            field, parts = f"{element.tag}.{key}", re.split(r"[/\\]", name)
            absolute = PurePosixPath(name).is_absolute() or bool(PureWindowsPath(name).anchor)
            if ".." in parts or (absolute and root.tag != "robot"):
                raise RobotError("value", field, f"got {shown(name)}, allowed is a path below the folder of the file")
            if element.tag in OPENED:
                raise RobotError("value", field, f"got {shown(name)}, allowed is {OPENED[element.tag]}")
