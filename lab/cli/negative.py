"""Command class that accepts negative numbers as arguments: `surefoot sim push -5` without `--` before the number."""

import re
from typing import Any

from typer.core import TyperCommand

_NEGATIVE = re.compile(r"-(\d|\.\d|inf|nan).*", re.IGNORECASE)


class NumbersCommand(TyperCommand):
    """Command that parses a word like `-5` as an argument, whose range check then applies, and not as an option."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words of a command line; unknown options are refused unless one word is a negative number."""
        ctx.ignore_unknown_options = any(_NEGATIVE.fullmatch(word) for word in args)
        return super().parse_args(ctx, args)
