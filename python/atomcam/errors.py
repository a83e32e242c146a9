"""Bad input."""

from ._core import Error

__all__ = ["Error", "error"]


def error(place: str, problem: str) -> Error:
    """An `Error` at a place; `problem` has the value and what is allowed."""
    made = Error(f"{place}: {problem}")
    made.place = place
    return made
