#!/usr/bin/env bash
# Prints docs/quality.md: where the presets stand on the front of speed against accuracy, and what each knob costs and buys, over all
# scenes. Needs a built program; takes an hour or more on two cores, and goes on where it stopped (out/quality).
#
#   benches/quality.sh [BUDGET] >docs/quality.md.new            time for each scene (10m)
#   SCENES="cornell-diffuse cardioid" benches/quality.sh 3m     some of the scenes
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
program=${CARDIOID:-target/release/cardioid}
[ -x "$program" ] || { echo "build first: cargo build --release" >&2; exit 1; }
budget=${1:-10m}
source benches/references.sh
around=(--around draft --around preview --around rounds --around final)

cat <<END
# What settings cost and buy

This page has the measurements. [which-settings.md](which-settings.md) draws the conclusions from them.

Written by \`make quality\` ([\`benches/quality.sh\`](../benches/quality.sh)); $(date +%Y-%m-%d), $(nproc) threads of an $(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -n 1),
$("$program" --version). Each section is what \`cardioid tradeoff SCENE\` writes, by renders with three seeds each, within
$budget for each scene. *Error*, *noise* and *bias* are relative: roots of means of squares over r^2 + f, f a hundredth of the square of the
reference's mean, free of the reference's noise. *Seconds* are those of one picture on the clock, *processor s* those of all threads.
A render is on the front if no other render has both less processor time and less error. \`reference\` is left out where its time exceeds the
budget.

END
all=$(for file in scenes/*.toml; do basename "$file" .toml; done)
for scene in ${SCENES:-$all}; do
    file=scenes/$scene.toml
    out=out/quality/$scene
    mkdir -p "$out"
    reference_of "$scene"
    reference=(--reference "${halves[0]}" --second-half "${halves[1]}" "${size_options[@]}")
    # The scene for any mesh needs none of its own to be measured: it has one.
    if "$program" tradeoff "$file" "${reference[@]}" "${around[@]}" --time-budget "$budget" -q -o "$out" 2>"$out/log"; then
        cat "$out/tradeoff.md"
        echo
    else
        sed "s/^/$scene: /" "$out/log" >&2
    fi
done
