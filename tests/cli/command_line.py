"""What the program says of its own command line: the manual page, and completion in each shell."""

import os
import pty
import re
import select
import shutil
import signal
import subprocess
import time

from harness import CASES, Failure, Skip, case, expect

SCENES = ("alpha.yaml", "beta.yml", "notes.txt")
# Typed words, what one of the shells must offer, what it must not.
ASKED = {
    "command": ("palpate ev", {"evaluate"}, {"run"}),
    "inner-command": ("palpate mesh ", {"embed", "info", "make", "stiffness"}, {"run"}),
    "option": ("palpate run x.yaml --vis", {"--visual-dt"}, {"--seed"}),
    "option-of-all": ("palpate run x.yaml --thr", {"--threads"}, set()),
    "value": ("palpate run --method h", {"hsl", "hsl-exact"}, {"vc"}),
    "value-in-list": ("palpate evaluate x.yaml --methods live,hsl-", {"live,hsl-exact"}, {"live,vc"}),
    "scene": ("palpate run ", {"alpha.yaml", "beta.yml", "folder"}, {"notes.txt"}),
    "folder": ("palpate run alpha.yaml --out fo", {"folder"}, {"notes.txt"}),
    "file-of-any-kind": ("palpate devices --report n", {"notes.txt"}, set()),
}


def needs(program, package=None):
    if shutil.which(program) is None:
        raise Skip(f"{package or program} is not installed (./dev setup test)")


def commands(context, *path):
    """Words of all commands that do something, from what --help lists."""
    text = context.succeeds([*path, "--help"])
    _, found, listed = text.partition("Subcommands:")
    if not found:
        return [path]
    inner = re.findall(r"(?m)^  (\S+)", listed)
    return [leaf for name in inner for leaf in commands(context, *path, name)]


def options(text):
    return set(re.findall(r"(?m)^  (?:-\w,)?(--[\w-]+)", text))


@case
def manual_names_everything(context):
    page = context.succeeds(["manual"]).replace("\\-", "-").replace("\\fB", "").replace("\\fR", "").replace("\\fI", "")
    sections = {part.split("\n", 1)[0]: part for part in re.split(r"(?m)^\.SS ", page)}
    leaves = commands(context)
    expect(len(leaves) > 15, f"only {len(leaves)} commands")
    for leaf in leaves:
        name = "palpate " + " ".join(leaf)
        mine = [part for head, part in sections.items() if re.match(rf"{name}( |$)", head)]
        expect(len(mine) == 1, f"{len(mine)} sections for {name}")
        asked = options(context.succeeds([*leaf, "--help"])) - {"--help", "--threads", "--version"}
        missing = {o for o in asked if not re.search(rf"(?m)^(-\w, )?{o}( |$)", mine[0])}
        expect(not missing, f"{name}: the manual has no {missing}")


@case
def manual_is_one(context):
    needs("mandoc")
    page = context.file("palpate.1", context.succeeds(["manual"]))
    done = subprocess.run(["mandoc", "-T", "lint", "-W", "warning", page], capture_output=True, text=True)
    expect(not done.stdout and done.returncode == 0, f"mandoc: {done.stdout}{done.stderr}")
    text = subprocess.run(["mandoc", "-T", "utf8", page], capture_output=True, text=True).stdout
    text = re.sub(".\b", "", text)
    for words in ("palpate mesh embed SURFACE [OPTION]...", "--visual-dt S", "EXIT STATUS"):
        expect(words in text, f"not on the page: {words}")


@case
def manual_is_dated_as_asked(context):
    environment = {**os.environ, "SOURCE_DATE_EPOCH": "86400"}
    process = context.start(["manual"], env=environment)
    output, _ = process.communicate(timeout=20)
    expect(output.startswith(".TH PALPATE 1 1970-01-02 "), f"its first line is {output.splitlines()[:1]}")


def settle(context):
    """A folder with files to complete, and the program on the path, under its name."""
    folder = context.folder / "here"
    (folder / "folder").mkdir(parents=True)
    for name in SCENES:
        (folder / name).touch()
    (context.folder / "bin").mkdir()
    (context.folder / "bin" / "palpate").symlink_to(os.path.abspath(context.program))
    return folder, {**os.environ, "PATH": f"{context.folder}/bin:{os.environ['PATH']}", "HOME": str(context.folder)}


def judge(asked, offered, answer):
    wanted, unwanted = asked
    offered = {word.rstrip("/") for word in offered}
    expect(wanted <= offered, f"does not offer {wanted - offered}: {answer!r}")
    expect(not unwanted & offered, f"offers {unwanted & offered}")


