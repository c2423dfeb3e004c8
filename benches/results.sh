#!/usr/bin/env bash
# Prints docs/results.md: everything measured anew on this machine. Takes about half an hour when nothing else runs.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

cat <<END
# Results

Written by \`make results\`; $(date +%Y-%m-%d), $(nproc) threads of an $(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -n 1),
$(target/release/cardioid --version). Pictures of 256 x 256 pixels of the three reference scenes. *Error* is free of
the reference's noise: mean((t - r1)(t - r2) / (r^2 + 0.01)) with the two halves r1, r2 of the reference; *999* is relMSE
without the worst 0.1 % of the pixels; *bias* the difference of mean luminance.

## Time against error

Wall seconds of whole processes, medians of runs that take turns with those of POV-Ray 3.7, where that is installed. Errors and
biases are means over these runs, which have a seed each.

END
benches/peers/run.sh "${1:-3}"
cat <<END

## What each mechanism costs and buys

At \`draft\`, everything else the same. Seconds of the processor, all threads. Pictures of one seed: differences of less than a
tenth are noise.

END
benches/ablation.sh draft
cat <<'END'

How to read it:

- **Projection maps** matter where casters fill little of what a light sees: without, the ring costs four fifths more.
- **The irradiance cache** brings the error of the boxes to a quarter in the same time, because each of its records gathers with a
  hundred rays.
- **Irradiance precomputed at photons** costs less than a third of a full estimate at each gather ray, for the same error.
- **The visible kernel** brings the error of the ring to a fifth: without it light leaks at the foot, inside and outside. In the
  box estimates lose light at the edges without it: 1.4 % of the whole.
- **Sharing caustic estimates** within a pixel saves about a tenth, for the same error.
- **As printed**, estimates know no visible kernel either: most of that row's difference is the kernel's.
- **Guided directions** lower the noise of indirect light at equal samples; in the Cornell box direct light makes most of the noise.
  They pay where indirect light comes from few directions: `scenes/door.toml`, `benches/guide.rs`.
- **Shadow photons** save shadow rays, which are cheap here: [shadow-photons.md](shadow-photons.md).
- **How far a record of the cache is read**: twice as far as records are placed, against once, lowers the error of the boxes by 8 to 20 %; 2.8
  times as far raises it again by 6 to 10 % (2026-11-23, as the next two).
- **Direct light at precomputed points by shadow rays** in place of photons: an error less by 9 % at `final`, 4 to 6 % at `draft`. **Half of a
  hemisphere's rays where photons came from**: 15 % less noise of a record, 7 % less error at `final`. With the line before, the error of
  `cornell-diffuse` at `final` is 20 % less, for 10 % more time.
- **Caustics at points**: the museum at 320 x 240 takes 0.6 s less for the cache of 8.0 s and 1.2 s less for the pixels of 7.1 s; the
  visible change (FLIP 0.002) is a twentieth of that of another seed. Where nothing is highly glossy they would cost 3 to 5 % of a `draft` for nothing, and are left out.
- **Emitters that mirrors show to glossy surfaces, by shadow rays**: FLIP of two seeds of the museum's sphere flake 0.077 instead of 0.092, and a
  third of the noise on its cylinder, for no more time.
- **Differential checking** sharpens edges and shortens smooth slopes too, so that the error of the ring's caustic grows.
END

cat <<'END'

## One map or two

Caustics and soft indirect light of `cornell-spheres` at a thousand points, half of them in caustics, from one map of all photons and
from two maps with as many in all (`examples/one_map_or_two.rs`). *Error* is the root of the mean squared error over the mean, and
*us* the microseconds of a place: two look-ups in place of one. With few photons one map has too few of either kind near a place;
with very many both are the same but for the wider discs that soft light can do with.

END
cargo run --release --quiet --example one_map_or_two
cat <<'END'

## Look-ups by the number of photons

The map beside two trees of a photon a node, on the photons of `cornell-spheres` (`examples/photon_map_scaling.rs`). Photons come in
an order, which a tree that is built as they arrive keeps in its depth.

END
cargo run --release --quiet --example photon_map_scaling
echo
benches/jensen96.sh
benches/figures.sh
