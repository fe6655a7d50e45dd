"""``python -m surefoot.services.supervisor``: a mere participant; `surefoot supervise` also holds the router."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
