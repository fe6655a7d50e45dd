"""``python -m services.stability``."""

from services.stability.service import SERVICE
from surefoot.launch import main

main(SERVICE)
