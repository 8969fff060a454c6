"""The fakes of devices (tests/devices/fakes) as the end-to-end cases use them."""

import json
import subprocess
import sys

from harness import expect

# A rigid ball above the ground, which a device's hand presses into it: 1.5 cm below it the ground begins.
PRESS = """\
palpate: 1
name: held
duration: {duration}
visual: {{step: 0.02}}
tool:
  rigid: true
  shape: {{sphere: {{radius: 0.01}}}}
  density: 500
  pose: {{position: [0, 0, 0.005]}}
  handles:
    ball: {{mass: 0.02}}
safety: {{start_gate: false}}
obstacles:
  - {{name: ground, plane: {{point: [0, 0, 0]}}}}
"""


class Fake:
    """A fake's program; `log` is what it wrote down when it has ended."""

    def __init__(self, context, name, *arguments):
        self.file = context.folder / f"{name}-{id(self)}.json"
        script = context.source / "tests" / "devices" / "fakes" / f"{name}.py"
        self.process = subprocess.Popen([sys.executable, "-B", str(script), *arguments, "--log", str(self.file)],
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        line = self.process.stdout.readline()
        expect(line, f"{name} did not begin")
        self.about = json.loads(line)
        self.log = None

    def end(self):
        if self.log is None:
            self.process.communicate(timeout=20)
            self.log = json.loads(self.file.read_text())
        return self.log

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.log is None:
            self.process.kill()
            self.process.communicate()
