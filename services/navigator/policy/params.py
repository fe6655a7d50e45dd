"""Model of a robot that navigates: scene, actions, drift, sight, filter and task, in one frozen, versioned object.

It is loaded from TOML (`params/*.toml` ship) and each value can be changed by `key=value`. Simulation, planning,
learning and filter take their numbers from here, so one hash identifies the model that a policy was made for.
"""

import hashlib
import json
import math
import tomllib
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from surefoot.errors import ConfigError
from surefoot.files import MAX_FILE_BYTES, FileError, read_regular
from surefoot.lockstep.config import value_of
from surefoot.nearest import did_you_mean

from .settings import Conduct, ModelPart, NotNegative, OdometryNoise, Positive

Share = Annotated[float, Field(ge=0, le=1)]
Kind = Literal["stand", "turn", "walk"]

KINDS: tuple[Kind, ...] = ("stand", "turn", "walk")
DETOUR = 1.16
"""Number of actions to a goal per step of a straight walk there, rotations included: 58 for 5 m in 10 cm steps (robot
of Osswald et al.)."""


class Scene(ModelPart):
    """Corridor, start and goal of a simulated episode."""

    x_min: float = Field(default=-1.0, description="m, wall behind the start")
    x_max: float = Field(default=6.5, description="m, wall behind the goal")
    y_min: float = Field(default=-1.0, description="m, right wall")
    y_max: float = Field(default=1.0, description="m, left wall")
    robot_radius: NotNegative = Field(default=0.15, description="m, the centre keeps this distance from walls")
    look_ahead: NotNegative = Field(default=0.10, description="m, a wall so far ahead of the radius blocks the robot")
    start_x: float = Field(default=0.0, description="m")
    start_y: float = Field(default=0.0, description="m")
    start_yaw_deg: float = Field(default=0.0, description="deg")
    goal_x: float = Field(default=5.0, description="m")
    goal_y: float = Field(default=0.0, description="m")
    goal_radius: Positive = Field(default=0.15, description="m, the goal is reached when the true position is so near")
    time_limit: Positive = Field(default=700.0, description="s, an episode is cut off then")
    landmarks_per_m2: NotNegative = Field(default=40.0, le=400, description="1/m^2, Poisson, drawn for each episode")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        r = self.robot_radius
        for name, x, y in (("start", self.start_x, self.start_y), ("goal", self.goal_x, self.goal_y)):
            if not (self.x_min + r <= x <= self.x_max - r and self.y_min + r <= y <= self.y_max - r):
                raise ValueError(f"{name} ({x}, {y}) is not inside the walls less robot_radius {r}")
        return self


class Drift(ModelPart):
    """Heading drift: unwanted turning in proportion to the distance walked."""

    kind: Literal["sign", "normal"] = Field(
        default="sign", description="sign: +-value, at random per episode; normal: drawn with this standard deviation"
    )
    course: Literal["constant", "flip", "step", "ramp"] = Field(
        default="constant",
        description="in an episode: flip: the other sign from half of the way on, step: none before, ramp: evenly from "
        "the value to its opposite",
    )
    per_10cm_deg: NotNegative = Field(default=4.0, description="deg per 10 cm walked")
    known_sd_deg: NotNegative = Field(
        default=4.3818, description="deg per 10 cm, what the filter expects: its start value is 0 with this deviation"
    )


