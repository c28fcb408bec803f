"""Kernels that take NamedTuples are called through `bind`, since numba unpacks tuples slowly."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FILES = {
    ".".join(file.relative_to(ROOT).with_suffix("").parts): ast.parse(file.read_text())
    for file in sorted((ROOT / "smarts").rglob("*.py"))
}


def names_in(node: ast.AST | None) -> set[str]:
    """Return every name in an annotation, also within strings."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        node = ast.parse(node.value, mode="eval")
    return {each.id for each in ast.walk(node) if isinstance(each, ast.Name)} if node else set()


def is_kernel(function: ast.FunctionDef) -> bool:
    return any("kernel" in names_in(decorator) for decorator in function.decorator_list)


TUPLES = {
    node.name
    for tree in FILES.values()
    for node in ast.walk(tree)
    if isinstance(node, ast.ClassDef) and any("NamedTuple" in names_in(base) for base in node.bases)
}
BOUND = {
    f"{module}.{node.name}"
    for module, tree in FILES.items()
    for node in tree.body
    if isinstance(node, ast.FunctionDef)
    and is_kernel(node)
    and any(names_in(each.annotation) & TUPLES for each in node.args.args)
}
"""Kernels that take NamedTuples, as dotted paths."""


def names_of(module: str, tree: ast.Module) -> dict[str, str]:
    """Return the dotted path of each imported or defined function name of a module."""
    known = {node.name: f"{module}.{node.name}" for node in tree.body if isinstance(node, ast.FunctionDef)}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            known |= {each.asname or each.name: f"{node.module}.{each.name}" for each in node.names}
    return known


def direct_calls(module: str, tree: ast.Module) -> list[str]:
    """Return direct calls of kernels in `BOUND`, made outside kernels."""
    known = names_of(module, tree)
    compiled = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and is_kernel(node)]
    inside = {call for function in compiled for call in ast.walk(function)}
    found = []
    for call in ast.walk(tree):
        if isinstance(call, ast.Call) and call not in inside:
            path, called = [], call.func
            while isinstance(called, ast.Attribute):
                path, called = [called.attr, *path], called.value
            if isinstance(called, ast.Name):
                name = ".".join([known.get(called.id, called.id), *path])
                if name in BOUND:
                    found.append(f"line {call.lineno}: {name}")
    return found


def test_kernels_of_tuples_are_bound():
    found = {module: calls for module, tree in FILES.items() if (calls := direct_calls(module, tree))}
    assert found == {}


def test_direct_calls_are_found():
    assert "smarts.sim.contacts.find_contacts" in BOUND
    source = (
        "from smarts.sim import contacts\nfrom smarts.sim.contacts import find_contacts as find\n"
        "find(1)\ncontacts.find_contacts(1)\n@kernel\ndef compiled():\n    find(1)\nbind(find, 1)(2)\n"
    )
    assert len(direct_calls("smarts.mine", ast.parse(source))) == 2
