#!/usr/bin/env bash
# The figures, Table 1 and the claims of Jensen 1996 with a measured line beside each. Prints part of docs/results.md and
# renders its pictures into docs/pictures.
#
#   benches/jensen96.sh [PART...] >part.md      parts: figure2 boxes series photons costs figure4 cognac table1 flip
#
# Seconds are wall seconds of passes as `--stats` has them, or processor seconds of whole processes where a heading says so.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
program=target/release/cardioid
pictures=docs/pictures
[ -x "$program" ] || { echo "build first: cargo build --release" >&2; exit 1; }
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT

# Counts of photons and settings of the two large pictures. The counts are those of Table 1.
museum=(--caustic-photons 389755 --global-photons 165791 --quality preview --spp "${MUSEUM_SPP:-16}" --adaptive
    --cache-samples 1792 --gather-samples 4 --glossy-samples 3 --global-nearest 240)
cognac=(--caustic-photons 224316 --global-photons 3095 --quality preview --spp "${COGNAC_SPP:-16}" --gather-samples 2)

# A number out of JSON that is printed one field a line; the first where there are several.
field() { sed -n "s/^ *\"$2\": \(-\{0,1\}[0-9.e+-]*\),\{0,1\}$/\1/p" "$1" | head -n 1; }

# Renders a scene to $out/NAME.exr with its statistics, and notes the processor seconds.
shoot() { # name, scene, options
    local name=$1 scene=$2 TIMEFORMAT='%U %S %R'
    shift 2
    { time "$program" render "scenes/$scene.toml" "$@" -q --stats "$out/$name.json" -o "$out/$name.exr" \
        2>"$out/log"; } 2>"$out/$name.time" || { cat "$out/log" >&2; return 1; }
}
cpu() { awk '{ print $1 + $2 }' "$out/$1.time"; }
wall() { awk '{ print $3 }' "$out/$1.time"; }
stat() { field "$out/$1.json" "$2"; }
# Sum of a number that each map has.
sum() { sed -n "s/^ *\"$2\": \(-\{0,1\}[0-9.e+-]*\),\{0,1\}$/\1/p" "$out/$1.json" | awk '{ s += $1 } END { print s + 0 }'; }
keep() { cp "$out/$1.png" "$pictures/$2.png"; }

# Error of a picture against the reference halves of its scene.
against() { # picture, scene
    "$program" compare "tests/reference/$2/reference-1.exr" --second-half "tests/reference/$2/reference-2.exr" \
        "$out/$1.exr" --json >"$out/errors.json"
}

figure2() {
    cat <<'END'
## Figure 2: the caustic of a ring from 12,000 photons

Without a filter and with the cone. A kernel that is cut at walls, which the paper did not have, is off; 50 photons in an
estimate.

END
    for kernel in constant cone; do
        shoot "$kernel" cardioid --spp 16 --caustic-photons 12000 --caustic-nearest 50 --kernel $kernel \
            --visible-kernel false --resolution 256x256
        keep $kernel "figure-2-$kernel"
    done
    echo "| no filter | cone, k = 1 |"
    echo "|---|---|"
    echo "| ![without a filter](pictures/figure-2-constant.png) | ![with the cone](pictures/figure-2-cone.png) |"
    for kernel in constant cone; do
        against $kernel cardioid
        printf '%s' "| error $(field "$out/errors.json" relmse_u | awk '{ printf "%.2g", $1 }') "
    done
    printf '|\n\n'
}

boxes() {
    cat <<'END'
## The Cornell boxes

The glossy box (figures 6 and 7) with at most 6 rays at the first glossy surface and 16 samples per pixel, beside paths
from the eye alone. *Error* is relMSE against paths with 1024 samples per pixel, at 160 x 120.

| | samples per pixel | processor s | error | mean luminance against the reference |
|---|---|---|---|---|
END
    shoot glossy-reference cornell-glossy --integrator path --spp 1024 --seed 7 --resolution 160x120
    shoot glossy-paths cornell-glossy --integrator path --spp 64 --resolution 160x120
    shoot glossy-maps cornell-glossy --glossy-samples 6 --spp 16 --global-photons 382598 --resolution 160x120
    for run in "glossy-maps|photon maps, 6 glossy rays|16" "glossy-paths|paths|64"; do
        IFS='|' read -r name what spp <<<"$run"
        "$program" compare "$out/glossy-reference.exr" "$out/$name.exr" --json >"$out/errors.json"
        printf '| %s | %s | %.1f | %.2g | %+.2f %% |\n' "$what" "$spp" "$(cpu "$name")" \
            "$(field "$out/errors.json" relmse)" "$(field "$out/errors.json" bias)"
    done
    shoot glossy cornell-glossy --quality final --spp 16 --glossy-samples 6 --global-photons 382598
    keep glossy cornell-glossy
    printf '\n![the glossy Cornell box](pictures/cornell-glossy.png)\n\n'
}

