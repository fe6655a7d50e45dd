"""Choice on a map with variances, as the robot measures it: unsure ground is unknown or worse, unseen ground too."""

from base64 import b64encode

import numpy as np
import pytest

from surefoot.errors import Refusal
from surefoot.geometry.heightmap import HeightMap
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.local import LocalSystem
from surefoot.schemas.footholds import AssessRequest, SelectRequest
from surefoot.schemas.hw import Tick
from surefoot.schemas.terrain import ElevationMap
from surefoot.schemas.topics import STATE_ELEVATION, TERRAIN_MAP
from surefoot.services.footholds.config import FootholdsConfig
from surefoot.services.footholds.ground import build_ground
from surefoot.services.footholds.relief import blur_relief
from surefoot.services.footholds.service import Footholds
from tests.services.footholds.grounds import CELL, flat
from tests.services.footholds.test_footholds_service import asked

CONFIG = FootholdsConfig(own_map=True)
SURE = 0.002**2


def text(layer: np.ndarray) -> str:
    return b64encode(layer.astype("<f4").tobytes()).decode()


def measured(z: np.ndarray, variance: np.ndarray | float = SURE, **changes: object) -> ElevationMap:
    heights = HeightMap(z=z.astype(np.float32), cell=CELL, origin=(-0.5, -0.4), version=3)
    variances = np.where(np.isnan(z), np.nan, np.broadcast_to(variance, z.shape))
    fields = {**heights.header(), "heights": text(z), "variances": text(variances)}
    return ElevationMap(**(fields | changes))  # pyright: ignore[reportArgumentType]


def give(service: Footholds, message: ElevationMap) -> None:
    service.on_tick(TickInputs(Tick.model_construct(tick=0, epoch=0), {STATE_ELEVATION.key: message}))


def choice(service: Footholds, request: SelectRequest):
    (leg,) = service.select(request).legs
    return leg


def test_by_its_configuration_it_reads_the_own_map_tick_by_tick_or_the_given_one_in_batches():
    own, given = Footholds(FootholdsConfig(own_map=True)), Footholds(FootholdsConfig())
    assert (own.inputs, own.batched) == ((STATE_ELEVATION,), False)
    assert (given.inputs, given.batched) == ((TERRAIN_MAP,), True)


@pytest.mark.parametrize(("own", "key"), [(True, "state/elevation"), (False, "terrain/map")])
def test_without_a_map_a_request_is_refused_with_the_topic_that_is_awaited(own, key):
    one = Footholds(FootholdsConfig(own_map=own))
    system = LocalSystem([one])
    with pytest.raises(Refusal, match=f"on {key} yet") as refusal:
        one.select(asked("lf"))
    assert refusal.value.code == "not_ready"
    system.close()


def test_a_sure_map_is_chosen_on_as_a_given_one(service):
    give(service, measured(flat()))
    leg = choice(service, asked("lf"))
    assert leg.status == "ok"
    assert abs(leg.foothold[2] - service.robot.foot_radius) < 1e-6


def test_unseen_ground_is_refused_and_so_is_ground_that_is_not_sure(service):
    z, where = flat(), choice_cell(service)
    hole = z.copy()
    hole[where[0] - 20 : where[0] + 21, where[1] - 20 : where[1] + 21] = np.nan
    give(service, measured(hole))
    unseen = choice(service, asked("lf"))
    assert (unseen.status, unseen.counts.unknown) == ("infeasible", 225)
    unsure = np.full(z.shape, SURE)
    unsure[where[0] - 20 : where[0] + 21, where[1] - 20 : where[1] + 21] = 0.04**2
    give(service, measured(z, unsure))
    assert choice(service, asked("lf")).counts.unknown == 225


def choice_cell(service: Footholds) -> tuple[int, int]:
    x, y, _ = asked("lf").legs[0].nominal
    return round((y + 0.4) / CELL), round((x + 0.5) / CELL)


def test_the_foot_goes_where_the_map_is_surer(service):
    z, (row, col) = flat(), choice_cell(service)
    variance = np.full(z.shape, SURE)
    variance[:, col - 4 :] = 0.015**2
    variance[:, col - 4 :: 2] = SURE  # beside sure cells: it is not a common error
    give(service, measured(z, variance))
    assert service.latched.known().surface.z[row, col] == 0.0
    assert choice(service, asked("lf")).offset[0] < -2 * CELL


def test_what_neighbours_share_moves_no_slope():
    z = HeightMap(z=flat().astype(np.float32), cell=CELL, origin=(-0.5, -0.4))
    ground = build_ground(z, 0.008)
    for shared in (1e-6, 1e-4):
        blurred = build_ground(z, 0.008, True, np.full(z.shape, shared, dtype=np.float32))
        assert blurred.relief.unsure.tobytes() == ground.relief.unsure.tobytes()


def test_slope_deviation_is_that_of_a_plane_through_cells_of_that_noise():
    z = HeightMap(z=flat().astype(np.float32), cell=CELL, origin=(-0.5, -0.4))
    relief = build_ground(z, 0.008).relief
    variance = np.full(z.shape, 1e-6, dtype=np.float32)
    variance[40, 40] = 5e-6  # 4e-6 above the least of its plane
    blur_relief(relief, variance, CELL, 2)
    x = CELL * (np.arange(25) % 5 - 2.0)
    assert relief.unsure[40, 40] == pytest.approx(np.sqrt(4e-6 * 2.0 / np.sum(x * x + x * x) * 2.0), rel=1e-3)
    assert relief.unsure[40, 46] == 0.0


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"variances": "!"}, "variances"),
        ({"variances": text(np.zeros(3))}, "as many float32"),
        ({"heights": "!"}, "no base64"),
        ({"heights": text(np.zeros(3))}, "need"),
        ({"frame": "odom"}, "must be 'map'"),
    ],
)
def test_a_map_that_cannot_be_is_logged_and_leaves_no_ground(service, wrong, words):
    give(service, measured(flat()))
    logged: list[str] = []
    service.log = lambda level, line: logged.append(line)
    give(service, measured(flat(), **wrong))
    assert len(logged) == 1
    assert words in logged[0]
    assert logged[0].startswith("state/elevation refused")
    with pytest.raises(Refusal) as refused:
        service.assess(AssessRequest())
    assert refused.value.code == "not_ready"


def test_negative_variances_and_a_map_of_unseen_cells_give_no_ground(service):
    logged: list[str] = []
    service.log = lambda level, line: logged.append(line)
    give(service, measured(flat(), -1.0))
    assert "must be >= 0" in logged[0]
    give(service, measured(np.full((1, 1), np.nan)))
    assert len(logged) == 1
    with pytest.raises(Refusal):
        service.select(asked("lf"))
