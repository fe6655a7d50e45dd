"""One number for a whole run: the same seed gives the same hash, on any bus and in any start order."""

import hashlib
from collections import Counter
from typing import Any

_HEAD = "{}|{}|{}|".format


class RunHash:
    """Running sha256 per key over (epoch, stamp_ns, seq, bytes), then one over the sorted (key, digest) pairs.

    One writer per key gives one order per key; the order between keys does not matter.
    """

    def __init__(self) -> None:
        self._digests: dict[str, Any] = {}
        self.counts: Counter[str] = Counter()

    def update(self, key: str, epoch: int, stamp_ns: int, seq: int, payload: bytes, attachment: bytes | None) -> None:
        """Add one message of a deterministic topic."""
        digest = self._digests.get(key)
        if digest is None:
            digest = self._digests[key] = hashlib.sha256()
        digest.update(_HEAD(epoch, stamp_ns, seq).encode() + (attachment or b"") + payload)
        self.counts[key] += 1

    def keys(self) -> dict[str, str]:
        """Return the digest of each key so far, hexadecimal."""
        return {key: digest.hexdigest() for key, digest in sorted(self._digests.items())}

    def hexdigest(self) -> str:
        """Return the hash of the run so far, hexadecimal."""
        total = hashlib.sha256()
        for key, digest in self.keys().items():
            total.update(f"{key}={digest}\n".encode())
        return total.hexdigest()