# What an eye sees of the difference of two seeds, in the large pictures as PNG. The first is that of Table 1 where that was made.
flip() {
    cat <<'END'
## From seed to seed

What an eye sees of the difference of two pictures at 1280 x 960 with the settings of Table 1, as PNG.

| scene | mean FLIP |
|---|---|
END
    local scene
    for scene in museum cognac; do
        local -n settings=$scene
        [ -f "$out/$scene.png" ] || shoot "$scene" "$scene" "${settings[@]}"
        shoot "other-$scene" "$scene" "${settings[@]}" --seed 1
        "$program" compare "$out/$scene.png" "$out/other-$scene.png" --json >"$out/errors.json"
        printf '| `%s` | %.4f |\n' "$scene" "$(field "$out/errors.json" flip)"
    done
    cat <<'END'

What makes that of the museum, at 320 x 240 with evenly spread samples (0.0337, on 2026-11-23), by four times as much of one thing at a time: samples of a pixel
0.0283, rays of the irradiance cache 0.0300. Samples shared out by variance: 0.0310.

END
}

# A row of pictures: titles, then names, both separated by |.
gallery() {
    echo "| $1 |"
    echo "$1" | sed 's/[^|]*/---/g; s/.*/|&|/'
    echo "$2" | sed 's/ *\([^|]*[^| ]\) */ ![\1](pictures\/\1.png) /g; s/.*/|&|/'
    echo
}

# A picture of the series.
frame() { # name, scene, options
    shoot "$1" "$2" --resolution 192x192 "${@:3}"
    keep "$1" "$1"
}

series() {
    cat <<'END'
## The Cornell box, step by step

What the lecture shows one after the other. *Ray traced*: shadow rays and ideal reflection alone, under a point light and
under the area light. The two maps as they are: 50,000 caustic photons with 60 in an estimate; 200,000 global ones with 100; and with 500, in
a disc. In a sphere (`--search sphere`), which in the lecture takes in what lies around corners, this picture is the same to the bit:
photons on surfaces that face elsewhere are never taken, so a disc matters on curved surfaces alone.

END
    # The same box under a point light of the same power, in the middle of where the lamp is.
    sed '/^# Faces down/,/^emission/d' scenes/cornell-spheres.toml >"$out/sharp.toml"
    cat >>"$out/sharp.toml" <<'END'

[[lights]]
type = "point"
position = [278.0, 540.0, 279.5]
power = [1.46, 1.03, 0.343]
END
    local traced=(--global-photons 0 --no-caustics --irradiance-cache false --spp 16)
    "$program" render "$out/sharp.toml" "${traced[@]}" --resolution 192x192 -q -o "$out/series-sharp.exr" 2>"$out/log" ||
        { cat "$out/log" >&2; return 1; }
    keep series-sharp series-sharp
    frame series-soft cornell-spheres "${traced[@]}"
    frame series-full cornell-spheres --quality preview
    local shown=(--integrator photons --spp 4 --visible-kernel false)
    frame series-caustic cornell-spheres "${shown[@]}" --map caustic --caustic-photons 50k --caustic-nearest 60
    frame series-global cornell-spheres "${shown[@]}" --map global --global-photons 200k --global-nearest 100
    frame series-500 cornell-spheres "${shown[@]}" --map global --global-photons 200k --global-nearest 500
    for count in 10k 100k 1M; do
        frame series-$count cornell-spheres "${shown[@]}" --map global --global-photons $count --global-nearest 100
    done
    gallery "ray traced, point light | ray traced, area light | both photon maps, \`preview\`" "series-sharp | series-soft | series-full"
    gallery "caustic map, 60 of 50,000 | global map, 100 of 200,000 | 500 of 200,000" "series-caustic | series-global | series-500"
    gallery "100 of 10,000 photons | of 100,000 | of 1,000,000" "series-10k | series-100k | series-1M"
}