class SightModel(ModelPart):
    """Detection of landmarks in a camera frame; an action may override its footprint and probability."""

    range_min: NotNegative = Field(default=0.15, description="m, nearest landmark in view")
    range_max: Positive = Field(default=0.95, description="m, farthest")
    half_angle_deg: Positive = Field(default=23.0, le=180, description="deg, to each side")
    most: int = Field(default=10, ge=1, le=64, description="landmarks used of a frame")
    range_sd: NotNegative = Field(default=0.15, description="m, noise of a range while moving")
    range_sd_share: NotNegative = Field(default=0.0, description="noise in proportion to the range, added in squares")
    bearing_sd_deg: Positive = Field(default=10.0, description="deg, noise of a bearing while moving")
    standing_share: Positive = Field(default=0.4, description="noise standing, relative to moving")
    moving_match_share: Share = Field(default=1.0, description="factor on the match probability of all moving actions")
    tilt_sd_deg: NotNegative = Field(default=0.0, description="deg, roll and pitch error common to a frame; 0 = none")
    pitch_deg: float = Field(default=0.0, ge=-20, le=20, description="deg, error of pitch in the mean, downwards")
    tilt_keep: Share = Field(default=0.0, description="share of the tilt error that the next frame of 0.1 s has again")
    standing_tilt_keep: Share | None = Field(
        default=None, description="share of the tilt error that is left after 0.1 s of standing; none = tilt_keep"
    )
    sway_sd: NotNegative = Field(default=0.0, description="m, sway of the body beside the commanded path")
    sway_keep: Share = Field(default=0.72, description="share of the sway that the next frame of 0.1 s has again")
    camera_height: Positive = Field(default=0.45, description="m above the floor")


class ActionModel(ModelPart):
    """Action that a policy may choose: motion, duration, camera frames and noise."""

    kind: Kind = Field(description="stand, turn on the spot, or walk (straight or on an arc)")
    forward: float = Field(default=0.0, ge=0, le=1, description="m")
    turn_deg: float = Field(default=0.0, ge=-180, le=180, description="deg, left positive")
    duration: Positive = Field(description="s")
    frames: int = Field(default=1, ge=1, le=64, description="frames of the camera that are used")
    match: Share = Field(description="probability that a landmark in view is recognised")
    along_sd: NotNegative = Field(default=0.0, description="m, noise of the position along the heading, of the action")
    across_sd: NotNegative = Field(default=0.0, description="m, across")
    heading_sd_deg: NotNegative = Field(default=0.0, description="deg")
    drift_walk_deg: NotNegative = Field(default=0.0, description="deg per 10 cm, change of the drift that is expected")
    range_min: float | None = Field(default=None, ge=0, description="m, where the footprint differs from `sight`")
    range_max: float | None = Field(default=None, gt=0, description="m, likewise")
    half_angle_deg: float | None = Field(default=None, gt=0, le=180, description="deg, likewise")


class Filter(ModelPart):
    """Uncertainty of the belief at the start, and number of its states."""

    states: Literal[3, 4] = Field(default=4, description="3: drift is noise (paper), 4: drift is estimated")
    position_sd: NotNegative = Field(default=0.05, description="m, at the start, of x and of y")
    heading_sd_deg: NotNegative = Field(default=5.0, description="deg, at the start")


class Guards(ModelPart):
    """Limits of repeated decisions (stands or turns in a row), for every policy."""

    stands: int = Field(default=15, ge=1, description="stands in a row, then the robot must move")
    turns: int = Field(
        default=16, ge=1, description="turns in a row (16 of 23 deg: once around), then it must not turn"
    )


class Reward(ModelPart):
    """Return of an episode, equation (7) of Osswald et al.: minus the seconds, plus a bonus at the goal."""

    goal: NotNegative = Field(default=200.0, description="for the step that reaches the goal")
    gamma: float = Field(default=0.99, gt=0, le=1, description="discount per action")


