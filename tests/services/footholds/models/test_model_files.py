"""Model files: they come back to the byte, and what is wrong is refused by name."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surefoot.services.footholds.learning.fit import Candidate, LearnOptions, learn
from surefoot.services.footholds.models.files import (
    MAX_BINS,
    MAX_BYTES,
    MAX_TERMS,
    MAX_TRIALS,
    ModelError,
    decode,
    encode,
    load,
    save,
)
from surefoot.services.footholds.models.lattice import inputs
from tests.services.footholds.learning.made import gather, samples
from tests.services.refusals import refused


@pytest.fixture(scope="module")
def data() -> bytes:
    options = LearnOptions(candidates=(Candidate(8, 0.1, 1e-6),))
    return encode(learn(gather(samples(300)), options))


def test_a_file_comes_back(data: bytes, tmp_path: Path) -> None:
    model = decode(data)
    again = load(save(model, tmp_path / "m.json"))
    assert encode(again) == data
    assert again.name == "learned/300"
    assert not list(tmp_path.glob("*.part"))


def test_a_file_that_could_not_be_read_again_is_not_written(data: bytes, tmp_path: Path) -> None:
    model = replace(decode(data), trials=("0" * 12,) * (MAX_TRIALS + 1))
    with pytest.raises(ModelError, match="trials"):
        save(model, tmp_path / "m.json")
    assert not list(tmp_path.iterdir())


def changed(data: bytes, **changes: Any) -> bytes:
    raw = json.loads(data)
    for path, value in changes.items():
        target, *_, last = raw, *path.split("__")
        for name in path.split("__")[:-1]:
            target = target[name]
        target[last] = value
    return json.dumps(raw).encode()


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"schema": "surefoot.slip/9"}, "schema"),
        ({"cell": 0.0}, "cell"),
        ({"cell": float("nan")}, "cell"),
        ({"foot_radius": "large"}, "foot_radius"),
        ({"distance_weight": -1.0}, "distance_weight"),
        ({"surprise": 1}, "surprise"),
        ({"terms__weights": [float("nan")] * 9}, "terms.weights.0"),
        ({"terms__weights": [0.1]}, "terms"),
        ({"terms__rates": [[-0.1, 0.1, 0.1]] * 8}, "terms.rates"),
        ({"terms__centres": [[0.0, 0.0, 0.0]] * 2000}, "terms.centres"),
        ({"ranges": [[1.0, 0.0]] * 3}, "ranges"),
        ({"bins": [[0, 0, 0, -1.0, 0, 0]]}, "bins.0.3"),
        ({"bins": [[0, 0, 0, 1.0, 0, 0]] * 2}, "bins"),
        ({"bins": [[0, 0, 0, 1.0, 0, 0], [10**9, 0, 0, 1.0, 0, 0]]}, "bins"),
        ({"bins": [[-2000, -2000, 0, 1.0, 0, 0], [0, 0, 0, 1.0, 0, 0]]}, "bins"),
        ({"bins": [[10**400, 0, 0, 1.0, 0, 0]]}, "bins.0.0"),
        ({"bins": [[0, 0, 0, 1.0, 10**400, 0]]}, "bins.0.4"),
        ({"bins": [[0, 0, 0, 1.0, 0, 10**400]]}, "bins.0.5"),
        ({"support": 2**31}, "support"),
        ({"seed": 2**63}, "seed"),
        ({"enough": 0.0}, "enough"),
        ({"lattice__width": [0.0, 1.0, 1.0]}, "lattice"),
        ({"terms__weights": [0.0] * 8 + [7.0]}, "terms"),
        ({"terms__warps": ["log", "log", "identity"]}, "terms.warps"),
        ({"smooth": 1}, "smooth"),
        ({"title": ""}, "title"),
        ({"title": "x" * 65}, "title"),
        ({"cell": 1.001}, "cell"),
        ({"foot_radius": 0.0}, "foot_radius"),
        ({"foot_radius": 1.001}, "foot_radius"),
        ({"distance_weight": 1000.1}, "distance_weight"),
        ({"landing_error": -0.001}, "landing_error"),
        ({"landing_error": 0.101}, "landing_error"),
        ({"support": -1}, "support"),
        ({"seed": -1}, "seed"),
        ({"trials": ["0123456789a"]}, "trials.0"),
        ({"trials": ["0123456789ab"] * (MAX_TRIALS + 1)}, "trials"),
        ({"provenance": [""] * 1001}, "provenance"),
        ({"relief": True, "base": [-0.1] * 6}, "base.0"),
        ({"relief": True, "base": [10.1] * 6}, "base.0"),
        ({"relief": True, "base": [0.1] * 5}, "base"),
        ({"terms__scales": [0.0, 1.0, 1.0]}, "terms.scales.0"),
        ({"terms__scales": [1.0, 0.0, 1.0]}, "terms.scales.1"),
        ({"terms__scales": [1.0, 1.0, 0.0]}, "terms.scales.2"),
        ({"terms__weights": [0.1] * (MAX_TERMS + 2)}, "terms.weights"),
        ({"terms__rates": []}, "terms"),
        ({"terms__centres": [], "terms__rates": [], "terms__weights": [], "terms__constant": False}, "terms"),
        ({"bins": [[-(10**400), 0, 0, 1.0, 0, 0]]}, "bins.0.0"),
        ({"bins": [[-(10**9), 0, 0, 1.0, 0, 0]]}, "bins"),
    ],
)
def test_refusals_name_the_field(data: bytes, changes: dict[str, Any], field: str) -> None:
    with refused(ModelError, field=field):
        decode(changed(data, **changes))


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (lambda raw: raw["terms"].update(weights=[-w for w in raw["terms"]["weights"]]), "terms"),
        (lambda raw: raw["terms"].update(weights=[-1.0] * len(raw["terms"]["weights"])), "terms"),
        (lambda raw: raw["terms"].update(weights=[1e300] * len(raw["terms"]["weights"])), "terms"),
        (lambda raw: raw.update(bins=[]), "bins"),
        (lambda raw: raw.update(ranges=[[5.0, 6.0]] * 3), "ranges"),
        (lambda raw: raw.update(ranges=[[-1e300, 1e300]] * 3), "ranges"),
        (lambda raw: raw.update(bins=[[10**9, *each[1:]] for each in raw["bins"][:1]]), "bins"),
        (lambda raw: raw["bins"][0].__setitem__(4, -5), "bins"),
        (lambda raw: raw["bins"][0].__setitem__(3, 1e30), "bins"),
        (lambda raw: raw["bins"][0].__setitem__(5, 10**40), "bins"),
        (lambda raw: raw.update(relief=True, base=[0.1]), "base"),
        (lambda raw: raw.update(relief=False, base=[0.1] * 6), "relief"),
        (lambda raw: raw["terms"].update(family="elementary"), "terms.family"),
    ],
)
def test_models_that_are_of_no_use_are_refused_by_name(data: bytes, change: Any, field: str) -> None:
    raw = json.loads(data)
    change(raw)
    with refused(ModelError, field=field):
        decode(json.dumps(raw).encode())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"schema": "surefoot.slip/9"}, "must be 'surefoot.slip/2' or 'surefoot.slip/1', got 'surefoot.slip/9'"),
        (
            {
                "lattice__origin": [0.0] * 3,
                "lattice__width": [1e-3] * 3,
                "bins": [[-900, 0, -900, 1.0, 0, 0], [900, 50, 900, 1.0, 0, 0]],
            },
            "its keys span",
        ),
        ({"terms__weights": [0.1]}, "terms do not fit together"),
        (
            {"terms__centres": [], "terms__rates": [], "terms__weights": [], "terms__constant": False},
            "terms do not fit together",
        ),
        ({"terms__weights": [1e300] * 9}, "no prediction lies between 0 and 1"),
    ],
)
def test_refusals_name_the_cause(data: bytes, changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ModelError, match=words):
        decode(changed(data, **changes))


@pytest.mark.parametrize("end", [0, 1])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_each_end_of_a_range_belongs_to_the_bins(data: bytes, axis: int, end: int) -> None:
    raw = json.loads(data)
    raw["ranges"][axis][end] += (-10.0, 10.0)[end]
    with refused(ModelError, field="ranges"):
        decode(json.dumps(raw).encode())


def test_a_range_that_ends_before_it_begins_is_refused_though_its_ends_belong_to_the_bins(data: bytes) -> None:
    raw, model = json.loads(data), decode(data)
    raw["bins"] = raw["bins"][:1]
    (centre,) = inputs(model.lattice.centres(dict([next(iter(model.bins.items()))])))
    raw["ranges"] = [[float(c - 1e-3), float(c + 1e-3)] for c in centre]
    decode(json.dumps(raw).encode())
    raw["ranges"] = [[high, low] for low, high in raw["ranges"]]
    with pytest.raises(ModelError, match="is empty"):
        decode(json.dumps(raw).encode())


def test_a_model_of_another_kind_is_not_written_and_too_many_bytes_are_not_read(data: bytes) -> None:
    model = decode(data)
    with refused(ModelError, field="terms"):
        encode(replace(model, terms=replace(model.terms, basis=object())))  # type: ignore[arg-type]
    with refused(ModelError, "too_large"):
        decode(bytes(MAX_BYTES + 1))
    bins = [[i % 100, i // 100, 0, 1.0, 0, 0] for i in range(MAX_BINS + 1)]
    with pytest.raises(ModelError, match=f"bins: List should have at most {MAX_BINS} items"):
        decode(changed(data, bins=bins))


def test_a_file_of_the_version_before_is_read(data: bytes) -> None:
    raw = json.loads(data)
    raw |= {"schema": "surefoot.slip/1"}
    for name in ("relief", "base", "enough", "trials"):
        raw.pop(name)
    assert decode(json.dumps(raw).encode()).name == "learned/300"


def mutated(raw: Any, rng: Any) -> None:
    """Change one number, text or list of a model in place."""
    while True:
        keys = list(raw) if isinstance(raw, dict) else list(range(len(raw)))
        if not keys:
            return
        key = keys[int(rng.integers(len(keys)))]
        if isinstance(raw[key], (dict, list)) and raw[key] and rng.random() < 0.9:
            raw = raw[key]
            continue
        values = (0, -1, 1e300, -1e300, 1e-300, 10**9, None, "x", [], {}, True, 0.5, -0.5, 1e6)
        raw[key] = values[int(rng.integers(len(values)))]
        return


def test_mutations_are_refused_or_still_predict_their_outcomes(data: bytes) -> None:
    rng, accepted = np.random.default_rng(0), 0
    for _ in range(150):
        raw = json.loads(data)
        mutated(raw, rng)
        try:
            model = decode(json.dumps(raw).encode())
        except ModelError:
            continue
        accepted += 1
        steep = np.array([[0.0, b, 0.0] for b in (0.05, 0.7)])
        flat, rough = model.exact(steep)
        assert flat < rough
    assert accepted < 100


@pytest.mark.parametrize("text", [b"", b"{", b"[]", b"null", b"\xff\xfe", b"[" * 100_000, b'{"schema": "x"}'])
def test_what_is_no_model(text: bytes) -> None:
    with pytest.raises(ModelError):
        decode(text)


def test_cut_off_anywhere(data: bytes) -> None:
    for end in range(0, len(data) - 3, 997):
        with pytest.raises(ModelError):
            decode(data[:end])


def test_absent_huge_and_unwritable(data: bytes, tmp_path: Path) -> None:
    with refused(ModelError, "unreadable"):
        load(tmp_path / "none.json")
    huge = tmp_path / "huge.json"
    with huge.open("wb") as stream:
        stream.truncate(MAX_BYTES + 1)
    with refused(ModelError, "too_large"):
        load(huge)
    with refused(ModelError, "unwritable"):
        save(decode(data), tmp_path / "none" / "m.json")
