"""Results of inputs: accepted, or refused with a reason."""

from enum import StrEnum


class InputResult(StrEnum):
    """Result of an input; the first four are accepted, all others are refusals, named by their reason.

    gap: accepted after missing samples; restart: the clock of the source began anew; stepped: its clock stepped back by
    less than the window of late samples; backward: older than the newest where none is missing; late: older than that
    window; ahead: a stamp far in the future; unit: in other units or with the other sign; frame: a position without a
    heading.
    """

    OK = "ok"
    GAP = "gap"  # accepted after missing samples
    RESTART = "restart"  # accepted: the source's clock began anew
    STEPPED = "stepped"  # accepted: the clock stepped back by less than the window; the estimate goes on
    NONFINITE = "nonfinite"
    SHAPE = "shape"
    DUPLICATE = "duplicate"
    BACKWARD = "backward"  # older than the newest where none is missing: the clock steps back
    LATE = "late"  # older than the window in which samples are put in their place
    AHEAD = "ahead"  # a stamp far in the future that nothing confirms
    SATURATED = "saturated"
    UNIT = "unit"  # in other units, or with the other sign
    COVARIANCE = "covariance"  # not symmetric, or not positive
    FRAME = "frame"  # a position without a heading: nothing shows how its frame is turned

    @property
    def accepted(self) -> bool:
        """True if the sample was accepted and is used, False if it was refused."""
        return self in _ACCEPTED


_ACCEPTED = (InputResult.OK, InputResult.GAP, InputResult.RESTART, InputResult.STEPPED)
RESULTS = tuple(InputResult)
"""All results of inputs, by their code in kernels; those up to `STEPPED` are accepted, later ones are refusals."""
OK, GAP, RESTART, STEPPED, NONFINITE, SHAPE, DUPLICATE, BACKWARD, LATE, AHEAD, SATURATED, UNIT, COVARIANCE, FRAME = (
    range(len(RESULTS))
)
