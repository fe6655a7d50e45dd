"""``python -m services.simulator``."""

from services.simulator.service import SERVICE
from surefoot.launch import main

main(SERVICE)
