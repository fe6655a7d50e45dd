"""The mapper service: images of a depth camera and odometry in, a height map about the robot with variances out."""

import numpy as np

from surefoot.errors import Refusal
from surefoot.geometry.rotations import rpy_from_matrix
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.service import Service
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import DepthImage, FootContacts, JointState
from surefoot.schemas.state import Odometry
from surefoot.schemas.topics import HW_CONTACTS, HW_DEPTH, HW_JOINTS, STATE_ELEVATION, STATE_ODOMETRY

from .config import MapperConfig
from .legs import TrunkOverFeet
from .mapper import LEAST_FEET, NOWHERE, Mapper, MapPose
from .messages import depth_view, depth_words, elevation_message, map_pose, standing_points
from .rehearsal import rehearse


class MapperService(Service[MapperConfig]):
    """Service that maps the ground about the robot while it walks; the map moves along with it."""

    name = "mapper"
    Config = MapperConfig
    inputs = (HW_DEPTH, HW_JOINTS, HW_CONTACTS, STATE_ODOMETRY)
    outputs = (STATE_ELEVATION,)

    def on_start(self) -> None:
        """Load the robot and its depth camera."""
        self.robot = load_robot(self.config.robot)
        self.on_reset()

    def rehearse(self) -> None:
        """Map made-up images, so that all kernels are loaded before the first tick."""
        rehearse(self.config.params())

    def on_reset(self) -> None:
        """Start after a reset with an empty height map and no image counted as refused."""
        self.mapper = Mapper(self.config.params())
        self._logged: set[str] = set()
        self._began = False
        self._creeping: TrunkOverFeet | None = None
        self._standing: tuple[MapPose, JointState, FootContacts] | None = None

    def on_tick(self, inputs: TickInputs) -> None:
        """Update the pose by the odometry, fuse the image of the tick, publish the map when its period has passed."""
        odometry, image = inputs.get(STATE_ODOMETRY), inputs.get(HW_DEPTH)
        self._follow(odometry, inputs.get(HW_JOINTS), inputs.get(HW_CONTACTS))
        if image is not None and self._began and self._creeping is None:
            self._take(image, inputs.tick.stamp_ns)
        if STATE_ELEVATION.due(inputs.number):
            self.publish(STATE_ELEVATION, elevation_message(self.mapper, self.mapper.refused))

    def _follow(self, odometry: Odometry | None, joints: JointState | None, contacts: FootContacts | None) -> None:
        """Move the map to the pose of a tick; store joints and contacts of the feet that stand on its ground."""
        if odometry is None or not odometry.initialised:
            self._creep(odometry, joints, contacts)
            return
        pose = map_pose(odometry)
        if self._creeping is not None:
            self.mapper.lay(pose, self._creeping)
            self._creeping = None
            self.log(
                "warning", "the odometry began anew; it is laid where the legs have the robot, and the map goes on"
            )
        if not self.mapper.moved(pose):
            self._began = False
            self.log("warning", "the odometry jumped: the map begins anew")
        elif joints is not None and contacts is not None:
            self._standing = self.mapper.placed(pose), joints, contacts
            if not self._began and len(feet := standing_points(self.robot, *self._standing)) >= LEAST_FEET:
                self.mapper.begin(feet)
            self._began = True

    def _creep(self, odometry: Odometry | None, joints: JointState | None, contacts: FootContacts | None) -> None:
        """Update the trunk's pose by its standing feet alone while the estimator restarts and there is no odometry."""
        pose = self.mapper.pose
        if pose is None or not self._began:
            return
        if self._creeping is None and odometry is not None:
            self._creeping = TrunkOverFeet(pose.position, float(rpy_from_matrix(pose.rot)[2]))
            self._standing = None
        if self._creeping is not None and joints is not None and contacts is not None:
            down = np.array([any(foot) for foot in contacts.touch])
            self._creeping.step(foot_positions(self.robot.model, np.array(joints.position)), down)

    def _take(self, image: DepthImage, now_ns: int) -> None:
        feet = NOWHERE if self._standing is None else standing_points(self.robot, *self._standing)
        error = self.mapper.error
        try:
            self.mapper.look(depth_view(image), now_ns, feet)
        except Refusal as refusal:
            self.mapper.refused[refusal.code] += 1
            if refusal.code not in self._logged:
                self._logged.add(refusal.code)
                self.log("warning", f"hw/depth refused ({refusal.code}): {refusal.message}")
        if self.mapper.error is not error:
            self.log("warning", depth_words(self.mapper.turned, self.mapper.error.scale))


SERVICE = MapperService
