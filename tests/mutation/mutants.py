"""Mutants: copies of a source file that differ in one place of one function.

Mutated are comparisons, arithmetic, boolean operators, signs, numbers, `True` and `False`, returned
values, conditions, calls made for their effect, `break` and `continue`. Never mutated are strings,
docstrings, what is inside f-strings and `raise` (message texts), annotations, decorators, defaults
of parameters, `strict=` of `zip`, and statements outside functions.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import Any

_COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}
_ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
_UNSWAPPABLE = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)
"""Negating the other comparisons is the same as swapping them."""


@dataclass(frozen=True)
class Mutant:
    """One change.

    Attributes:
        file: The source file.
        function: Qualified name of the function.
        line: First line of the function's code object, by which it is found.
        lines: Lines of the changed expression.
        before, after: The changed expression or statement.
        name: File, function and number of the mutant.
        key: Identifies the mutant as long as its function is not edited.
        code: The function's code with the change.
    """

    file: Path
    function: str
    line: int
    lines: range
    before: str
    after: str
    name: str
    key: str
    code: CodeType


def mutants_of(file: Path, root: Path) -> Iterator[Mutant]:
    """Yield every mutant of a file that can replace its function while the program runs."""
    tree = ast.parse(file.read_text())
    original = dict(_functions(compile(tree, str(file), "exec")))
    for function, name in _definitions(tree):
        line = min([function.lineno, *(each.lineno for each in function.decorator_list)])
        digest = hashlib.sha256(ast.dump(function).encode()).hexdigest()[:12]
        sites = [site for part in function.body for site in _sites(function, part)]
        for number, (parent, name_of_field, index, old, new) in enumerate(sites):
            ast.fix_missing_locations(ast.copy_location(new, old))
            _put(parent, name_of_field, index, new)
            try:
                codes = dict(_functions(compile(tree, str(file), "exec")))
                before, after = ast.unparse(old), ast.unparse(new)
            finally:
                _put(parent, name_of_field, index, old)
            code = codes[name, line]
            if code.co_freevars != original[name, line].co_freevars or before == after:
                continue
            head = _head(old)
            lines = range(head.lineno, (head.end_lineno or head.lineno) + 1)
            of_file = f"{file.relative_to(root)}::{name}"
            key = f"{of_file}::{digest}::{number}"
            first, second = (text.split("\n")[0] for text in (before, after))
            yield Mutant(file, name, line, lines, first, second, f"{of_file}::{number}", key, code)


def _definitions(tree: ast.AST, prefix: str = "") -> Iterator[tuple[ast.FunctionDef, str]]:
    for node in getattr(tree, "body", []):
        if isinstance(node, ast.FunctionDef):
            yield node, prefix + node.name
        elif isinstance(node, ast.ClassDef):
            yield from _definitions(node, f"{prefix}{node.name}.")


def _functions(code: CodeType) -> Iterator[tuple[tuple[str, int], CodeType]]:
    for each in code.co_consts:
        if isinstance(each, CodeType):
            yield (each.co_qualname, each.co_firstlineno), each
            yield from _functions(each)


_Site = tuple[ast.AST, str, int | None, Any, Any]


def _sites(parent: ast.AST, node: ast.AST) -> Iterator[_Site]:
    """Yield (parent, field, index, old node, new node) of all changes in a statement."""
    place: tuple[str, int | None] = next(
        (field, value.index(node) if isinstance(value, list) else None)
        for field, value in ast.iter_fields(parent)
        if value is node or (isinstance(value, list) and node in value)
    )
    for new in _alternatives(node):
        yield (parent, *place, node, new)
    if isinstance(node, (ast.JoinedStr, ast.Raise)):
        return
    if isinstance(node, ast.keyword) and node.arg == "strict":
        return
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list", "args") and not isinstance(
            node, ast.Call
        ):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _sites(node, child)


def _head(node: Any) -> Any:
    """Return the expression that tells on which lines a node is evaluated."""
    if isinstance(node, (ast.If, ast.While)):
        return node.test
    return node.ifs[0] if isinstance(node, ast.comprehension) else node


def _put(parent: ast.AST, field: str, index: int | None, node: ast.AST) -> None:
    if index is None:
        setattr(parent, field, node)
    else:
        getattr(parent, field)[index] = node


def _alternatives(node: ast.AST) -> Iterator[ast.AST]:
    match node:
        case ast.Compare():
            for index, op in enumerate(node.ops):
                ops = [*node.ops[:index], _COMPARISONS[type(op)](), *node.ops[index + 1 :]]
                yield ast.Compare(node.left, ops, node.comparators)
        case ast.BinOp() if type(node.op) in _ARITHMETIC:
            yield ast.BinOp(node.left, _ARITHMETIC[type(node.op)](), node.right)
        case ast.AugAssign() if type(node.op) in _ARITHMETIC:
            yield ast.AugAssign(node.target, _ARITHMETIC[type(node.op)](), node.value)
        case ast.BoolOp():
            yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
        case ast.UnaryOp():
            yield node.operand
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int(value)):
            yield ast.Constant(value + 1)
        case ast.Constant(value=float(value)):
            yield ast.Constant(2 * value or 1.0)
        case ast.Return(value=ast.expr() as value):
            if not (isinstance(value, ast.Constant) and value.value is None):
                yield ast.Return(ast.Constant(None))
        case ast.If() | ast.While() | ast.IfExp() if _negatable(node.test):
            kind: Any = type(node)
            yield kind(ast.UnaryOp(ast.Not(), node.test), node.body, node.orelse)
        case ast.comprehension(ifs=[first, *rest]) if _negatable(first):
            ifs: list[ast.expr] = [ast.UnaryOp(ast.Not(), first), *rest]
            yield ast.comprehension(node.target, node.iter, ifs, node.is_async)
        case ast.Expr(value=ast.Call()):
            yield ast.Pass()
        case ast.Break():
            yield ast.Continue()
        case ast.Continue():
            yield ast.Break()


def _negatable(test: ast.expr) -> bool:
    if isinstance(test, ast.Compare) and len(test.ops) == 1:
        return isinstance(test.ops[0], _UNSWAPPABLE)
    return not isinstance(test, (ast.UnaryOp, ast.Constant))
