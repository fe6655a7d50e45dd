"""Rules of the house, measured on the sources: `python -m tests.house [folder ...]` prints what breaks them.

Each rule is a function from sources to findings, so that tests and the command read the same. Findings that are allowed
for now are counted per file in `tests/contract/house_allowed.json`; `python -m tests.house --allow` writes it anew.
`python -m tests.house --lines` prints files, lines, and lines of code per folder.
"""

import ast
import json
import re
import sys
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from io import StringIO
from pathlib import Path

ROOT = Path(__file__).parents[1]
ALLOWED = ROOT / "tests" / "contract" / "house_allowed.json"
PRODUCT = ("schemas", "surefoot", "services", "lab", "papers")
"""Folders that a wheel holds, and whose names a user meets."""
BESIDE = ("benchmarks", "examples", "tests")
"""Folders beside the product, to which the rules of `WIDE` apply, too."""
MOST_LINES, MOST_PARAMETERS, MOST_SHELL = 60, 8, 150

WORDS = re.compile(
    r"\b(tell|tells|told|telling|say|says|said|saying|hear|hears|heard|speak|speaks|spoke|spoken|judge|judges|judged|"
    r"judging|nobody|onlookers?|newcomers?|doubts?)\b",
    re.IGNORECASE,
)
"""Words of talk between people; a program publishes, returns, reports, requests, logs, raises, checks."""
OPENINGS = re.compile(r"(What|Whether|How|Who|Whom|Which|Or|And)\b")
"""A docstring starts with a verb or a noun; a question, as of an example, may start with these."""
NOTE = re.compile(r"\b(note|notes) (\d|[§(])|\(note, section|design note", re.IGNORECASE)
"""Citations of notes that are not in the repository."""


@dataclass(frozen=True)
class Finding:
    """One place that breaks a rule."""

    path: str
    line: int
    text: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.text}"


class Source:
    """One Python file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.name = str(path.relative_to(ROOT))
        self.text = path.read_text()

    @cached_property
    def tree(self) -> ast.Module:
        return ast.parse(self.text)

    @cached_property
    def nodes(self) -> list[ast.AST]:
        """All nodes of the tree, found once for all rules."""
        return list(ast.walk(self.tree))

    def docstrings(self) -> Iterator[tuple[int, str]]:
        """Yield line and text of each docstring, those of fields and constants included."""
        for node in self.nodes:
            value = node.value if isinstance(node, ast.Expr) else None
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                yield node.lineno, value.value

    def messages(self) -> Iterator[tuple[int, str]]:
        """Yield line and text of each string of several words that is no docstring, parts of f-strings included."""
        within = {id(node.value) for node in self.nodes if isinstance(node, ast.Expr)}
        for node in self.nodes:
            words = node.value if isinstance(node, ast.Constant) and id(node) not in within else None
            if isinstance(words, str) and " " in words.strip():
                yield node.lineno, words

    def comments(self) -> Iterator[tuple[int, str]]:
        """Yield line and text of each comment."""
        for token in tokenize.generate_tokens(StringIO(self.text).readline):
            if token.type == tokenize.COMMENT:
                yield token.start[0], token.string.lstrip("# ")

    def code_lines(self) -> int:
        """Return the number of lines that are neither blank nor comments nor docstrings."""
        within = [node for node in self.nodes if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)]
        prose = {line for node in within for line in range(node.lineno, (node.end_lineno or 0) + 1)}
        every = enumerate(self.text.splitlines(), 1)
        return sum(bool(line.strip()) and not line.lstrip().startswith("#") and k not in prose for k, line in every)


def sources(folders: Iterable[str] = PRODUCT) -> list[Source]:
    """Return the Python files below folders of the checkout; links to folders are left out, so each file comes once."""
    found = {
        path
        for folder in folders
        for path in ((ROOT / folder).rglob("*.py") if (ROOT / folder).is_dir() else [ROOT / folder])
        if not any(part.is_symlink() for part in path.parents) and "__pycache__" not in path.parts
    }
    return [Source(path) for path in sorted(found)]


def long_functions(files: Iterable[Source]) -> list[Finding]:
    """Return functions of more than 60 lines."""
    out: list[Finding] = []
    for file in files:
        for node in file.nodes:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                length = (node.end_lineno or node.lineno) - node.lineno + 1
                if length > MOST_LINES:
                    out.append(Finding(file.name, node.lineno, f"{node.name} has {length} lines"))
    return out


def is_command(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Return whether a function's parameters are the options of a command."""
    return any("typer." in ast.unparse(argument) or "Json" in ast.unparse(argument) for argument in node.args.args)


