"""Compiling tells at once that it takes long, but only once, and how far it is; what fails is told by name."""

import pytest

from surefoot.errors import SurefootError
from surefoot.kernels import warming


@pytest.fixture(autouse=True)
def apart(monkeypatch, tmp_path):
    """Stamps of its own; the kernels' caches stay where they are."""
    monkeypatch.setattr(warming, "_stamps", lambda: tmp_path / "warm")


def test_says_first_that_it_takes_long_and_then_how_far_it_is(monkeypatch):
    chosen = tuple(name for name in warming.kernel_modules() if name.startswith("surefoot.services.footholds"))[:2]
    monkeypatch.setattr(warming, "kernel_modules", lambda: chosen)
    told = []
    assert warming.is_cold()
    warming.warm_if_cold(told.append)
    assert told[0] == f"compiling numeric kernels: {len(chosen)} modules, takes a minute or two, only this once"
    assert [line.split(" after ")[0] for line in told[1:]] == [f"  {n} of {len(chosen)}" for n in (1, 2)]
    assert not warming.is_cold()
    warming.warm_if_cold(told.append)
    assert len(told) == 3


def test_what_cannot_be_compiled_is_told_by_name(monkeypatch):
    monkeypatch.setattr(warming, "kernel_modules", lambda: ("services.nothing",))
    with pytest.raises(SurefootError) as caught:
        warming.warm_all()
    assert "services.nothing" in caught.value.message
    assert "\n" not in caught.value.message
    assert warming.is_cold()
