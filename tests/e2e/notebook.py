#!/usr/bin/env python3
"""Runs the code cells of a notebook one after the other.

    notebook.py PACKAGES NOTEBOOK

PACKAGES is the folder that holds `anigen`."""
import ast
import json
import sys

sys.path.insert(0, sys.argv[1])
names = {"__name__": "__main__"}
with open(sys.argv[2], encoding="utf-8") as file:
    cells = json.load(file)["cells"]
for number, cell in enumerate(cells):
    if cell["cell_type"] != "code":
        continue
    code = "".join(cell["source"])
    tree = ast.parse(code)
    shown = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, f"cell {number}", "exec"), names)
    if shown is not None:
        print(eval(compile(ast.Expression(shown.value), f"cell {number}", "eval"), names))
