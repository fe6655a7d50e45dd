"""After the dry run nothing is compiled or loaded for any kind of ground."""

import pytest

from surefoot.kernels import jit
from surefoot.services.simulator import world
from surefoot.services.simulator.ground.terrain import KINDS, make_terrain


@pytest.mark.parametrize("kind", KINDS)
def test_no_kernel_is_loaded_for_a_ground_after_the_dry_run(kind: str) -> None:
    jit.set_aside()
    world.rehearse()
    before = jit.loaded()
    assert make_terrain(kind, seed=1).quat_wxyz.shape == (4,)
    now = jit.loaded()
    assert [name for name in now if now[name] != before.get(name)] == []
