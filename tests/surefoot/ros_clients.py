"""Clients of ROS 2 that need no ROS: pyzeros and zenoh-ros2-sdk, or a skip where they are not installed."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from surefoot.bus.ros2 import types
from tests.surefoot.net import Net

SDK = "zenoh-ros2-sdk, which reads and publishes as a second client, is not installed"


@contextmanager
def pyzeros_node(net: Net) -> Iterator[tuple[Any, Any]]:
    """A node of pyzeros and the messages of ros2-pyterfaces, which it takes."""
    pyzeros = pytest.importorskip("pyzeros")
    messages = pytest.importorskip("ros2_pyterfaces.cyclone.all_msgs")
    with net.plain() as session, pyzeros.auto_context("stranger", session) as node:
        yield node, messages


def pyzeros_publishes() -> None:
    """Compile the attachment of publishers of pyzeros; once on a machine, tests/conftest.py names the folder."""
    attachment = pytest.importorskip("pyzeros.builtin_msgs").Attachment
    if shutil.which("cc") is None:
        pytest.skip("pyzeros compiles the attachment of its messages, and there is no C compiler")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CFLAGS", "-O0")  # 18 s instead of 57
        attachment().serialize()


@contextmanager
def sdk_client(net: Net, definitions: Path) -> Iterator[tuple[Any, dict[str, Any]]]:
    """zenoh-ros2-sdk with rmw_zenoh's own session settings, and arguments that lead its entities to the router.

    It reads message definitions from files, which are written to `definitions`, and computes keys and hashes itself.
    """
    sdk = pytest.importorskip("zenoh_ros2_sdk", reason=SDK, exc_type=ImportError)
    store = types()
    for kind in store.fielddefs:
        package, _, name = kind.split("/")
        path = definitions / package / "msg" / f"{name}.msg"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(store.generate_msgdef(kind, ros_version=2)[0].split("=" * 80)[0])
    place = {"router_ip": "127.0.0.1", "router_port": int(net.address.rpartition(":")[2])}
    session = sdk.ZenohSession.get_instance(**place)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sdk.get_registry(), "messages_dir", definitions)
        try:
            yield sdk, place
        finally:
            session.close()
