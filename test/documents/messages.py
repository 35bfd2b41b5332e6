"""Messages as the code writes them: texts of its string literals, with … for what is filled in."""

from __future__ import annotations

import ast
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "rotary_error_monitor"


def template(node: ast.expr) -> str:
    """Text of a literal, … for each value; empty of what is no text."""
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=parts):
            return "".join(template(part) if isinstance(part, ast.Constant) else "…" for part in parts)
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return template(left) + template(right)
    return ""


def parsed(path: Path) -> ast.Module:
    """The code of a file, without its docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body = node.body[1:] or [ast.Pass()]
    return tree


def written() -> set[str]:
    """All texts of the package."""
    files = PACKAGE.rglob("*.py")
    return {template(n) for path in files for n in ast.walk(parsed(path)) if isinstance(n, ast.expr)} - {""}


def _is_bad(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "Level"
        and node.attr in ("WARN", "ERROR", "STALE")
    )


def _parts(node: ast.expr) -> set[ast.AST]:
    """What a text is made of, which is no text of its own."""
    return {part for part in ast.walk(node) if part is not node} if template(node) else set()


def diagnostics() -> set[str]:
    """Sentences in those functions of the nodes that give a level of warning or worse."""
    found = set()
    for path in (PACKAGE / "nodes").glob("*.py"):
        for function in ast.walk(parsed(path)):
            if isinstance(function, ast.FunctionDef) and any(map(_is_bad, ast.walk(function))):
                texts = [node for node in ast.walk(function) if isinstance(node, ast.expr) and template(node)]
                parts = {part for node in texts for part in _parts(node)}
                found |= {template(node) for node in texts if node not in parts}
    return {text for text in found if len(text.replace("…", " ").split()) > 1}