class Shell:
    """An interactive shell at a terminal of its own."""

    def __init__(self, arguments, folder, environment):
        self.process, self.terminal = pty.fork()
        if self.process == 0:
            os.chdir(folder)
            os.execvpe(arguments[0], arguments, {**environment, "TERM": "dumb", "COLUMNS": "200", "LC_ALL": "C.UTF-8"})

    def until(self, pattern, seconds=20):
        text, end = "", time.monotonic() + seconds
        while not re.search(pattern, text):
            if time.monotonic() > end:
                raise Failure(f"no {pattern!r} within {seconds} s: {text[-600:]!r}")
            if select.select([self.terminal], [], [], 0.1)[0]:
                text += os.read(self.terminal, 65536).decode(errors="replace")
        return text

    def type(self, text):
        os.write(self.terminal, text.encode())

    def completes(self, typed, line):
        """Tab completes what is the only one; `echo` shows what the line has become."""
        self.type(f"{typed}\x01echo \x05 ''end\r")
        text = self.until(r"\nend|[^']end\r")
        expect(f"\n{line}" in text.replace("\r", "").replace(" end", ""), f"{typed!r} became {text!r}")

    def close(self):
        os.kill(self.process, signal.SIGKILL)
        os.waitpid(self.process, 0)
        os.close(self.terminal)


@case
def completion_in_bash(context):
    needs("bash")
    script = context.file("palpate.bash", context.succeeds(["completion", "bash"]))
    folder, environment = settle(context)
    # As bash calls it: words split at its word breaks, = and : among them.
    for name, (line, *asked) in {**ASKED, "value-behind-equals": ("palpate run --method=h", {"hsl", "hsl-exact"}, {"vc"}),
                                 "after-equals": ("palpate run --aim=", {"sample", "predicted"}, set())}.items():
        words = [w for part in line.split(" ") for w in re.split(r"(?<=[^=])(?==)|(?<==)(?=[^=])", part)]
        call = (f"source {script}; compopt() {{ :; }}; COMP_WORDS=({' '.join(repr(w) for w in words)}); "
                f"COMP_CWORD={len(words) - 1}; _palpate; printf '%s\\n' \"${{COMPREPLY[@]}}\"")
        done = subprocess.run(["bash", "--norc", "-euc", call], cwd=folder, env=environment, capture_output=True, text=True)
        expect(done.returncode == 0, f"{name}: {done.stderr}")
        try:
            judge(asked, done.stdout.split(), done.stdout + done.stderr)
        except Failure as failure:
            raise Failure(f"{name}: {failure}") from None


@case
def completion_at_a_bash_prompt(context):
    needs("bash")
    folder, environment = settle(context)
    shell = Shell(["bash", "--norc", "--noprofile", "-i"], folder, environment)
    try:
        shell.type("PS1='> '; bind 'set enable-bracketed-paste off'; source <(palpate completion bash); echo rea''dy\r")
        shell.until("ready")
        for typed, line in (("palpate eval\t--methods=li\t", "palpate evaluate --methods=live"),
                            ("palpate run al\t--out fo\t", "palpate run alpha.yaml --out folder/"),
                            ("palpate run --device=reco\tx.csv", "palpate run --device=recorded:x.csv")):
            shell.completes(typed, line)
    finally:
        shell.close()


@case
def completion_in_zsh(context):
    needs("zsh")
    folder, environment = settle(context)
    (context.folder / "_palpate").write_text(context.succeeds(["completion", "zsh"]))
    shell = Shell(["zsh", "-f", "-i"], folder, environment)
    try:
        shell.type("PS1='> '; fpath=(.. $fpath); autoload -Uz compinit; compinit -u -D; "
                   "echo rea''dy\r")
        shell.until("ready\r")
        for typed, line in (("palpate eval\t--methods=li\t", "palpate evaluate --methods=live"),
                            ("palpate run al\t--out fo\t", "palpate run alpha.yaml --out folder"),
                            ("palpate run --device reco\tx.csv", "palpate run --device recorded:x.csv"),
                            ("palpate mesh emb\t", "palpate mesh embed")):
            shell.completes(typed, line)
    finally:
        shell.close()


@case
def completion_in_fish(context):
    needs("fish")
    script = context.file("palpate.fish", context.succeeds(["completion", "fish"]))
    folder, environment = settle(context)
    for name, (line, *asked) in {**ASKED, "value-behind-equals":
                                 ("palpate run --method=h", {"--method=hsl", "--method=hsl-exact"}, {"--method=vc"})}.items():
        done = subprocess.run(["fish", "--no-config", "-c", f"source {script}; complete -C '{line}'"], cwd=folder,
                              env=environment, capture_output=True, text=True)
        expect(done.returncode == 0 and not done.stderr, f"{name}: {done.stderr}")
        try:
            judge(asked, [row.split("\t")[0] for row in done.stdout.splitlines()], done.stdout)
        except Failure as failure:
            raise Failure(f"{name}: {failure}") from None


def rejects_case(name, arguments, words):
    CASES[f"completion-{name}"] = lambda context: context.rejects(arguments, words)


rejects_case("of-another-shell", ["completion", "tcsh"], ["tcsh", "fish"])
rejects_case("of-no-shell", ["completion"], ["shell"])
