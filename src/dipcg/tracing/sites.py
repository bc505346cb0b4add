"""Where a random draw is made: the calls that lead to it, and the name of what it is assigned to."""

from __future__ import annotations

import ast
import functools
import hashlib
import linecache
import re
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FrameType

# Words of modules and functions that make materials, whose draws cannot change a mesh.
MATERIAL = re.compile(r"(^|[._])(material|materials|shader|shaders|texture|textures|colou?rs?|hsv|rgb)([._]|$)", re.I)
# Functions around a draw that make its value easier to read: the parameter has the value after the call.
READABLE = {"exp": "log", "deg2rad": "degrees", "radians": "degrees"}
HERE = str(Path(__file__).parent)
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)


@dataclass(frozen=True)
class Site:
    """A place in a program that draws, as seen from one chain of calls."""

    key: str
    """A short name of the place, with a hash of the calls that lead there"""
    name: str
    """What the draw is assigned to, or the file and the line"""
    line: str
    """File, line number, and text of that line"""
    group: str = ""
    """The class or function that the name comes from"""
    form: str = ""
    """"log" where the program takes the draw's exponential, "degrees" where it turns it into radians"""
    compared: str = ""
    """"<" or ">" where the draw is only ever compared with something, and is true below or above it"""
    material: bool = False
    retried: bool = False
    """Whether it stands in a `while` loop, which may draw again until it likes the value"""


# A frame of the program: its code, and the position of the instruction that it is in.
Place = tuple[CodeType, int]


def places(frame: FrameType | None, stop: CodeType) -> tuple[Place, ...]:
    """The frames from the draw, innermost first, up to the one that runs `stop`, which is left out.

    Frames of this folder, which call the program, are left out too: another version of dipcg must find the same draws.
    """
    found: list[Place] = []
    while frame is not None and frame.f_code is not stop:
        if not frame.f_code.co_filename.startswith(HERE):
            found.append((frame.f_code, frame.f_lasti))
        frame = frame.f_back
    return tuple(found)


@functools.cache
def site(chain: tuple[Place, ...]) -> Site:
    """The site of a draw; a chain that goes through a call again is shortened, so that recursion repeats a site."""
    steps = [_step(*place) for place in dict.fromkeys(chain)]
    digest = hashlib.sha256("\n".join(steps).encode()).hexdigest()[:6]
    described = [_describe(*place) for place in chain]
    inner = described[0]
    # A helper's own name for a value that it returns counts only where its callers have none.
    outside = next((one for one in described if not one.returned), described[-1])
    named = outside if outside.name else next((one for one in described if one.name), outside)
    code, at = chain[described.index(named)]
    return Site(
        key=f"{steps[0].rpartition(':')[0]} {digest}",
        name=snake(named.name) or f"{Path(code.co_filename).stem}_{_position(code, at)[0]}",
        line=_line(code, at),
        group=_group(code),
        form=next((one.form for one in described[: described.index(named) + 1] if one.form), ""),
        compared=inner.compared,
        material=bool(MATERIAL.search(named.name)) or any(map(_is_material, chain)),
        retried=any(one.retried for one in described[: described.index(named) + 1]),
    )


@dataclass(frozen=True)
class Use:
    """What one frame does with the value of the call that it is in."""

    name: str = ""
    returned: bool = False
    form: str = ""
    compared: str = ""
    retried: bool = False


def use_of(node: ast.AST, parents: dict[ast.AST, ast.AST]) -> Use:
    """What is done with the value of an expression: the name it gets, whether it is returned, compared or retried."""
    name, form, compared, child = "", "", "", node
    while child in parents and not isinstance(child, ast.stmt):
        parent = parents[child]
        if isinstance(parent, ast.keyword) and parent.arg:
            name = name or parent.arg
        elif isinstance(parent, ast.Dict):
            name = name or next(
                (_constant(k) for k, v in zip(parent.keys, parent.values, strict=True) if v is child), ""
            )
        elif isinstance(parent, ast.Compare) and child is node:
            compared = _side(parent, node)
        elif isinstance(parent, ast.Call) and child is node and _called(parent) in READABLE:
            form = READABLE[_called(parent)]
        elif isinstance(parent, ast.IfExp) and child is parent.test:
            return Use(_if_name(parent, parents), False, form, compared, _in_while(node, parents))
        elif isinstance(parent, ast.Lambda):
            return Use(name, not name, form, compared, False)
        child = parent
    assigned = "" if name else _assigned(child, node)
    returned = not name and (isinstance(child, ast.Return) or _is_returned(child, assigned, parents))
    compared = compared or _only_compared(child, assigned, parents)
    return Use(name or assigned, returned, form, compared, _in_while(node, parents))


def snake(name: str) -> str:
    """A name for the command line: lower case, words parted by `_`."""
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)
    word = re.sub(r"\W+", "_", parted).strip("_").lower()
    return word if not word or word.isidentifier() else f"n_{word}"


def _describe(code: CodeType, at: int) -> Use:
    nodes, parents = _tree(code.co_filename)
    node = nodes.get(_position(code, at))
    return Use() if node is None else use_of(node, parents)


