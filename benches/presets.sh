#!/usr/bin/env bash
# What the presets cost and buy: the table of README.md, measured. Needs a built program and bash; takes some minutes.
# Every time is that of a whole process; path tracing gets the time that `final` took.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
program=target/release/cardioid
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
TIMEFORMAT=%R

# A number out of JSON that is printed one field a line: file, field; fields of that name are added up.
sum() { sed -n "s/^ *\"$2\": \([0-9.e+-]*\),\{0,1\}$/\1/p" "$1" | awk '{ s += $1 } END { print s + 0 }'; }

row() { # scene, name of the row, options
    local scene=$1 name=$2 seconds error bias photons bytes
    shift 2
    seconds=$({ time "$program" render "scenes/$scene.toml" "$@" -q --stats "$out/s.json" -o "$out/p.exr" 2>/dev/null; } 2>&1)
    "$program" compare "tests/reference/$scene/reference-1.exr" \
        --second-half "tests/reference/$scene/reference-2.exr" "$out/p.exr" --json >"$out/c.json"
    error=$(sum "$out/c.json" relmse_u)
    bias=$(sum "$out/c.json" bias)
    # Whole numbers are counts of photons; the seconds of the pass have the same name and a point.
    photons=$(sed -n "s/^ *\"photons\": \([0-9]*\),\{0,1\}$/\1/p" "$out/s.json" | awk "{ s += \$1 } END { print s + 0 }")
    bytes=$(sum "$out/s.json" bytes)
    awk -v s="$scene" -v n="$name" -v t="$seconds" -v e="$error" -v b="$bias" -v p="$photons" -v m="$bytes" 'BEGIN {
        printf "| `%s` | %s | %.1f | %.2g | %+.2f %% | %s | %s |\n", s, n, t, e, b,
            p > 0 ? sprintf("%.2f M", p / 1e6) : "none", m > 0 ? sprintf("%.1f MB", m / 1e6) : "none" }'
    last=$seconds
}

echo "| scene | preset | seconds | error | bias | photons | memory of maps |"
echo "|---|---|---|---|---|---|---|"
for scene in cornell-diffuse cornell-spheres cardioid; do
    for quality in draft preview final; do
        row "$scene" "$quality" --quality "$quality"
    done
    row "$scene" "path tracing, same time as final" --integrator path --spp 1000000 --time-limit "${last}s"
done
