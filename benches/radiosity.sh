#!/usr/bin/env bash
# Prints the tables of docs/radiosity.md: error against time over the number of patches, beside photon maps and path tracing, and the cost of
# the three methods. Needs a built program.
#
#   benches/radiosity.sh >out/radiosity.md
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
program=${CARDIOID:-target/release/cardioid}
[ -x "$program" ] || { echo "build first: cargo build --release" >&2; exit 1; }
out=out/radiosity
mkdir -p "$out"
scene=scenes/cornell-diffuse.toml
reference=(tests/reference/cornell-diffuse/reference-1.exr --second-half tests/reference/cornell-diffuse/reference-2.exr)

# Error (relrmse_u) and bias of a picture.
figures() {
    "$program" compare "${reference[@]}" "$1" | awk 'NR == 2 { printf "%.2f %% | %s %%", 100 * $5, $7 }'
}

# Processor seconds of a run, of all threads.
seconds() {
    local TIMEFORMAT='%U %S'
    { time "$@" >"$out/said" 2>&1 || { cat "$out/said" >&2; exit 1; }; } 2>&1 | awk '{ printf "%.2f", $1 + $2 }'
}

# Numbers of a picture's statistics.
of() {
    python3 -c 'import json, sys
found = json.load(open(sys.argv[1]))["radiosity"]
print(found["patches"], found["links"], "%.0f" % (found["bytes"] / 1e6), "%.2f" % found["seconds_factors"], "%.2f" % (found["seconds_solution"] + found["seconds_corners"]), "%.4f" % found["row_sum"], sep=" | ")' "$1"
}

echo "## Patches"
echo
echo "| method | patches | links | MB | s for form factors | s for the solution | row sum | view | processor s in all | error | bias |"
echo "|---|---|---|---|---|---|---|---|---|---|---|"
for run in "hierarchy 1000" "hierarchy 4000" "hierarchy 16000" "hierarchy 64000" "matrix 1000" "matrix 2000" "matrix 4000" "shooting 1000"; do
    read -r method patches <<<"$run"
    rm -f "$out/solution"
    for view in flat smooth gather final; do
        [ "$method" = hierarchy ] || [ "$view" = flat ] || continue
        took=$(seconds "$program" radiosity "$scene" --method "$method" --patches "$patches" --view "$view" --spp 16 \
            --stats "$out/stats.json" -o "$out/$method-$patches-$view.exr")
        echo "| $method | $(of "$out/stats.json") | $view | $took | $(figures "$out/$method-$patches-$view.exr") |"
    done
done
echo
echo "## Beside the other methods"
echo
echo "| method | processor s in all | error | bias |"
echo "|---|---|---|---|"
for run in "--quality draft" "--quality preview" "--quality final" "--integrator path --spp 16" "--integrator path --spp 256"; do
    # shellcheck disable=SC2086 # the words of the run
    took=$(seconds "$program" render "$scene" $run -o "$out/other.exr")
    echo "| \`$run\` | $took | $(figures "$out/other.exr") |"
done
