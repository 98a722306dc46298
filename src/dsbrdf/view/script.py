"""The page's JavaScript: modules, one a concern, put into one script and made smaller."""

from __future__ import annotations

import re
from functools import cache
from importlib import resources

__all__ = ["bundle", "minified"]

_IMPORT = re.compile(r'^import (\{[^}]*\}) from "\./(\w+)\.js";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?(?:const|function|class) (\w+))", re.MULTILINE)
_OTHER = re.compile(r"^(?:import|export)\b.*", re.MULTILINE)


@cache
def minified(entry: str = "main") -> str:
    """`bundle` without comments and what space it does not need; names are kept, for the console."""
    import rjsmin

    text: str = rjsmin.jsmin(bundle(entry))
    return text


def bundle(entry: str = "main") -> str:
    """The module `entry` and all it imports, in the order in which they run, each in a scope of its own.

    A page that opens from disk can import no files. Modules say `import { a, b } from "./x.js";` and `export` before
    a const, function or class; other forms are refused.

    Raises
    ------
    ValueError
        If a module imports or exports in another form.
    """
    done: dict[str, str] = {}

    def visit(name: str) -> None:
        if name in done:
            return
        text = _read(name)
        for _, imported in _IMPORT.findall(text):
            visit(imported)
        done[name] = _scoped(name, text)

    visit(entry)
    return "const modules = {};\n" + "".join(done.values())


def _read(name: str) -> str:
    return resources.files(__package__).joinpath("js", f"{name}.js").read_text(encoding="utf-8")


def _scoped(name: str, text: str) -> str:
    """A module as an entry of `modules`: an object of what it exports."""
    exported = ", ".join(match[1] for match in _EXPORT.findall(text))
    text = _EXPORT.sub(r"\1", _IMPORT.sub(r"const \1 = modules.\2;\n", text))
    if other := _OTHER.search(text):
        raise ValueError(f"{name}.js: {other[0]!r} is no form of import or export that the page knows.")
    return f"modules.{name} = await (async () => {{\n{text}return {{ {exported} }};\n}})();\n"
