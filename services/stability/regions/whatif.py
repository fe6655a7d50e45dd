"""What if a leg is lifted, or a foot is set down there; and batches: the questions that `many` answers in one call."""

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..programs.contacts import (
    MAX_CONTACTS,
    MAX_COORDINATE,
    Array,
    ContactSet,
    StabilityError,
    contact_set,
    within,
)
from .many import Ints, Variants, assess


@dataclass(frozen=True, slots=True)
class Batch:
    """Contact sets laid one after the other, each with its CoM."""

    contacts: ContactSet
    """All contacts."""
    begin: Ints
    """(s + 1,) where each set begins, and the end."""
    com: Array
    """(s, 2) m."""


def pack(position: ArrayLike, normal: ArrayLike, mu: ArrayLike, counts: ArrayLike, com: ArrayLike) -> Batch:
    """Check and normalise many sets at once.

    Args:
        position: (n, 3) m, of the contacts of all sets, one set after the other.
        normal: (n, 3), any length but zero.
        mu: (n,) or one number for all; inf = unlimited.
        counts: (s,) contacts of each set.
        com: (s, 2) m.

    Raises:
        StabilityError: names the set and its contact, as in `sets.7.contacts.2.normal`.
    """
    c, each = np.array(com, dtype=np.float64).reshape(-1, 2), np.array(counts, dtype=np.int64).reshape(-1)
    begin = np.concatenate((np.zeros(1, dtype=np.int64), np.cumsum(each)))
    p = np.asarray(position, dtype=np.float64).reshape(-1, 3)
    if each.size != len(c) or begin[-1] != len(p) or (each < 0).any():
        raise StabilityError("shape", "counts", f"{each.size} counts of {begin[-1]} contacts, got {len(c)}, {len(p)}")
    for i in np.flatnonzero(each > MAX_CONTACTS):
        allowed = f"at most {MAX_CONTACTS} are allowed"
        raise StabilityError("too_many", f"sets.{i}.contacts", f"got {each[i]} contacts, {allowed}")
    for i in np.flatnonzero(~np.isfinite(c).all(axis=1)):
        raise StabilityError("not_finite", f"sets.{i}.com", f"got {c[i].tolist()}, must be finite")
    if not (np.abs(c) <= MAX_COORDINATE).all():
        for i, place in enumerate(c):
            within(place, f"sets.{i}.com")
    try:
        return Batch(contact_set(p, normal, mu, limit=len(p)), begin, c)
    except StabilityError as error:
        raise StabilityError(error.code, _place(error.field, begin), error.message) from None


def _place(field: str, begin: Ints) -> str:
    """`contacts.17.normal` of the pool as a field of the set it belongs to."""
    parts = field.split(".")
    if len(parts) < 2:
        return field
    k = int(parts[1])
    s = int(np.searchsorted(begin, k, side="right")) - 1
    return ".".join((f"sets.{s}.contacts", str(k - int(begin[s])), *parts[2:]))


def batch(sets: Batch, threads: int | None = None) -> Variants:
    """Status and margin of every set, on all cores unless told how many; the answers are the same on any number."""
    index = np.arange(len(sets.contacts))
    return assess(sets.contacts, index, sets.begin, sets.com, threads=threads or os.cpu_count() or 1)


def what_if(contacts: ContactSet, com: Array, candidates: ContactSet | None = None) -> Variants:
    """The set as it is, without each of its contacts, and with each of the candidates added, in this order.

    Args:
        contacts: n contacts now.
        com: (2,) m.
        candidates: m places for one more foot, each tried alone.
    """
    n, m, pool = len(contacts), 0, contacts
    if candidates is not None and len(candidates):
        m = len(candidates)
        pool = ContactSet(
            np.concatenate((contacts.position, candidates.position)),
            np.concatenate((contacts.normal, candidates.normal)),
            np.concatenate((contacts.mu, candidates.mu)),
        )
    all_of = np.arange(n)
    left = np.tile(all_of, (n, 1))[~np.eye(n, dtype=np.bool_)]
    more = np.column_stack((np.tile(all_of, (m, 1)), n + np.arange(m))).ravel()
    size = np.concatenate(([0, n], np.full(n, n - 1), np.full(m, n + 1)))
    return assess(pool, np.concatenate((all_of, left, more)), np.cumsum(size), np.tile(com, (1 + n + m, 1)))
