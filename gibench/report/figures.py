"""Figures as words."""

from __future__ import annotations

from typing import Any

import pandas as pd


def number(value: Any, digits: int = 2) -> str:
    """A figure to read: blank where there is none."""
    return "" if pd.isna(value) else f"{value:,.{digits}f}"


def percent(value: Any) -> str:
    """A share to read: blank where there is none."""
    return "" if pd.isna(value) else f"{100 * value:.0f} %"
