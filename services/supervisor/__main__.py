"""Entry point of the supervisor service without a router, which `surefoot supervise` runs as well."""

from surefoot.lockstep.launch import main

from .service import SERVICE

main(SERVICE)
