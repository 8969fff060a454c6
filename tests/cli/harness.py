"""What the end-to-end cases share: registering a case, running the program, judging what it did."""

import csv
import json
import pathlib
import re
import resource
import subprocess

CASES = {}
MEMORY_LIMIT = 6 << 30  # bytes of address space


# A bar, held at its top and pressed on the ground.
SCENE = """\
palpate: 1
name: press
duration: 0.3
visual: {step: 0.02}
tool:
  shape: {bar: {size: [0.08, 0.06, 0.08], cells: [2, 2, 2]}}
  material: {youngs_modulus: 2.0e4, poisson_ratio: 0.4, density: 1000}
  friction: 0.5
  handles:
    top:
      region: {halfspace: {point: [0, 0, 0.079], normal: [0, 0, 1]}}
      mass: 0.02
      hand:
        keyframes:
          - {t: 0, position: [0, 0, 0]}
          - {t: 0.2, position: [0.005, 0, -0.002]}
obstacles:
  - {name: ground, plane: {}}
"""


class Failure(Exception):
    """The program did not do what the case expects."""


class Skip(Exception):
    """What the case needs is not installed."""


def with_vtk(script, *arguments):
    """What a script of this folder prints; it runs with the distribution's Python, which has VTK."""
    return with_python({"vtk": "python3-vtk9"}, script, *arguments)


def with_python(packages, script, *arguments):
    """The same with other modules; `packages`: what brings each."""
    python = "/usr/bin/python3"
    for module, package in packages.items():
        if subprocess.run([python, "-c", f"import {module}"], capture_output=True).returncode != 0:
            raise Skip(f"{package} is not installed (./dev setup test)")
    done = subprocess.run([python, "-B", str(pathlib.Path(__file__).parent / script), *map(str, arguments)],
                          capture_output=True, text=True, timeout=100)
    expect(done.returncode == 0, f"{script}: {done.stderr.strip()[-600:]}")
    return done.stdout


def case(function):
    """Registers a function of one argument, a Context, as a case named after it."""
    CASES[function.__name__.replace("_", "-")] = function
    return function


def rejected_variants(prefix, variants):
    """Registers one case for each entry {name: function(context) -> (arguments, words)}: see Context.rejects()."""
    for name, make in variants.items():

        def run(context, make=make):
            arguments, words = make(context)
            context.rejects(arguments, words)

        CASES[f"{prefix}-{name}"] = run


def expect(condition, message):
    if not condition:
        raise Failure(message)


class Context:
    def __init__(self, program, source, folder):
        self.program = program
        self.source = pathlib.Path(source)
        self.folder = pathlib.Path(folder)  # empty, removed after the case
        self.out = self.folder / "out"

    def scene(self, name):
        return self.source / "scenes" / f"{name}.yaml"

    def file(self, name, content):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    def start(self, arguments, **options):
        first = options.pop("preexec_fn", lambda: None)

        def limit():
            first()
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, MEMORY_LIMIT))

        return subprocess.Popen([str(self.program)] + [str(a) for a in arguments], stdin=subprocess.DEVNULL,
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace",
                                cwd=self.folder, preexec_fn=limit, **options)

    def run(self, arguments, timeout=120):
        """Exit code, standard output and standard error."""
        process = self.start(arguments)
        try:
            output, errors = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            raise Failure(f"did not end within {timeout} s")
        return process.returncode, output, errors

    def succeeds(self, arguments, timeout=120):
        code, output, errors = self.run(arguments, timeout)
        expect(code == 0, f"exit code {code}, standard error: {errors.strip()}")
        return output

    def rejects(self, arguments, words=(), timeout=30):
        """Bad input: exit code 2, one line on standard error that holds the words, no result that looks complete."""
        code, _, errors = self.run(arguments, timeout)
        # on a busy machine it may say what it was at
        lines = [line for line in errors.splitlines() if not re.search(r"\(\d+ s\)$", line)]
        expect(code == 2, f"exit code {code} and not 2; standard error: {errors.strip()[-600:]!r}")
        expect(len(lines) == 1 and lines[0].strip(), f"{len(lines)} lines on standard error and not one: {errors!r}")
        expect(len(lines[0]) < 500, "the line is longer than 500 characters")
        for word in words:
            expect(str(word) in lines[0], f"the line does not name {str(word)!r}: {lines[0]}")
        self.no_complete_result()
        return lines[0]

    def no_complete_result(self):
        for name in ("summary.json", "report.html"):
            expect(not (self.out / name).exists(), f"{name} was left behind")

    def summary(self, out=None):
        text = ((out or self.out) / "summary.json").read_text()

        def not_finite(word):
            raise Failure(f"summary.json holds {word}")

        return json.loads(text, parse_constant=not_finite)

    def table(self, name, out=None):
        """Header and rows of a CSV file; every row is complete and every cell that is a number is finite."""
        with open((out or self.out) / name, newline="") as stream:
            header, *rows = list(csv.reader(stream))
        for index, row in enumerate(rows):
            expect(len(row) == len(header), f"{name}: row {index} has {len(row)} cells and not {len(header)}")
            bad = [c for c in row if c.strip().lower() in ("", "nan", "-nan", "inf", "-inf")]
            expect(not bad, f"{name}: row {index} holds {bad[:1]}")
        return header, rows
