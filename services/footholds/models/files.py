"""Files of learned slip models: versioned JSON; a refusal names the wrong field."""

import json
import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from surefoot.disk import regular_size, whole
from surefoot.errors import SurefootError

from .bases import Gaussians
from .lattice import ROUGHEST, Bin, Key, Lattice, LatticeError, inputs
from .learned import KNOTS, Conditions, LearnedModel, Terms
from .shipped import shipped as shipped

SCHEMA = "surefoot.slip/2"
OLD = "surefoot.slip/1"
"""Format name of older model files, which hold coefficients of 3 x 3 cells and no identities of trials; still
readable."""
MAX_BYTES = 16_000_000
"""Largest size of a model file, bytes; a larger file is refused."""
MAX_TERMS = 1000
MAX_BINS = 200_000
MAX_TRIALS = 500_000
"""Largest number of trial identities in a model file: one for each outcome that a walking robot has learned from."""
MAX_SUM = 10**40
"""Largest integer sum of a bin in a model file (slips in 1e-9, squares in 1e-18): valid sums are smaller, and a float
holds it."""
MAX_COUNT = 1e9
"""Largest number of samples of a bin in a model file."""
LEAST_ERROR = 1e-4
"""Mean square error of slip per stroke below which a model's predictions of its own bins are accepted
unconditionally."""
MAX_SPAN = 2_000_000
"""Largest number of bins in the box from the smallest to the largest index on all axes: it becomes a dense array, 8
MB."""
DIGITS = 10
"""Number of significant digits with which the numbers of a fit are written to a model file."""

