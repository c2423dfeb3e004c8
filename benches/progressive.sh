#!/usr/bin/env bash
# Tables of docs/progressive.md: error against rounds, the slope of its logarithm, where rounds overtake `final`; and what --target-error
# reaches. Needs a built program; takes a quarter of an hour or more.
#
#   benches/progressive.sh rounds [MOST]               error after 2, 4, 8 ... MOST rounds (256)
#   benches/progressive.sh targets [SEEDS] [TARGETS]   what is reached for TARGETS ("0.1 0.05 0.03") with so many seeds (5)
#   SCENES="museum cardioid" benches/progressive.sh ...   scenes other than the three with references in tests/reference; for those
#                                                      benches/references.sh makes some
#
# Errors are free of the reference's noise. Seconds are those of the processor, all threads, of whole processes.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
program=${CARDIOID:-target/release/cardioid}
[ -x "$program" ] || { echo "build first: cargo build --release" >&2; exit 1; }
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
scenes=${SCENES:-cornell-diffuse cornell-spheres cardioid}
source benches/references.sh

# A number out of JSON that is printed one field a line: the last field of that name.
field() { sed -n "s/^ *\"$2\": \(-\{0,1\}[0-9.e+-]*\),\{0,1\}$/\1/p" "$1" | tail -n 1; }

# Renders with the options, and sets `error` (true), `estimate`, `noise`, `bias`, `rounds` and `cpu`.
render() { # scene, options
    local scene=$1
    shift
    reference_of "$scene"
    "$program" render "scenes/$scene.toml" "${size_options[@]}" "$@" -q --beauty-only -o "$out/p.exr" --stats "$out/s.json" 2>"$out/log" ||
        { cat "$out/log" >&2; exit 1; }
    "$program" compare "${halves[0]}" --second-half "${halves[1]}" "$out/p.exr" --json >"$out/e.json"
    error=$(field "$out/e.json" relrmse_u)
    cpu=$(field "$out/s.json" cpu)
    sed -n '/"rounds": {/,/"history"/p' "$out/s.json" >"$out/r.json"
    rounds=$(field "$out/r.json" done)
    estimate=$(sed -n '/"error": {/,$p' "$out/r.json" | sed 1d >"$out/x.json"; field "$out/x.json" error)
    noise=$(field "$out/r.json" noise)
    bias=$(field "$out/r.json" bias)
}

case ${1:-rounds} in
rounds)
    most=${2:-256}
    echo "| scene | rounds | processor s | error | estimated | noise | bias | slope of log error over log rounds |"
    echo "|---|---|---|---|---|---|---|---|"
    for scene in $scenes; do
        rm -f "$out/kept"
        total=0 before= resume=
        for ((n = 2; n <= most; n *= 2)); do
            # shellcheck disable=SC2086
            render "$scene" --integrator progressive --rounds "$n" --checkpoint "$out/kept" $resume
            resume="--resume $out/kept"
            total=$(awk "BEGIN { print $total + $cpu }")
            awk -v s="$scene" -v n="$n" -v t="$total" -v e="$error" -v g="$estimate" -v v="$noise" -v b="$bias" -v o="$before" 'BEGIN {
                printf "| `%s` | %d | %.1f | %.2f %% | %.2f %% | %.2f %% | %.2f %% | %s |\n", s, n, t, 100 * e, 100 * g, 100 * v,
                    100 * b, o == "" ? "" : sprintf("%.2f", log(e / o) / log(2)) }'
            before=$error
        done
        render "$scene" --quality final
        printf '| `%s` | two passes, `final` | %.1f | %s | | | | |\n' "$scene" "$cpu" "$(awk "BEGIN { printf \"%.2f %%\", 100 * $error }")"
    done
    ;;
targets)
    seeds=${2:-5}
    targets=${3:-0.1 0.05 0.03}
    echo "| scene | asked for | rounds | reached, by seed | within 1.5 times |"
    echo "|---|---|---|---|---|"
    good=0 all=0
    for scene in $scenes; do
        for target in $targets; do
            reached="" counts="" within=0
            for ((seed = 1; seed <= seeds; seed++)); do
                render "$scene" --target-error "$target" --seed "$seed"
                reached="$reached $(awk "BEGIN { printf \"%.2f\", 100 * $error }")"
                counts="$counts $rounds"
                ok=$(awk "BEGIN { print ($error <= 1.5 * $target) ? 1 : 0 }")
                within=$((within + ok)) good=$((good + ok)) all=$((all + 1))
            done
            printf '| `%s` | %s %% |%s |%s %% | %d of %d |\n' "$scene" "$(awk "BEGIN { print 100 * $target }")" "$counts" "$reached" "$within" "$seeds"
        done
    done
    echo
    echo "Within 1.5 times what was asked for: $good of $all."
    ;;
*)
    sed -n '2,10p' "$0" >&2
    exit 2
    ;;
esac
