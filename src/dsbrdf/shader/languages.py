"""One source in four languages: `dsbrdf.glsl` is written in a part of GLSL that turns into the others line by line.

It has one declaration a line with its type in front, structs that are filled field by field, conditions in braces; no
conditional expressions, no output parameters, no overloaded functions, and all components in a constructor.
"""

from __future__ import annotations

import re
from collections.abc import Callable

__all__ = ["LANGUAGES", "texel_block", "translate"]

LANGUAGES = ("glsl", "wgsl", "hlsl", "slang")

#: Names of types, by language.
TYPES: dict[str, dict[str, str]] = {
    "glsl": {},
    "hlsl": {"vec2": "float2", "vec3": "float3", "vec4": "float4", "ivec4": "int4"},
    "wgsl": {
        "vec2": "vec2f",
        "vec3": "vec3f",
        "vec4": "vec4f",
        "ivec4": "vec4i",
        "float": "f32",
        "int": "i32",
    },
}
TYPES["slang"] = TYPES["hlsl"]

#: Vectors of parameters a line.
TEXELS_A_LINE = 3
#: Turns of a loop, at most.
MAX_LOOP = 16
TYPE = r"(float|int|bool|vec[234]|ivec4|dsbrdf_\w+)"


def translate(source: str, language: str) -> str:
    """The source in a language, one of `LANGUAGES`; comments stay, but for names of types."""
    if language == "glsl":
        return source
    line_by_line = {"wgsl": _to_wgsl, "hlsl": _to_hlsl, "slang": _to_slang}[language]
    lines = [line_by_line(line) for line in source.split("\n")]
    rename = _renamer(TYPES[language])
    return "\n".join(map(rename, lines))


def texel_block(rows: list[str], language: str) -> str:
    """The parameters as one array of vectors, each a text of four numbers, and the function that reads it."""
    n = len(rows)
    vector = _renamer(TYPES[language])("vec4")
    entries = [f"{vector}({row})" for row in rows]
    packed = [", ".join(entries[i : i + TEXELS_A_LINE]) for i in range(0, n, TEXELS_A_LINE)]
    values = ",\n    ".join(packed)
    if language == "glsl":
        array = f"const vec4 DSBRDF_TEXELS[{n}] = vec4[{n}](\n    {values});\n"
    elif language == "wgsl":
        array = f"var<private> DSBRDF_TEXELS: array<vec4f, {n}> = array<vec4f, {n}>(\n    {values});\n"
    else:
        array = f"static const float4 DSBRDF_TEXELS[{n}] = {{\n    {values}}};\n"
    return array + translate("vec4 dsbrdf_texel(int i) {\n    return DSBRDF_TEXELS[i];\n}\n", language)


def _to_hlsl(line: str) -> str:
    return re.sub(r"^const ", "static const ", line)


def _to_slang(line: str) -> str:
    """As HLSL, with what Slang needs to differentiate."""
    if re.match(rf"^{TYPE} (\w+)\((.*)\) {{$", line):
        return line if line.startswith("int ") else f"[Differentiable]\n{line}"
    if line.startswith("struct "):
        return line.replace(" {", " : IDifferentiable {")
    # Of a loop whose end is known Slang counts the turns itself
    loop = re.match(r"( +)for \(int k = 0; k < \D", line)
    return f"{loop[1]}[MaxIters({MAX_LOOP})]\n{line}" if loop else _to_hlsl(line)


def _to_wgsl(line: str) -> str:
    if line.lstrip().startswith("//"):
        return line
    line = re.sub(rf"^const {TYPE} (\w+) = ", r"const \2: \1 = ", line)
    line = re.sub(rf"^{TYPE} (\w+)\((.*)\) {{$", _head, line)
    line = re.sub(rf"^(\s+){TYPE} (\w+) = ", r"\1var \3: \2 = ", line)
    line = re.sub(r"for \(int (\w+) = (\w+);(.*); \+\+\w+\)", r"for (var \1: int = \2;\3; \1++)", line)
    line = re.sub(r"^(    )(dsbrdf_\w+) (\w+);$", r"\1var \3: \2;", line)
    # Fields of a struct
    line = re.sub(rf"^(    ){TYPE} (\w+);$", r"\1\3: \2,", line)
    return "}" if line == "};" else line


def _head(match: re.Match[str]) -> str:
    """The head of a function: names before types."""
    kind, name, arguments = match.groups()
    pairs = (argument.split() for argument in arguments.split(", "))
    return f"fn {name}({', '.join(f'{label}: {of}' for of, label in pairs)}) -> {kind} {{"


def _renamer(types: dict[str, str]) -> Callable[[str], str]:
    """A function that renames types where they stand as words."""
    if not types:
        return lambda line: line
    pattern = re.compile(rf"\b({'|'.join(types)})\b")
    return lambda line: pattern.sub(lambda match: types[match[1]], line)
