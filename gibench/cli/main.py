"""The command line's entry: one line on standard error and an exit code for whatever goes wrong."""

from __future__ import annotations

import errno
import io
import os
import sys
import traceback
from collections.abc import Sequence
from functools import cache
from typing import Annotated, Any

import typer

from gibench import __version__
from gibench.cli import (
    ab,
    advise,
    bake,
    calibrate,
    compare,
    conform,
    devices,
    experiment,
    explain,
    history,
    merge,
    profiles,
    project,
    quality,
    report,
    run,
    scenes,
    share,
    techniques,
    validate_projection,
)
from gibench.cli.layout import Sectioned
from gibench.cli.notices import notices
from gibench.cli.options import paragraphs
from gibench.errors import GibenchError, Interrupted

INTRODUCTION = """
Benchmark real-time diffuse global illumination, pass by pass, inside a device's limits.

Runs techniques as ordered OpenCL passes on one scene and joins time and memory in one table. A
device profile (a phone, a laptop GPU) is held to by its limits; the times are those of the
machine at hand.

Start here:  gibench run --device-profile iphone7
"""
EXIT_CODES = """
Exit codes: 0 fine; 1 a check failed or something broke; 2 usage or bad input; 3 the device, the
profile or its budget cannot run what was asked; 130 interrupted. What goes wrong is told in one
line on standard error.
"""

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=paragraphs(EXIT_CODES),
)
for command in (
    run.run,
    quality.quality,
    advise.advise,
    experiment.experiment,
    explain.explain,
    project.project,
    validate_projection.validate_projection,
    calibrate.calibrate,
    bake.bake,
    ab.ab,
    compare.compare,
    conform.conform,
    report.report,
    merge.merge,
    share.submit,
    share.gallery,
    scenes.scenes,
    techniques.techniques,
    devices.devices,
):
    text = paragraphs(command.__doc__)
    summary = text.partition("\n")[0]  # given, so that the list of commands does not cut it short
    app.command(command.__name__.replace("_", "-"), cls=Sectioned, help=text, short_help=summary)(
        command
    )
app.add_typer(profiles.app, name="profiles", short_help=profiles.SUMMARY)
app.add_typer(history.app, name="history", short_help=history.SUMMARY)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"gibench {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True, help=paragraphs(INTRODUCTION))
def gibench(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Say the version."),
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of whatever goes wrong.")
    ] = False,
) -> None:
    """What holds for every subcommand; alone, the help."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit with its code."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in arguments
    for stream in (sys.stdout, sys.stderr):  # in a locale that lacks a letter it is written out
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    sys.exit(call([a for a in arguments if a != "--debug"], debug=debug))


@cache
def _command() -> Any:
    """The command of ``app``: made once, for all calls of a process."""
    return typer.main.get_command(app)


def call(arguments: list[str], *, debug: bool = False) -> int:
    """Run the command line and return its exit code."""
    try:
        command = _command()
        with notices(), command.make_context("gibench", arguments) as context:
            command.invoke(context)
            sys.stdout.flush()
        return 0
    except typer.Exit as leave:
        return int(leave.exit_code)
    except (BrokenPipeError, SystemExit) as error:
        # 'gibench ... | head': the reader has what it wanted (rich turns that into SystemExit).
        if isinstance(error, SystemExit) and not isinstance(error.__context__, BrokenPipeError):
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (KeyboardInterrupt, typer.Abort):
        return _tell(Interrupted("interrupted"), debug)
    except GibenchError as error:
        return _tell(error, debug)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            return _tell(_full(error), debug, cause=error)
        if hasattr(error, "format_message"):  # a usage error of typer's
            return _tell(GibenchError(_usage(error)), debug, code=2)
        what = f"unexpected {type(error).__name__}: {error}"
        mend = "please report this with the traceback that 'gibench --debug ...' shows"
        return _tell(GibenchError(what, mend=mend), debug, cause=error)


def _full(error: OSError) -> GibenchError:
    """A disk that is full; standard output is let go if it cannot be written."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    what = f"cannot be written ({error.strerror})"
    return GibenchError(what, where=error.filename or "the output", mend="free some space")


def _tell(
    error: GibenchError, debug: bool, *, code: int | None = None, cause: Exception | None = None
) -> int:
    """One line on standard error; the traceback before it under ``--debug``."""
    if debug:
        traceback.print_exception(cause or error)
    print(f"gibench: {error}", file=sys.stderr)
    return error.exit_code if code is None else code


def _usage(error: Exception) -> str:
    """A usage error in one line, with where to read on."""
    message = " ".join(str(error.format_message()).split()).rstrip(".")  # type: ignore[attr-defined]
    context = getattr(error, "ctx", None)
    return f"{message}; see '{context.command_path if context else 'gibench'} --help'"
