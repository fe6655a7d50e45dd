"""Conversion of the simulated world's samples, state and maps to messages on the bus."""

from base64 import b64encode
from typing import Any

import numpy as np

from surefoot.geometry.heightmap import HeightMap
from surefoot.geometry.rotations import quat_from_matrix
from surefoot.lockstep.driver import DueSample
from surefoot.schemas import topics
from surefoot.schemas.hw import (
    CameraImage,
    DepthImage,
    FootContacts,
    Imu,
    JointState,
    Landmark,
    LandmarkDetections,
    Range,
    Sighting,
)
from surefoot.schemas.sim import Truth as TruthMessage
from surefoot.schemas.terrain import HeightMapMessage, LandmarkMap
from surefoot.schemas.topics import Topic

from .ground.terrain import Terrain
from .physics.samples import ExactState, Samples
from .sensors.depth import DepthCamera, DepthFrame
from .sensors.images import TakenImage, jpeg
from .sensors.landmarks import Landmarks
from .sensors.sight import Senses


def sample_messages(samples: Samples) -> list[DueSample]:
    """Return the messages of the samples that the hardware releases in a tick."""
    imu, joints, contacts = samples
    out: list[DueSample] = []
    if imu is not None:
        message = Imu(acc=tuple(imu.acc.tolist()), gyro=tuple(imu.gyro.tolist()), saturated=imu.saturated)
        out.append(DueSample(topics.HW_IMU, message, imu.stamp_ns, imu.seq))
    if joints is not None:
        state = JointState(
            position=tuple(joints.position.tolist()),
            current=tuple(joints.current.tolist()),
            torque=tuple(joints.torque.tolist()),
        )
        out.append(DueSample(topics.HW_JOINTS, state, joints.stamp_ns, joints.seq))
    if contacts is not None:
        force = contacts.normal_force
        normal = (None,) * len(contacts.touch) if force is None else tuple(force.tolist())
        feet = FootContacts(touch=contacts.touch, normal_force_n=normal)
        out.append(DueSample(topics.HW_CONTACTS, feet, contacts.stamp_ns, contacts.seq))
    return out


def sight_messages(sight: Senses | None, stamp_ns: int) -> list[DueSample]:
    """Return the messages of cameras, ultrasound and bumpers in a tick."""
    out: list[DueSample] = []
    if sight is None:
        return out
    if sight.frame is not None:
        frame, goal = sight.frame, sight.frame.goal
        message = LandmarkDetections(
            landmarks=tuple(
                Landmark(range=d.range, bearing=d.bearing, descriptor=tuple(d.descriptor.tolist()))
                for d in frame.landmarks
            ),
            goal=None if goal is None else Sighting(range=goal.range, bearing=goal.bearing),
        )
        out.append(DueSample(topics.HW_LANDMARKS, message, stamp_ns, frame.seq))
    if sight.image is not None:
        taken = sight.image
        out.append(DueSample(topics.HW_IMAGE, image_message(taken), taken.stamp_ns, taken.seq))
    if sight.depths is not None and sight.depth is not None:
        out.append(
            DueSample(topics.HW_DEPTH, depth_message(sight.depths, sight.depth.camera), stamp_ns, sight.depths.seq)
        )
    if sight.reach is not None and sight.ranger is not None:
        r = sight.ranger
        near = Range(
            distance=sight.reach.distance, shortest=r.shortest, longest=r.longest, field_of_view=2.0 * r.half_cone,
            bump=sight.reach.bump,
        )  # fmt: skip
        out.append(DueSample(topics.HW_RANGE, near, stamp_ns, sight.reach.seq))
    return out


def image_message(taken: TakenImage) -> CameraImage:
    """Return an image of the simulated camera as a message, with its optics and the camera's pose in base_link."""
    height, width = taken.pixels.shape
    data = taken.pixels.tobytes() if taken.format == "gray8" else jpeg(taken.pixels)
    return CameraImage(
        width=width, height=height, format=taken.format, pixels=b64encode(data).decode(), focal=taken.focal,
        center=(0.5 * width, 0.5 * height), exposure=taken.exposure, readout=taken.readout,
        position=tuple(taken.position.tolist()), quat_wxyz=tuple(quat_from_matrix(taken.look).tolist()),
    )  # fmt: skip


def depth_message(frame: DepthFrame, camera: DepthCamera) -> DepthImage:
    """Return an image of the depth camera as a message; `camera` gives focal length, noise and mounting."""
    f = camera.file
    return DepthImage(
        width=f.width_px, height=f.height_px, depths=b64encode(frame.depths.astype("<f4").tobytes()).decode(),
        focal=camera.focal, center=(0.5 * f.width_px, 0.5 * f.height_px), sigma=f.sigma, sigma_square=f.sigma_square,
        position=(f.position[0], f.position[1], f.position[2]), quat_wxyz=tuple(quat_from_matrix(camera.look).tolist()),
    )  # fmt: skip


def lacking(sight: Senses | None, heights: HeightMapMessage | None) -> tuple[Topic[Any], ...]:
    """Return the topics that are never published for want of a sensor or map; None: no such sensors, no map."""
    blind = () if sight is not None and sight.landmarks is not None else (topics.HW_LANDMARKS, topics.TERRAIN_LANDMARKS)
    blind = blind if sight is not None and sight.eye is not None else (*blind, topics.HW_IMAGE)
    blind = blind if sight is not None and sight.depth is not None else (*blind, topics.HW_DEPTH)
    blind = blind if heights is not None else (*blind, topics.TERRAIN_MAP)
    return blind if sight is not None and sight.ranger is not None else (*blind, topics.HW_RANGE)


def truth_message(truth: ExactState) -> TruthMessage:
    """Return the exact state of the simulated robot as the message `sim/truth`."""
    return TruthMessage(
        position=tuple(truth.position.tolist()),
        quat_wxyz=tuple(truth.quat_wxyz.tolist()),
        velocity=tuple(truth.velocity.tolist()),
        angular_velocity=tuple(truth.angular_velocity.tolist()),
        com=tuple(truth.com.tolist()),
        joints=tuple(truth.joints.tolist()),
        foot_position=tuple(map(tuple, truth.foot_position.tolist())),
        foot_force_n=tuple(truth.foot_force_n.tolist()),
        foot_displacement=tuple(truth.foot_displacement.tolist()),
        contact_sliding=tuple(truth.contact_sliding.tolist()),
        stance_sliding=tuple(truth.stance_sliding.tolist()),
        stances=tuple(truth.stances.tolist()),
        foot_twist=tuple(truth.foot_twist.tolist()),
        stance_twist=tuple(truth.stance_twist.tolist()),
        tilt=truth.tilt,
        fallen=truth.fallen,
        touching=truth.touching,
    )


def map_message(heights: HeightMap, terrain: Terrain, profile: str) -> HeightMapMessage:
    """Return the message of the height map that the robot gets; `profile`: how it differs from the true one."""
    return HeightMapMessage(**heights.header(), kind=terrain.kind, profile=profile, data=heights.to_bytes())


def landmark_message(field: Landmarks, seed: int) -> LandmarkMap:
    """Return the message of the landmarks' map, without the marker of the goal."""
    rows = np.concatenate((field.position, field.descriptor), axis=1).astype("<f4")
    return LandmarkMap(
        count=len(rows), descriptor_length=field.descriptor.shape[1], version=1, source=f"simulator, seed {seed}",
        data=rows.tobytes(),
    )  # fmt: skip
