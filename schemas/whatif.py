"""Requests about the stability of many contact sets at once: with a leg lifted or placed elsewhere, or of any sets."""

from typing import Annotated, ClassVar

from pydantic import Field

from .base import BulkRequest, Reply, Request, Vec2
from .stability import MAX_CONTACTS, Contact, RegionStatus

MAX_SETS = 10_000
MAX_JSON_SETS = 1000

Contacts = Annotated[tuple[Contact, ...], Field(max_length=MAX_CONTACTS)]


class Variant(Reply):
    """Stability of one contact set for one position of the centre of mass."""

    status: RegionStatus = Field(description="as in RegionReply")
    margin: float | None = Field(description="m, signed distance of the CoM to the edge; null: no region, or no edge")
    stable: bool = Field(description="status is ok and margin >= 0")


class WhatifRequest(Request):
    """Asks for the stability without each contact in turn, and with one more contact at each candidate place."""

    contacts: Contacts = Field(description="contacts now")
    com: Vec2 = Field(description="x, y of the centre of mass, frame world, m")
    candidates: Contacts = Field(default=(), description="places for one more foot, each tried alone")


class WhatifReply(Reply):
    """Reply to a what-if request: every variant in the order of the request."""

    now: Variant = Field(description="the contacts as they are")
    lifts: tuple[Variant, ...] = Field(description="for each contact: the set without it")
    candidates: tuple[Variant, ...] = Field(description="for each candidate: the set with it")


class BatchSet(Request):
    """Contact set with the position of its centre of mass."""

    contacts: Contacts = Field(description="contacts")
    com: Vec2 = Field(description="x, y of the centre of mass, frame world, m")


class BatchRequest(BulkRequest):
    """Asks for the stability of many contact sets at once: as ``sets``, or as ``counts`` and raw numbers.

    JSON is limited to 1 MiB and 1000 sets. Raw: the payload is float64, little-endian, x and y of
    the CoM of each set, then for every contact of all sets, one set after the other, position (3), normal (3), mu (inf
    = unlimited); the JSON of this model is the attachment.
    """

    schema_version: ClassVar[str] = "1.1"
    sets: Annotated[tuple[BatchSet, ...], Field(max_length=MAX_JSON_SETS)] = Field(
        default_factory=tuple, description="up to 1000 contact sets"
    )
    counts: Annotated[tuple[Annotated[int, Field(ge=0, le=MAX_CONTACTS)], ...], Field(max_length=MAX_SETS)] = Field(
        default=(), description="raw: contacts of each set; then sets stays empty"
    )


class BatchReply(Reply):
    """Reply to a batch of contact sets: answers in the order of the request."""

    results: tuple[Variant, ...] = Field(description="one answer for each set")
