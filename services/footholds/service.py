"""Foothold service: latches the terrain map, answers `footholds/select` and `footholds/assess`."""

from dataclasses import replace

import numpy as np

from surefoot.errors import Refusal
from surefoot.geometry.heightmap import HeightMap, HeightMapError
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.service import Service
from surefoot.robot.reader import load_robot
from surefoot.schemas.footholds import AssessReply, AssessRequest, SelectReply, SelectRequest
from surefoot.schemas.terrain import HeightMapMessage
from surefoot.schemas.topics import FOOTHOLDS_ASSESS, FOOTHOLDS_SELECT, TERRAIN_MAP
from surefoot.services.footholds.assess import assess, whole_map, window_about
from surefoot.services.footholds.config import FootholdsConfig
from surefoot.services.footholds.ground import FootholdGround, build_ground
from surefoot.services.footholds.messages import base_pose, leg_foothold, mask_bits, mask_counts
from surefoot.services.footholds.rehearsal import made_up_map, made_up_requests
from surefoot.services.footholds.select import Landing, placement, select


class Footholds(Service[FootholdsConfig]):
    """Tells each leg where to step on the latched map."""

    name = "footholds"
    Config = FootholdsConfig
    inputs = (TERRAIN_MAP,)
    batched = True
    serves = (FOOTHOLDS_SELECT, FOOTHOLDS_ASSESS)

    def on_start(self) -> None:
        """Load the robot, register the handlers."""
        self.robot = load_robot(self.config.robot)
        self.model = self.config.model()
        self.params = self.config.params()
        self.legs = {leg.name: index for index, leg in enumerate(self.robot.legs)}
        self._message: HeightMapMessage | None = None
        self._ground: FootholdGround | None = None
        self.handle(FOOTHOLDS_SELECT, self.select)
        self.handle(FOOTHOLDS_ASSESS, self.assess)

    def rehearse(self) -> None:
        """Answer made-up requests on a made-up map, as another service of the same configuration."""
        other = Footholds(self.config)
        other.on_start()
        other._ground = build_ground(made_up_map(other.robot), other.robot.foot_radius, self.config.smooth)
        selects, assesses = made_up_requests(other.robot)
        for each in selects:
            other.select(each)
        for each in assesses:
            other.assess(each)

    def on_reset(self) -> None:
        """Forget the map; the new epoch brings its own."""
        self._message = self._ground = None

    def on_tick(self, inputs: TickInputs) -> None:
        """Prepare the map when it is another one."""
        message = inputs.get(TERRAIN_MAP)
        if message is None or message is self._message:
            return
        self._message = message
        try:
            heights = HeightMap.from_wire(message.model_dump(), message.data)
        except HeightMapError as error:
            self._ground = None
            self.log("error", f"terrain/map refused: {error}")
            return
        self._ground = build_ground(heights, self.robot.foot_radius, self.config.smooth)

    def select(self, request: SelectRequest) -> SelectReply:
        """Footholds of all legs of a request."""
        ground = self._map()
        landings = [
            Landing(self._leg(leg.leg, f"legs.{i}.leg"), leg.nominal, leg.stroke) for i, leg in enumerate(request.legs)
        ]
        params = self.params if request.mode == "robust" else replace(self.params, robust=False)
        if request.mode == "random":
            if request.seed is None:
                raise Refusal("invalid", "mode random needs a seed", "seed")
            params = replace(params, seed=request.seed)
        found = select(ground, self.robot, self.model, base_pose(request.base), landings, params)
        legs = tuple(map(leg_foothold, request.legs, found))
        return SelectReply(legs=legs, map_version=ground.version, model=self.model.name)

    def assess(self, request: AssessRequest) -> AssessReply:
        """Layers of a window or of the whole map."""
        ground = self._map()
        if request.size % 2 == 0:
            raise Refusal("invalid", f"size must be odd, got {request.size}", "size")
        window = whole_map(ground)
        if request.centre is not None:
            if not ground.near(*request.centre):
                raise Refusal("invalid", f"centre must lie near the map, got {request.centre}", "centre")
            window = window_about(ground, *request.centre, request.size)
        leg = None
        if request.leg is not None:
            if request.base is None:
                raise Refusal("invalid", "leg needs base: where the trunk is when the foot lands", "base")
            leg = placement(self.robot, self._leg(request.leg, "leg"), base_pose(request.base), request.stroke)
            if leg is None:
                raise Refusal("invalid", f"no rotation: {request.base.quat_wxyz}", "base.quat_wxyz")
        p = self.params
        found = assess(
            ground, self.model, window, request.centre, request.stroke, request.layers, p.limits, p.distance_weight, leg
        )
        return AssessReply(
            layers=request.layers, rows=window.rows, cols=window.cols, cell=ground.surface.cell,
            origin=ground.surface.centre(window.row, window.col),
            mask_bits=mask_bits(), counts=mask_counts(found.counts), map_version=ground.version, model=self.model.name,
            data=np.ascontiguousarray(found.layers, dtype="<f4").tobytes(),
        )  # fmt: skip

    def _map(self) -> FootholdGround:
        if self._ground is None:
            raise Refusal("not_ready", "no terrain map has come yet")
        return self._ground

    def _leg(self, name: str, field: str) -> int:
        if name not in self.legs:
            raise Refusal("unknown_leg", f"{self.robot.name} has the legs {', '.join(self.legs)}; got {name!r}", field)
        return self.legs[name]


SERVICE = Footholds
