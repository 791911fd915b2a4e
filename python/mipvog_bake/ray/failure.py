"""Failures with the messages and exit codes of the program."""

from __future__ import annotations

USAGE, MALFORMED, INPUT_OUTPUT, LIMIT = 2, 3, 5, 6


class Failure(Exception):
    """A message for the user, and the exit code."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message, exit_code)
        self.message = message
        self.exit_code = exit_code

    def __str__(self) -> str:
        return self.message
