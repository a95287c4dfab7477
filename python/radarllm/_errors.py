"""Exceptions of the package."""

from __future__ import annotations


class Error(ValueError):
    """Something is wrong with an input, a file or an argument.

    ``hint`` says how to resolve it, ``path`` names the file or folder; both may be None.
    """

    hint: str | None
    path: str | None

    def __init__(self, message: str = "", *, hint: str | None = None, path: str | None = None) -> None:
        super().__init__(message)
        self.hint = hint
        self.path = path

    def __str__(self) -> str:
        message = str(self.args[0]) if self.args else ""
        return f"{message}\nhint: {self.hint}" if self.hint else message


class NotFoundError(FileNotFoundError, Error):
    """A file, a folder or a name does not exist."""

    __init__ = Error.__init__
    __str__ = Error.__str__


class ExistsError(FileExistsError, Error):
    """The output exists, and replacing it was not asked for."""

    __init__ = Error.__init__
    __str__ = Error.__str__


class Bug(RuntimeError):
    """A defect of the package, not of the input: please report the message and the lines before it."""
