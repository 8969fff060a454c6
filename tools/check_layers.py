#!/usr/bin/env python3
"""Checks that the rooms of src/palpate know only what they may know.

- A room depends on rooms that stand before it in PALPATE_ROOMS (root CMakeLists.txt), so that data flows one way.
- A file includes headers of its own room and of the rooms that its CMakeLists.txt reaches through DEPENDS. Free to all
  is the handle model: plain data, the only thing that the visual loop hands to the haptic loop.
- Nothing up to `simulation` includes YAML, threads or devices.
- No header that `haptics` includes, directly or not, belongs to meshes, elements, contact or simulation.

Prints one line for each violation, and exits with 1 if there is one.
"""

import re

import reporting

INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]', re.MULTILINE)
FORBIDDEN_UP_TO_SIMULATION = re.compile(
    r"^(yaml-cpp/.*|thread|mutex|shared_mutex|condition_variable|future|stop_token|semaphore|latch|barrier"
    r"|pthread\.h|palpate/devices/.*)$"
)
FREE_HEADERS = ("palpate/linearization/handle_model.h",)
FORBIDDEN_FOR_HAPTICS = ("mesh", "fem", "contact", "simulation")


def room_order(root):
    text = re.sub(r"#.*", "", (root / "CMakeLists.txt").read_text())
    return re.search(r"set\(PALPATE_ROOMS\s+([^)]*)\)", text).group(1).split()


def room_calls(cmake_file):
    """The words of each palpate_room() or palpate_library() call; a room may be made of several libraries."""
    text = re.sub(r"#.*", "", cmake_file.read_text())
    return [call.split() for call in re.findall(r"palpate_(?:room|library)\(([^)]*)\)", text)]


def declared_dependencies(cmake_file):
    """The libraries after DEPENDS, or PUBLIC, in these calls of a room's CMakeLists.txt."""
    dependencies, keyword = [], None
    for word in (word for call in room_calls(cmake_file) for word in call):
        if word in ("SOURCES", "DEPENDS", "LIBRARIES", "ALONE", "OPTIONS", "SHOWN", "PUBLIC"):
            keyword = word
        elif keyword in ("DEPENDS", "PUBLIC"):
            dependencies.append(word)
    return dependencies


def reachable(room, dependencies):
    seen, stack = {room}, [room]
    while stack:
        for other in dependencies.get(stack.pop(), []):
            if other not in seen:
                seen.add(other)
                stack.append(other)
    return seen


def room_of(include):
    parts = include.split("/")
    return parts[1] if len(parts) > 2 and parts[0] == "palpate" else None


def line_of(text, include):
    return text[: re.search(r'[<"]' + re.escape(include) + r'[>"]', text).start()].count("\n") + 1


def check(root):
    errors = []
    order = room_order(root)
    rooms = root / "src" / "palpate"
    folders = sorted(p for p in rooms.iterdir() if p.is_dir() and any(p.rglob("*.[hc]*")))
    declared = [p for p in folders if (p / "CMakeLists.txt").exists()]
    home = {call[0]: p.name for p in declared for call in room_calls(p / "CMakeLists.txt") if call}
    dependencies = {
        p.name: sorted({home.get(d, d) for d in declared_dependencies(p / "CMakeLists.txt")} - {p.name}) for p in declared
    }
    files = {f: f.read_text() for p in folders for f in sorted(p.rglob("*")) if f.suffix in (".h", ".cpp")}
    includes = {f: INCLUDE.findall(text) for f, text in files.items()}

    for folder in folders:
        room = folder.name
        if room not in dependencies:
            errors.append(f"src/palpate/{room}: has sources and no CMakeLists.txt")
        if room not in order:
            errors.append(f"src/palpate/{room}: is not in PALPATE_ROOMS")
        for other in dependencies.get(room, []):
            if room in order and (other not in order or order.index(other) >= order.index(room)):
                errors.append(f"src/palpate/{room}/CMakeLists.txt: depends on {other}, which does not stand before it")

    simulation = order.index("simulation")
    for file, names in includes.items():
        room = file.relative_to(rooms).parts[0]
        if room not in dependencies:
            continue  # reported above
        allowed = reachable(room, dependencies)
        for name in names:
            place = f"{file.relative_to(root)}:{line_of(files[file], name)}"
            if room_of(name) and room_of(name) not in allowed and name not in FREE_HEADERS:
                errors.append(f"{place}: {room} includes {name} but does not depend on {room_of(name)}")
            if room in order and order.index(room) <= simulation and FORBIDDEN_UP_TO_SIMULATION.match(name):
                errors.append(f"{place}: {room} must not know {name}")

    errors += haptics_errors(root, rooms, includes)
    return errors


def haptics_errors(root, rooms, includes):
    """Follows the includes of haptics from header to header."""
    errors = []
    start = [f for f in includes if f.relative_to(rooms).parts[0] == "haptics"]
    paths = {f: [f] for f in start}
    stack = list(start)
    while stack:
        file = stack.pop()
        for name in includes[file]:
            header = root / "src" / name
            if header not in includes or header in paths:
                continue
            paths[header] = paths[file] + [header]
            if room_of(name) in FORBIDDEN_FOR_HAPTICS:
                chain = " -> ".join(str(p.relative_to(rooms)) for p in paths[header])
                errors.append(f"haptics must not know {room_of(name)}: {chain}")
            else:
                stack.append(header)
    return errors


if __name__ == "__main__":
    reporting.run(check)
