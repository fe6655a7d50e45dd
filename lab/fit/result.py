"""Result of a fit: values with their 95 % intervals, by dotted key of the navigation model."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Interval:
    """Fitted value and the ends of its 95 % interval, in the unit of its key in the navigation model."""

    value: float
    low: float
    high: float
    count: int = 0
    """Number of samples from which the value was computed; 0 = fitted to all recordings at once."""


@dataclass
class Fitted:
    """Parameters of a navigation model that were fitted to recordings of a robot."""

    values: dict[str, Interval] = field(default_factory=dict[str, Interval])
    """Fitted value with its interval, by dotted key of the navigation model."""
    undecided: list[str] = field(default_factory=list[str])
    """Dotted model keys that the recordings do not determine; they keep the values of the initial model."""
    runs: int = 0
    """Number of recordings used in the fit."""
    sightings: int = 0
    """Number of landmark sightings that were matched to the map, over all recordings."""
    improvement: float = 0.0
    """Increase of the log-likelihood from the initial to the fitted model, nats."""
