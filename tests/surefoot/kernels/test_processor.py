"""One level of processors shares its kernels; any other has its own, also where it is emulated on a better one."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import llvmlite.binding as llvm
import pytest

from surefoot.kernels import processor as module
from surefoot.kernels.processor import LEVEL, NEEDS

EMULATOR = shutil.which("qemu-x86_64")
PROGRAM = """
import sys
sys.path[:0] = sys.argv[1:]
from surefoot.kernels.processor import LEVEL, processor
from surefoot import stability
feet = stability.contacts([[0.1, 0.1, 0.0], [0.1, -0.1, 0.0], [-0.1, 0.0, 0.05]], friction=0.5)
region = stability.region(feet)
print(processor() == LEVEL, region.inner.tobytes().hex(), region.outer.tobytes().hex())
"""


@pytest.mark.parametrize("lost", [None, *sorted(NEEDS)])
def test_a_processor_that_lacks_a_feature_is_not_of_the_level(monkeypatch, lost):
    features = {**dict.fromkeys(NEEDS, True), "sse2": True, "avx512f": False, **({lost: False} if lost else {})}
    monkeypatch.setattr(llvm, "get_host_cpu_features", lambda: features)
    name = module.processor.__wrapped__()
    assert (name == LEVEL) is (lost is None)
    assert lost is None or ("sse2" in name.split() and lost not in name.split())


@pytest.mark.slow
@pytest.mark.skipif(EMULATOR is None, reason="no emulator here: apt-get install qemu-user")
def test_a_processor_without_avx2_gives_the_same_bits(tmp_path):
    python, places = Path(sys.executable).resolve(), [path for path in sys.path if path]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    shown: list[list[str]] = []
    for before in ((), (str(EMULATOR), "-cpu", "Nehalem")):
        done = subprocess.run(
            [*before, str(python), "-I", "-c", PROGRAM, *places], env=environment, capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        shown.append(done.stdout.split())
    assert shown[1][0] == "False"
    assert shown[0][1:] == shown[1][1:]
