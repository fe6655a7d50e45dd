"""A dry run of the mapper: made-up images of level ground."""

import numpy as np

from .mapper import DepthView, MapParams, Mapper, MapPose

DOWN = (0.0, -0.70710678, 0.70710678, 0.0)
"""Rotation from a camera that looks straight down, its top ahead, to base_link, as a quaternion w, x, y, z."""


def rehearse(params: MapParams) -> None:
    """Run a map on two made-up images, a move and a publication, so that its kernels are compiled."""
    mapper = Mapper(params)
    pose = MapPose(0, np.array([0.0, 0.0, 0.1]), np.eye(3), np.eye(6) * 1e-6)
    mapper.moved(pose)
    mapper.begin(np.array([[0.1, 0.0, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0]]))
    depths = np.full((4, 4), 0.4)
    view = DepthView(0, depths, 4.0, (2.0, 2.0), 0.001, 0.0, "base_link", np.array([0.0, 0.0, 0.3]), np.array(DOWN))
    mapper.look(view, 0)
    mapper.moved(pose._replace(stamp_ns=10_000_000, position=np.array([0.01, 0.0, 0.1])))
    mapper.look(view._replace(stamp_ns=10_000_000, depths=depths + 0.001), 10_000_000)
    mapper.heights()
