#!/usr/bin/env bash
# Shows that a change of the code changes no result: every channel of pictures to the bit, all counts of statistics, renders from
# saved photon maps, and checkpoints that are resumed. Renders the scenes small with a program built before and one built after the change.
#
#   benches/same_results.sh record PROGRAM >before.txt
#   benches/same_results.sh record PROGRAM >after.txt && diff before.txt after.txt
#   benches/same_results.sh compare PROGRAM_BEFORE PROGRAM_AFTER     # both, and what differs; exit code 1 where anything does
#
# Results hold for one machine: Embree rounds by what the processor has. Set SCENES or SIZE for other scenes (names in scenes/) or
# another size. Needs `cargo build --release --example hashes`.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
scenes=${SCENES:-cardioid cognac cornell-diffuse cornell-glossy cornell-spheres desk door landscape mesh mirror-square museum}
size=${SIZE:-24x18}
here=$PWD
hashes=$here/target/release/examples/hashes
[ -x "$hashes" ] || { echo "build first: cargo build --release --example hashes" >&2; exit 1; }
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT

# Runs a program where its files are to be: their names are in what it counts.
run() {
    (cd "$out" && "$@" 2>log) || { echo "$*" >&2; cat "$out/log" >&2; exit 1; }
}

# What a program makes of a scene, as hashes.
render() { # program, scene, name, options
    local program=$1 scene=$2 name=$3
    shift 3
    run "$program" render "$here/scenes/$scene.toml" --resolution "$size" "$@" -q -o "$name.exr" --stats "$name.json"
    "$hashes" "$out/$name.exr" "$out/$name.json"
    rm -f "$out/$name".*
}

record() { # program
    local program=$1 scene seed
    for scene in $scenes; do
        for seed in 1 2; do
            render "$program" "$scene" "$scene-photon-map-$seed" --quality draft --seed $seed
            render "$program" "$scene" "$scene-photons-$seed" --quality draft --integrator photons --seed $seed
            render "$program" "$scene" "$scene-path-$seed" --quality draft --integrator path --spp 8 --seed $seed
            render "$program" "$scene" "$scene-progressive-$seed" --quality draft --integrator progressive --rounds 2 --seed $seed
        done
        # Maps in a file, and a render from them.
        run "$program" photons "$here/scenes/$scene.toml" --quality draft -q -o saved.photons
        render "$program" "$scene" "$scene-from-file" --quality draft --photon-map saved.photons
        rm -f "$out/saved.photons"
        # One round, and another one resumed from its checkpoint.
        run "$program" render "$here/scenes/$scene.toml" --resolution "$size" --quality draft --integrator progressive --rounds 1 -q \
            --checkpoint rounds -o first.exr
        render "$program" "$scene" "$scene-resumed" --quality draft --integrator progressive --rounds 2 \
            --resume rounds
        rm -f "$out/rounds" "$out"/first.*
    done
}

case ${1:-} in
    record) record "$(realpath "$2")" ;;
    compare)
        record "$(realpath "$2")" >"$out/before"
        record "$(realpath "$3")" >"$out/after"
        diff "$out/before" "$out/after" && echo "the same: $(wc -l <"$out/after") hashes"
        ;;
    *) sed -n '2,12s/^# \{0,1\}//p' "$0" >&2; exit 2 ;;
esac
