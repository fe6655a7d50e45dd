"""The service about the map: what it refuses, in which words, and what it publishes."""

import math
from base64 import b64encode

import numpy as np
import pytest

from surefoot.errors import Refusal
from surefoot.geometry.rotations import matrix_from_rpy, quat_from_matrix, rpy_from_matrix
from surefoot.lockstep.join import TickInputs
from surefoot.robot.kinematics import foot_positions, legs_ik
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import DepthImage, FootContacts, JointState, Tick
from surefoot.schemas.state import Odometry
from surefoot.schemas.terrain import ElevationMap
from surefoot.schemas.topics import HW_CONTACTS, HW_DEPTH, HW_JOINTS, STATE_ELEVATION, STATE_ODOMETRY
from surefoot.services.mapper.config import MapperConfig
from surefoot.services.mapper.mapper import LAID, MOST_DOUBTFUL, Mapper
from surefoot.services.mapper.messages import depth_words
from surefoot.services.mapper.service import MapperService
from tests.services.mapper.scenes import FOCAL, HEIGHT, LOOK, PLACE, TICK_NS, WIDTH, Slope, picture, pose
from tests.services.stage import Stage

ROBOT = load_robot("ragno")
BASE = ROBOT.foot_radius - float(foot_positions(ROBOT.model, ROBOT.neutral)[0, 2])
"""Height of base_link in the neutral stance, m."""
GOOD = picture(Slope(), z=BASE, sigma=0.002)


def changed(image, value, share=0.6):
    depths = image.depths.copy()
    depths.ravel()[: int(share * depths.size)] = value
    return image._replace(depths=depths)


@pytest.mark.parametrize(
    ("view", "now", "code", "words"),
    [
        (changed(GOOD, -0.2), 0, "depths", "-0.2 m"),
        (changed(GOOD, math.inf), 0, "depths", "inf"),
        (changed(GOOD, 1e30), 0, "depths", "1e+30"),
        (changed(GOOD, math.nan, 1.0), 0, "blind", "no depth"),
        (GOOD._replace(depths=np.full((HEIGHT, WIDTH), 50.0)), 0, "blind", "no depth"),
        (GOOD, 31 * TICK_NS, "late", "0.310 s old"),
        (GOOD._replace(stamp_ns=TICK_NS), 0, "late", "0 to 0.3"),
        (GOOD._replace(frame="map"), 0, "frame", "'map'"),
        (GOOD._replace(quat_wxyz=np.array([2.0, 0.0, 0.0, 0.0])), 0, "camera", "unit quaternion"),
        (GOOD._replace(position=np.array([np.nan, 0.0, 0.0])), 0, "camera", "within 10 m"),
        (GOOD._replace(position=np.array([50.0, 0.0, 0.0])), 0, "camera", "50.0"),
        (GOOD._replace(stamp_ns=5 * TICK_NS), 5 * TICK_NS, "no_odometry", "20 ms"),
    ],
)  # fmt: skip
def test_an_image_that_cannot_be_is_refused_in_words_and_changes_nothing(view, now, code, words):
    mapper = Mapper()
    mapper.moved(pose())
    with pytest.raises(Refusal, match=words.replace("+", r"\+").replace("'", ".")) as refused:
        mapper.look(view, now)
    assert refused.value.code == code
    assert "\n" not in refused.value.message
    assert mapper.heights() is None
    mapper.look(GOOD, 0)  # a good one afterwards is taken
    with pytest.raises(Refusal, match="after one of"):
        mapper.look(GOOD, 0)


def test_a_few_impossible_depths_are_left_out_and_counted():
    mapper = Mapper()
    mapper.moved(pose())
    depths = GOOD.depths.copy()
    depths[0, :3] = -1.0, math.inf, 1e9
    mapper.look(GOOD._replace(depths=depths), 0)
    assert mapper.refused["depth"] == 3
    heights, _ = mapper.heights()
    assert np.nanmax(np.abs(heights - (0.1 - BASE))) < 0.01  # the robot of `pose` is not at BASE


WAVY = 1.0 + 0.15 * np.sin(np.arange(WIDTH))
"""Scale of depths by column that neither a turn nor one scale explains."""
FEET = np.array([[0.25, 0.1, 0.0], [0.3, -0.1, 0.0], [0.35, 0.0, 0.0], [0.4, 0.1, 0.0]])
"""Points under standing feet where the camera has seen the ground."""


def walked(images=10):
    """A map of level ground, seen on a way of 20 mm an image."""
    rng, mapper = np.random.default_rng(0), Mapper()
    for k in range(images):
        mapper.moved(pose(0.02 * k, tick=k))
        mapper.look(picture(Slope(), 0.02 * k, tick=k, sigma=0.002, rng=rng), k * TICK_NS)
    mapper.moved(pose(0.02 * images, tick=images))
    return mapper, picture(Slope(), 0.02 * images, tick=images, sigma=0.002, rng=rng)


