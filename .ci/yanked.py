#!/usr/bin/env python3
"""Fails if Cargo.lock holds a version that its authors have yanked.

Reads cargo's own copy of the registry index, which `cargo update --dry-run` refreshes; it makes no network requests. A
crate that the copy does not contain is counted and listed as unknown.

usage: yanked.py Cargo.lock
"""

import json
import os
import pathlib
import sys
import tomllib


def cached_path(name):
    """Path of a crate in a registry index: 1/a, 2/ab, 3/a/abc, se/rd/serde."""
    name = name.lower()
    folder = {1: "1", 2: "2", 3: f"3/{name[:1]}"}.get(len(name), f"{name[:2]}/{name[2:4]}")
    return pathlib.Path(".cache", folder, name)


def yanked_by_version(indexes, name):
    """Versions of a crate, and whether each is yanked, from every cached index that contains it."""
    versions = {}
    for index in indexes:
        try:
            content = (index / cached_path(name)).read_bytes()
        except OSError:
            continue
        # Two version words, a cache key, then pairs of version and index line, all separated by
        # NUL.
        for part in content.split(b"\0"):
            if part.startswith(b"{"):
                entry = json.loads(part)
                versions[entry["vers"]] = entry["yanked"]
    return versions


def main():
    with open(sys.argv[1], "rb") as file:
        packages = [p for p in tomllib.load(file)["package"] if p.get("source", "").startswith("registry+")]
    home = pathlib.Path(os.environ.get("CARGO_HOME", pathlib.Path.home() / ".cargo"))
    indexes = [path for path in (home / "registry" / "index").glob("*") if path.is_dir()]
    yanked, unknown = [], []
    for package in packages:
        state = yanked_by_version(indexes, package["name"]).get(package["version"])
        label = f"{package['name']} {package['version']}"
        if state is None:
            unknown.append(label)
        elif state:
            yanked.append(label)
    print(f"yanked versions: {len(yanked)} of {len(packages)} locked crates, {len(unknown)} not in cargo's index copy")
    for label in unknown:
        print(f"  unknown: {label}")
    for label in yanked:
        print(f"  yanked: {label}; `cargo update -p {label.split()[0]}` selects another version")
    if len(unknown) == len(packages):
        print("  no crate could be checked: run `cargo update --dry-run` first, which fills cargo's copy of the index")
    sys.exit(bool(yanked) or len(unknown) == len(packages))


main()
