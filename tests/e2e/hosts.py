"""Hosts of one network on this machine: network namespaces at a bridge, made and removed by the test."""

import itertools
import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

import pytest

from tests.processes import running

ROOT = Path(__file__).parents[2]


def run_ip(*words: str) -> None:
    """Run `ip` (raises CalledProcessError with what it wrote)."""
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True, timeout=20.0)


_MADE = itertools.count(step=1001)
"""Offset of the number of each network of this process."""


class Hosts:
    """Namespaces with an address each on a network that this process joins; a context manager that removes them."""

    def __init__(self, count: int) -> None:
        number = (os.getpid() + next(_MADE)) % 10_000
        self.bridge, self.network = f"sfbr{number}", f"10.213.{number % 250}"
        self.here = f"{self.network}.1"
        self.names = tuple(f"sf{number}h{n}" for n in range(count))

    def __enter__(self) -> Self:
        if shutil.which("ip") is None or os.geteuid() != 0:
            pytest.skip("network namespaces need root and `ip` of the package iproute2")
        try:
            run_ip("link", "add", self.bridge, "type", "bridge")
            run_ip("address", "add", f"{self.here}/24", "dev", self.bridge)
            run_ip("link", "set", self.bridge, "up")
            for number, name in enumerate(self.names):
                self._add(number, name)
        except subprocess.CalledProcessError as error:
            self._remove()
            pytest.skip(f"this kernel allows no network namespaces, veth or bridges: {error.stderr.strip()}")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._remove()

    def address(self, number: int) -> str:
        """Return the address of a host."""
        return f"{self.network}.{number + 2}"

    def command(self, number: int) -> list[str]:
        """Return the words before a command that runs it on a host."""
        return ["ip", "netns", "exec", self.names[number]]

    @contextmanager
    def cut(self, number: int) -> Iterator[None]:
        """Separate a host from all others."""
        run_ip("link", "set", self._link(number), "down")
        try:
            yield
        finally:
            run_ip("link", "set", self._link(number), "up")

    @contextmanager
    def silent(self, number: int) -> Iterator[None]:
        """Let all frames from and to a host vanish, while its link and all its connections seem to stand."""
        run_ip("link", "set", self._link(number), "nomaster")
        try:
            yield
        finally:
            run_ip("link", "set", self._link(number), "master", self.bridge)

    @contextmanager
    def bad_link(self, number: int, *words: str) -> Iterator[Counter[str]]:
        """Put a relay that delays, loses and doubles frames between a host and all others.

        Args:
            number: of the host.
            words: options of `tests.e2e.relay`.

        Yields:
            What became of the frames, by name; filled at the end.
        """
        counts = Counter[str]()
        taps = tuple(f"{self._link(number)}{side}" for side in "ab")
        aside = f"{self.bridge}x"
        try:
            for tap in taps:
                run_ip("tuntap", "add", "dev", tap, "mode", "tap")
        except subprocess.CalledProcessError as error:
            self._drop(*taps)
            pytest.skip(f"delay and loss need /dev/net/tun: {error.stderr.strip()}")
        try:
            run_ip("link", "add", aside, "type", "bridge")
            for link, bridge in ((self._link(number), aside), (taps[0], aside), (taps[1], self.bridge)):
                run_ip("link", "set", link, "master", bridge, "up")
            run_ip("link", "set", aside, "up")
            command = [sys.executable, "-m", "tests.e2e.relay", *taps, *words]
            with running(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as relay:
                yield counts
                relay.terminate()
                counts.update(json.loads(relay.communicate(timeout=20.0)[0]))
        finally:
            run_ip("link", "set", self._link(number), "master", self.bridge)
            self._drop(*taps, aside)

    @staticmethod
    def _drop(*links: str) -> None:
        for link in links:
            subprocess.run(["ip", "link", "del", link], capture_output=True, timeout=20.0)

    def _link(self, number: int) -> str:
        return f"{self.names[number]}v"

    def _add(self, number: int, name: str) -> None:
        run_ip("netns", "add", name)
        run_ip("link", "add", self._link(number), "type", "veth", "peer", "name", "eth0", "netns", name)
        run_ip("link", "set", self._link(number), "master", self.bridge, "up")
        run_ip("-n", name, "address", "add", f"{self.address(number)}/24", "dev", "eth0")
        for link in ("lo", "eth0"):
            run_ip("-n", name, "link", "set", link, "up")

    def _remove(self) -> None:
        for name in self.names:
            subprocess.run(["ip", "netns", "del", name], capture_output=True, timeout=20.0)
        subprocess.run(["ip", "link", "del", self.bridge], capture_output=True, timeout=20.0)
