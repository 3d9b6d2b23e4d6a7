"""Source lines of our modules for the parts that the paper's core module has, to stand beside its 427.

A source line holds code: it is neither blank, nor a comment, nor part of a string that is a statement of its own (a
docstring). How the paper counts, it does not say.
"""

import ast
import io
import tokenize
from pathlib import Path

PARTS: dict[str, tuple[str, ...]] = {
    "encoding": ("numerics/encoding.py",),
    "amplifier": ("amplifiers.py", "numerics/amplifier.py"),
    "network": ("composition.py", "nerf.py", "qnerf.py", "field.py"),
    "rendering": ("numerics/quadrature.py", "numerics/compositing.py", "rendering.py"),
}
"""Listing 1; Listing 2 and Eq. 4; Table 1 and Listing 3; Listing 4. Files of `baselines`."""

BASELINES = Path(__file__).parent.parent / "baselines"
SILENT = frozenset(
    {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
)


def source_lines(text: str) -> int:
    """Lines of a Python module that hold code; raises `SyntaxError` for what is none."""
    told = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            told |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    held: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in SILENT:
            held |= set(range(token.start[0], token.end[0] + 1))
    return len(held - told)


def core_module_lines() -> dict[str, int]:
    """Part → source lines of its files."""
    return {
        part: sum(source_lines((BASELINES / name).read_text(encoding="utf-8")) for name in names)
        for part, names in PARTS.items()
    }
