#!/usr/bin/env python3
"""Write a C file that holds the page's files: embed.py OUT.c FOLDER [MORE FILES]

Each gets its type by its name, and an ETag by its content; it is there as it is and packed by gzip.
"""
import gzip
import hashlib
import pathlib
import sys

TYPES = {".html": "text/html; charset=utf-8", ".css": "text/css; charset=utf-8",
         ".js": "text/javascript; charset=utf-8", ".svg": "image/svg+xml", ".png": "image/png",
         ".json": "application/json", ".yaml": "application/yaml; charset=utf-8",
         ".txt": "text/plain; charset=utf-8", ".webmanifest": "application/manifest+json",
         ".glsl": "text/plain; charset=utf-8"}


def main(out, folder, *more):
    files = sorted(p for p in pathlib.Path(folder).rglob("*") if p.is_file() and not p.name.startswith("."))
    names = [p.relative_to(folder).as_posix() for p in files] + [pathlib.Path(p).name for p in more]
    files += [pathlib.Path(p) for p in more]
    lines = ["/* Made by scripts/embed.py. */", '#include "web/api/assets.h"', ""]
    rows = []
    for number, path in enumerate(files):
        if path.suffix not in TYPES:
            sys.exit(f"embed.py: {path}: no type is known for files of this name; add it to TYPES")
        data = path.read_bytes()
        etag = hashlib.sha256(data).hexdigest()[:32]
        packed = gzip.compress(data, 9, mtime=0)
        for name, content in ((f"file_{number}", data), (f"packed_{number}", packed)):
            lines.append(f"static const unsigned char {name}[] = {{")
            for at in range(0, len(content), 32):
                lines.append("    " + "".join(f"{byte}," for byte in content[at:at + 32]))
            lines.append("    0};")
        rows.append(f'    {{"{names[number]}", "{TYPES[path.suffix]}", "{etag}", file_{number}, {len(data)}, '
                    f'packed_{number}, {len(packed)}}},')
    lines += ["const struct web_asset_file web_asset_files[] = {", *rows, "    {0, 0, 0, 0, 0, 0, 0}};",
              f"const size_t web_asset_file_count = {len(rows)};", ""]
    pathlib.Path(out).write_text("\n".join(lines))


if __name__ == "__main__":
    main(*sys.argv[1:])
