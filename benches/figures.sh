#!/usr/bin/env bash
# Figures 8 and 9 of Jensen & Christensen 1995 by this program: estimates of a caustic against the exact solution (table, and the
# plot docs/pictures/figure-8.svg), and the statistics of the desk and the landscape, what adaptive samples buy on the desk, and the
# pictures of both. Prints Markdown. Needs a built program, and a quarter of an hour.
#
#   benches/figures.sh [tables|pictures] >table.md      one of the two alone
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
part=${1:-all}
size=640x480
program=$(realpath "${CARGO_TARGET_DIR:-target}")/release/cardioid
[ -x "$program" ] || { echo "build first: cargo build --release" >&2; exit 1; }
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT

# The first number of that name out of JSON that is printed one field a line; zero where there is none.
field() { sed -n "s/^ *\"$2\": \(-\{0,1\}[0-9.e+-]*\),\{0,1\}$/\1/p" "$1" | head -n 1 | grep . || echo 0; }
# All of them added up.
total() { sed -n "s/^ *\"$2\": \([0-9]*\),\{0,1\}$/\1/p" "$1" | awk '{ s += $1 } END { print s + 0 }'; }

tables() {
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

The paper's search made its picture with photon maps take a quarter longer; here seconds differ as much from run to run. Shadow rays are
not nine tenths of all rays, as one for each light and sample does.

The desk with illumination maps on table, wall and block, against the same with photon maps everywhere:

END
(cd "$out" && "$program" compare desk0.exr desk2.exr) | sed 's/^/    /'
cat <<'END'

## Samples by variance

The desk at `draft`, 320x240 pixels, against 256 samples per pixel of the same maps: samples spread evenly, and by the variance
around a pixel (`--adaptive`). *999* is relMSE without the worst 0.1 % of the pixels.

| samples per pixel | evenly: error | 999 | s | by variance: error | 999 | s |
|---|---|---|---|---|---|---|
END
small() { # picture, options
    local name=$1 TIMEFORMAT=%R
    shift
    { time "$program" render scenes/desk.toml --quality draft --resolution 320x240 --seed 3 -q "$@" -o "$out/$name.exr" 2>"$out/log"; } 2>"$out/$name.time"
}
error() { "$program" compare "$out/even.exr" "$out/$1.exr" --json >"$out/e.json"; echo "$(field "$out/e.json" relmse) $(field "$out/e.json" relmse_t) $(cat "$out/$1.time")"; }
small even --spp 256
for spp in 4 8 16; do
    small a --spp "$spp"
    small b --spp "$spp" --adaptive
    echo "$spp $(error a) $(error b)" | awk '{ printf "| %d | %.2g | %.2g | %.1f | %.2g | %.2g | %.1f |\n", $1, $2, $3, $4, $5, $6, $7 }'
done
cat <<'END'

## Indirect light of both scenes against paths

At 96x72 and `preview`, with 200 000 or 3 000 000 global photons, against paths: difference of the layer's mean. Estimates reach over as much
surface as eighty photons need. In a landscape whose grooves are smaller than that they lose light, and the little light that the inside
of the lampshade reflects is blurred. Both errors fall as photons become more; check before you trust the indirect light of either scene to a few percent.

| scene | 200 000 | 3 000 000 |
|---|---|---|
END
bias() { # scene, samples of the paths
    local scene=$1 small=(--resolution 96x72 -q)
    "$program" render "scenes/$scene.toml" "${small[@]}" --integrator path --spp "$2" --seed 5 -o "$out/paths.exr" 2>"$out/log"
    printf '| %s |' "$scene"
    for photons in 200000 3000000; do
        "$program" render "scenes/$scene.toml" "${small[@]}" --quality preview --caustic-photons 100000 \
            --global-photons "$photons" -o "$out/maps.exr" 2>"$out/log"
        "$program" compare "$out/paths.exr" "$out/maps.exr" --aov indirect --json >"$out/e.json"
        printf ' %+.1f %% |' "$(field "$out/e.json" bias)"
    done
    echo
}
bias desk 256
bias landscape 128
}

# Caustics of half a million photons, as the five million of `final` take most of its time here.
pictures() {
    cat <<'END'

## The scenes of 1995

The desk with photon maps everywhere, at `final` with 500 000 caustic photons, beside the same with illumination maps on table, wall
and block; and the landscape at `preview`.

| photon maps | illumination maps |
|---|---|
| ![the desk with photon maps](pictures/desk.png) | ![the desk with illumination maps](pictures/desk-illumination-maps.png) |

![a lens casts a caustic on a fractal landscape](pictures/landscape.png)
END
    shot() { # picture, scene, options
        local name=$1 scene=$2
        shift 2
        "$program" render "scenes/$scene.toml" -q "$@" -o "docs/pictures/$name.png" 2>"$out/log" || { cat "$out/log" >&2; exit 1; }
    }
    shot desk desk --quality final --caustic-photons 500000
    shot desk-illumination-maps desk --quality final --caustic-photons 500000 --illumination-maps true
    shot landscape landscape --quality preview
}

case $part in
    tables | pictures) "$part" ;;
    all) tables && pictures ;;
    *)
        echo "unknown part \`$part\`: tables or pictures, or nothing for both" >&2
        exit 2
        ;;
esac
