"""The mapper service: images of a depth camera and odometry in, a height map about the robot with variances out."""

from surefoot.errors import Refusal
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.service import Service
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import DepthImage, FootContacts, JointState
from surefoot.schemas.state import Odometry
from surefoot.schemas.topics import HW_CONTACTS, HW_DEPTH, HW_JOINTS, STATE_ELEVATION, STATE_ODOMETRY

from .config import MapperConfig
from .mapper import LEAST_FEET, NOWHERE, Mapper, MapPose
from .messages import depth_view, elevation_message, map_pose, standing_points
from .rehearsal import rehearse


class MapperService(Service[MapperConfig]):
    """Maps the ground ahead while the robot walks; the map moves along with it."""

    name = "mapper"
    Config = MapperConfig
    inputs = (HW_DEPTH, HW_JOINTS, HW_CONTACTS, STATE_ODOMETRY)
    outputs = (STATE_ELEVATION,)

    def on_start(self) -> None:
        """Load the robot."""
        self.robot = load_robot(self.config.robot)
        self.on_reset()

    def rehearse(self) -> None:
        """Map a made-up image."""
        rehearse(self.config.params())

    def on_reset(self) -> None:
        """Forget map and refusals."""
        self.mapper = Mapper(self.config.params())
        self._logged: set[str] = set()
        self._began = self._lost = False
        self._standing: tuple[MapPose, JointState, FootContacts] | None = None

    def on_tick(self, inputs: TickInputs) -> None:
        """Follow the odometry, take the image of the tick, publish the map when it is due."""
        odometry, image = inputs.get(STATE_ODOMETRY), inputs.get(HW_DEPTH)
        if odometry is not None:
            self._follow(odometry, inputs.get(HW_JOINTS), inputs.get(HW_CONTACTS))
        if image is not None and self._began and not self._lost:
            self._take(image, inputs.tick.stamp_ns)
        if STATE_ELEVATION.due(inputs.number):
            self.publish(STATE_ELEVATION, elevation_message(self.mapper, self.mapper.refused))

    def _follow(self, odometry: Odometry, joints: JointState | None, contacts: FootContacts | None) -> None:
        """Take a pose. Where the frame of an odometry that began anew lies in the old one is unknown: no map then."""
        if self._lost or not (odometry.initialised or self._began):
            return
        pose = map_pose(odometry)
        if not odometry.initialised or not self.mapper.moved(pose):
            self._lost = True
            self.mapper.forget()
            self.log("warning", "the odometry began anew: nothing is mapped until the next reset")
        elif joints is not None and contacts is not None:
            self._standing = pose, joints, contacts
            if not self._began and len(feet := standing_points(self.robot, *self._standing)) >= LEAST_FEET:
                self.mapper.begin(feet)
            self._began = True

    def _take(self, image: DepthImage, now_ns: int) -> None:
        feet = NOWHERE if self._standing is None else standing_points(self.robot, *self._standing)
        try:
            self.mapper.look(depth_view(image), now_ns, feet)
        except Refusal as refusal:
            self.mapper.refused[refusal.code] += 1
            if refusal.code not in self._logged:
                self._logged.add(refusal.code)
                self.log("warning", f"hw/depth refused ({refusal.code}): {refusal.message}")


SERVICE = MapperService
