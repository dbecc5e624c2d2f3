"""What lamina.pyi says, for `help` in Python: docstrings.py lamina.pyi FILE

FILE becomes lines {"Mapping.add", R"doc(...)doc"}, of the module itself "", for docs.cc.
"""
import ast
import sys

KINDS = (ast.ClassDef, ast.FunctionDef)


def documented(node, name=""):
    text = ast.get_docstring(node)
    if text is None:
        raise SystemExit(f"{sys.argv[1]}: {name or 'the module'} is not described")
    yield name, text
    for member in node.body:
        special = getattr(member, "name", "").startswith("__")
        if isinstance(member, KINDS) and (not special or ast.get_docstring(member)):
            yield from documented(member, f"{name}.{member.name}" if name else member.name)


with open(sys.argv[1]) as file:
    entries = list(documented(ast.parse(file.read())))
with open(sys.argv[2], "w") as file:
    for name, text in entries:
        file.write(f'{{"{name}", R"doc({text})doc"}},\n')
