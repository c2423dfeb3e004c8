#!/usr/bin/env bash
# A large mesh from the start to the first camera ray, in turns with a bare process that reads the file once and commits it to
# Embree: processor seconds, wall seconds and peak memory, and their ratios.
#
#   benches/large_mesh.sh MESH.ply [RUNS]
#
# MESH: binary little-endian PLY of x, y, z and triangles, best of ten million triangles or more. Needs GNU time.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
mesh=${1:?usage: benches/large_mesh.sh MESH.ply [RUNS]}
runs=${2:-3}
cargo build --release --quiet --bin cardioid --example bare_build
target=${CARGO_TARGET_DIR:-target}/release
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
measure() { # NAME COMMAND...
    local name=$1
    shift
    /usr/bin/time -a -o "$folder/$name" -f "%U %S %e %M" "$@" >"$folder/$name.out" 2>"$folder/$name.err"
}
# Once, so that the file is in the system's cache for all.
cat "$mesh" >/dev/null
for ((run = 0; run < runs; run++)); do
    measure bare "$target/examples/bare_build" "$mesh"
    measure cardioid "$target/cardioid" render "$mesh" --integrator path --resolution 1x1 --spp 1 --beauty-only --quiet \
        -o "$folder/one.png"
done
cat "$folder/bare.out"
awk -v load="$(cut -d' ' -f1 /proc/loadavg)" '
    function middle(values, count,   i, j, swap) {
        for (i = 1; i < count; i++) for (j = i + 1; j <= count; j++)
            if (values[j] < values[i]) { swap = values[i]; values[i] = values[j]; values[j] = swap }
        return count % 2 ? values[(count + 1) / 2] : (values[count / 2] + values[count / 2 + 1]) / 2
    }
    FNR == 1 { file++ }
    { cpu[file, FNR] = $1 + $2; wall[file, FNR] = $3; memory[file, FNR] = $4; count = FNR }
    END {
        split("bare cardioid", names, " ")
        printf "%-10s %12s %12s %12s   (medians of %d runs in turns, load %s)\n", "", "processor s", "wall s", "peak MB", count, load
        for (f = 1; f <= 2; f++) {
            for (i = 1; i <= count; i++) { a[i] = cpu[f, i]; b[i] = wall[f, i]; c[i] = memory[f, i] }
            x[f] = middle(a, count); y[f] = middle(b, count); z[f] = middle(c, count)
            printf "%-10s %12.2f %12.2f %12.0f\n", names[f], x[f], y[f], z[f] / 1000
        }
        printf "%-10s %12.3f %12.3f %12.3f\n", "ratio", x[2] / x[1], y[2] / y[1], z[2] / z[1]
    }' "$folder/bare" "$folder/cardioid"
