"""How a subcommand's help is laid out: plain text, its options under the headings they name.

Typer's own panels come with Rich's Markdown and syntax highlighter, which take longer to load than
everything else that ``gibench --help`` does.
"""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand


class Sectioned(TyperCommand):
    """A subcommand whose help lists its options by ``rich_help_panel``, in order of appearance,
    and those that name none last."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write each heading with its arguments or options (of Click's ``HelpFormatter``)."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            entry = parameter.get_help_record(ctx)
            if entry is not None:
                kind = "Arguments" if parameter.param_type_name == "argument" else "Options"
                heading = getattr(parameter, "rich_help_panel", None) or kind
                sections.setdefault(heading, []).append(entry)
        for heading, entries in sorted(sections.items(), key=lambda item: item[0] == "Options"):
            with formatter.section(heading):
                formatter.write_dl(entries)
