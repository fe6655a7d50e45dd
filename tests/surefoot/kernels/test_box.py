"""Arguments in a box: shared with Python, alive as long as the box, and no longer."""

import gc
import sys
import threading
import weakref
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.kernels.box import KernelBox
from surefoot.kernels.jit import free_kernel, kernel


class Parts(NamedTuple):
    numbers: Array
    step: float


@kernel
def boxed(parts: Parts) -> KernelBox[Parts]:
    return KernelBox(parts)


@kernel
def advance(box: KernelBox[Parts]) -> float:
    parts = box.parts
    kept = parts.numbers[1:]
    kept[0] += parts.step
    return float(kept[0])


@kernel
def rows_of(box: KernelBox[Parts]) -> tuple[Array, Array]:
    numbers = box.parts.numbers
    return numbers[:1], numbers.copy()


@free_kernel
def total(numbers: Array, rounds: int) -> float:
    out = 0.0
    for _ in range(rounds):
        part = numbers[1:]
        out += part[0] + numbers.copy()[0]
    return out


def test_a_box_shares_its_arrays_and_copies_its_numbers():
    numbers = np.zeros(3)
    box = boxed(Parts(numbers, 0.5))
    numbers[1] = 2.0
    assert [advance(box), advance(box)] == [2.5, 3.0]
    assert numbers.tolist() == [0.0, 3.0, 0.0]


def test_arrays_live_as_long_as_their_box_or_what_was_returned_of_them():
    numbers = np.arange(3.0)
    box, alive = boxed(Parts(numbers, 1.0)), weakref.ref(numbers)
    del numbers
    for _ in range(100):
        advance(box)
    gc.collect()
    assert alive() is not None
    view, copied = rows_of(box)
    del box
    gc.collect()
    assert view.tolist() == [0.0]
    assert copied[1] == 101.0
    assert alive() is not None
    del view
    gc.collect()
    assert alive() is None


def test_kernels_without_the_interpreters_lock_leave_no_references_behind():
    numbers, found = np.ones(8), list[float]()
    total(numbers, 1)
    before = sys.getrefcount(numbers)
    threads = [threading.Thread(target=lambda: found.append(total(numbers, 20_000))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [40_000.0] * 4
    assert sys.getrefcount(numbers) == before
