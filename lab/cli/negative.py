"""A command whose arguments may be negative numbers: `surefoot sim push -5` without `--` before the number."""

import re
from typing import Any

from typer.core import TyperCommand

_NEGATIVE = re.compile(r"-(\d|\.\d|inf|nan).*", re.IGNORECASE)


class NumbersCommand(TyperCommand):
    """Command that takes a word like `-5` as an argument, whose own check names the allowed range, not as an option."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words of the command line; unknown options stay refused unless a negative number is among them."""
        ctx.ignore_unknown_options = any(_NEGATIVE.fullmatch(word) for word in args)
        return super().parse_args(ctx, args)
