"""Versions of the software that computed a recorded run."""

from surefoot.services.supervisor.scenarios.recorded import RUN, VERSIONS


def recorded_versions(metadata: dict[str, dict[str, str]]) -> dict[str, str]:
    """Return the versions of surefoot, libraries and interpreter that computed a run, by name, surefoot first."""
    own = metadata.get(RUN, {}).get("version")
    return ({} if own is None else {"surefoot": own}) | metadata.get(VERSIONS, {})
