"""Errors of reading an NPZ file that is damaged, of another program, or made to harm."""

import lzma
import struct
import zipfile
import zlib

BROKEN_NPZ = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, ValueError, EOFError, KeyError, TypeError,
    AttributeError, OverflowError, MemoryError, RuntimeError,
)  # fmt: skip
"""What zip, its ways of packing and numpy raise, besides OSError: without an errno, a bzip2 stream is damaged. Of
RuntimeError are members that are encrypted, or packed in a way of another version."""
