"""Measures the size of all tracked Python: code lines, and counts of what makes code heavy.

python -m perf.size

A code line has a token that is no comment and no docstring (any string that stands alone). Counts are of
the product's syntax trees: `raise`; yields of faults (in generators of `str` or of a class `...Fault`);
functions that only check (a `raise` or a yield of a fault, no value returned, nothing stored in an object);
functions above complexity 10, by radon's rule.
"""

from __future__ import annotations

import ast
import io
import subprocess
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PRODUCT = ("smarts", "algorithms", "benchmark", "smarts_agent_kit")
COMPLEX = 10
"""Highest complexity that is not counted."""
_LAYOUT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
_LAYOUT |= {tokenize.ENCODING, tokenize.ENDMARKER}
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def code_lines(text: str, tree: ast.Module) -> int:
    """Return the number of code lines of a file."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    lines = {line for t in tokens if t.type not in _LAYOUT for line in range(t.start[0], t.end[0] + 1)}
    for node in ast.walk(tree):
        match node:
            case ast.Expr(value=ast.Constant(value=str())):
                lines.difference_update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(lines)


def own_nodes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes within a function, without those of functions and classes in it."""
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, (*_FUNCTIONS, ast.ClassDef)):
            yield child
            yield from own_nodes(child)


def complexity(function: ast.AST) -> int:
    """Return McCabe's complexity of a function, counted as radon does: 1 and its decisions."""
    count = 1
    for node in own_nodes(function):
        if isinstance(node, ast.Try | ast.TryStar):
            count += len(node.handlers) + bool(node.orelse)
        elif isinstance(node, ast.BoolOp):
            count += len(node.values) - 1
        elif isinstance(node, ast.If | ast.IfExp | ast.Assert):
            count += 1
        elif isinstance(node, ast.For | ast.While | ast.AsyncFor):
            count += 1 + bool(node.orelse)
        elif isinstance(node, ast.comprehension):
            count += 1 + len(node.ifs)
        elif isinstance(node, ast.Match):
            count += sum(getattr(case.pattern, "pattern", False) is not None for case in node.cases)
    return count


def counts_of(tree: ast.Module) -> Counter[str]:
    """Return what is counted in a file of the product."""
    found: Counter[str] = Counter()
    for function in (node for node in ast.walk(tree) if isinstance(node, _FUNCTIONS)):
        nodes = [*own_nodes(function)]
        raised = sum(isinstance(node, ast.Raise) for node in nodes)
        kind = ast.unparse(function.returns) if function.returns else ""
        is_of_faults = kind == "Iterator[str]" or "Fault" in kind
        yields = is_of_faults * sum(isinstance(node, ast.Yield | ast.YieldFrom) for node in nodes)
        returns = any(isinstance(node, ast.Return) and node.value is not None for node in nodes)
        stores = any(
            isinstance(node, ast.Attribute | ast.Subscript) and isinstance(node.ctx, ast.Store)
            for node in nodes
        )
        others = not yields and any(isinstance(node, ast.Yield | ast.YieldFrom) for node in nodes)
        found["yields of faults"] += yields
        found["functions that only check"] += bool(raised or yields) and not (returns or stores or others)
        found[f"functions above complexity {COMPLEX}"] += complexity(function) > COMPLEX
    found["raise"] += sum(isinstance(node, ast.Raise) for node in ast.walk(tree))
    return found


def main() -> None:
    """Print the table."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True)
    tracked = [ROOT / name for name in names.stdout.split("\0") if name and (ROOT / name).is_file()]
    lines: Counter[str] = Counter()
    counts: Counter[str] = Counter()
    classes: Counter[str] = Counter()
    for file in (file for file in tracked if file.suffix == ".py"):
        text = file.read_text(encoding="utf-8")
        tree, folder = ast.parse(text), file.relative_to(ROOT).parts[0]
        lines[folder] += code_lines(text, tree)
        if folder in PRODUCT:
            counts.update(counts_of(tree))
            classes.update(node.name for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    counts["class names defined twice"] = sum(number > 1 for number in classes.values())
    counts["tracked files"] = len(tracked)
    counts["bytes of results"] = sum(
        each.stat().st_size for each in tracked if ROOT / "results" in each.parents
    )
    print("code lines")
    rows = {**lines, "product": sum(lines[name] for name in PRODUCT), "all": sum(lines.values())}
    for name, number in (*rows.items(), ("", ""), *sorted(counts.items())):
        print(f"  {name:32}{number:>13,}" if name else "counts")


if __name__ == "__main__":
    main()
