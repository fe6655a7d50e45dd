"""Errors that reading an NPZ file raises when the file is damaged, of another program, or malicious."""

import lzma
import struct
import zipfile
import zlib
from pathlib import Path

BROKEN_NPZ = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, ValueError, EOFError, KeyError, TypeError,
    AttributeError, OverflowError, MemoryError, RuntimeError,
)  # fmt: skip
"""Exceptions, besides OSError, that reading a damaged, encrypted or unsupported NPZ file may raise."""

MAGIC = b"PK\x03\x04"
"""First bytes of an NPZ file, which is a zip archive: the signature by which it is recognised."""


def damage_of(path: Path) -> str:
    """Return what is wrong with a file whose reading raised one of `BROKEN_NPZ`: a text to follow the file's name."""
    with path.open("rb") as file:
        head = file.read(len(MAGIC))
    if head == MAGIC:
        return "is cut off, damaged, or holds objects that are neither numbers nor text"
    return f"begins with {head!r}, allowed is an NPZ file: {MAGIC!r}" if head else "is empty"
