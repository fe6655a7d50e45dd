"""Outcomes of chosen footholds: slip of each stance, sent to the foothold service with the next request."""

from surefoot.schemas.footholds import LegFoothold, LegRequest, StanceOutcome

MOST = 32
"""Largest number of stance outcomes that wait for the next foothold request; older ones are dropped."""
Choice = tuple[LegRequest, tuple[float, float]]


class Outcomes:
    """Chosen footholds of each leg, with slip and sensor state in the stances on them.

    A choice is made before its leg lifts off, so the stance that ends next is that of the choice before.
    """

    def __init__(self) -> None:
        self._chosen: dict[str, Choice] = {}
        self._standing: dict[str, Choice] = {}
        self._ended: list[StanceOutcome] = []

    def chose(self, asked: LegRequest, reply: LegFoothold) -> None:
        """Record the choice of a foothold; one that was never stepped on is replaced by the next."""
        if reply.status == "ok" and reply.foothold is not None:
            self._chosen[asked.leg] = (asked, (reply.foothold[0], reply.foothold[1]))
        else:
            self._chosen.pop(asked.leg, None)

    def ended(self, leg: str, slip: float, healthy: bool = True) -> None:
        """Record the end of a leg's stance: distance that the foot slid, m, and True if its sensors were sound."""
        standing = self._standing.pop(leg, None)
        if leg in self._chosen:
            self._standing[leg] = self._chosen.pop(leg)
        if standing is None:
            return
        asked, foothold = standing
        nominal = (asked.nominal[0], asked.nominal[1])
        outcome = StanceOutcome(
            leg=leg, foothold=foothold, nominal=nominal, stroke=asked.stroke, slip=slip, healthy=healthy
        )
        self._ended = [*self._ended, outcome][-MOST:]

    def take(self) -> tuple[StanceOutcome, ...]:
        """Return the outcomes of the stances that ended since the last call, and clear them."""
        found, self._ended = tuple(self._ended), []
        return found
