#!/usr/bin/env bash
# Time against error on the three reference scenes, beside POV-Ray where it is installed (apt install povray).
#
#   benches/peers/run.sh [REPEATS] >table.md
#
# Wall seconds of whole processes, scene loading and writing included: medians of REPEATS runs (3). Errors are free of the
# reference's noise: mean((t - r1)(t - r2) / (r^2 + 0.01)). Each of our runs has a seed of its own, 0, 1 and so on; errors and
# biases are means over them, since few samples of the edge of a lamp move the mean of a single picture by half a percent.
# The picture alone is written, as POV-Ray does. A run of one renderer is followed by one of the other, so that a busy machine slows both.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
repeats=${1:-3}
program=target/release/cardioid
povray=$(command -v povray || true)
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT

# Wall seconds of a command, whose output goes to a log.
seconds() {
    local TIMEFORMAT=%R
    { time "$@" >"$out/log" 2>&1; } 2>&1 || { cat "$out/log" >&2; return 1; }
}

# The median of the numbers in a file.
median() { sort -g "$1" | awk '{ v[NR] = $1 } END { print NR % 2 ? v[(NR + 1) / 2] : (v[NR / 2] + v[NR / 2 + 1]) / 2 }'; }

# A number out of JSON that is printed one field a line.
field() { sed -n "s/^ *\"$2\": \(-\{0,1\}[0-9.e+-]*\),\{0,1\}$/\1/p" "$1" | head -n 1; }

ours() { # scene, options
    local scene=$1
    shift
    # shellcheck disable=SC2068 # options are words
    seconds "$program" render "scenes/$scene.toml" --seed "$run" --beauty-only $@ -q -o "$out/picture.exr"
}

theirs() { # scene, options
    local scene=$1 option declared=()
    shift
    for option in "$@"; do
        case $option in
        +*) declared+=("$option") ;;
        *) declared+=("Declare=$option") ;;
        esac
    done
    seconds "$povray" +Lbenches/peers/povray "+Ibenches/peers/povray/$scene.pov" "+O$out/picture.exr" +FE \
        File_Gamma=1.0 +W256 +H256 "+WT$(nproc)" -D +A0.1 +AM1 "${declared[@]}"
}

# Appends to files the seconds of one run, and its error, error without the worst 0.1 % and bias.
measure() { # file, scene, renderer, options
    local file=$1 scene=$2 renderer=$3
    shift 3
    "$renderer" "$scene" "$@" >>"$file.seconds"
    "$program" compare "tests/reference/$scene/reference-1.exr" \
        --second-half "tests/reference/$scene/reference-2.exr" "$out/picture.exr" --json >"$out/errors.json"
    printf '%s %s %s\n' "$(field "$out/errors.json" relmse_u)" "$(field "$out/errors.json" relmse_t)" \
        "$(field "$out/errors.json" bias)" >>"$file.error"
}

# Settings: a name, then options. Four for each scene.
presets=("draft|--quality draft" "preview|--quality preview" "final|--quality final")
cornell_diffuse=("fast: 3 samples, 20 k photons, a coarse cache|--quality draft --spp 3 --global-photons 20k --cache-samples 64 --cache-error 0.5" "${presets[@]}")
cornell_spheres=("fast: 50 k caustic photons, a coarse cache|--quality draft --caustic-photons 50k --cache-samples 64 --caustic-reuse 0.3" "${presets[@]}")
cardioid=("fast: 1 sample, 10 k photons|--quality draft --spp 1 --caustic-photons 10k" "${presets[@]}")
pov_cornell_diffuse=(
    "POV-Ray, 40 rays|Gather=40 Bound=0.5 Lights=4 Pretrace=0.04 +R2"
    "POV-Ray, 150 rays|Gather=150 Bound=0.25 Lights=5 Pretrace=0.01 +R3"
)
pov_cornell_spheres=(
    "POV-Ray, 60 rays|Gather=60 Bound=0.4 Lights=4 Pretrace=0.02 Photons=100000 +R2"
    "POV-Ray, 200 rays|Gather=200 Bound=0.25 Lights=5 Pretrace=0.01 Photons=1000000 +R3"
)
pov_cardioid=(
    "POV-Ray, 100 k photons|Lights=8 Photons=100000 +R2"
    "POV-Ray, 500 k photons|Lights=12 Photons=500000 +R3"
)

[ -x "$program" ] || { echo "build first: cargo build --release" >&2; exit 1; }
if [ -z "$povray" ]; then
    echo "POV-Ray is not installed (apt install povray): its rows are left out" >&2
fi
echo "| scene | renderer | wall s | error | 999 | bias |"
echo "|---|---|---|---|---|---|"
for scene in cornell-diffuse cornell-spheres cardioid; do
    variable=${scene//-/_}
    declare -n settings=$variable peers=pov_$variable
    for ((run = 0; run < repeats; run++)); do
        for ((i = 0; i < ${#settings[@]}; i++)); do
            # shellcheck disable=SC2086 # options are words
            measure "$out/$scene-ours-$i" "$scene" ours ${settings[i]#*|}
            if [ -n "$povray" ] && [ "$i" -lt "${#peers[@]}" ]; then
                # shellcheck disable=SC2086
                measure "$out/$scene-theirs-$i" "$scene" theirs ${peers[i]#*|}
            fi
        done
    done
    for who in ours theirs; do
        declare -n names=$([ "$who" = ours ] && echo "$variable" || echo "pov_$variable")
        for ((i = 0; i < ${#names[@]}; i++)); do
            [ -e "$out/$scene-$who-$i.error" ] || continue
            read -r error trimmed bias < <(awk '{ e += $1; t += $2; b += $3 } END { print e / NR, t / NR, b / NR }' \
                "$out/$scene-$who-$i.error")
            awk -v s="$scene" -v n="${names[i]%%|*}" -v t="$(median "$out/$scene-$who-$i.seconds")" \
                -v e="$error" -v m="$trimmed" -v b="$bias" -v who="$who" 'BEGIN {
                printf "| `%s` | %s | %.2f | %.2g | %.2g | %+.2f %% |\n", s, (who == "ours" ? "**cardioid**, " : "") n, t, e, m, b }'
        done
    done
done
