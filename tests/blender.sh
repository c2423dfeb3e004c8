#!/usr/bin/env bash
# The add-on for Blender: its plain parts by python3, and inside Blender against closed forms and Cycles.
#
#   tests/blender.sh target/release/cardioid
#
# Blender is what CARDIOID_BLENDER names (any number of them, with blanks between): a Python with the module `bpy`, of the wheel
# `pip install bpy`, or the program `blender`, 4.2 or later. Without it, python3 and `blender` on PATH are tried. What is not there is
# left out, and said.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

if ! command -v python3 >/dev/null; then
    echo "tests/blender.sh: left out: there is no python3"
    exit 0
fi
python3 -m unittest discover -s tests/blender

program=${1:-}
if [ ! -x "$program" ]; then
    echo "tests/blender.sh: left out inside of Blender: there is no program '$program'; name it, as target/release/cardioid"
    exit 0
fi
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
ln -s "$(realpath "$program")" "$folder/cardioid"
export PATH="$folder:$PATH"

found=0
for blender in ${CARDIOID_BLENDER:-python3 blender}; do
    if [ "$(basename "$blender")" = blender ]; then
        command -v "$blender" >/dev/null || continue
        version=$("$blender" --version | sed -n 's/^Blender \([0-9]*\.[0-9]*\).*/\1/p')
        run=("$blender" --background --factory-startup --python-exit-code 1 --python tests/blender/in_blender.py)
    else
        # Its last line: the module may print lines of its own.
        version=$("$blender" -c 'import bpy; print(bpy.app.version_string)' 2>/dev/null | tail -n 1) || continue
        run=("$blender" tests/blender/in_blender.py)
    fi
    if [ "$(printf '%s\n' 4.2 "$version" | sort -V | head -n 1)" != 4.2 ]; then
        echo "tests/blender.sh: left out: $blender is Blender $version, and the add-on is for 4.2 and later"
        continue
    fi
    echo "== Blender $version"
    found=1
    "${run[@]}" 2>&1 | { grep -v '^Fra:\|^Saved: \|^Info: \|^ *Time: \|^$' || true; }
done
if [ "$found" = 0 ]; then
    echo "tests/blender.sh: left out inside of Blender: there is none; set CARDIOID_BLENDER to a Python with bpy (pip install bpy)"
fi
