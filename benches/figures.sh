#!/usr/bin/env bash
# Figures 8 and 9 of Jensen & Christensen 1995 by this program: estimates of a caustic against the exact solution (table, and the
# plot docs/pictures/figure-8.svg), and the statistics of the desk and the landscape. Prints Markdown. Needs a built program.
#
#   benches/figures.sh [WIDTHxHEIGHT] >table.md
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
size=${1:-320x240}
program=${CARGO_TARGET_DIR:-target}/release/cardioid
[ -x "$program" ] || { echo "build first: cargo build --release" >&2; exit 1; }
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT

# The first number of that name out of JSON that is printed one field a line; zero where there is none.
field() { sed -n "s/^ *\"$2\": \(-\{0,1\}[0-9.e+-]*\),\{0,1\}$/\1/p" "$1" | head -n 1 | grep . || echo 0; }
# All of them added up.
total() { sed -n "s/^ *\"$2\": \([0-9]*\),\{0,1\}$/\1/p" "$1" | awk '{ s += $1 } END { print s + 0 }'; }

cat <<'END'
## Figure 8 of 1995: a caustic against the exact solution

`cardioid bench caustic scenes/mirror-square.toml`: 100 000 caustic photons on 4 m², four seeds, 105 places inside of the caustic
for mean and RMS, nine lines across its edge. Elements of the caustic's illumination map are 5 cm wide, as an estimate of 200 photons
has its radius. Photons are stratified, so that noise is below one over the root of N.

END
"$program" bench caustic scenes/mirror-square.toml -o docs/pictures/figure-8.svg
cat <<END

![Irradiance along a line through the caustic](pictures/figure-8.svg)

## Figure 9 of 1995: statistics of its scenes

At \`draft\`, $size pixels, 4 samples each. Rays in millions; seconds of the wall, all threads.

| picture | photons kept | photons summed up | light rays | gather rays | shadow rays | pass 1 s | whole s |
|---|---|---|---|---|---|---|---|
END
row() { # name, scene, options
    local name=$1 scene=$2
    shift 2
    "$program" render "scenes/$scene.toml" --quality draft --spp 4 --resolution "$size" "$@" -q \
        --stats "$out/s.json" -o "$out/$scene$#.exr" 2>"$out/log" || { cat "$out/log" >&2; exit 1; }
    # Counts of kept photons are whole; the seconds of the pass have the same name and a point.
    kept=$(sed -n '/"maps": \[/,/^  \]/s/^      "photons": \([0-9]*\),\{0,1\}$/\1/p' "$out/s.json" | awk '{ s += $1 } END { print s + 0 }')
    summed=$(sed -n '/"illumination": {/,/}/s/^ *"photons": \([0-9]*\),\{0,1\}$/\1/p' "$out/s.json" | grep . || echo 0)
    bounces=$(total "$out/s.json" bounces)
    seconds=$(sed -n '/"times": {/,/}/s/^ *"[a-z]*": \([0-9.e+-]*\),\{0,1\}$/\1/p' "$out/s.json" | awk '{ s += $1 } END { print s }')
    pass=$(sed -n '/"times": {/,/}/s/^ *"photons": \([0-9.e+-]*\),\{0,1\}$/\1/p' "$out/s.json")
    awk -v n="$name" -v k="$kept" -v d="$summed" -v b="$bounces" -v g="$(total "$out/s.json" gather_rays)" \
        -v h="$(total "$out/s.json" shadow_rays)" -v p="$pass" -v t="$seconds" 'BEGIN {
        printf "| %s | %d | %d | %.2f | %.2f | %.2f | %.1f | %.1f |\n", n, k, d, b / 1e6, g / 1e6, h / 1e6, p, t }'
}
row "desk, illumination maps (figure 4)" desk --illumination-maps true
row "desk, photon maps (figure 5)" desk
row "landscape (figure 6)" landscape
cat <<END

The desk with illumination maps on table, wall and block, against the same with photon maps everywhere:

END
"$program" compare "$out/desk0.exr" "$out/desk2.exr" | sed 's/^/    /'
