"""Camera images of a run in the report: the last one of each action, with features, matches and search regions."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from surefoot.errors import SurefootError
from surefoot.services.vision.view import greys

from ..scene.sights import SeenImage, features, gates, in_image, words
from .drawing import GREEN, ORANGE, page_figure

COLUMNS = 2


def figure_of(sights: dict[str, SeenImage]) -> Figure:
    """Return a figure of the last image of each action: features, matches with their search regions, pose entropy."""
    rows = -(-len(sights) // COLUMNS)
    figure = page_figure(3.1 * rows)
    for i, (action, sight) in enumerate(sights.items()):
        _draw(figure.add_subplot(rows, COLUMNS, i + 1), action, sight)
    return figure


def _draw(axes: Axes, action: str, sight: SeenImage) -> None:
    axes.set_axis_off()
    axes.set_title(f"{action or 'no action'}, {words(sight)}".replace(", entropy", ",\nentropy"), fontsize=8.0)
    try:
        pixels = greys(sight.image)
    except SurefootError as error:
        axes.text(0.5, 0.5, str(error), ha="center", wrap=True, transform=axes.transAxes)
        return
    height, width = pixels.shape
    axes.imshow(pixels, cmap="gray", vmin=0, vmax=255, extent=(0.0, width, height, 0.0))
    axes.set(xlim=(0.0, width), ylim=(height, 0.0))
    try:
        axes.plot(*features(sight, pixels).T, ".", color=ORANGE, markersize=2.0)
        axes.plot(*in_image(sight.places, sight).T, "o", color=GREEN, markersize=4.0, fillstyle="none")
        for outline in gates(sight):
            axes.plot(*outline.T, color=GREEN, linewidth=0.5, alpha=0.6)
    except SurefootError:  # the camera does not look at the floor
        return