def many_parameters(files: Iterable[Source]) -> list[Finding]:
    """Return functions of more than 8 parameters, `self` not counted; the options of a command are no parameters."""
    out: list[Finding] = []
    for file in files:
        for node in file.nodes:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not is_command(node):
                named = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                count = len([each for each in named if each.arg not in ("self", "cls")])
                if count > MOST_PARAMETERS:
                    out.append(Finding(file.name, node.lineno, f"{node.name} has {count} parameters"))
    return out


def long_shells(files: Iterable[Source]) -> list[Finding]:
    """Return `service.py` files of more than 150 lines."""
    return [
        Finding(file.name, 1, f"{len(file.text.splitlines())} lines")
        for file in files
        if file.path.name == "service.py" and len(file.text.splitlines()) > MOST_SHELL and "/cli/" not in file.name
    ]


def classes_twice(files: Iterable[Source]) -> list[Finding]:
    """Return classes whose name, a leading underscore aside, another class of the product has."""
    places: dict[str, list[Finding]] = defaultdict(list)
    for file in files:
        for node in file.nodes:
            if isinstance(node, ast.ClassDef):
                places[node.name.lstrip("_")].append(Finding(file.name, node.lineno, f"class {node.name}"))
    return [each for found in places.values() if len(found) > 1 for each in found]


def numbers_twice(files: Iterable[Source]) -> list[Finding]:
    """Return module constants that two modules define with the same name and the same number."""
    places: dict[tuple[str, float], list[Finding]] = defaultdict(list)
    for file in files:
        for node in file.tree.body:
            for name, value in _constants(node):
                if name.isupper() and (number := _number(value)) is not None:
                    where = Finding(file.name, node.lineno, f"{name} = {ast.unparse(value)}")
                    places[name.lstrip("_"), number].append(where)
    return [each for found in places.values() if len(found) > 1 for each in found]


def _constants(node: ast.stmt) -> Iterator[tuple[str, ast.expr]]:
    """Yield name and value of each assignment to a name in a statement, those of `A, B = 2, 5` one by one."""
    if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.value is not None:
        yield node.target.id, node.value
    elif isinstance(node, ast.Assign):
        target, value = node.targets[0], node.value
        pairs = [(target, value)]
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            numbers = [_number(each) for each in value.elts]
            if len(numbers) > 1 and numbers == [(numbers[0] or 0) + k for k in range(len(numbers))]:
                return  # indices of columns
            pairs = list(zip(target.elts, value.elts, strict=True))
        yield from ((name.id, each) for name, each in pairs if isinstance(name, ast.Name))


def _number(value: ast.expr) -> float | None:
    """Return the number that an expression of literals makes; None if there is a name in it."""
    if any(isinstance(node, ast.Name | ast.Call | ast.Attribute) for node in ast.walk(value)):
        return None
    try:
        made = eval(compile(ast.Expression(value), "constant", "eval"), {})
    except (TypeError, ValueError, ArithmeticError):
        return None
    return float(made) if isinstance(made, int | float) and not isinstance(made, bool) else None


def helpers_twice(files: Iterable[Source]) -> list[Finding]:
    """Return module functions of the same body, names of the functions and docstrings aside, in two modules."""
    places: dict[str, list[Finding]] = defaultdict(list)
    for file in files:
        for node in file.tree.body:
            if isinstance(node, ast.FunctionDef):
                body = node.body[1:] if ast.get_docstring(node) is not None else node.body
                if body and not (len(body) == 1 and isinstance(body[0], ast.Raise | ast.Pass)):
                    shape = ast.dump(node.args) + "".join(map(ast.dump, body))
                    if len(shape) > 300:
                        places[shape].append(Finding(file.name, node.lineno, f"{node.name}()"))
    return [each for found in places.values() if len({e.path for e in found}) > 1 for each in found]


