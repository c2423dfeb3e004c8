#!/bin/sh
# Table 1 of Christensen & Batali 2004 on a city of our own: sizes of the cache of bricks against hits and time, from the street and from the
# air, and the same pictures with maps in memory. Results are in docs/irradiance-atlas.md.
#
#   benches/irradiance_atlas.sh [PHOTONS] [FOLDER]
set -eu
cd "$(dirname "$0")/.."
photons=${1:-4M}
folder=${2:-target/irradiance-atlas}
scene=scenes/city.toml
cardioid=${CARDIOID:-target/release/cardioid}
size=${SIZE:-1024x553}
# Gather rays read the atlas wherever they land, as in the paper: by default the nearest 15 m of this city would be computed accurately.
options=${OPTIONS:---spp 4 --accurate-distance 0.001}
mkdir -p "$folder"

if [ ! -e "$folder/atlas/bricks.json" ]; then
    $cardioid photons $scene --global-photons "$photons" --atlas "$folder/atlas"
    $cardioid bricks $scene --atlas "$folder/atlas"
fi
$cardioid bricks $scene --atlas "$folder/atlas" --inspect | tail -1

render() { # name, options
    name=$1
    shift
    $cardioid render $scene --resolution "$size" --stats "$folder/$name.json" -o "$folder/$name.exr" --overwrite -q $options "$@"
}

row() { # name, first cell
    python3 - "$folder/$1.json" "$2" <<'END'
import json, sys
stats = json.load(open(sys.argv[1]))
atlas = stats.get("atlas")
seconds = stats["times"]["cache"] + stats["times"]["pixels"]
cells = [sys.argv[2]]
if atlas:
    seen = atlas["lookups"]
    cells += [f"{seen['missed']:,}", f"{atlas['hit_percent']:.2f} %", f"{atlas['touched']:,}", f"{atlas['bricks_per_ray']:.2f}"]
    cells += [f"{seen['looked_up']:,}"]
else:
    cells += ["-"] * 5
cells += [f"{seconds:.1f}", f"{stats['process']['cpu']:.1f}"]
print("| " + " | ".join(cells) + " |")
END
}

for view in street air; do
    echo
    echo "$view, $size"
    echo
    echo "| cache | misses | hits | bricks touched | look-ups a ray | look-ups | seconds of pass 2 | processor seconds |"
    echo "|---|---|---|---|---|---|---|---|"
    case $view in
        street) camera="" ;;
        air) camera="--set height=260 --set look=0" ;;
    esac
    for cache in 0 100kB 1MB 10MB 100MB; do
        render "$view-$cache" $camera --atlas "$folder/atlas" --brick-cache $cache
        row "$view-$cache" "$cache"
    done
    render "$view-memory" $camera --global-photons "$photons"
    row "$view-memory" "maps in memory"
    $cardioid compare "$folder/$view-memory.exr" "$folder/$view-10MB.exr"
done
