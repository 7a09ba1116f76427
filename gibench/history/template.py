"""The pages of this folder: templates with style, script and data. No network, no libraries."""

from __future__ import annotations

import json
from importlib.resources import files
from typing import Any


def filled(name: str, data: Any) -> str:
    """The page ``name`` (its ``.html`` and ``.js`` beside this file) of plain ``data``."""
    folder = files("gibench.history")
    page = folder.joinpath(f"{name}.html").read_text(encoding="utf-8")
    style = files("gibench.report").joinpath("page.css").read_text(encoding="utf-8")
    script = "".join(
        folder.joinpath(part).read_text(encoding="utf-8") for part in ("shared.js", f"{name}.js")
    )
    # '</' inside a script element would end it.
    text = json.dumps(data, ensure_ascii=False, allow_nan=False).replace("</", "<\\/")
    page = page.replace("/*STYLE*/", style).replace("/*SCRIPT*/", script)
    return page.replace("/*DATA*/null", text)
