#!/usr/bin/env python3
"""Checks what clang-tidy would need minutes for, in a second, over all C++ sources.

- Constants at namespace scope and static constants of a class are named kName.
- Each source below tests/ that has tests is named x_test.cpp.
- Each file that is included with quotes is there.

Prints one line for each violation, and exits with 1 if there is one.
"""

import re

import reporting

FOLDERS = ("include", "src", "examples", "apps", "python", "shared", "tests", "bench", "fuzz")
CONSTANT = re.compile(
    r"^(?:(?:inline |static )*(?:constexpr|const) |[ ]+static (?:inline )?constexpr )"
    r"(?:inline )?(?P<type>[\w:<>,\*& ]*?[\w>\*]) (?P<name>\w+)(?:\[\w*\])*(?= =| ?\{|;|\[)",
    re.MULTILINE,
)
INCLUDE = re.compile(r'^\s*#\s*include\s*"([^"]+)"', re.MULTILINE)
TEST = re.compile(r"^(?:TYPED_)?TEST(?:_F|_P)?\(", re.MULTILINE)


def line_of(text, position):
    return text.count("\n", 0, position) + 1


def constants(text):
    """Those that are not named kName."""
    for match in CONSTANT.finditer(text):
        if match.group("type") in ("struct", "class", "enum") or re.match(r"k[A-Z0-9]", match.group("name")):
            continue
        yield match


def check(root, files):
    for file, text in files.items():
        place = file.relative_to(root)
        for match in constants(text):
            yield f"{place}:{line_of(text, match.start('name'))}: constant {match.group('name')} should be named kName"
        if place.parts[0] == "tests" and TEST.search(text) and not file.name.endswith("_test.cpp"):
            yield f"{place}: has tests and is not named x_test.cpp"
        for match in INCLUDE.finditer(text):
            name = match.group(1)
            if not any((folder / name).exists() for folder in (file.parent, root / "src", root / "include", root, root / "web", root / "apps")):
                yield f"{place}:{line_of(text, match.start())}: includes {name}, which is not there"


def check_sources(root):
    sources = [f for folder in FOLDERS for f in sorted((root / folder).rglob("*")) if f.suffix in (".h", ".cpp")]
    return check(root, {f: f.read_text() for f in sources if "third_party" not in f.parts})


if __name__ == "__main__":
    reporting.run(check_sources)
