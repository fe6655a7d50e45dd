"""``python -m surefoot.services.supervisor``: the supervisor alone; `surefoot supervise` also runs the router."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
