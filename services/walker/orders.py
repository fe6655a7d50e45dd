"""Record of the navigator's last order, by which none is obeyed twice, not even after a restart of the walker."""

from dataclasses import dataclass

from surefoot.schemas.navigation import MotionOrder


@dataclass(frozen=True, slots=True)
class TakenOrder:
    """Number of the navigator's last order that the walker obeyed or refused, with the reason of a refusal."""

    number: int = 0
    """Number of the order; 0 = none yet."""
    refused: str = ""
    """Reason why the order was refused, in words; empty = it was not."""
    known: bool = True
    """False: of a walker that was started in mid-run without its memory. The first order that it sees may be an old
    one, so it is not obeyed."""
    seen: int = 0
    """Number of the first order that such a walker saw, which counts as taken."""

    def after(self, order: MotionOrder) -> "TakenOrder":
        """Return the record after a message with `order`, with another `number` if the order is to be obeyed."""
        if not self.known:
            return TakenOrder(self.number, seen=order.number)
        if order.number in (0, self.number, self.seen):
            return self
        return TakenOrder(order.number)
