"""Start of one service as a process: command line, configuration, bus, signals, and the exit."""

import argparse
import gc
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: small matrices, and the cores belong to the services

from surefoot.bus.endpoint import checked, to_connect
from surefoot.errors import EXIT_USAGE, BusError, CallError, SurefootError
from surefoot.heap import share_heaps
from surefoot.lockstep.config import load_config
from surefoot.lockstep.ending import ENDING
from surefoot.lockstep.service import Service
from surefoot.logline import log_line, write_line
from surefoot.version import VERSION

ZENOH_RUNTIME = "(rx:(worker_threads:1),acc:(handover:rx),net:(handover:rx))"
"""Setting of Zenoh's thread pools by which one thread receives. Two would wake each other at every frame; with one the
demo runs a third faster. Not for a router, in which forwarding to a slow reader would stop all reception."""


def main(service: type[Service[Any]], arguments: list[str] | None = None) -> NoReturn:
    """Run a service until it is stopped, then end the process without the interpreter's own shutdown.

    That shutdown, with compiled kernels and a compiler loaded, takes up to seconds on a busy machine, and a service
    shall exit within two seconds of SIGTERM. The bus and files are closed before.
    """
    ENDING.watch()
    share_heaps()
    gc.freeze()  # what is imported by now stays
    gc.enable()  # who starts a service may have switched it off until here
    try:
        code = run(service, arguments)
    except SystemExit as end:  # --help, or stopped while starting
        code = end.code if isinstance(end.code, int) else 0
    with suppress(OSError):  # a log on a full disk
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)


def run(service: type[Service[Any]], arguments: list[str] | None = None) -> int:
    """Run a service until SIGTERM or SIGINT; return the exit code.

    It is `EXIT_USAGE` if arguments or configuration cannot be used, 1 if the network cannot, which may pass.
    """
    options = _parser(service).parse_args(arguments)
    try:
        options.connect = [checked("--connect", place) for place in options.connect] or [to_connect()]
        options.listen = [checked("--listen", place, any_port=True) for place in options.listen]
        config = load_config(service.Config, service.name, options.config, os.environ, options.set)
        if options.print_config:
            sys.stdout.write(config.model_dump_json(indent=2) + "\n")
            return 0
        return _serve(service(config), options)
    except SurefootError as error:  # of the configuration, or of a robot or another file that it names
        write_line(log_line("error", service.name, str(error)))
        return 1 if isinstance(error, BusError | CallError) else EXIT_USAGE
    except Exception as error:
        write_line(log_line("error", service.name, f"ended by {type(error).__name__}: {error}"))
        raise


def _serve(service: Service[Any], options: argparse.Namespace) -> int:
    from surefoot.bus.seals import given_secret
    from surefoot.bus.tokens import given_services
    from surefoot.bus.zenoh import ZenohBus, ZenohOptions
    from surefoot.lockstep.local import node_of

    endpoint = ZenohOptions(
        options.mode,
        tuple(options.connect),
        tuple(options.listen),
        options.namespace,
        identity=service.name,
        secret=given_secret(),
        services=given_services(),
    )
    if options.mode != "router":
        os.environ.setdefault("ZENOH_RUNTIME", ZENOH_RUNTIME)  # read when the process opens its first session
    bus: ZenohBus | None = None

    try:
        bus = ZenohBus(endpoint)
        node = node_of(service, bus)
        node.start()
        spare_collector()
        ENDING.prepared(node.stop)
        node.run()
    finally:
        if bus is not None:
            bus.close()  # a session that stays open would keep the process alive for ever
    return 0


def spare_collector() -> None:
    """Exclude the objects of the start-up from garbage collection and raise its limits, so that it rarely runs."""
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)


def _parser(service: type[Service[Any]]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=f"surefoot-service {service.name}", description=(service.__doc__ or "").strip().split("\n")[0]
    )
    parser.add_argument("--connect", action="append", default=[], help="router to connect to [SUREFOOT_CONNECT]")
    parser.add_argument("--listen", action="append", default=[], help="endpoint to listen on [tcp/127.0.0.1:0]")
    parser.add_argument("--mode", choices=("peer", "client", "router"), default="peer", help="Zenoh mode [peer]")
    robot = os.environ.get("SUREFOOT_ROBOT", "ragno")
    namespace = os.environ.get("SUREFOOT_NAMESPACE") or f"surefoot/{Path(robot).name}"
    parser.add_argument("--namespace", default=namespace, help=f"<fleet>/<robot> [{namespace}]")
    parser.add_argument("--config", type=Path, default=None, help="TOML file with one table per service")
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE", help="one field, the strongest")
    parser.add_argument("--print-config", action="store_true", help="print the effective configuration and end")
    parser.add_argument("--version", action="version", version=VERSION)
    return parser
