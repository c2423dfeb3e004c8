"""Packs the add-on as an extension: `python3 blender/pack.py FOLDER` writes cardioid-VERSION.zip there."""

import re
import sys
import zipfile
from pathlib import Path

#: The same file each time it is packed: zip files know no earlier date.
_DATE = (1980, 1, 1, 0, 0, 0)


def pack(folder):
    """Writes the zip file into a folder, and yields its path."""
    own = Path(__file__).resolve().parent
    manifest = (own / "blender_manifest.toml").read_text(encoding="utf-8")
    version = re.search(r'^version = "(.+)"$', manifest, re.MULTILINE).group(1)
    path = Path(folder) / f"cardioid-{version}.zip"
    files = [own / "blender_manifest.toml"] + sorted(own.glob("*.py")) + sorted(own.parent.glob("LICENSE-*"))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            if file.name != "pack.py":
                archive.writestr(zipfile.ZipInfo(file.name, _DATE), file.read_bytes(), zipfile.ZIP_DEFLATED)
    return path


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python3 blender/pack.py FOLDER")
    print(pack(sys.argv[1]))
