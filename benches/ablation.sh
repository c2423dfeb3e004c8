#!/usr/bin/env bash
# What each mechanism costs and buys: pictures with it off and on, everything else the same. Prints a table.
#
#   benches/ablation.sh [QUALITY] >table.md
#
# Seconds are those of the processor (user and system, all threads) of whole processes, so that they add up alike on any
# number of cores; errors are free of the reference's noise. Needs a built program.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
quality=${1:-preview}
program=target/release/cardioid
[ -x "$program" ] || { echo "build first: cargo build --release" >&2; exit 1; }
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT

# A number out of JSON that is printed one field a line.
field() { sed -n "s/^ *\"$2\": \(-\{0,1\}[0-9.e+-]*\),\{0,1\}$/\1/p" "$1" | head -n 1; }

row() { # mechanism, scene, setting, options
    local mechanism=$1 scene=$2 setting=$3 seconds TIMEFORMAT='%U %S'
    shift 3
    seconds=$({ time "$program" render "scenes/$scene.toml" --quality "$quality" "$@" -q -o "$out/p.exr" 2>"$out/log"; } 2>&1) ||
        { cat "$out/log" >&2; exit 1; }
    "$program" compare "tests/reference/$scene/reference-1.exr" \
        --second-half "tests/reference/$scene/reference-2.exr" "$out/p.exr" --json >"$out/e.json"
    awk -v m="$mechanism" -v s="$scene" -v o="$setting" -v t="$seconds" -v e="$(field "$out/e.json" relmse_u)" \
        -v k="$(field "$out/e.json" relmse_t)" -v b="$(field "$out/e.json" bias)" 'BEGIN {
        split(t, part, " ")
        printf "| %s | `%s` | %s | %.1f | %.2g | %.2g | %+.2f %% |\n", m, s, o, part[1] + part[2], e, k, b }'
}

# Off and on of one option.
pair() { # mechanism, scene, option, off, on
    row "$1" "$2" "$4" "--$3" "$4"
    row "" "$2" "$5" "--$3" "$5"
}

echo "| mechanism | scene | setting | processor s | error | 999 | bias |"
echo "|---|---|---|---|---|---|---|"
pair "projection maps" cornell-spheres aim-photons false true
pair "" cardioid aim-photons false true
pair "irradiance cache" cornell-diffuse irradiance-cache false true
pair "" cornell-spheres irradiance-cache false true
pair "irradiance precomputed at photons" cornell-diffuse precomputed-irradiance false true
pair "accurate below a small distance" cornell-diffuse accurate-distance 0 0.02
pair "approximate below a small weight" cornell-spheres approximate-weight 0 0.01
pair "visible kernel" cornell-diffuse visible-kernel false true
pair "" cardioid visible-kernel false true
pair "caustic estimates shared within pixels" cornell-spheres caustic-reuse 0 0.2
pair "" cardioid caustic-reuse 0 0.2
row "directions guided by photons" cornell-diffuse "none, no cache" --irradiance-cache false
row "" cornell-diffuse "photons, no cache" --irradiance-cache false --guide photons
row "" cornell-diffuse "none, paths" --integrator path --spp 64
row "" cornell-diffuse "photons, paths" --integrator path --spp 64 --guide photons
row "shadow photons" cornell-diffuse "off, 16 shadow rays" --light-samples 16
row "" cornell-diffuse "as-printed, 16 shadow rays" --light-samples 16 --shadow-photons as-printed
row "" cornell-diffuse "bounded, 16 shadow rays" --light-samples 16 --shadow-photons bounded
pair "k-th photon does not count" cardioid estimator as-printed corrected
for kernel in constant cone epanechnikov gaussian; do
    row "$([ $kernel = constant ] && echo kernel)" cardioid $kernel --kernel $kernel
done
pair "differential checking" cardioid differential-check false true
row "search by a fixed radius" cardioid "the nearest"
row "" cardioid "1.5 mm" --caustic-radius 0.0015
pair "search region" cornell-diffuse search sphere disc