def prose(files: Iterable[Source]) -> list[Finding]:
    """Return texts with words of talk, docstrings that do not open as a sentence, and notes that are not here.

    Texts are docstrings, comments and, outside of tests, strings of several words, which users may read.
    """
    out: list[Finding] = []
    for file in files:
        for line, text in file.docstrings():
            first = text.strip().splitlines()[0] if text.strip() else ""
            if OPENINGS.match(first) and "?" not in first:
                out.append(Finding(file.name, line, f"opening: {first}"))
            out += _words(file.name, line, text)
        for line, text in file.comments():
            if not text.startswith(("type:", "pyright:", "noqa", "fmt:")):
                out += _words(file.name, line, text)
        for line, text in file.messages() if not file.name.startswith("tests/") else ():
            out += _words(file.name, line, text)
    return out


def _words(name: str, line: int, text: str) -> Iterator[Finding]:
    for offset, row in enumerate(text.splitlines()):
        plain = re.sub(r"`[^`]*`", "", row)  # names of code stand as they are
        for rule, what in ((WORDS, "word"), (NOTE, "note")):
            if (found := rule.search(plain)) is not None:
                yield Finding(name, line + offset, f"{what} {found.group(0)!r}: {row.strip()}")


def pages(_: Iterable[Source] = ()) -> list[Finding]:
    """Return lines of README, changelog, pages and TOML files with words of talk; code in backticks is left out."""
    out: list[Finding] = []
    files = (ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "pyproject.toml", *sorted((ROOT / "docs").rglob("*.md")))
    toml = [path for folder in ("scenarios", "surefoot/robots") for path in sorted((ROOT / folder).rglob("*.toml"))]
    for path in (*files, *toml):
        text = re.sub(
            r"^```.*?^```$", lambda m: "\n" * m[0].count("\n"), path.read_text(), flags=re.DOTALL | re.MULTILINE
        )
        out += _words(str(path.relative_to(ROOT)), 1, text)
    return out


def climbing_names(files: Iterable[Source]) -> list[Finding]:
    """Return absolute imports of a module's own service or own top folder: inside a room imports are relative."""
    out: list[Finding] = []
    for file in files:
        parts = Path(file.name).parts
        if parts[0] == "surefoot":
            continue
        room = ".".join(("surefoot", *parts[: 2 if parts[0] == "services" else 1]))
        for node in file.nodes:
            if isinstance(node, ast.ImportFrom) and not node.level and f"{node.module}.".startswith(f"{room}."):
                out.append(Finding(file.name, node.lineno, f"from {node.module} import ...: make it relative"))
    return out


RULES = (
    long_functions,
    many_parameters,
    long_shells,
    classes_twice,
    numbers_twice,
    helpers_twice,
    climbing_names,
    prose,
    pages,
)


WIDE = (long_functions, many_parameters, prose)
"""Rules that apply to tests, benchmarks and examples, too."""


def findings() -> dict[str, list[Finding]]:
    """Return what breaks each rule, by the rule's name."""
    product, beside = sources(), sources(BESIDE)
    return {rule.__name__: rule([*product, *beside] if rule in WIDE else product) for rule in RULES}


def counted() -> dict[str, dict[str, int]]:
    """Return the number of findings by rule and file."""
    return {name: dict(sorted(Counter(each.path for each in found).items())) for name, found in findings().items()}


def _write(line: str) -> None:
    sys.stdout.write(line + "\n")


def lines() -> dict[str, tuple[int, int, int]]:
    """Return files, lines, and lines of code of each folder with Python files, and of the product together."""
    found = {folder: sources([folder]) for folder in (*PRODUCT, *BESIDE)}
    found["product"] = [file for folder in PRODUCT for file in found[folder]]
    return {
        folder: (len(files), sum(len(file.text.splitlines()) for file in files), sum(f.code_lines() for f in files))
        for folder, files in found.items()
    }


def main(words: list[str]) -> None:
    """Print what breaks the rules below folders; names and numbers are compared with the whole product."""
    if "--lines" in words:
        _write(f"{'':10} {'files':>6} {'lines':>7} {'code':>7}")
        for folder, (files, every, code) in lines().items():
            _write(f"{folder:10} {files:6} {every:7} {code:7}")
        return
    if "--allow" in words:
        ALLOWED.write_text(json.dumps(counted(), indent=1) + "\n")
        return
    wanted = {file.name for file in sources(words)}
    for rule, every in findings().items():
        found = [each for each in every if not words or each.path in wanted]
        _write(f"-- {rule}: {len(found)}")
        for each in found:
            _write(f"   {each}")


if __name__ == "__main__":
    main(sys.argv[1:])
