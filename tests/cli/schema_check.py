#!/usr/bin/python3
"""Holds YAML files against a JSON Schema and prints as JSON what is wrong with each: {file: [text...]}.

usage: schema_check.py SCHEMA FILE...
"""

import json
import re
import sys

import jsonschema
import yaml


class Loader(yaml.SafeLoader):
    """Numbers and words as YAML 1.2 has them, and editors with it: 1e4 is a number, and yes a word."""


Loader.yaml_implicit_resolvers = {k: [r for r in v if r[0].endswith((":null", ":merge"))]
                                  for k, v in yaml.SafeLoader.yaml_implicit_resolvers.items()}  # fmt: skip
for kind, pattern, first in (("bool", r"^(true|false)$", "tf"), ("int", r"^[-+]?[0-9]+$", "-+0123456789"),
                             ("float", r"^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?$", "-+0123456789.")):  # fmt: skip
    Loader.add_implicit_resolver(f"tag:yaml.org,2002:{kind}", re.compile(pattern), list(first))

with open(sys.argv[1]) as stream:
    schema = json.load(stream)
jsonschema.Draft7Validator.check_schema(schema)
validator = jsonschema.Draft7Validator(schema)
found = {}
for name in sys.argv[2:]:
    with open(name) as stream:
        value = yaml.load(stream, Loader)
    found[name] = [f"{'.'.join(map(str, e.absolute_path))}: {e.message}"[:200] for e in validator.iter_errors(value)]
json.dump(found, sys.stdout)