def pitched(view, degrees):
    """The image, stated to be of a camera that looks further down: the mount has bent the other way."""
    turn = matrix_from_rpy(0.0, math.radians(degrees), 0.0)
    return view._replace(quat_wxyz=quat_from_matrix(turn @ LOOK))


FAULTS = (
    (lambda view, before: view._replace(depths=before.depths), "frozen"),
    (lambda view, before: view._replace(depths=np.full_like(view.depths, np.nan)), "blind"),
    (lambda view, before: view._replace(depths=np.zeros_like(view.depths)), "depths"),
    (lambda view, before: view._replace(depths=view.depths * WAVY), "shifted"),
    (lambda view, before: view._replace(depths=view.depths[:, ::-1] + 0.05), "shifted"),
)
DEEPER = (
    (lambda view, before: view._replace(depths=view.depths * 1.1), "shifted"),
    (lambda view, before: view._replace(depths=view.depths + 0.03), "shifted"),
)
"""Faults that a scale may explain where feet carry the map; without feet the ground itself may lie lower."""


@pytest.mark.parametrize(
    ("fault", "code", "feet"),
    [(*each, FEET) for each in FAULTS] + [(*each, FEET[:0]) for each in FAULTS + DEEPER],
)
def test_a_camera_that_fails_on_the_way_is_refused_and_the_map_stays(fault, code, feet):
    mapper, view = walked()
    assert mapper.look(view, view.stamp_ns, feet) > 500
    kept, rng = mapper.heights()[0].copy(), np.random.default_rng(5)
    for k in range(11, 16):
        mapper.moved(pose(0.2, tick=k))
        with pytest.raises(Refusal) as refused:
            mapper.look(fault(picture(Slope(), 0.2, tick=k, sigma=0.002, rng=rng), view), k * TICK_NS, feet)
        assert refused.value.code == code
        assert "\n" not in refused.value.message
    assert np.array_equal(mapper.heights()[0], kept, equal_nan=True)
    good = picture(Slope(), 0.2, tick=16, sigma=0.002, rng=np.random.default_rng(1))
    mapper.moved(pose(0.2, tick=16))
    assert mapper.look(good, 16 * TICK_NS, feet) > 500  # back in order


def walked_on(change, feet=FEET[:0]):
    """A mapper after ten images that are changed and ten that are not, its error after the ten, and its refusals."""
    mapper, view = walked()
    mapper.look(view, view.stamp_ns, FEET)
    rng, refused, found = np.random.default_rng(6), [], None
    for k in range(11, 31):
        mapper.moved(pose(0.02 * k, tick=k))
        image = picture(Slope(), 0.02 * k, tick=k, sigma=0.002, rng=rng)
        try:
            mapper.look(change(image) if k <= 20 else image, k * TICK_NS, feet)
        except Refusal as refusal:
            refused.append((k, refusal.code))
        if k == 20:
            found = math.degrees(mapper.turned), mapper.error.scale
    return mapper, found, refused


@pytest.mark.parametrize("degrees", [4.0, -5.0, 10.0])
def test_images_of_a_camera_that_was_knocked_aside_are_turned_back(degrees):
    mapper, (turned, scale), refused = walked_on(lambda image: pitched(image, degrees))
    assert turned == pytest.approx(abs(degrees), abs=0.3)
    assert scale == 1.0
    assert refused == [(11, "shifted"), (21, "shifted")]
    assert math.degrees(mapper.turned) < 0.3
    heights, _ = mapper.heights()
    assert np.nanmedian(np.abs(heights)) < 0.002
    assert np.nanquantile(np.abs(heights), 0.99) < 0.01


@pytest.mark.parametrize("scale", [1.15, 0.9, 1.3])
def test_depths_of_a_wrong_scale_are_corrected_where_the_feet_carry_the_map(scale):
    mapper, (turned, found), refused = walked_on(lambda image: image._replace(depths=image.depths * scale), FEET)
    assert found == pytest.approx(scale, rel=0.01)
    assert turned == 0.0
    assert refused == [(11, "shifted"), (21, "shifted")]
    assert mapper.error.scale == pytest.approx(1.0, abs=0.01)
    heights, _ = mapper.heights()
    assert np.nanmedian(np.abs(heights)) < 0.002


@pytest.mark.parametrize(
    ("degrees", "scale", "words"),
    [
        (4.0, 1.0, "not as stated: turned by 4.0 deg; its images"),
        (0.01, 1.15, "not as stated: depths +15 % off; its images"),
        (4.0, 0.9, "not as stated: turned by 4.0 deg, depths -10 % off; its images"),
        (0.04, 0.998, "as stated again"),
    ],
)
def test_of_a_camera_only_the_faults_that_were_found_are_logged(degrees, scale, words):
    assert words in depth_words(math.radians(degrees), scale)


