"""Attacks by clients under the name of a service: forged joint commands, and a liveliness token shown beforehand."""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import surefoot
from benchmarks.bench import Bench, table
from benchmarks.machine import Machine, up
from surefoot.client import Client
from surefoot.schemas.topics import CMD_WALK, HEALTH_GET, SIM_TRUTH
from tests.processes import running

BENCH = Bench("forged")
READERS = ("simulator", "stability")
"""Services that read the frames of the walker."""
TURN = 0.6
"""Angle that is added to each joint of a forged command, rad."""

PEER = """
import json, os, sys, time, zenoh
address, namespace, seconds = sys.argv[1], sys.argv[2], float(sys.argv[3])
config = zenoh.Config()
for key, value in {"mode": "peer", "connect/endpoints": [address], "listen/endpoints": ["tcp/127.0.0.1:0"],
                   "scouting/multicast/enabled": False, "namespace": namespace}.items():
    config.insert_json5(key, json.dumps(value))
session = zenoh.open(config)
"""
FORGER = (
    PEER
    + """
publisher, sent, turn = session.declare_publisher("@frame/walker"), set(), float(sys.argv[4])

def on_frame(sample):
    head, *entries = sample.attachment.to_bytes().decode().split(";")
    begin, payload = 1, sample.payload.to_bytes()
    for entry in entries:
        key, size, tick, epoch, stamp, seq = entry.split(",")
        body, begin = payload[begin : begin + int(size)], begin + int(size) + 1
        if key == "cmd/joints" and int(tick) >= 0 and body not in sent:
            command = json.loads(body)
            command.update(tick=int(tick) + 2, seq=int(seq) + 2, stamp_ns=int(stamp) + 20_000_000,
                           position=[x + turn for x in command["position"]])
            made = json.dumps(command).encode()
            index = f"cmd/joints,{len(made)},{int(tick) + 2},{epoch},{command['stamp_ns']},{command['seq']}"
            publisher.put(b"[" + made + b"]", attachment=f"{head.split(':')[0]};{index}".encode())
            sent.add(made)

subscriber = session.declare_subscriber("@frame/walker", on_frame)
time.sleep(seconds)
print(len(sent), flush=True)
os._exit(0)  # the session closes with the process
"""
)
SHOWN = (
    PEER
    + """
name = str(session.zid())
token = session.liveliness().declare_token(f"alive/estimator/{name}")
publisher, end = session.declare_publisher("@frame/estimator"), time.monotonic() + seconds
print("shown", flush=True)
while time.monotonic() < end:
    for epoch in (1, 2, 3):
        primes = ";".join(f"{key},0,-1,{epoch},0,0" for key in ("state/velocity", "state/odometry"))
        publisher.put(b"[]", attachment=f"{name};{primes}".encode())
    time.sleep(0.1)
"""
)


def _refused(client: Client, service: str) -> dict[str, int]:
    """Return how many messages a service has refused, by reason."""
    return client.call(HEALTH_GET.of(service)).health.refused


def _stranger(machine: Machine, program: str, seconds: float, *more: str) -> list[str]:
    return [sys.executable, "-c", program, machine.address, machine.namespace, str(seconds), *more]


@BENCH.part()
def commands(*, seconds: float = 10.0) -> None:
    """A hexapod walks while a stranger with the copied name of the walker commands other joint angles.

    Args:
        seconds: wall time of the attack.
    """
    with tempfile.TemporaryDirectory() as name, up(Path(name)) as machine:
        with surefoot.connect("ragno", machine.address) as client:
            client.call(CMD_WALK, action="walk", distance=1.0)
            command = _stranger(machine, FORGER, seconds, str(TURN))
            done = subprocess.run(command, capture_output=True, text=True, timeout=seconds + 60.0, check=False)
            truth = client.latest(SIM_TRUTH)
            found = {service: _refused(client, service) for service in READERS}
        rows = [(service, codes.get("forged", 0), codes.get("conflict", 0)) for service, codes in found.items()]
    table("forged joint commands", ("reader", "refused as forged", "in conflict"), rows)
    print(f"{done.stdout.strip()} commands sent; fallen {truth.fallen}, way {truth.position[0]:.2f} m", flush=True)


@BENCH.part()
def token(*, seconds: float = 40.0) -> None:
    """A stranger shows the token of the estimator and proves its links; then the estimator is killed.

    Args:
        seconds: wall time for which the stranger stays.
    """
    with (
        tempfile.TemporaryDirectory() as name,
        up(Path(name)) as machine,
        running(_stranger(machine, SHOWN, seconds), stdout=subprocess.PIPE, text=True) as stranger,
    ):
        assert stranger.stdout is not None
        stranger.stdout.readline()
        time.sleep(2.0)
        began = time.monotonic()
        back = machine.restart("estimator") - began
        time.sleep(3.0)
        with surefoot.connect("ragno", machine.address) as client:
            healths = {s: client.call(HEALTH_GET.of(s)).health for s in ("walker", "stability")}
    rows = [(s, h.refused.get("unbound", 0), ", ".join(h.late) or "nothing") for s, h in healths.items()]
    table("frames of the stranger", ("reader", "refused as unbound", "silent 3 s later"), rows)
    print(f"the estimator is healthy again after {back:.1f} s", flush=True)
