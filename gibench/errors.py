"""The errors a user can meet, each with the exit code the command line promises.

Exit codes (README, "Exit codes"): 1 a check failed or a regression was found; 2 usage or bad
input; 3 this device, profile or budget cannot run it. Every message is one line that says what is
wrong, where, and how to mend it.
"""

from __future__ import annotations


def printable(text: str) -> str:
    """Text that every stream can write: bytes of file names that are not UTF-8, which Python keeps
    as lone surrogates (PEP 383), and other surrogates are written out.
    """
    try:
        return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    except UnicodeEncodeError:
        return text.encode("utf-8", "backslashreplace").decode("utf-8")


class GibenchError(Exception):
    """An error with a one-line message for the user.

    Args:
        what: what is wrong.
        where: the file, option or buffer it is about, if any.
        mend: what the user can do about it, if anything.
    """

    exit_code = 1

    def __init__(self, what: str, *, where: object = None, mend: str | None = None) -> None:
        self.what = what
        self.where = None if where is None else str(where)
        self.mend = mend
        message = what if self.where is None else f"{self.where}: {what}"
        line = " ".join((message if mend is None else f"{message}; {mend}").split())
        super().__init__(printable(line))


class CheckFailed(GibenchError):
    """A check failed or a regression was found."""

    exit_code = 1


class BadInput(GibenchError):
    """The command line, a file or a setting is wrong."""

    exit_code = 2


class CannotRun(GibenchError):
    """The device, the profile or its budget cannot run what was asked."""

    exit_code = 3


class Interrupted(GibenchError):
    """Ctrl-C; what was measured until then is kept."""

    exit_code = 130
