"""A member of the roster with plain Zenoh and JSON, written from docs/systems.md; nothing of ours is imported.

`python foreign_estimator.py <endpoint> <fleet>/<robot>` stands in for the toy estimator: half of the specific force is
the velocity. It ends when its input is closed.
"""

import json
import os
import queue
import sys

import zenoh

NAME = "estimator"
INPUT, OUTPUT = "hw/imu", "state/velocity"
BLOCK = zenoh.CongestionControl.BLOCK
ZERO = [0.0, 0.0, 0.0]


class Member:
    """Memory of a participant: proof of its input, its answers for repetition, and what waits for the batch."""

    def __init__(self, session, prefix):
        self.session, self.prefix = session, prefix
        self.instance = str(session.zid())
        self.proved, self.answers, self.batch = False, {}, []

    def put(self, key, payload, attachment=None):
        self.session.put(f"{self.prefix}/{key}", payload, attachment=attachment, congestion_control=BLOCK)

    def on_frame(self, sample):
        messages, found = iter(json.loads(sample.payload.to_bytes())), {}
        for entry in sample.attachment.to_bytes().decode().split(";")[1:]:  # the first is the driver's instance
            key, length, tick, *_ = entry.split(",")
            found[key] = next(messages) if int(length) else None
            self.proved |= key == INPUT and int(tick) == -1
        manifest = found.get("hw/tick")
        if manifest is None:
            return
        if manifest["tick"] == -1:
            self.answers.clear()
            self.put(f"@frame/{NAME}", b"[]", f"{self.instance};{OUTPUT},0,-1,0,0,0")
            if self.proved:
                self.done(manifest, ready=True)
        elif NAME in manifest["roster"]:
            self.on_tick(manifest, found.get(INPUT))

    def on_tick(self, manifest, imu):
        at = (manifest["epoch"], manifest["tick"])
        if at not in self.answers:
            header = {"stamp_ns": imu["stamp_ns"], "tick": at[1], "epoch": at[0], "seq": at[1], "source": NAME}
            body = json.dumps({**header, **estimate(0.5 * imu["acc"][0])})
            self.answers[at] = (body, f"{OUTPUT},{len(body)},{at[1]},{at[0]},{imu['stamp_ns']},{at[1]}")
            self.batch.append(self.answers[at])
        body, index = self.answers[at]
        self.put(f"@frame/{NAME}", f"[{body}]", f"{self.instance};{index}")
        if manifest["report"]:
            bodies, indices = zip(*self.batch, strict=True) if self.batch else ((), ())
            self.put(f"@batch/{NAME}", f"[{','.join(bodies)}]", ";".join((self.instance, *indices)))
            self.batch.clear()
            self.done(manifest)

    def done(self, manifest, **more):
        header = {"tick": manifest["tick"], "epoch": manifest["epoch"], "source": NAME, "instance": self.instance}
        self.put(f"@tick/{NAME}", json.dumps({**header, **more}))

    def on_health(self, query):
        if query.attachment is not None and query.attachment.to_bytes() == b"probe":
            query.reply(f"{self.prefix}/health/{NAME}", b"", attachment=b"probe")
            return
        health = {"service": NAME, "instance": self.instance, "state": "running", "pid": os.getpid()}
        query.reply(f"{self.prefix}/health/{NAME}", json.dumps({"health": health}))


def estimate(speed):
    """The fields of `surefoot schema show VelocityEstimate` that must be given."""
    flags = dict.fromkeys(("initialised", "inputs_ok", "filter_ok", "sensors_ok"), True)
    vectors = dict.fromkeys(("velocity_imu", "velocity_heading", "angular_velocity", "gyro_bias"), ZERO)
    rest = {"roll": 0.0, "pitch": 0.0, "covariance": [0.0] * 36, "standing": False, "slipping": []}
    return {"mode": "ekf", "velocity": [speed, 0.0, 0.0], "g_up": [0.0, 0.0, 9.81], **vectors, **flags, **rest}


def main(endpoint, prefix):
    config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [endpoint]}}))
    with zenoh.open(config) as session:
        member, arrived = Member(session, prefix), queue.SimpleQueue()
        subscriber = session.declare_subscriber(f"{prefix}/@frame/driver", arrived.put)
        health = session.declare_queryable(f"{prefix}/health/{NAME}", member.on_health)
        token = session.liveliness().declare_token(f"{prefix}/alive/{NAME}/{member.instance}")
        request = json.dumps({"service": NAME, "instance": member.instance})
        while not member.answers:
            try:
                member.on_frame(arrived.get(timeout=0.5))
            except queue.Empty:  # no prime comes: ask for it
                list(session.get(f"{prefix}/sim/join", payload=request, timeout=0.3))
        while True:
            member.on_frame(arrived.get())
        del subscriber, health, token


if __name__ == "__main__":
    import threading

    threading.Thread(target=main, args=sys.argv[1:3], daemon=True).start()
    sys.stdin.read()
    os._exit(1 if any(name.split(".")[0] in ("surefoot", "schemas", "services") for name in sys.modules) else 0)
