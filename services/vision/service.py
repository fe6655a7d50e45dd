"""The vision service: images of the floor in, recognised landmarks out, for the navigator."""

from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from surefoot.lockstep.join import Delayed, TickInputs
from surefoot.lockstep.service import Service
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import CameraImage
from surefoot.schemas.state import SeenLandmarks
from surefoot.schemas.topics import HW_IMAGE, HW_JOINTS, STATE_LANDMARKS, STATE_ODOMETRY, STATE_POSE

from .config import VisionConfig
from .eye import Eye, Seen
from .feature_map import CODE, FeatureMap, load
from .features import Extractor
from .messages import belief_of, landmarks_message
from .motion import MotionHistory, OdometryAt, since
from .opencv import opencv
from .recognise import RecogniseParams
from .rehearsal import rehearse
from .view import Patch

SILENT_NS = 900_000_000
"""Time without an image after which the camera counts as silent, ns."""


class ImageJob(NamedTuple):
    """Image that the worker thread processes: its future result, its time, ns, and the odometry then."""

    result: Future[Seen]
    stamp_ns: int
    moment: OdometryAt


class VisionService(Service[VisionConfig]):
    """Service that recognises a map's landmarks in images on a worker thread; ticks wait for it in lockstep only."""

    name = "vision"
    Config = VisionConfig
    inputs = (HW_IMAGE, HW_JOINTS, STATE_ODOMETRY, Delayed(STATE_POSE))
    outputs = (STATE_LANDMARKS,)

    def on_start(self) -> None:
        c = self.config
        opencv()
        self.robot = load_robot(c.robot)
        self.patch = Patch(c.nearest, c.farthest, c.beside, c.pixel)
        self.limits = {HW_IMAGE.key: SILENT_NS}
        self._worker = ThreadPoolExecutor(1, "vision")
        self.world: FeatureMap | None = None
        self._codes = np.zeros((0, CODE))
        if c.map is not None:
            self.use(load(c.map))
        self.on_reset()

    def use(self, world: FeatureMap) -> None:
        """Set the map for recognition from the next reset on; log a warning if its pixels or OpenCV version differ."""
        self.world, self._codes = world, world.codes
        if world.pixel != self.patch.pixel:
            self.log("warning", f"the map's pixels are {world.pixel:g} m, these {self.patch.pixel:g} m: few will match")
        if world.opencv.split(".")[0] != opencv().__version__.split(".")[0]:
            text = f"the map's features are of OpenCV {world.opencv or 'unknown'}, this is {opencv().__version__}"
            self.log("warning", f"{text}: build it anew if few match")

    def rehearse(self) -> None:
        rehearse(self._eye())

    def _eye(self) -> Eye:
        kind = self.config.features if self.world is None else self.world.kind
        limits = RecogniseParams(most=self.config.most)
        return Eye(Extractor(kind, self.config.count), self.world, self.patch, limits)

    def on_reset(self) -> None:
        self.eye, self.motion = self._eye(), MotionHistory(self.robot)
        self._job: ImageJob | None = None
        self._belief, self._stamp, self._came = None, -1, 0
        self._camera: tuple[str, ...] = ()
        self._flags = self._last_flags = self._camera

    def on_tick(self, inputs: TickInputs) -> None:
        now, motion = inputs.tick.stamp_ns, self.motion
        joints, odometry, image = inputs.get(HW_JOINTS), inputs.get(STATE_ODOMETRY), inputs.get(HW_IMAGE)
        if joints is not None:
            motion.bent(joints)
        if odometry is not None:
            motion.moved(odometry)
        self._belief = inputs.get(STATE_POSE) or self._belief
        if image is not None:
            self._came = now
            self._take(image, now)
        elif now - self._came > SILENT_NS:
            self._camera = ("silent",)
        if STATE_LANDMARKS.due(inputs.number):
            self._publish(now, wait=inputs.tick.mode == "lockstep")

    def _take(self, image: CameraImage, now: int) -> None:
        """Begin to process an image, unless it is repeated or older than `late_s`, or another one is in process."""
        camera: tuple[str, ...] = ()
        if image.stamp_ns <= self._stamp:
            camera = ("repeated",)
        elif now - image.stamp_ns > 1e9 * self.config.late_s:
            camera = ("late",)
        self._stamp = max(self._stamp, image.stamp_ns)
        here = self.motion.at(image.stamp_ns)
        if not camera and here is not None and self._job is None:
            moment, base = here
            belief = belief_of(self._belief, moment)
            self._job = ImageJob(self._worker.submit(self.eye.look, image, base, belief), image.stamp_ns, moment)
        self._camera = camera

    def _publish(self, now: int, *, wait: bool) -> None:
        """Publish the result of the last image; in lockstep wait for it, so that runs are reproducible."""
        job, here = self._job, self.motion.now
        if job is None or here is None or not (wait or job.result.done()):
            self.publish(STATE_LANDMARKS, SeenLandmarks(landmarks=(), flags=self._noted(self._camera or self._flags)))
            return
        self._job, seen = None, job.result.result()
        self._flags = seen.flags
        places = since(seen.places, job.moment, here)
        message = landmarks_message(places, seen, self._codes, job.stamp_ns, self._camera)
        self._noted(message.flags)
        self.publish(STATE_LANDMARKS, message)

    def _noted(self, flags: tuple[str, ...]) -> tuple[str, ...]:
        """Log a change of the image's fault flags, and return them."""
        if flags != self._last_flags:
            self._last_flags = flags
            self.log("warning" if flags else "info", f"camera: {', '.join(flags) or 'sees again'}")
        return flags

    def on_stop(self) -> None:
        """Stop the worker thread without waiting for the image that it processes."""
        self._worker.shutdown(wait=False, cancel_futures=True)


SERVICE = VisionService
