"""Model files: they come back to the byte, and what is wrong is refused by name."""

import json
from pathlib import Path
from typing import Any

import pytest

from surefoot.services.footholds.learning.fit import Candidate, LearnOptions, learn
from surefoot.services.footholds.learning.samples import gather
from surefoot.services.footholds.models.bases import DECAY
from surefoot.services.footholds.models.files import MAX_BYTES, ModelError, decode, encode, load, save
from tests.services.footholds.learning.made import samples
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
        ({"lattice__width": [0.0, 1.0, 1.0]}, "lattice"),
        ({"terms__weights": [0.0] * 8 + [7.0]}, "terms"),
        ({"terms__warps": ["log", "log", "identity"]}, "terms.warps"),
    ],
)
def test_refusals_name_the_field(data: bytes, changes: dict[str, Any], field: str) -> None:
    with refused(ModelError, field=field):
        decode(changed(data, **changes))


@pytest.mark.parametrize("rate", [1e6, -1e6])
def test_terms_that_overflow_predict_nothing(data: bytes, rate: float) -> None:
    terms = {"terms__family": "elementary", "terms__kinds": [[DECAY, DECAY, DECAY]], "terms__constant": False}
    terms |= {"terms__centres": [[1e3, 1e3, 1e3]], "terms__rates": [[rate] * 3], "terms__weights": [1e300]}
    if rate < 0.0:
        terms["terms__centres"] = [[-1e3, -1e3, -1e3]]
    with refused(ModelError, "useless"):
        decode(changed(data, **terms))


@pytest.mark.parametrize("text", [b"", b"{", b"[]", b"null", b"\xff\xfe", b"[" * 100_000, b'{"schema": "x"}'])
def test_what_is_no_model(text: bytes) -> None:
    with pytest.raises(ModelError):
        decode(text)


def test_cut_off_anywhere(data: bytes) -> None:
    for end in range(0, len(data) - 3, 997):
        with pytest.raises(ModelError):
            decode(data[:end])


def test_absent_huge_and_unwritable(data: bytes, tmp_path: Path) -> None:
    with refused(ModelError, "absent"):
        load(tmp_path / "none.json")
    huge = tmp_path / "huge.json"
    with huge.open("wb") as stream:
        stream.truncate(MAX_BYTES + 1)
    with refused(ModelError, "too_large"):
        load(huge)
    with refused(ModelError, "unwritable"):
        save(decode(data), tmp_path / "none" / "m.json")
