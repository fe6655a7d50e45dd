"""Record of the navigator's last order, so that no order is obeyed twice, not even after a walker restart."""

from dataclasses import dataclass

from surefoot.schemas.navigation import MotionOrder


@dataclass(frozen=True, slots=True)
class TakenOrder:
    """Number of the navigator's last order that the walker obeyed or refused, with the reason of a refusal."""

    number: int = 0
    """Number of the last navigator order that was taken up; 0 = none yet."""
    refused: str = ""
    """Reason why the order was refused, in words; empty = it was not."""
    known: bool = True
    """True if the last order number is known; False for a walker started in mid-run without its memory, which ignores
    the first order that it receives, as it may be an old one."""
    seen: int = 0
    """Number of the order ignored by a walker started in mid-run without its memory; it counts as taken."""

    def after(self, order: MotionOrder) -> "TakenOrder":
        """Return the record after a message with `order`; its `number` changes if the order is to be obeyed."""
        if not self.known:
            return TakenOrder(self.number, seen=order.number)
        if order.number in (0, self.number, self.seen):
            return self
        return TakenOrder(order.number)
