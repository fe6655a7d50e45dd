"""Entry point of the supervisor service without a router; `surefoot supervise` runs the service and a router."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