photons() {
    cat <<'END'
## How many photons

`cornell-spheres` at `draft`, everything else the same: "rendering time is only slightly affected by the number of photons",
and 200,000 to 500,000 "give nice results" (section 6).

| photons in each map | pass 1, s | rendering, s | error | bias |
|---|---|---|---|---|
END
    for count in 10000 30000 100000 300000 1000000; do
        shoot "count" cornell-spheres --quality draft --global-photons $count --caustic-photons $count
        against "count" cornell-spheres
        awk -v n=$count -v p="$(stat count photons)" -v c="$(stat count cache)" -v x="$(stat count pixels)" \
            -v e="$(field "$out/errors.json" relmse_u)" -v b="$(field "$out/errors.json" bias)" \
            'BEGIN { printf "| %d | %.2f | %.2f | %.2g | %+.2f %% |\n", n, p, c + x, e, b }'
    done
    cat <<'END'

That the number of photons depends on the flux and not on the objects, the test
`walls_of_a_million_triangles_need_no_more_photons` shows: the Cornell box with walls of 1.3 million triangles has the error of the
plain one from the same number of photons.

END
}

costs() {
    cat <<'END'
## The cost of the same error

`cornell-diffuse`; processor seconds of whole processes, less those of a process that does next to nothing. Plain final gathering
and paths are unbiased but for noise, whose square falls with one over the samples: what they would take to the error of
the photon map is their time times the ratio of errors, measured where both are small.

| | settings | processor s | error | seconds to the error of the first line |
|---|---|---|---|---|
END
    shoot idle cornell-diffuse --integrator path --spp 1 --resolution 16x16
    shoot cached cornell-diffuse --quality draft
    shoot plain cornell-diffuse --quality draft --irradiance-cache false --precomputed-irradiance true --spp 16
    shoot full cornell-diffuse --quality draft --irradiance-cache false --precomputed-irradiance false --spp 8
    shoot paths cornell-diffuse --integrator path --spp 64
    against cached cornell-diffuse
    local goal
    goal=$(field "$out/errors.json" relmse_u)
    for run in "cached|photon map with irradiance cache|\`draft\`" \
        "plain|plain final gathering, irradiance precomputed at photons|\`draft\`, no cache, 16 spp" \
        "full|plain final gathering, an estimate at each ray|\`draft\`, no cache, 8 spp" "paths|paths|64 spp"; do
        IFS='|' read -r name what how <<<"$run"
        against "$name" cornell-diffuse
        awk -v w="$what" -v h="$how" -v t="$(cpu "$name")" -v i="$(cpu idle)" -v g="$goal" \
            -v e="$(field "$out/errors.json" relmse_u)" \
            'BEGIN { printf "| %s | %s | %.2f | %.2g | %.1f |\n", w, h, t - i, e, (t - i) * e / g }'
    done
    echo
}

figure4() {
    cat <<'END'
## Figure 4: the global map of the museum

165,000 photons shown directly, 80 in an estimate, on everything diffuse; the flake too, where its diffuse part is. Kernels are not cut at walls.

END
    shoot figure-4 museum --integrator photons --map global --global-photons 165k --global-nearest 80 --visible-kernel false \
        --spp 4 --resolution 640x480
    keep figure-4 figure-4
    printf '![the global photon map of the museum](pictures/figure-4.png)\n\n'
}

cognac() {
    cat <<'END'
## The cognac glass: what caustics bring

Without caustics the ground below the glass is black; with 216 shadow photons or so, which the paper counts, most shadow rays are
saved. The third picture has the lecture's settings: 200,000 photons, 40 in an estimate.

END
    local small=(--quality preview --spp 16 --resolution 400x300)
    shoot cognac-dark cognac "${small[@]}" --no-caustics
    keep cognac-dark cognac-dark
    shoot cognac-lit cognac "${small[@]}" --caustic-photons 224316 --global-photons 3095
    keep cognac-lit cognac-lit
    shoot cognac-lecture cognac "${small[@]}" --caustic-photons 200k --caustic-nearest 40
    keep cognac-lecture cognac-lecture
    gallery "no caustics | 224,316 photons, 120 in an estimate | 200,000 photons, 40 in an estimate" \
        "cognac-dark | cognac-lit | cognac-lecture"
    cat <<'END'
| shadow photons | rays | direct | shadow | shadow rays saved |
|---|---|---|---|---|
END
    local rays
    for mode in "as-printed 3000" "as-printed 66000" "bounded 200000"; do
        read -r mode rays <<<"$mode"
        shoot shadows cognac --quality draft --spp 4 --resolution 400x300 --shadow-photons "$mode" --shadow-photon-rays "$rays"
        awk -v m="$mode" -v r="$rays" -v d="$(stat shadows direct_photons)" -v s="$(stat shadows shadow_photons)" \
            -v k="$(stat shadows rays_saved_percent)" \
            'BEGIN { printf "| `%s` | %d | %d | %d | %.1f %% |\n", m, r, d, s, k }'
    done
    echo
}

