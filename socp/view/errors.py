"""Errors as text, in two digits."""

import math


def small(value: float) -> str:
    """Return a violation or an error in two digits."""
    return "0" if value == 0 else f"{value:.1e}"


def signed_error(value: float) -> str:
    """Return an error with its sign in two digits, a dash for one that is not known."""
    if math.isnan(value):
        return "-"
    return "0" if value == 0 else f"{value:+.1e}"


def switch_error(error: float) -> str:
    """Return the error of a switching time as text; an infinite one belongs to a time that is not
    determined.
    """
    return f"within {error:.1e}" if math.isfinite(error) else "not determined"
