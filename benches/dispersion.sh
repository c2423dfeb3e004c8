#!/usr/bin/env bash
# What dispersion costs: time and noise of caustics with all wavelengths, with three, and with none, at the same number of photons.
#
# Noise is half the mean square difference between two seeds, relative as in `cardioid compare`. Prints a table in Markdown.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

program=${1:-target/release/cardioid}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

printf '| scene | `--wavelengths` | processor seconds | noise of caustics | noise times seconds, over `off` |\n|---|---|---|---|---|\n'
for scene in prism gem; do
    declare -A noise seconds
    for wavelengths in off continuous 3; do
        seconds[$wavelengths]=0
        for seed in 1 2; do
            TIMEFORMAT=%U
            spent=$({ time "$program" render "scenes/$scene.toml" --quality draft --resolution 240x160 --caustic-photons 300000 \
                --wavelengths "$wavelengths" --seed "$seed" --output "$folder/$seed.exr" --overwrite --quiet 2>"$folder/said"; } 2>&1)
            seconds[$wavelengths]=$(awk -v a="${seconds[$wavelengths]}" -v b="$spent" 'BEGIN { print a + b / 2 }')
        done
        # For caustics whose noise is that of photons alone, both pictures are as far from the truth.
        noise[$wavelengths]=$("$program" compare "$folder/1.exr" "$folder/2.exr" --aov caustics --json |
            awk -F: '/"relmse"/ { gsub(/[ ,]/, "", $2); print $2 / 2; exit }')
        printf '| %s | `%s` | %.2f | %.4g | %.2f |\n' "$scene" "$wavelengths" "${seconds[$wavelengths]}" "${noise[$wavelengths]}" \
            "$(awk -v n="${noise[$wavelengths]}" -v s="${seconds[$wavelengths]}" -v m="${noise[off]}" -v t="${seconds[off]}" \
                'BEGIN { print n * s / (m * t) }')"
    done
done
