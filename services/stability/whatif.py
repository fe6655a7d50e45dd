"""What if a leg is lifted, or a foot is set down there: status and margin of every variant in one call."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from services.stability.contacts import Array, ContactSet
from services.stability.margin import Margin, margin
from services.stability.region import RegionStatus, region

COARSE = 1e6  # m; margins find their own directions, so the region need not be refined


@dataclass(frozen=True, slots=True)
class Variant:
    """A contact set in place of the present one."""

    status: RegionStatus
    margin: Margin

    @property
    def stable(self) -> bool:
        """The region has an area and the CoM lies in it."""
        return self.status == "ok" and self.margin.value is not None and self.margin.value >= 0.0


def assess(contacts: ContactSet, com: Array) -> Variant:
    """Status and margin of a contact set for a CoM (2,) m."""
    found = region(contacts, tolerance=COARSE)
    return Variant(found.status, margin(found, com))


def lifts(contacts: ContactSet, com: Array) -> list[Variant]:
    """For each contact: the set without it."""
    return [assess(contacts.without(i), com) for i in range(len(contacts))]


def additions(contacts: ContactSet, candidates: ContactSet, com: Array) -> list[Variant]:
    """For each candidate: the set with it."""
    out: list[Variant] = []
    for i in range(len(candidates)):
        pairs = ((contacts.position, candidates.position), (contacts.normal, candidates.normal))
        position, normal = (np.concatenate((a, b[i : i + 1])) for a, b in pairs)
        out.append(assess(ContactSet(position, normal, np.append(contacts.mu, candidates.mu[i])), com))
    return out


def batch(sets: Sequence[tuple[ContactSet, Array]]) -> list[Variant]:
    """Many contact sets, each with its CoM."""
    return [assess(contacts, com) for contacts, com in sets]
