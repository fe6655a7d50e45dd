"""Interface of slip models: the hand-made score and the learned ones."""

from typing import Protocol

from ..features import Features, Layer

UNLEARNED = -1.0
"""Value that marks a cell whose ground lies outside what a model has learned, in place of its predicted slip P; other
values outside [0, 1] are artefacts of a fit."""


class SlipModel(Protocol):
    """Predictor of the slip of a foothold from the ground: distance slid by the contact per length of stroke."""

    @property
    def name(self) -> str:
        """Name and version of the slip model, as replies of the service state it."""
        ...

    @property
    def distance_weight(self) -> float:
        """Weight k, 1/m, of the distance K4 from the nominal foothold in the cost Q = P + k K4, P the slip."""
        ...

    @property
    def landing_error(self) -> float:
        """Standard deviation of landings around the chosen cell along each axis, m.

        The predicted slip P is averaged over landings of this error; where it is 0, over the free cells of 3 x 3.
        """
        ...

    @property
    def relief(self) -> bool:
        """True if coefficients come from fitted planes, False if from 3 x 3 cells as by Walas & Belter."""
        ...

    def unfit(self, cell: float, smooth: bool, foot_radius: float) -> str:
        """Return the reason why the model does not hold on a map, empty if it does.

        Args:
            cell: edge of a cell, m. K1 and K2 scale with it.
            smooth: True if the map goes through the 3 x 3 median.
            foot_radius: radius of the foot sphere, m.
        """
        ...

    def predict(self, features: Features, cell: float) -> Layer:
        """Return the slip per stroke P(K1, K2, cos K3) of every cell of a map that the model holds on.

        Args:
            features: ground coefficients K1 (m), K2 (m), cos K3, (ny, nx) each.
            cell: edge of a cell, m.

        Returns:
            Predicted slip, no unit, (ny, nx) float32. NaN where the coefficients are, -1 outside the learned inputs;
            another value outside [0, 1] is an artefact of a fit and makes the cell unknown.
        """
        ...

    def spread(self, features: Features, cell: float) -> Layer:
        """Return the standard deviation of the slip of single steps, (ny, nx) float32, no unit; NaN = unknown.

        `features`: ground coefficients K1 (m), K2 (m), cos K3, (ny, nx) each; `cell`: edge of a cell, m.
        """
        ...

    def support_of(self, features: Features, cell: float) -> Layer:
        """Return the share, 0 to 1, of the slip P that was learned from similar steps, (ny, nx) float32; NaN = no P.

        `features`: ground coefficients K1 (m), K2 (m), cos K3, (ny, nx) each; `cell`: edge of a cell, m.
        """
        ...
