"""What a fit found: numbers with their intervals, by dotted key of the model."""

from dataclasses import dataclass, field

Z95 = 1.959964
"""Half of a 95 % interval in standard deviations."""


@dataclass(frozen=True)
class Interval:
    """A number and its 95 % interval."""

    value: float
    low: float
    high: float
    count: int = 0
    """Samples it comes from; 0 where all recordings together decide."""


@dataclass
class Fitted:
    """What recordings say about a robot."""

    values: dict[str, Interval] = field(default_factory=dict[str, Interval])
    """Numbers by dotted key of the model."""
    undecided: list[str] = field(default_factory=list[str])
    """Keys of which the recordings say too little; the model to begin with keeps its numbers."""
    runs: int = 0
    """Recordings used."""
    sightings: int = 0
    """Landmarks matched in all."""
    improvement: float = 0.0
    """nats by which the recordings became likelier against the model to begin with."""
