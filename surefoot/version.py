"""Version of the distribution, and a text on the platform, on which the last bits of its results depend."""

import math
from functools import cache

VERSION = "0.1.0"


@cache
def numbers() -> str:
    """Return a text on what the bits of a run depend on besides the code: processor type and C library functions.

    A C library has several versions of sine, exponential and the like and chooses by the processor: with fused
    multiply-add their last bits differ. They are named by a digest of 4096 of their values.
    """
    import hashlib  # here: every command and service asks for the version, few for this
    import platform
    import struct

    values: list[float] = []
    for k in range(512):
        x = math.ldexp(1.0 + 0.61803398875 * k % 1.0, k % 12 - 8)
        values += math.sin(x), math.cos(x), math.tan(x), math.asin(x / 16.0), math.atan2(x, 0.7)
        values += math.exp(x), math.log(x), math.pow(x, 1.7)
    return f"{platform.machine()}, functions {hashlib.sha256(struct.pack('<4096d', *values)).hexdigest()[:8]}"
