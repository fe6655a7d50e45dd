"""Result of a fit: numbers with their intervals, by dotted key of the model."""

from dataclasses import dataclass, field

Z95 = 1.959964
"""Half width of the 95 % interval of a normal distribution, in standard deviations."""


@dataclass(frozen=True)
class Interval:
    """Fitted number with its 95 % interval."""

    value: float
    low: float
    high: float
    count: int = 0
    """Number of samples behind the value; 0 = value fitted to all recordings at once, without a count."""


@dataclass
class Fitted:
    """Numbers of a navigation model that were fitted to recordings of a robot."""

    values: dict[str, Interval] = field(default_factory=dict[str, Interval])
    """Fitted value with its interval, by dotted key of the navigation model."""
    undecided: list[str] = field(default_factory=list[str])
    """Dotted model keys that the recordings do not determine; they keep the values of the initial model."""
    runs: int = 0
    """Number of recordings that the fit is made from."""
    sightings: int = 0
    """Number of landmark sightings that were matched to the map, over all recordings."""
    improvement: float = 0.0
    """Gain of the log-likelihood over that of the initial model, nats."""
