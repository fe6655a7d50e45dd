"""Items that are drawn beside a robot, their styles, and the numbers beside the picture."""

from typing import NamedTuple

from surefoot.arrays import Array


class Style(NamedTuple):
    """Look of one kind of item.

    Attributes:
        layer: group that a reader may hide.
        kind: line, fill (a polygon), dot (spheres), ring (circles on the ground), arrow (pairs of points), label
            (text beside a point).
        colour: `#rrggbb`.
        size: width of a line, radius of a dot, or height of letters, share of the robot's extent.
        title: text in the legend.
    """

    layer: str
    kind: str
    colour: str
    size: float
    title: str


class Item(NamedTuple):
    """Drawn item of a scene: points (n, 3) m, world, in a style; points of arrows are tail and head in turn.

    Attributes:
        style: name in `STYLES`.
        points: (n, 3) m, world; a label has one.
        text: text of a label; empty for other items.
    """

    style: str
    points: Array
    text: str = ""


class Lasting(NamedTuple):
    """Item of a scene that is drawn from simulated time `time`, s, to the end."""

    time: float
    item: Item


STYLES: dict[str, Style] = {
    "region": Style("support", "fill", "#2a9d63", 0.008, "support region"),
    "unsafe": Style("support", "fill", "#cc3b3b", 0.008, "support region, CoM outside"),
    "plumb": Style("CoM", "line", "#1c7a4b", 0.005, "height of the CoM"),
    "com_planned": Style("CoM", "dot", "#1c7a4b", 0.022, "CoM, planned"),
    "com_measured": Style("CoM", "ring", "#1c2733", 0.022, "CoM, measured"),
    "force": Style("forces", "arrow", "#e07b1a", 0.012, "force on a foot"),
    "holding": Style("certificate", "arrow", "#7cc49f", 0.024, "forces that hold the planned CoM"),
    "foothold": Style("footholds", "ring", "#1f6fb2", 0.035, "planned foothold"),
    "foothold_bad": Style("footholds", "ring", "#cc3b3b", 0.035, "foothold with a remark"),
    "expected": Style(
        "footholds", "label", "#1f6fb2", 0.035, "Q and slip per stroke that was expected there, with its 80 % interval"
    ),
    "slips": Style("slip", "ring", "#cc3b3b", 0.06, "foot slides"),
    "footprint": Style("slip", "ring", "#5d6b78", 0.02, "end of a stance"),
    "footprint_slid": Style("slip", "ring", "#cc3b3b", 0.03, "end of a stance, slid"),
    "ghost": Style("estimate", "line", "#7a4fb5", 0.007, "estimated pose"),
    "belief": Style("belief", "fill", "#e07b1a", 0.006, "pose in the map, 95 %"),
    "goal": Style("belief", "arrow", "#2a9d63", 0.02, "goal"),
    "match": Style("landmarks", "ring", "#2a9d63", 0.016, "landmark recognised in the image"),
    "gate": Style("landmarks", "line", "#2a9d63", 0.004, "gate of the farthest of them"),
    "landmark": Style("landmarks", "dot", "#b08d2e", 0.012, "landmark"),
}  # fmt: skip
"""Drawing style of every kind of item in a scene, by name."""

VALUES: dict[str, tuple[str, str, int]] = {
    "speed": ("speed forward", "m/s", 3),
    "speed_true": ("speed forward, true", "m/s", 3),
    "margin": ("margin, planned CoM", "mm", 1),
    "margin_measured": ("margin, measured CoM", "mm", 1),
    "tilt": ("tilt", "deg", 2),
    "drift": ("odometry error", "cm", 2),
    "remaining": ("still to go", "m", 2),
    "nis": ("NIS", "", 2),
    "entropy": ("entropy of the pose", "nats", 2),
    "features": ("features of the image", "", 0),
    "matches": ("matches with the map", "", 0),
}
"""Numbers shown beside a picture, by name: (title, unit, number of printed decimals)."""