@functools.cache
def _tree(path: str) -> tuple[dict[tuple, ast.AST], dict[ast.AST, ast.AST]]:
    """The expressions of a file by their position, and the parent of every node."""
    try:
        tree = ast.parse("".join(linecache.getlines(path)))
    except (SyntaxError, ValueError):
        return {}, {}
    parents = {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return {(n.lineno, n.end_lineno, n.col_offset, n.end_col_offset): n for n in calls}, parents


def _position(code: CodeType, at: int) -> tuple:
    """Line, last line, column and last column of the instruction at an offset of bytes."""
    for index, position in enumerate(code.co_positions()):
        if index == at // 2:
            return position
    return (code.co_firstlineno, None, None, None)


def _step(code: CodeType, at: int) -> str:
    line, _, column, _ = _position(code, at)
    return f"{_file(code)}:{line}:{column}"


def _file(code: CodeType) -> str:
    """The last two parts of the path, which are the same on every machine."""
    return "/".join(Path(code.co_filename).parts[-2:])


def _line(code: CodeType, at: int) -> str:
    number = _position(code, at)[0]
    text = " ".join(linecache.getline(code.co_filename, number).split())
    return f"{Path(code.co_filename).name} line {number}: {text}"


def _group(code: CodeType) -> str:
    words = [word for word in code.co_qualname.split(".") if not word.startswith("<")]
    return words[0] if words else ""


def _is_material(place: Place) -> bool:
    code, _ = place
    folders = ".".join(Path(code.co_filename).with_suffix("").parts[-3:])
    return bool(MATERIAL.search(folders) or MATERIAL.search(code.co_qualname))


def _assigned(statement: ast.AST, node: ast.AST) -> str:
    """The name that a statement gives to what an expression in it makes."""
    if isinstance(statement, ast.Assign):
        return _target(statement.targets[0], statement.value, node)
    if isinstance(statement, (ast.AnnAssign, ast.AugAssign)):
        return _target(statement.target, statement.value, node)
    return ""


def _target(target: ast.AST, value: ast.AST | None, node: ast.AST) -> str:
    if isinstance(target, ast.Name):
        return "" if target.id == "_" else target.id
    if isinstance(target, ast.Attribute):
        return target.attr
    if isinstance(target, ast.Subscript):
        return _constant(target.slice) or _target(target.value, None, node)
    if not isinstance(target, (ast.Tuple, ast.List)):
        return ""
    values = value.elts if isinstance(value, (ast.Tuple, ast.List)) else []
    for one, part in zip(target.elts, values, strict=False):
        if any(inner is node for inner in ast.walk(part)):
            return _target(one, part, node)
    return "_".join(filter(None, (_target(one, None, node) for one in target.elts)))


def _constant(node: ast.AST | None) -> str:
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def _called(call: ast.Call) -> str:
    function = call.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def _if_name(choice: ast.IfExp, parents: dict[ast.AST, ast.AST]) -> str:
    """A draw that decides which value something gets: `x_case` for `x = 1 if uniform() < 0.2 else …`."""
    outer = use_of(choice, parents).name
    return f"{outer}_case" if outer else ""


def _only_compared(statement: ast.AST, name: str, parents: dict[ast.AST, ast.AST]) -> str:
    """The side on which it is true, of a draw that a plain assignment names and that is used in comparisons alone."""
    if not _is_plain(statement):
        return ""
    uses = _uses(statement, name, parents)
    compares = [parent for use in uses if isinstance(parent := parents[use], ast.Compare)]
    return _side(compares[0], uses[0]) if uses and len(compares) == len(uses) else ""


def _is_returned(statement: ast.AST, name: str, parents: dict[ast.AST, ast.AST]) -> bool:
    """Whether a function assigns a value to a local name, and returns it as it is."""
    return _is_plain(statement) and any(isinstance(parents[use], ast.Return) for use in _uses(statement, name, parents))


def _is_plain(statement: ast.AST) -> bool:
    """Whether a statement is `name = call(…)`."""
    if not (isinstance(statement, ast.Assign) and isinstance(statement.value, ast.Call)):
        return False
    return len(statement.targets) == 1 and isinstance(statement.targets[0], ast.Name)


def _uses(statement: ast.AST, name: str, parents: dict[ast.AST, ast.AST]) -> list[ast.Name]:
    """Where the function around a statement reads a name."""
    scope: ast.AST = statement
    while scope in parents and not isinstance(scope, FUNCTIONS):
        scope = parents[scope]
    return [n for n in ast.walk(scope) if isinstance(n, ast.Name) and n.id == name and isinstance(n.ctx, ast.Load)]


def _side(compare: ast.Compare, node: ast.AST) -> str:
    """On which side of the threshold a comparison holds: "<" for `draw < 0.5` and for `0.5 > draw`."""
    below = isinstance(compare.ops[0], (ast.Lt, ast.LtE))
    return "<" if below == (compare.left is node) else ">"


def _in_while(node: ast.AST, parents: dict[ast.AST, ast.AST]) -> bool:
    while node in parents and not isinstance(node, FUNCTIONS):
        node = parents[node]
        if isinstance(node, ast.While):
            return True
    return False
