"""The sources of kaju's agents and of their engine, as a page runs them: the very same code.

Annotations, docstrings and imports are taken out, for a page's Python is small and need not read
them. What these sources name from elsewhere, `engine.py` brings.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from typing import Any

from kaju import errors, stepping
from kaju.agents import boundary_agent, material_agent, own_agents, parameter, shares
from kaju.model.transfer import agent_engine, load_model, transfer

WHOLE: tuple[Any, ...] = (
    errors.KajuError, errors.ParameterError, errors.AgentError, errors.brief, errors.require,
    stepping.chosen, shares.Amounts, shares.no_number, shares.Load, shares.Emission,
    shares.Emissions, shares.Lateral, shares.Neighbourhood, shares.Shares, parameter.is_number,
    parameter.declared, parameter.Declaration, parameter.Parameter, parameter.State,
    material_agent.LoadBox, material_agent.PlacedAgent, material_agent.MaterialAgent,
    boundary_agent.BoundaryAgent, boundary_agent.FreeBoundaryAgent,
    boundary_agent.RigidBoundaryAgent, boundary_agent.RollerBoundaryAgent,
    own_agents._near, own_agents.OwnAgents, transfer.check_shares,
)  # fmt: skip
"""Classes and functions, in an order in which each finds its bases."""
METHODS: dict[Any, tuple[str, ...]] = {
    transfer.Transfer: ("heading", "emissions"),
    load_model.LoadModel: ("agent_at", "axis_of", "heading", "hand_over", "__setattr__"),
    agent_engine.AgentEngine: (
        "__init__", "_clear", "begin", "act", "end", "hand_over", "box_over",
        "emissions_of", "split", "_give_back", "_open_boxes", "_judged", "_bring", "_put",
        "_wake", "note_taken", "_note_states", "_arms_to_wakers",
    ),
}  # fmt: skip
"""Methods of classes that a page makes in another way."""
CONSTANTS = {
    "MOST_EMISSIONS": own_agents.MOST_EMISSIONS,
    "MOST_REMEMBERED": agent_engine.MOST_REMEMBERED,
    "BOUNDARY_NAMES": transfer.BOUNDARY_NAMES,
}


class _Plain(ast.NodeTransformer):
    """Takes out what only readers and type checkers need; named tuples become `Record`."""

    def visit_Import(self, node: ast.AST) -> None:
        """Leave out an import."""

    visit_ImportFrom = visit_Assert = visit_Import  # noqa: N815

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST | None:
        """Leave out annotations, docstrings, and overloads."""
        if any(isinstance(d, ast.Name) and d.id == "overload" for d in node.decorator_list):
            return None
        node.returns = None
        for argument in ast.walk(node.args):
            if isinstance(argument, ast.arg):
                argument.annotation = None
        return self._body(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST | None:
        """Keep a value that is given, without its kind."""
        self.generic_visit(node)
        if node.value is None:
            return None
        return ast.Assign([node.target], node.value, lineno=node.lineno)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """Take a list for an array: the page's tables are lists."""
        self.generic_visit(node)
        array = isinstance(node.func, ast.Attribute) and node.func.attr == "tolist"
        return node.func.value if array else node  # type: ignore[attr-defined]

    def visit_GeneratorExp(self, node: ast.GeneratorExp) -> ast.AST:
        """Make a list at once, which takes half as long there."""
        self.generic_visit(node)
        return ast.ListComp(node.elt, node.generators)

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        """Leave out what types are of; name the fields of a named tuple or a dataclass."""
        node.bases = [
            base.value if isinstance(base, ast.Subscript) else base for base in node.bases
        ]
        tuples = any(isinstance(base, ast.Name) and base.id == "NamedTuple" for base in node.bases)
        if tuples or node.decorator_list:
            named = [part for part in node.body if isinstance(part, ast.AnnAssign)]
            fields = tuple(ast.unparse(part.target) for part in named)
            values = ", ".join(ast.unparse(part.value) for part in named if part.value)
            told = ast.parse(f"fields, defaults = {fields!r}, ({values}{',' if values else ''})")
            node.body = [*told.body, *(part for part in node.body if part not in named)]
            node.bases = [ast.Name("Record")]
            own = [one for one in node.decorator_list if "dataclass" not in ast.unparse(one)]
            node.decorator_list = own
        return self._body(node)

    def _body(self, node: Any) -> ast.AST:
        node.body = [
            part
            for part in node.body
            if not (isinstance(part, ast.Expr) and isinstance(part.value, ast.Constant))
        ]
        self.generic_visit(node)
        node.body = node.body or [ast.Pass()]
        return node  # type: ignore[no-any-return]


def _plain(of: Any) -> str:
    tree = ast.parse(textwrap.dedent(inspect.getsource(of)))
    return ast.unparse(ast.fix_missing_locations(_Plain().visit(tree)))


def heart() -> str:
    """Return the sources as one text."""
    parts = [f"{name} = {value!r}" for name, value in CONSTANTS.items()]
    parts += map(_plain, WHOLE)
    for of, names in METHODS.items():
        methods = "\n".join(_plain(getattr(of, name)) for name in names)
        parts.append(f"class {of.__name__}:\n{textwrap.indent(methods, '    ')}")
    walls = ", ".join(one.__name__ for one in boundary_agent.BOUNDARIES.values())
    parts.append(f"BOUNDARIES = {{one.name: one for one in ({walls})}}")
    return "\n".join(parts)
