"""Command line `surefoot` with its subcommands, one module each, which import heavy libraries only when they run."""

import os
import signal
import sys
import threading

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy, as in every service

import typer

from surefoot.errors import EXIT_USAGE

from . import (
    bag,
    bridge,
    doctor,
    graph,
    node,
    param,
    render,
    report,
    robot,
    run,
    schema,
    service,
    sim,
    stop,
    system,
    topic,
    view,
    warm,
)
from .compiling import COSTS, compilation_reported
from .needed import needed
from .output import EXIT_CHECK, EXIT_INTERRUPT, fail, misused, notify, state
from .rooms import room_commands

app = typer.Typer(
    name="surefoot",
    help="Support stack for legged robots: run scenarios, start and watch services, talk to them.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("run")(run.run)
app.command("list")(run.list_all)
app.command("up")(system.up)
app.command("down")(system.down)
app.command("stop")(stop.stop)
app.command("status")(system.status)
app.command("logs")(system.logs)
app.command("health")(system.health)
app.command("supervise")(system.supervise)
app.command("report")(report.report)
app.command("render")(render.render)
app.command("view")(view.view)
app.command("warm")(warm.warm)
app.command("call")(service.call)
app.command("doctor")(doctor.doctor)
app.command("graph")(graph.graph)
app.add_typer(topic.app, name="topic")
app.add_typer(service.app, name="service")
app.add_typer(node.app, name="node")
app.add_typer(param.app, name="param")
app.add_typer(schema.app, name="schema")
app.add_typer(bag.app, name="bag")
app.add_typer(robot.app, name="robot")
app.add_typer(sim.app, name="sim")
app.add_typer(bridge.app, name="bridge")
for room in room_commands():
    app.add_typer(room)


def _version(wanted: bool) -> None:
    if wanted:
        from surefoot.version import VERSION

        sys.stdout.write(VERSION + "\n")
        raise typer.Exit


@app.callback()
def common(
    debug: bool = typer.Option(False, "--debug", help="Show tracebacks of errors."),
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Show the version."),
) -> None:
    """Set the options that all commands share: tracebacks of errors, version."""
    state.debug = debug


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; exit code 0: ok, 1: a check failed, 2: usage error, 130: interrupted.

    SIGTERM ends a command as Ctrl-C does, so that the command removes half-written files.
    """
    if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    words = sys.argv[1:] if arguments is None else arguments
    try:
        with compilation_reported(notify, COSTS.get(next(iter(words), ""), ())):
            code = needed(app, words)(args=words, prog_name="surefoot", standalone_mode=False)
        sys.exit(code if isinstance(code, int) else 0)
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPT)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader has gone
        sys.exit(EXIT_CHECK)
    except Exception as error:
        if hasattr(error, "show"):  # typer's own: words that are no use of the command
            sys.exit(misused(error, json="--json" in words))
        if state.debug:
            raise
        sys.exit(fail(error))


__all__ = ["EXIT_CHECK", "EXIT_INTERRUPT", "EXIT_USAGE", "app", "main"]

if __name__ == "__main__":
    main()
