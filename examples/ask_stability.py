"""Will it fall? Asks the stability service with plain Zenoh; nothing of surefoot is imported."""

import json
import os
import sys

import zenoh

told = os.environ.get("SUREFOOT_CONNECT") or os.environ.get("SUREFOOT_LISTEN") or "tcp/127.0.0.1:7447"
endpoint = sys.argv[1] if len(sys.argv) > 1 else told
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [endpoint]}}))
feet = [
    {"position": [x, y, 0.0], "normal": [0.0, 0.0, 1.0], "mu": 0.5} for x, y in [(0.1, 0.1), (0.1, -0.1), (-0.1, 0.0)]
]
try:
    session = zenoh.open(config)
except zenoh.ZError:
    sys.exit(f"no router answers at {endpoint} (start one with `surefoot up`, or name another as argument)")
with session:
    for step in (0.02, 0.05, 0.10):
        question = {"contacts": feet, "com": [0.02, 0.0], "movement": [step, 0.0, 0.0]}
        for reply in session.get("surefoot/ragno/stability/check", payload=json.dumps(question), timeout=5.0):
            answer = json.loads((reply.ok or reply.err).payload.to_string())
            print(f"move {step:.2f} m: stable {answer['stable']}, margin {answer['margin']:+.4f} m")
