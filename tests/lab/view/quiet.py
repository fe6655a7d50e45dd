"""A client without a network, for tests of the view."""

from types import SimpleNamespace

from surefoot.bus.interface import Delivery
from surefoot.errors import CallError
from surefoot.lab.scene.scene import KEYS
from surefoot.record.recording import read_recording, topic_of


class QuietClient:
    """A client of a system whose messages a test hands over, and that answers nothing but what it is given."""

    def __init__(self, answers=()):
        self.newest, self.sinks, self.calls, self.answers = {}, {}, [], dict(answers)
        self.asked = []
        self.bus = SimpleNamespace(
            endpoint=SimpleNamespace(namespace="surefoot/ragno"),
            newest=self.newest_of,
            subscribe=lambda topic, sink: self.sinks.update({topic.key: sink}),
        )

    def newest_of(self, topic):
        self.asked.append(topic.key)
        return lambda: self.newest.pop(topic.key, None)

    def call(self, key, timeout_s=None, **fields):
        self.calls.append((key, fields))
        if key not in self.answers:
            raise CallError("absent", f"no service answers {key}")
        return self.answers[key]

    def hand_over(self, recording, until_s=2.0, without=(), **header):
        """Deliver the messages of a recording up to a time, with another header; return the last of each key."""
        last = {}
        for item in read_recording(recording, KEYS):
            if item.stamp_ns < until_s * 1e9 and item.key not in without:
                last[item.key] = item
        last = {key: item.message().model_copy(update=header) for key, item in last.items()}
        self.newest = {key: Delivery(topic_of(key), message, None) for key, message in last.items()}
        return last
