"""Prints the size of the program: lines of Rust per crate, without comments, blank lines and tests; files; public items.

Usage: python3 tests/lines.py
"""

import pathlib
import re

ROOT = pathlib.Path(__file__).parent.parent
ITEM = re.compile(r"pub (?:const |async |unsafe )*(?:fn|struct|enum|trait|type|const|static|union) \w")


def code(text):
    """Lines of code above the unit tests."""
    lines, inside = [], False
    for line in text.split("#[cfg(test)]")[0].splitlines():
        line = line.strip()
        if inside:
            inside = "*/" not in line
        elif line.startswith("/*"):
            inside = "*/" not in line
        elif line and not line.startswith("//"):
            lines.append(line)
    return lines


def crates():
    """Name of each crate, and its files."""
    yield "trisplat", sorted((ROOT / "src").rglob("*.rs"))
    for folder in sorted((ROOT / "crates").iterdir()):
        if (folder / "src").is_dir():
            yield folder.name, sorted((folder / "src").rglob("*.rs"))


def main():
    rows = []
    for name, files in crates():
        sizes = [code(file.read_text()) for file in files if file.stem != "tests" and "tests" not in file.parts]
        items = sum(1 for lines in sizes for line in lines if ITEM.match(line))
        rows.append((name, sum(map(len, sizes)), len(sizes), items))
    print("crate        lines  files  pub")
    for name, lines, files, items in sorted(rows, key=lambda row: -row[1]):
        print(f"{name:10} {lines:7,} {files:6} {items:4}")
    rest = [row for row in rows if row[0] != "bench"]
    lines, files, items = (sum(row[column] for row in rest) for column in (1, 2, 3))
    print(f"{len(rest)} crates without bench: {lines:,} lines, {files} files, {lines // files} lines per file, {items} items and methods that are `pub`")


if __name__ == "__main__":
    main()
