#!/usr/bin/env bash
# Halves of references for the scenes that have none in tests/reference, rendered where they are missing:
# out/references/SCENE-1.exr and -2.exr. By paths where paths find all light, else in rounds. Needs a built program.
#
#   benches/references.sh [TIME] [SIZE] [SCENE ...]     time for each half (1m), pixels (96x72), scenes (all)
#
# Sourced, it is the function `reference_of SCENE`, which sets `halves` (the two files) and `size_options` for renders of that size.
references=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
by_paths=" cornell-glossy door mesh "

reference_of() {
    local scene=$1 given=$references/tests/reference/$1 made=$references/out/references/$1
    if [ -d "$given" ]; then
        halves=("$given/reference-1.exr" "$given/reference-2.exr")
        size_options=()
    else
        halves=("$made-1.exr" "$made-2.exr")
        size_options=(--resolution "${REFERENCE_SIZE:-96x72}")
        [ -e "${halves[1]}" ] || { echo "no reference of $scene: run benches/references.sh first" >&2; return 1; }
    fi
}

[ "${BASH_SOURCE[0]}" = "$0" ] || return 0
set -euo pipefail
cd "$references"
program=${CARDIOID:-target/release/cardioid}
time=${1:-1m} size=${2:-96x72}
shift $(($# < 2 ? $# : 2))
mkdir -p out/references
for scene in ${*:-$(for file in scenes/*.toml; do basename "$file" .toml; done)}; do
    [ -d "tests/reference/$scene" ] && continue
    case $by_paths in
    *" $scene "*) how=(--integrator path --spp 65536) ;;
    *) how=(--integrator progressive --rounds 65536) ;;
    esac
    for half in 1 2; do
        file=out/references/$scene-$half.exr
        [ -e "$file" ] || "$program" render "scenes/$scene.toml" --resolution "$size" "${how[@]}" --time-limit "$time" \
            --seed "100000$half" --beauty-only -q -o "$file"
    done
done
