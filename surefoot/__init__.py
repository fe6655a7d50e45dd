"""Support stack for legged robots under one name; every part is loaded when it is first used.

    import surefoot

    feet = surefoot.stability.contacts([[0.1, 0.1, 0.0], [0.1, -0.1, 0.0], [-0.1, 0.0, 0.0]], friction=0.5)
    surefoot.stability.margin(feet, com=[0.02, 0.0])

| name | content |
|---|---|
| `connect`, `connect_async` | a running system: topics and queries |
| `stability` | support regions, margins, forces |
| `estimation` | velocity, tilt and path from IMU and feet |
| `terrain` | height maps and footholds |
| `navigation` | pose filter and planner |
| `robots` | descriptions and kinematics |
| `bags` | recordings |
| `simulation` | scenarios and the simulated world |

Arguments of these are checked once, at this border: a wrong shape, unit, range or NaN raises `SurefootError` with the
field, the value and what is allowed. SI units, z up, quaternions as w, x, y, z.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from surefoot import bags, estimation, navigation, robots, simulation, stability, terrain
    from surefoot.client import Client, connect
    from surefoot.client_async import AsyncClient, connect_async
    from surefoot.errors import SurefootError
    from surefoot.version import VERSION as __version__

_PARTS = ("bags", "estimation", "navigation", "robots", "simulation", "stability", "terrain")
_PLACES = {
    "AsyncClient": ("surefoot.client_async", "AsyncClient"),
    "Client": ("surefoot.client", "Client"),
    "SurefootError": ("surefoot.errors", "SurefootError"),
    "__version__": ("surefoot.version", "VERSION"),
    "connect": ("surefoot.client", "connect"),
    "connect_async": ("surefoot.client_async", "connect_async"),
}
__all__ = [
    "AsyncClient", "Client", "SurefootError", "__version__", "bags", "connect", "connect_async", "estimation",
    "navigation", "robots", "simulation", "stability", "terrain",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Return a part of the library, such as `stability`, which is imported at its first use."""
    if name in _PARTS:
        return import_module(f"surefoot.{name}")
    if name in _PLACES:
        module, attribute = _PLACES[name]
        return getattr(import_module(module), attribute)
    raise AttributeError(f"surefoot has no {name!r}; it has {', '.join(__all__)}")


def __dir__() -> list[str]:
    """Return the names of the library."""
    return sorted(__all__)
