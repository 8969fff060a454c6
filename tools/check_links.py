#!/usr/bin/env python3
"""Checks what the documents point to.

- A link to a file of the repository leads to one, and its #anchor to a heading there.
- A path in backquotes that begins with a folder of the repository (`src/...`, `tests/...`) exists; `*` stands for
  anything, and so does a word in capitals; a name without its ending for all files of that name.

Prints one line for each that leads nowhere, and exits with 1 if there is one.
"""

import re

import reporting

LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
FENCE = re.compile(r"^```.*?^```$|^    [^\n]*$", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"`([^`\n]+)`")
PATH = re.compile(r"(include|src|apps|python|examples|packaging|tests|bench|fuzz|shared|tools|scenes|docs|web|cmake|figures)/[\w./*-]+")


def anchors(text):
    """Of a document's headings, as web forges make them."""
    found = {}
    for heading in re.findall(r"^#+ +(.*)$", re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL), re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "")
        slug = re.sub(r"[^\w\- ]", "", plain.strip().lower()).replace(" ", "-")
        found[slug] = found.get(slug, -1) + 1
    return {f"{slug}-{i}" if i else slug for slug, count in found.items() for i in range(count + 1)}


def exists(root, path):
    path = re.sub(r"\b[A-Z]{3,}\b", "*", path)
    if "*" in path:
        return any(root.glob(path))
    whole = root / path
    return whole.exists() or any(whole.parent.glob(whole.name + ".*"))


def check(root):
    errors = []
    documents = [*root.glob("*.md"), *root.glob("docs/**/*.md"), *root.glob("web/*.md")]
    for document in sorted(documents):
        text = document.read_text()
        place = document.relative_to(root)
        for target in LINK.findall(FENCE.sub("", text)):
            if re.match(r"[a-z]+:", target):
                continue
            name, _, anchor = target.partition("#")
            file = (document.parent / name).resolve() if name else document
            if not file.exists():
                errors.append(f"{place}: {target} leads nowhere")
            elif anchor and anchor not in anchors(file.read_text()):
                errors.append(f"{place}: {file.name} has no heading #{anchor}")
        for code in CODE.findall(FENCE.sub("", text)):
            if PATH.fullmatch(code) and not exists(root, code.rstrip("/")):
                errors.append(f"{place}: there is no {code}")
    return errors


if __name__ == "__main__":
    reporting.run(check)
