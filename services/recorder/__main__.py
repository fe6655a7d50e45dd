"""``python -m services.recorder``."""

from services.recorder.service import SERVICE
from surefoot.launch import main

main(SERVICE)