def test_where_the_feet_contradict_the_map_as_the_image_does_the_map_begins_anew():
    mapper, _ = walked()
    raised = FEET + np.array([0.0, 0.0, 0.03])  # the odometry has lost 3 cm of height
    view = picture(Slope(0.03), 0.2, tick=10, sigma=0.002, rng=np.random.default_rng(2))
    assert mapper.look(view, 10 * TICK_NS, raised) > 500
    heights, _ = mapper.heights()
    assert np.nanmax(np.abs(heights - 0.03)) < 0.02
    assert np.nanmedian(np.abs(heights - 0.03)) < 0.003


def test_a_tilt_that_the_odometry_has_lost_is_no_turn_of_the_camera():
    """Feet and images lie on one plane that the map does not know: the robot is tilted otherwise than it believes."""
    mapper, _ = walked()
    rng, slope = np.random.default_rng(3), math.tan(math.radians(5.0))
    tilted = FEET + np.stack((0.0 * FEET[:, 0], 0.0 * FEET[:, 0], slope * FEET[:, 0]), 1)
    for k in range(10, 13):
        mapper.moved(pose(0.2, tick=k))
        mapper.look(picture(Slope(along=slope), 0.2, tick=k, sigma=0.002, rng=rng), k * TICK_NS, tilted)
    assert mapper.turned == 0.0
    assert not mapper.refused["shifted"]


def test_a_map_that_all_images_contradict_for_long_begins_anew():
    mapper, _ = walked()
    rng = np.random.default_rng(4)
    for k in range(10, 40):
        mapper.moved(pose(0.2, tick=k))
        view = picture(Slope(0.03), 0.2, tick=k, sigma=0.002, rng=rng)
        if k < 10 + MOST_DOUBTFUL:
            with pytest.raises(Refusal, match="lie elsewhere"):
                mapper.look(view, k * TICK_NS)
        else:
            mapper.look(view, k * TICK_NS)
    heights, _ = mapper.heights()
    assert np.nanmedian(np.abs(heights - 0.03)) < 0.002


@pytest.mark.parametrize("share", [0.3, 0.8])
def test_pixels_without_a_depth_are_left_out(share):
    mapper, view = walked()
    depths = view.depths.copy()
    depths[np.random.default_rng(3).random(depths.shape) < share] = np.nan
    assert mapper.look(view._replace(depths=depths), view.stamp_ns, FEET) > 100
    assert mapper.refused["depth"] == 0


@pytest.fixture
def service():
    one = MapperService(MapperConfig(robot="ragno", cell_m=0.01, cells=101))
    one.attach(Stage())
    one.on_start()
    return one


def image(view=GOOD, **changes):
    fields = {
        "width": WIDTH, "height": HEIGHT, "focal": FOCAL, "center": (WIDTH / 2, HEIGHT / 2), "sigma": 0.002,
        "sigma_square": 0.0, "position": tuple(PLACE), "quat_wxyz": tuple(view.quat_wxyz),
        "depths": b64encode(view.depths.astype("<f4").tobytes()).decode(), "stamp_ns": view.stamp_ns,
    }  # fmt: skip
    return DepthImage(**(fields | changes))


def tick(service, number, depth=None, x=0.0, initialised=True, joints=ROBOT.neutral):
    odometry = Odometry(
        position=(x, 0.0, BASE), quat_wxyz=(1, 0, 0, 0), yaw=0.0, velocity=(0, 0, 0), covariance=(0.0,) * 16,
        initialised=initialised, stamp_ns=number * TICK_NS,
    )  # fmt: skip
    messages = {
        STATE_ODOMETRY.key: odometry,
        HW_JOINTS.key: JointState(position=tuple(joints)),
        HW_CONTACTS.key: FootContacts(touch=((True,),) * 6, normal_force_n=(None,) * 6),
    }
    if depth is not None:
        messages[HW_DEPTH.key] = depth
    service.on_tick(TickInputs(Tick.model_construct(tick=number, epoch=0, stamp_ns=number * TICK_NS), messages))


def last(service) -> ElevationMap:
    key, message = service.runtime.sent[-1]
    assert key == STATE_ELEVATION.key
    return message


def layers(message):
    from base64 import b64decode

    shape = message.rows, message.cols
    return tuple(np.frombuffer(b64decode(text), "<f4").reshape(shape) for text in (message.heights, message.variances))


