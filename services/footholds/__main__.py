"""``python -m services.footholds``."""

from services.footholds.service import SERVICE
from surefoot.launch import main

main(SERVICE)
