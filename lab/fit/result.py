"""Result of a fit: numbers with their intervals, by dotted key of the model."""

from dataclasses import dataclass, field

Z95 = 1.959964
"""Half of a 95 % interval in standard deviations."""


@dataclass(frozen=True)
class Interval:
    """Fitted number with its 95 % interval."""

    value: float
    low: float
    high: float
    count: int = 0
    """Number of samples; 0 = fitted to all recordings at once, not counted."""


@dataclass
class Fitted:
    """Numbers of a navigation model that were fitted to recordings of a robot."""

    values: dict[str, Interval] = field(default_factory=dict[str, Interval])
    """Numbers by dotted key of the model."""
    undecided: list[str] = field(default_factory=list[str])
    """Keys that the recordings do not decide; they keep the numbers of the first model."""
    runs: int = 0
    """Number of recordings that the fit is made from."""
    sightings: int = 0
    """Number of matched landmarks."""
    improvement: float = 0.0
    """Gain of the log-likelihood over the first model, nats."""