def test_the_service_publishes_what_it_saw_and_before_that_one_unknown_cell(service):
    tick(service, 0, initialised=False)
    assert (last(service).rows, last(service).cols) == (1, 1)
    assert np.isnan(layers(last(service))[0]).all()
    tick(service, 1)
    tick(service, 2, image(GOOD._replace(stamp_ns=2 * TICK_NS)))
    for number in range(3, 41):
        tick(service, number)
    message = last(service)
    assert (message.rows, message.version, message.refused.get("depths", 0)) == (101, 1, 0)
    heights, variances = layers(message)
    assert np.isfinite(heights[:, 70:]).sum() > 200
    assert np.nanmax(np.abs(heights[:, 70:])) < 0.01  # level ground under a trunk that stands at BASE by its odometry
    assert np.nanmin(variances) > 0.0
    assert np.isfinite(heights[50, 50])  # under the feet


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        (lambda at: image(stamp_ns=at, depths="no base64!"), "depths"),
        (lambda at: image(stamp_ns=at, width=WIDTH + 1), "depths"),
        (lambda at: image(stamp_ns=at, frame="odom"), "frame"),
        (lambda at: image(stamp_ns=at - 10**9), "late"),
        (lambda at: image(changed(GOOD, -1.0)._replace(stamp_ns=at)), "depths"),
    ],
)
def test_bad_images_are_counted_and_logged_once(service, wrong, code):
    tick(service, 1)
    for number in range(2, 41):
        tick(service, number, wrong(number * TICK_NS))
    message = last(service)
    assert message.refused[code] == 39
    assert message.version == 0
    (line,) = service.runtime.logged
    assert line.startswith(f"warning: hw/depth refused ({code})")


def test_a_jump_of_the_odometry_begins_the_map_anew(service):
    tick(service, 1)
    tick(service, 2, image(stamp_ns=2 * TICK_NS))
    assert service.mapper.heights() is not None
    tick(service, 3, x=0.5)
    assert service.mapper.heights() is None
    for number in range(4, 41):
        tick(service, number, x=0.5)
    heights, _ = layers(last(service))
    assert np.isfinite(heights).sum() > 100  # the plane under the feet at the new place
    assert [line.split(": ", 1)[1] for line in service.runtime.logged] == ["the odometry jumped: the map begins anew"]


def stride(x, turn=0.0):
    """Joint angles at which the feet stand as if the trunk had moved by x m and turned, rad, over them."""
    feet = foot_positions(ROBOT.model, ROBOT.neutral)
    places = (feet - np.array([x, 0.0, 0.0])) @ matrix_from_rpy(0.0, 0.0, turn)
    angles, reached = legs_ik(ROBOT.model, places)
    assert reached.all()
    return angles.ravel()


@pytest.mark.parametrize(("way", "turn"), [(0.0, 0.0), (0.02, 0.0), (0.015, 0.1)])
def test_a_map_survives_an_estimator_that_begins_anew(service, way, turn):
    """The robot has walked 0.3 m when its estimator is started anew, ends its step, and stands meanwhile."""
    rng = np.random.default_rng(8)
    for number in range(1, 16):
        x = 0.02 * number
        view = picture(Slope(), x, BASE, number, sigma=0.002, rng=rng)
        tick(service, number, image(view, stamp_ns=number * TICK_NS), x=x)
    before, variance = (layer.copy() for layer in service.mapper.heights())
    origin = service.mapper.origin
    for number, step in enumerate(np.linspace(0.0, 1.0, 11), 16):
        tick(service, number, initialised=False, joints=stride(step * way, step * turn))
    for number in range(27, 30):
        tick(service, number, joints=stride(way, turn))  # at (0, 0, BASE) and heading 0 by an odometry that is new
    pose = service.mapper.pose
    assert np.abs(pose.position - (0.3 + way, 0.0, BASE)).max() < 1e-3
    assert rpy_from_matrix(pose.rot)[2] == pytest.approx(turn, abs=2e-3)
    after, less_sure = service.mapper.heights()
    assert service.mapper.origin == origin
    assert np.array_equal(before, after, equal_nan=True)
    assert np.nanmin(less_sure - variance) > 0.8 * LAID.z**2
    assert any("began anew" in line for line in service.runtime.logged)
    view = picture(Slope(), 0.3 + way, BASE, 30, sigma=0.002, rng=rng)
    taken = service.mapper.images
    if turn == 0.0:
        tick(service, 30, image(view, stamp_ns=30 * TICK_NS), joints=stride(way, turn))
        assert service.mapper.images == taken + 1
        assert np.nanmedian(np.abs(service.mapper.heights()[0])) < 0.003


def test_the_look_of_the_scene_is_a_rotation():
    assert np.abs(LOOK @ LOOK.T - np.eye(3)).max() < 1e-12
    assert np.linalg.det(LOOK) == pytest.approx(1.0)
