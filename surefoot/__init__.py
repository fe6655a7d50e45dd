"""The runtime of surefoot: bus, lockstep, robots, kinematics, recording and the public client."""

from importlib.util import find_spec
from pathlib import Path

_schemas = find_spec("schemas")
_origin = _schemas.origin if _schemas is not None else None
if _origin is None or Path(_origin).resolve().parents[1] != Path(__file__).resolve().parents[1]:
    raise ImportError(f"another package 'schemas' hides that of surefoot: {_origin}; remove it or put surefoot first")
