"""Hash of all messages of a run: equal for runs of the same seed, on any bus and in any start order of services."""

import hashlib
from collections import Counter
from typing import Any

_HEAD = "{}|{}|{}|".format


class RunHash:
    """Hash of a run: a sha256 per key over (epoch, stamp_ns, seq, bytes), then one over the sorted (key, digest) pairs.

    The messages of a key have one publisher, hence a fixed order; the order between keys does not matter.
    """

    def __init__(self) -> None:
        self._digests: dict[str, Any] = {}
        self.counts: Counter[str] = Counter()

    def update(self, key: str, epoch: int, stamp_ns: int, seq: int, payload: bytes, attachment: bytes | None) -> None:
        """Add a message of a key to the hash, with run number (epoch), stamp, sequence number and bytes.

        Only topics whose content is the same in every run of a seed are to be added.
        """
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
