"""``python -m services.walker``."""

from services.walker.service import SERVICE
from surefoot.launch import main

main(SERVICE)
