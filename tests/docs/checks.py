#!/usr/bin/env python3
"""Whether tools/check_site and tools/check_tutorials find what is wrong."""

import importlib.machinery
import importlib.util
import pathlib
import sys
import tempfile
import unittest

TOOLS = pathlib.Path(__file__).resolve().parents[2] / "tools"


def load(name):
    loader = importlib.machinery.SourceFileLoader(name, str(TOOLS / name))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(name, loader))
    loader.exec_module(module)
    return module


class Site(unittest.TestCase):
    def errors(self, body, style="", title="page"):
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder).resolve()
            (folder / "other.html").write_text('<title>other</title><p id="here">')
            (folder / "page.html").write_text(f"<title>{title}</title>{body}")
            (folder / "style.css").write_text(style)
            return list(load("check_site").check(folder))

    def test_takes_what_is_right(self):
        self.assertEqual(self.errors('<a href="other.html#here">x</a><a href="https://example.org/">y</a>'
                                     '<script src="style.css"></script><img src="style.css" alt="z">'), [])

    def test_finds_what_is_wrong(self):
        for body, words in (('<a href="gone.html">', "leads nowhere"),
                            ('<a href="other.html#gone">', "no such anchor"),
                            ('<a href="../x.html">', "leads nowhere"),
                            ('<a href="file:///etc/x">', "no address"),
                            ('<script src="https://example.org/x.js"></script>', "from outside"),
                            ('<link rel="stylesheet" href="//example.org/x.css">', "from outside"),
                            ('<img src="gone.png" alt="z">', "not there"),
                            ('<img src="other.html">', "no text")):
            found = self.errors(body)
            self.assertEqual(len(found), 1, f"{body}: {found}")
            self.assertIn(words, found[0])
        self.assertIn("from outside", self.errors("", "@import url(https://example.org/x.css);")[0])
        self.assertIn("not there", self.errors("", "p { background: url('gone.png') }")[0])
        self.assertIn("no title", self.errors("", title="")[0])


class Tutorials(unittest.TestCase):
    def errors(self, text):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "t.md"
            path.write_text(text)
            scratch = pathlib.Path(folder) / "scratch"
            scratch.mkdir()
            return load("check_tutorials").Tutorial(path).check(scratch, pathlib.Path("/bin/false"))

    def test_runs_what_it_says(self):
        errors, text = self.errors("Save this as `a/b.txt`:\n\n```\none 10.0\n```\n".replace("a/", "")
                                   + "\n```console\n$ cat b.txt\none   10.1\n$ true\n```\n")
        self.assertEqual(errors, [])
        self.assertIn("one   10.1", text)

    def test_finds_what_is_wrong(self):
        for block, words in (("$ echo 10.0\n10.5", "prints"), ("$ echo a\nb", "prints"), ("$ echo a", "1 lines and not 0"),
                             ("$ exit 3", "exit code 3"), ("$ echo\npalpate: x", "exit code 0"), ("echo a", "command"),
                             ("$ echo 7 of 5 ms\n7 in 5 ms", "prints")):
            errors, _ = self.errors(f"```console\n{block}\n```\n")
            self.assertTrue(any(words in e for e in errors), f"{block!r}: {errors}")
        self.assertIn("no command", self.errors("Text.\n")[0][0])

    def test_writes_what_is_printed(self):
        self.assertIn("$ echo 2 x\n2 x\n", self.errors("```console\n$ echo 2 x\n3 x\n```\n")[1])

    def test_compares_numbers(self):
        same = load("check_tutorials").same
        for a, b in (("x 1.00", "x 1.01"), ("0.0061", "0.0062"), ("1e-19", "-3e-18"), ("step 5.1 ms", "step 77 ms"),
                     ("time   0.8 s", "time 3 s"), ("a   b", "a b"), ("(-0.5, 2)", "(-0.5, 2)")):
            self.assertTrue(same(a, b), (a, b))
        for a, b in (("x 1.00", "x 1.05"), ("12", "13"), ("-0.5", "0.5"), ("x 5 s", "x 6 s"), ("1 2", "1")):
            self.assertFalse(same(a, b), (a, b))


if __name__ == "__main__":
    sys.dont_write_bytecode = True
    unittest.main()