Whole = Annotated[int, Field(ge=-MAX_SUM, le=MAX_SUM)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Triple = tuple[Finite, Finite, Finite]
Rows = Annotated[list[Triple], Field(max_length=MAX_TERMS)]


class ModelError(SurefootError):
    """Error for a slip model file that cannot be used."""


class _FilePart(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class _LatticePart(_FilePart):
    origin: Triple
    width: Triple


class _TermsPart(_FilePart):
    family: Literal["gaussian"]
    scales: tuple[Annotated[Finite, Field(gt=0)], Annotated[Finite, Field(gt=0)], Annotated[Finite, Field(gt=0)]]
    warps: tuple[Literal["identity", "log", "asinh"], Literal["identity", "log", "asinh"], Literal["identity", "asinh"]]
    centres: Rows
    rates: Rows
    constant: bool
    weights: Annotated[list[Finite], Field(max_length=MAX_TERMS + 1)]


class _ModelFile(_FilePart):
    schema_: Literal["surefoot.slip/1", "surefoot.slip/2"] = Field(alias="schema")
    title: Annotated[str, Field(min_length=1, max_length=64)]
    robot: str
    robot_hash: str
    cell: Annotated[Finite, Field(gt=0, le=1)]
    smooth: bool
    foot_radius: Annotated[Finite, Field(gt=0, le=1)]
    outcome: Literal["sliding / |f|"]
    distance_weight: Annotated[Finite, Field(ge=0, le=1000)]
    distance_weight_unit: Literal["1/m"]
    landing_error: Annotated[Finite, Field(ge=0, le=0.1)]
    support: Annotated[int, Field(ge=0, lt=2**31)]
    relief: bool = False
    enough: Annotated[Finite, Field(gt=0)] | None = None
    base: list[Annotated[Finite, Field(ge=0, le=10)]] = []
    trials: Annotated[list[Annotated[str, Field(pattern=r"^[0-9a-f]{12}$")]], Field(max_length=MAX_TRIALS)] = []
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    lattice: _LatticePart
    ranges: tuple[tuple[Finite, Finite], tuple[Finite, Finite], tuple[Finite, Finite]]
    terms: _TermsPart
    choice: dict[str, Finite]
    provenance: Annotated[list[str], Field(max_length=1000)]
    bins: Annotated[
        list[tuple[Whole, Whole, Whole, Annotated[Finite, Field(gt=0)], Whole, Whole]], Field(max_length=MAX_BINS)
    ]


def encode(model: LearnedModel) -> bytes:
    """Return a model as the bytes of its file; equal models give equal bytes.

    Raises:
        ModelError: its terms are no Gaussians, or it has too many trials.
    """
    basis, c = model.terms.basis, model.conditions
    if not isinstance(basis, Gaussians):
        raise ModelError("invalid", f"{model.name}: only Gaussians are written, got {type(basis).__name__}", "terms")
    if len(model.trials) > MAX_TRIALS:
        text = f"{model.name} has {len(model.trials)} trials, at most {MAX_TRIALS} are written"
        raise ModelError("too_large", text, "trials")
    terms: dict[str, Any] = {
        "family": "gaussian", "scales": _rounded(model.terms.scales), "warps": list(model.terms.warps),
        "constant": basis.constant, "weights": _rounded(model.terms.weights), "centres": _rounded(basis.centres),
        "rates": _rounded(basis.widths),
    }  # fmt: skip
    head = {
        "schema": SCHEMA, "title": model.title, "robot": c.robot, "robot_hash": c.robot_hash, "cell": c.cell,
        "smooth": c.smooth, "foot_radius": c.foot_radius, "outcome": "sliding / |f|",
        "distance_weight": model.distance_weight, "distance_weight_unit": "1/m", "landing_error": model.landing_error,
        "support": model.support, "relief": model.relief, "base": _rounded(np.array(model.base)),
        "enough": None if math.isinf(model.enough) else model.enough, "seed": model.seed,
        "lattice": {"origin": list(model.lattice.origin), "width": list(model.lattice.width)},
        "ranges": _rounded(np.array(model.ranges)), "choice": dict(sorted(model.choice.items())),
        "provenance": list(model.provenance), "trials": list(model.trials), "terms": terms,
    }  # fmt: skip
    lines = [f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in head.items()]
    bins = ",\n".join(
        f"    {json.dumps([*key, each.count, each.total, each.squares])}" for key, each in sorted(model.bins.items())
    )
    return ("{\n" + ",\n".join(lines) + ',\n  "bins": [\n' + bins + "\n  ]\n}\n").encode()


def decode(data: bytes, source: str = "model") -> LearnedModel:
    """Return the model of a file's bytes.

    Raises:
        ModelError: the bytes are no model; it names the field.
    """
    if len(data) > MAX_BYTES:
        raise ModelError("too_large", f"{source} has {len(data)} bytes, at most {MAX_BYTES} are allowed")
    try:
        raw: Any = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise ModelError("invalid", f"{source} is no JSON: {error}") from None
    schema = raw.get("schema") if isinstance(raw, dict) else None
    if schema not in (SCHEMA, OLD):
        raise ModelError("schema", f"{source} must be {SCHEMA!r} or {OLD!r}, got {schema!r}", "schema")
    try:
        entries = _ModelFile.model_validate_json(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ModelError("invalid", f"{source}: {where}: {first['msg']}, got {first['input']!r:.80}", where) from None
    try:
        lattice = Lattice(entries.lattice.origin, entries.lattice.width)
    except LatticeError as error:
        raise ModelError("invalid", f"{source}: {error}", error.field) from None
    bins: dict[Key, Bin] = {(i, j, k): Bin(count, total, squares) for i, j, k, count, total, squares in entries.bins}
    if len(bins) != len(entries.bins):
        raise ModelError("invalid", f"{source}: a bin is given twice", "bins")
    if entries.relief and len(entries.base) != 1 + len(KNOTS):
        raise ModelError("invalid", f"{source}: base needs {1 + len(KNOTS)} weights, got {len(entries.base)}", "base")
    if entries.base and not entries.relief:
        raise ModelError("invalid", f"{source}: base goes with relief = true, got false: it is of planes", "relief")
    _check_outcomes(lattice, bins, source)
    _check_ranges(lattice, bins, entries.ranges, source)
    scales, warps = np.array(entries.terms.scales), tuple(entries.terms.warps)
    terms = Terms(_basis(entries.terms, source), np.array(entries.terms.weights), warps, scales)
    model = LearnedModel(
        title=entries.title,
        conditions=Conditions(entries.cell, entries.smooth, entries.foot_radius, entries.robot, entries.robot_hash),
        terms=terms,
        lattice=lattice, bins=bins, ranges=entries.ranges, distance_weight=entries.distance_weight,
        landing_error=entries.landing_error, support=entries.support, relief=entries.relief, base=tuple(entries.base),
        enough=math.inf if entries.enough is None else entries.enough,
        trials=tuple(entries.trials), seed=entries.seed, choice=entries.choice,
        provenance=tuple(entries.provenance),
    )  # fmt: skip
    check(model, source)
    return model


def _check_outcomes(lattice: Lattice, bins: dict[Key, Bin], source: str) -> None:
    """Raise ModelError for bins that no samples can make: none, beyond all ground, or of impossible slips."""
    if not bins:
        raise ModelError("useless", f"{source}: it has no bins, at least one is needed", "bins")
    first, last = np.array(lattice.origin), np.array(lattice.width)
    keys = np.array(list(bins), dtype=np.float64)
    low, high = first + keys * last, first + (keys + 1.0) * last
    ends = np.array([[-1.0, 1.0], [0.0, ROUGHEST], [-1.0, 1.0]])
    if (high < ends[:, 0]).any() or (low > ends[:, 1]).any():
        worst = list(bins)[int(np.argmax(np.abs(keys).max(axis=1)))]
        raise ModelError("invalid", f"{source}: the bin {worst} lies beyond any ground {ends.tolist()}", "bins")
    span = math.prod(int(n) + 1 for n in np.ptp(keys, axis=0))
    if span > MAX_SPAN:
        raise ModelError("invalid", f"{source}: its keys span {span} bins, at most {MAX_SPAN} are allowed", "bins")
    for key, each in bins.items():
        if each.count > MAX_COUNT or not each.possible:
            facts = f"count {each.count:g}, mean slip {each.mean:g}"
            raise ModelError("invalid", f"{source}: no samples can make the bin {key} with {facts}", "bins")


def _check_ranges(lattice: Lattice, bins: dict[Key, Bin], ranges: tuple[tuple[float, float], ...], source: str) -> None:
    """Raise ModelError for ranges of inputs that are empty or do not belong to the bins.

    Each end has to lie within a bin's width of the bins' inputs.
    """
    centres = lattice.centres(bins)
    u, slack = inputs(centres), np.array(lattice.width)
    slack[0] = ROUGHEST * lattice.width[0] + lattice.width[1]
    names = ("K1 / (8 cell)", "K2 / (8 cell)", "cos K3")
    for (low, high), axis, seen, near in zip(ranges, names, u.T, slack, strict=True):
        if not low <= high:
            raise ModelError("invalid", f"{source}: the range of {axis} is empty: {low} to {high}", "ranges")
        if abs(low - seen.min()) > near or abs(high - seen.max()) > near:
            found = f"{low:g} to {high:g}, its bins have {seen.min():g} to {seen.max():g}"
            raise ModelError("invalid", f"{source}: the range of {axis} is {found}", "ranges")


def check(model: LearnedModel, source: str = "model") -> None:
    """Raise ModelError for a model that does not predict its own outcomes; `source` names it in the message.

    Raises:
        ModelError: all predictions are NaN or beyond 1, or they are worse than the mean of all outcomes.
    """
    try:
        values = model.table[0]
    except ValueError as error:  # a logarithm of what is not positive
        raise ModelError("invalid", f"{source}: {error}", "terms.warps") from None
    usable = np.isfinite(values) & (values <= 1.0)
    if not usable.any():
        raise ModelError("useless", f"{source}: no prediction lies between 0 and 1", "terms")
    count = np.array([each.count for each in model.bins.values()])
    mean = np.minimum(np.array([each.mean for each in model.bins.values()]), 1.0)
    found = np.minimum(model.exact(model.lattice.centres(model.bins)), 1.0)
    left, all_ = (float(count @ (of - mean) ** 2) for of in (found, float(count @ mean) / float(count.sum())))
    if not left <= max(all_, LEAST_ERROR * float(count.sum())):
        raise ModelError(
            "useless", f"{source}: its terms predict its own {len(mean)} bins worse than their mean does", "terms"
        )


def load(path: str | Path) -> LearnedModel:
    """Return the slip model of a file.

    Raises:
        ModelError: unreadable, too large, or not a model.
    """
    source = Path(path)
    try:
        size = regular_size(source)
        if size > MAX_BYTES:
            raise ModelError("too_large", f"{source.name} has {size} bytes, at most {MAX_BYTES} are allowed")
        data = source.read_bytes()
    except OSError as error:
        raise ModelError("unreadable", f"{str(source)!r} cannot be read: {error.strerror}") from None
    return decode(data, source.name)


def save(model: LearnedModel, path: str | Path) -> Path:
    """Write a model file, whole or not at all; return its path.

    Raises:
        ModelError: the folder cannot be written, or the disk is full.
    """
    target = Path(path)
    try:
        with whole(target) as part:
            part.write_bytes(encode(model))
    except OSError as error:
        raise ModelError("unwritable", f"{str(target)!r} cannot be written: {error.strerror}") from None
    return target


def _basis(terms: _TermsPart, source: str) -> Gaussians:
    m = len(terms.centres)
    wanted = m + terms.constant
    if len(terms.rates) != m or len(terms.weights) != wanted or wanted == 0:
        found = f"{m} centres, {len(terms.rates)} rates, {len(terms.weights)} weights"
        raise ModelError("invalid", f"{source}: terms do not fit together: {found}", "terms")
    centres, rates = np.array(terms.centres).reshape(m, 3), np.array(terms.rates).reshape(m, 3)
    if (rates < 0.0).any():
        raise ModelError("invalid", f"{source}: a Gaussian needs rates >= 0, got {rates.min()!r}", "terms.rates")
    return Gaussians(centres, rates, terms.constant)


def _rounded(values: np.ndarray) -> Any:
    """Return an array of any shape as nested lists, every number with 10 digits."""
    return json.loads(
        json.dumps(values.tolist()),
        parse_float=lambda text: float(f"{float(text):.{DIGITS}g}") if math.isfinite(float(text)) else float(text),
    )