class NavigationModel(ModelPart):
    """All numbers of a navigating robot: scene, drift, sight, filter, reward, conduct and actions."""

    version: Literal[1] = Field(default=1, description="of this format")
    name: str = Field(default="", max_length=64, description="name of the robot or study")
    extends: str = Field(default="", max_length=256, description="model or file that gives all other values")
    scene: Scene = Scene()
    drift: Drift = Drift()
    sight: SightModel = SightModel()
    filter: Filter = Filter()
    guards: Guards = Guards()
    reward: Reward = Reward()
    odometry: OdometryNoise = OdometryNoise()
    conduct: Conduct = Conduct()
    decision_delay: NotNegative = Field(
        default=0.0, le=5, description="s before the end of an action: decision is made"
    )
    switching: dict[Kind, dict[Kind, NotNegative]] = Field(
        default_factory=dict, description="s, extra time of an action (second key) after one of another kind (first)"
    )
    actions: Annotated[dict[str, ActionModel], Field(min_length=1, max_length=32)]
    action_sets: Annotated[dict[str, tuple[str, ...]], Field(min_length=1)]
    use: str = Field(default="four", description="action set in use")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.use not in self.action_sets:
            raise ValueError(f"use: got {self.use!r}, allowed are {', '.join(self.action_sets)}")
        for name, action in self.actions.items():
            wrong = _contradiction(action)
            if wrong:
                raise ValueError(f"actions.{name}: {wrong}")
        for title, names in self.action_sets.items():
            unknown = [name for name in names if name not in self.actions]
            if unknown or len(set(names)) != len(names) or not names:
                raise ValueError(
                    f"action_sets.{title}: got {names}, allowed are different ones of {list(self.actions)}"
                )
            kinds = {self.actions[name].kind for name in names}
            if not {"walk", "turn"} <= kinds:
                raise ValueError(f"action_sets.{title}: has {sorted(kinds)}, but needs walk and turn")
            for name in names:
                mirror_of(self, name, names)
        refuse_standing_for_ever(self)
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the actions of the set in use, in the order of all arrays."""
        return self.action_sets[self.use]

    @property
    def used(self) -> tuple[ActionModel, ...]:
        """Actions of the set in use, in the order of `names`."""
        return tuple(self.actions[name] for name in self.names)

    def sha256(self) -> str:
        """Hash of all values that policies depend on: not names, odometry, conduct and course of the drift."""
        left_out: Any = {"name": True, "extends": True, "odometry": True, "conduct": True, "drift": {"course"}}
        if self.sight.standing_tilt_keep is None:  # hashes from before this field stay valid
            left_out["sight"] = {"standing_tilt_keep"}
        content = self.model_dump(mode="json", exclude=left_out)
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _contradiction(action: ActionModel) -> str:
    if action.kind == "walk" and action.forward <= 0:
        return f"got forward {action.forward}, a walk needs > 0"
    if action.kind != "walk" and action.forward > 0:
        return f"got forward {action.forward}, allowed for kind {action.kind} is 0"
    if action.kind == "turn" and action.turn_deg == 0:
        return "got turn_deg 0, a turn needs another"
    if action.kind == "stand" and action.turn_deg != 0:
        return f"got turn_deg {action.turn_deg}, allowed for a stand is 0"
    return ""


def mirror_of(model: NavigationModel, name: str, names: tuple[str, ...]) -> str:
    """Return the name of the action among `names` that does what another one does, but to the other side.

    Raises:
        ValueError: there is none.
    """
    own = model.actions[name]
    for other in names:
        if model.actions[other] == own.model_copy(update={"turn_deg": -own.turn_deg + 0.0}):
            return other
    raise ValueError(f"action {name!r} turns by {own.turn_deg} deg, but none of {', '.join(names)} mirrors it")


def refuse_standing_for_ever(model: NavigationModel) -> None:
    """Raise ValueError where the discount makes standing for ever worth more than reaching the goal.

    Standing for ever: -dt_s / (1 - gamma). Goal after N walks of dt_w: -dt_w (1 - gamma^(N-1)) / (1 - gamma) +
    gamma^(N-1) r, N = 1.16 distance / forward. With gamma = 1 standing is minus infinity.
    """
    gamma = model.reward.gamma
    if gamma >= 1.0:
        return
    distance = math.hypot(model.scene.goal_x - model.scene.start_x, model.scene.goal_y - model.scene.start_y)
    for title, names in model.action_sets.items():
        chosen = [model.actions[name] for name in names]
        stands = [a.duration for a in chosen if a.kind == "stand"]
        walk = min((a for a in chosen if a.kind == "walk"), key=lambda a: a.duration / a.forward)
        steps = max(1, math.ceil(DETOUR * distance / walk.forward))
        standing = -min(stands) / (1.0 - gamma) if stands else -math.inf
        kept = gamma ** (steps - 1)
        goal = -walk.duration * (1.0 - kept) / (1.0 - gamma) + kept * model.reward.goal
        if standing >= goal:
            raise ValueError(
                f"reward.gamma: got {gamma}, with which standing for ever is best ({title}): "
                f"-{min(stands)} / (1 - {gamma}) = {standing:.2f} >= {goal:.2f} = "
                f"-{walk.duration} (1 - {gamma}^{steps - 1}) / (1 - {gamma}) + "
                f"{gamma}^{steps - 1} {model.reward.goal:g}, "
                f"the goal after {steps} walks; allowed is a larger one, or 1"
            )


def shipped() -> tuple[str, ...]:
    """Return the names of the navigation models that come with the package."""
    folder = resources.files("surefoot.services.navigator") / "params"
    return tuple(sorted(f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")))


def load(source: str | Path, overrides: Iterable[str] = ()) -> NavigationModel:
    """Return the model of a shipped name or of a TOML file, changed by `key=value` strings.

    Args:
        source: `paper`, `paper-blur`, `nao`, or a path that ends in .toml.
        overrides: dotted key and TOML value, as in `drift.per_10cm_deg=2` or `actions.walk.match=0.1`.

    Raises:
        ConfigError: names the file and the field, the received value and what is allowed.
    """
    values = _tables(str(source), ())
    for item in overrides:
        key, sign, text = item.partition("=")
        if not sign or not key.strip():
            raise ConfigError("invalid", f"got {item!r}, allowed is key=value such as drift.per_10cm_deg=2", "set")
        _put(values, key.strip().split("."), value_of(text), item)
    return validated(values, str(source))


def validated(values: Mapping[str, Any], where: str) -> NavigationModel:
    """Return the model of nested tables, as of a TOML file; `where`: file or name, for the message of an error.

    Raises:
        ConfigError: names the first field that cannot be used.
    """
    try:
        return NavigationModel.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"])
        got = "" if isinstance(first["input"], Mapping) or first["type"] == "missing" else f", got {first['input']!r}"
        raise ConfigError("invalid", f"{where}: {field or 'model'}: {first['msg']}{got}", field or None) from None


def _tables(source: str, seen: tuple[str, ...]) -> dict[str, Any]:
    if source in seen or len(seen) > 8:
        raise ConfigError("invalid", f"{source}: extends itself by way of {' -> '.join(seen)}", "extends")
    if source.endswith(".toml"):
        try:
            content = read_regular(Path(source), MAX_FILE_BYTES)
        except FileError as error:
            code = "invalid" if error.code == "value" else error.code
            raise ConfigError(code, f"{source}: {error.message}", "params") from None
    elif source in shipped():
        content = (resources.files("surefoot.services.navigator") / "params" / f"{source}.toml").read_bytes()
    else:
        hint, known = did_you_mean(source, shipped()), ", ".join(shipped())
        raise ConfigError("invalid", f"got {source!r}{hint}; allowed are {known}, or a file *.toml", "params")
    try:
        values = tomllib.loads(content.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ConfigError("malformed", f"{source}: is not valid TOML: {error}", "params") from None
    base = values.get("extends", "")
    if not isinstance(base, str):
        raise ConfigError("invalid", f"{source}: extends: got {base!r}, allowed is a name or a file", "extends")
    if not base:
        return values
    if base.endswith(".toml") and source.endswith(".toml"):
        base = str(Path(source).parent / base)
    return _merged(_tables(base, (*seen, source)), values)


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    out = dict(below)
    for key, value in above.items():
        old = out.get(key)
        out[key] = _merged(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
    return out


def _put(values: dict[str, Any], keys: list[str], value: Any, item: str) -> None:
    at: Any = values
    for key in keys[:-1]:
        at[key] = dict(at.get(key, {})) if isinstance(at.get(key, {}), Mapping) else None
        at = at[key]
        if at is None:
            raise ConfigError("unknown_key", f"{item!r}: {key!r} has no fields", ".".join(keys))
    at[keys[-1]] = value
