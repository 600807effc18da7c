"""What modules import: read from their source, or seen after running a program."""

import ast
import subprocess
import sys

from recordings import ROOT


def imported_names(path):
    """Dotted names of all imports of a file, those inside functions too."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"relative import in {path.name}, line {node.lineno}"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def modules_after(program):
    """Top-level modules that are loaded once a program has run."""
    listing = "; import sys; print(*{name.split('.')[0] for name in sys.modules})"
    done = subprocess.run(
        [sys.executable, "-c", program + listing],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    return set(done.stdout.split())
