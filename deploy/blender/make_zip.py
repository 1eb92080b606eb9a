#!/usr/bin/env python3
"""Pack the Blender add-on: `make blender-addon`.

    deploy/blender/make_zip.py VERSION OUT.zip

One zip for both forms: Blender 3.4 to 4.1 read bl_info, 4.2 and later the manifest. The same sources give the same bytes."""
import os
import re
import sys
import zipfile

FOLDER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "azulejo_render")


def checked(name, text, version):
    """Both forms must have the release's version."""
    if name == "blender_manifest.toml" and 'version = "%s"\n' % version not in text.split("schema_version", 1)[1].split("\n", 1)[1]:
        raise SystemExit("make_zip: %s has another version than %s" % (name, version))
    if name == "__init__.py" and re.search(r'"version": \((\d+), (\d+), (\d+)\)', text).groups() != tuple(version.split(".")):
        raise SystemExit("make_zip: %s has another version than %s" % (name, version))
    return text


def main(version, out):
    os.makedirs(os.path.dirname(out) or ".", exist_ok=True)
    with zipfile.ZipFile(out + ".part", "w", zipfile.ZIP_DEFLATED) as package:
        for name in sorted(os.listdir(FOLDER)):
            if not name.endswith((".py", ".toml")):
                continue
            with open(os.path.join(FOLDER, name), encoding="utf-8") as source:
                text = checked(name, source.read(), version)
            row = zipfile.ZipInfo("azulejo_render/" + name, (1980, 1, 1, 0, 0, 0))
            row.external_attr, row.compress_type = 0o644 << 16, zipfile.ZIP_DEFLATED
            package.writestr(row, text)
    os.replace(out + ".part", out)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
