"""What the checks of the repository have in common: where it is, and how they end."""

import pathlib
import sys


def run(check):
    """Prints the errors that check(root) lists, root being the first argument or the repository; exits with 1 if any."""
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).parent.parent).resolve()
    errors = list(check(root))
    for error in errors:
        print(error, file=sys.stderr)
    sys.exit(1 if errors else 0)
