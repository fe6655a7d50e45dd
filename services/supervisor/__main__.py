"""``python -m services.supervisor``: a mere participant; `surefoot supervise` also holds the router."""

from services.supervisor.service import SERVICE
from surefoot.launch import main

main(SERVICE)
