"""Errors of reading an NPZ file that is damaged, of another program, or made to harm."""

import lzma
import struct
import zipfile
import zlib

BROKEN_NPZ = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, ValueError, EOFError, KeyError, TypeError,
    AttributeError, OverflowError, MemoryError, RuntimeError,
)  # fmt: skip
"""Errors of zip, its ways of packing and numpy, besides OSError, which without an errno is a damaged bzip2 stream.
A member that is encrypted, or packed in a way of another version, raises a RuntimeError."""
