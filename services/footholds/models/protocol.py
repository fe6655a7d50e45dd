"""What a slip model must offer; the hand-made score and every learned model look like this to the rest."""

from typing import Protocol

from surefoot.services.footholds.features import Features, Layer


class SlipModel(Protocol):
    """Predicts the slip r = d / |f| of a foothold from its ground coefficients."""

    @property
    def name(self) -> str:
        """Name and version; every reply carries it."""
        ...

    def predict(self, features: Features, cell: float) -> Layer:
        """P(K1, K2, cos K3) of every cell.

        Args:
            features: coefficients, (ny, nx) each.
            cell: edge of a cell, m. K1 and K2 scale with it: a model that cannot convert refuses another cell.

        Returns:
            Predicted slip, (ny, nx) float32. NaN where the coefficients are; a value outside [0, 1] is an artefact
            of a fit and makes the cell unknown.

        Raises:
            ValueError: the model was learned on another cell size and does not hold for this one.
        """
        ...