# One row: a scene at the resolution and the counts of photons of the paper.
row() { # name, scene, the paper's pass 1, the paper's rendering, resolution, options, which begin with both counts
    local name=$1 scene=$2 first=$3 second=$4 size=$5 caustic=$7 global=$9
    shift 5
    shoot "$name" "$scene" --resolution "$size" "$@"
    # The boxes are shown elsewhere, and are large.
    case $name in museum | cognac) keep "$name" "$name" ;; esac
    awk -v n="$scene" -v s="$size" -v c="$caustic" -v g="$global" -v f="$first" -v r="$second" \
        -v p="$(stat "$name" photons)" -v k="$(stat "$name" cache)" -v x="$(stat "$name" pixels)" \
        -v spp="$(stat "$name" spp)" -v m="$(sum "$name" bytes)" -v d="$(stat "$name" mean_path_depth)" 'BEGIN {
        printf "| `%s` | %s | %d | %d | %s | %s | %.1f s | %.0f s | %d | %.1f MB | %.2f |\n",
            n, s, c, g, f, r, p, k + x, spp, m / 1e6, d }'
}

table1() {
    cat <<'END'
## Table 1

The scenes of the paper, reconstructed from its text and pictures, at its resolutions with its counts of photons. The
paper's seconds are those of a Pentium at 100 MHz; its pictures differ from ours in what its text leaves open. *Depth* is the
mean depth of an image-sampling ray, "very close to 2" in the diffuse box.

| scene | pixels | caustic | global | pass 1, 1996 | rendering, 1996 | pass 1 | rendering | samples per pixel | maps | depth |
|---|---|---|---|---|---|---|---|---|---|---|
END
    local boxes=(--caustic-photons 21162 --global-photons 286489 --quality preview --spp 4)
    local glossy=(--caustic-photons 0 --global-photons 382598 --quality preview --spp 1 --glossy-samples 6)
    row table-cornell-spheres cornell-spheres "67 s" "8 min" 1280x960 "${boxes[@]}"
    row table-cornell-glossy cornell-glossy "56 s" "50 min" 2560x1920 "${glossy[@]}"
    row museum museum "298 s" "51 min" 1280x960 "${museum[@]}"
    row cognac cognac "27 min" "65 min" 1280x960 "${cognac[@]}"
    # One alone is the noisiest of the three times.
    local seconds=()
    for _ in 1 2 3; do
        shoot final cornell-diffuse --quality final
        seconds+=("$(wall final)")
    done
    local final
    final=$(printf '%s\n' "${seconds[@]}" | sort -n | sed -n 2p)
    printf '\nThe museum takes %.0f and the cognac glass %.0f times as long as `cornell-diffuse` at 256 x 256 and `final`,\nwhich is %.2f s, the median of three.\n' \
        "$(awk "BEGIN { print $(wall museum) / $final }")" "$(awk "BEGIN { print $(wall cognac) / $final }")" "$final"
    cat <<'END'

The paper spends most of the time of the museum on the teapot as the cylinder shows it. Here, of the processor seconds of the pixels at 640 x 480
(2026-11-23, without `--adaptive`), the cylinder takes 7 % on 4 % of the picture, the teapot 5 % on 2 %, the sphere flake 9 % on 3 %: a glossy
surface seen in another gets one ray for each of its own.

| the museum | the cognac glass |
|---|---|
| ![museum](pictures/museum.png) | ![cognac](pictures/cognac.png) |

END
}

[ $# -gt 0 ] || set -- figure2 boxes series photons costs figure4 cognac table1 flip
for part in "$@"; do "$part"; done
