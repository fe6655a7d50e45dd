"""Policies by name: rules, files that ship, other files, or a table that is computed now."""

from pathlib import Path

from surefoot.errors import Refusal
from surefoot.nearest import did_you_mean
from surefoot.version import VERSION

from .arrays import Arrays, arrays
from .choose import PLANNER, SARSA
from .decider import Policy, by_rule
from .files import load_policy, shipped
from .params import NavigationModel
from .planner import planner

NAMES = ("hand", "tuned", "steer", "planner", "sarsa")


def known() -> tuple[str, ...]:
    """Return the names of all policies that can be requested, shipped files included."""
    return (*NAMES, *shipped())


def find(name: str, model: NavigationModel, world: Arrays | None = None, *, any_model: bool = False) -> Policy:
    """Return the policy of a name or file for a navigation model.

    Args:
        name: `hand` (35 deg), `tuned`, `steer`, `planner` (computed for the model, about 1 s, if no file for it ships),
            `sarsa` (a file for these actions that ships), the name of a shipped file, or a path that ends in .npz.
        model: model of the robot.
        world: arrays of the model; None = they are made.
        any_model: a file that was made for another model is taken as it is, for studies; else its table is computed
            anew for this model (planner) or the file is refused (sarsa).

    Raises:
        Refusal: no such policy, a file that cannot be used, one for other actions, or learned for another model.
    """
    world = arrays(model) if world is None else world
    ruled = by_rule(name, world)
    if ruled is not None:
        return ruled
    files = shipped()
    if name.endswith(".npz"):
        return _for_model(load_policy(Path(name), world.names), model, world, any_model)
    if name in files:
        return _for_model(load_policy(files[name], world.names), model, world, any_model)
    if name in ("planner", "sarsa"):
        own = [path for stem, path in files.items() if stem.split("-")[0] == name]
        fitting = [policy for path in own if (policy := _if_for(path, world.names)) is not None]
        made_for = [policy for policy in fitting if policy.provenance.get("model_sha256") == model.sha256()]
        if made_for:
            return made_for[0]
        if name == "planner":
            return planner(world, provenance_of(model, "planner"))
        if fitting:
            return _for_model(fitting[0], model, world, any_model)
    hint, allowed = did_you_mean(name, known()), ", ".join(known())
    raise Refusal("unknown_policy", f"got {name!r}{hint} for {', '.join(world.names)}; allowed are {allowed}", "policy")


def _for_model(policy: Policy, model: NavigationModel, world: Arrays, any_model: bool) -> Policy:
    """Return a stored policy for a model: unchanged, or computed anew for the model if it is a planner's.

    Raises:
        Refusal: its table was learned for another model, and `any_model` is False.
    """
    made_for = policy.provenance.get("model_sha256")
    if any_model or policy.tables.kind not in (PLANNER, SARSA) or made_for == model.sha256():
        return policy
    of = f"{policy.provenance.get('model', '')!r} ({made_for[:12] if made_for else 'no model_sha256'})"
    here = f"{model.name!r} ({model.sha256()[:12]})"
    if policy.tables.kind == PLANNER:
        return planner(world, provenance_of(model, "planner", instead_of=f"{policy.name}, made for the model {of}"))
    text = f"{policy.name} was learned for the model {of}, this one is {here}; `surefoot train navigator` learns for it"
    raise Refusal("policy_model", text, "policy")


def _if_for(path: Path, actions: tuple[str, ...]) -> Policy | None:
    try:
        return load_policy(path, actions)
    except Refusal as refusal:
        if refusal.code == "policy_actions":
            return None
        raise


def provenance_of(model: NavigationModel, name: str, **more: str) -> dict[str, str]:
    """Return the origin of a policy by key: its name, model and hash of the model, action set, version of surefoot.

    `more`: further texts by key.
    """
    return {
        "name": name,
        "model": model.name,
        "model_sha256": model.sha256(),
        "action_set": model.use,
        "surefoot": VERSION,
        **more,
    }
