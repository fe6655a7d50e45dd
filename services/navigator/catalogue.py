"""Navigation model, actions and policies by name, for one configuration of the navigator."""

import math

from surefoot.lockstep.ages import PERIODS
from surefoot.schemas.navigation import PolicyReply

from .belief.common_errors import CommonErrors
from .belief.tracker import Motion
from .config import NavigatorConfig
from .goals import Act
from .policy.arrays import arrays, row_of
from .policy.decider import Decider, Policy
from .policy.library import find, known
from .policy.params import ActionModel, NavigationModel, load


def act_of(name: str, action: ActionModel, model: NavigationModel) -> Act:
    """Return an action of the navigation model as the pilot orders and predicts it."""
    row = row_of(model, action)
    motion = row.forward, 0.0, row.turn, row.forward, row.var_along, row.var_across, row.var_heading, row.var_drift
    return Act(name, action.kind, Motion(*map(float, motion)), action.duration, float(row.match))


def errors_of(model: NavigationModel, *, sway: bool) -> CommonErrors:
    """Return the errors that the landmarks of a frame share: tilt of the camera, and sway of the body if `sway`.

    Sway counts where the belief follows commands; odometry measures it.
    """
    sight = model.sight
    standing = None if sight.standing_tilt_keep is None else fade_of(sight.standing_tilt_keep)
    return CommonErrors(
        math.radians(sight.tilt_sd_deg), math.radians(sight.pitch_deg), sight.sway_sd if sway else 0.0,
        tilt_fade=fade_of(sight.tilt_keep), sway_fade=fade_of(sight.sway_keep), height=sight.camera_height,
        standing_tilt_fade=standing,
    )  # fmt: skip


def fade_of(keep: float) -> float:
    """Return the time constant, s, of an error that keeps the share `keep` from one frame to the next, 0.1 s later."""
    return math.inf if keep >= 1.0 else -0.1 / math.log(keep) if keep > 0.0 else 0.0


def longest_blind_ns(model: NavigationModel) -> int:
    """Return the time without a frame after which the camera counts as silent, ns: three frame intervals."""
    apart = max(action.duration / action.frames for action in model.actions.values())
    return round(PERIODS * 1e9 * apart)


class Catalogue:
    """Model, actions and policies of one configuration of the navigator.

    Raises:
        ConfigError: the model cannot be used.
        Refusal: the default policy cannot be used.
    """

    def __init__(self, config: NavigatorConfig) -> None:
        self.config = config
        overrides = [*config.set, *([f'use="{config.actions}"'] if config.actions else [])]
        self.model: NavigationModel = load(config.params, overrides)
        self.world = arrays(self.model)
        self.acts = tuple(
            act_of(name, action, self.model) for name, action in zip(self.model.names, self.model.used, strict=True)
        )
        self.default = config.policy
        self._found: dict[str, Policy] = {}
        self.find(None)

    def find(self, name: str | None) -> Policy:
        """Return a policy by name or file, None = the default; it is read or computed once.

        Raises:
            Refusal: there is no such policy, or it cannot be used.
        """
        name = name or self.default
        if name not in self._found:
            self._found[name] = find(name, self.model, self.world)
        return self._found[name]

    def decider(self, name: str | None) -> Decider:
        """Return a chooser of actions by the policy of a name or file; None = the default policy.

        Raises:
            Refusal: there is no such policy, or it cannot be used.
        """
        return Decider(self.world, self.find(name))

    def choose(self, name: str) -> None:
        """Make the policy of a name or file the default.

        Raises:
            Refusal: there is no such policy, or it cannot be used.
        """
        self.find(name)
        self.default = name

    def message(self) -> PolicyReply:
        """Return the default policy, its origin, and the names of all policies as a message."""
        policy = self.find(None)
        return PolicyReply(
            policy=policy.name,
            known=known(),
            actions=policy.actions,
            version=policy.provenance.get("surefoot", ""),
            sha256=policy.sha256,
            provenance=dict(policy.provenance),
        )
