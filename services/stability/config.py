"""Configuration of the stability service."""

from pydantic import Field

from surefoot.lockstep.config import ServiceConfig

from .sensing.state import WatchParams


class StabilityConfig(ServiceConfig):
    """Settings of the stability service: friction of the ground, and accuracy of the status that is published."""

    live = ("mu", "tolerance_m", "directions", "measured_com")

    mu: float = Field(  # the limit of a contact in a request, MAX_MU
        default=0.6, ge=0, le=10_000, description="friction coefficient taken for every foot while walking, no unit"
    )
    tolerance_m: float = Field(
        default=1e-3, gt=0, le=1, description="m, accuracy of the region in state/stability (margins are exact)"
    )
    directions: int = Field(default=24, ge=8, le=128, description="at most so many directions for that region")
    measured_com: bool = Field(default=True, description="work out the CoM from joint torques when they are measured")

    def watch(self) -> WatchParams:
        """Return the parameters of the status that is published while the robot walks."""
        return WatchParams(mu=self.mu, tolerance=self.tolerance_m, directions=self.directions)
