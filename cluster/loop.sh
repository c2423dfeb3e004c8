#!/usr/bin/env bash
# Renders a scene as parts without a scheduler, by the same contract as slurm.sh: one part after another, and the merge.
#
#     cluster/loop.sh SCENE [options of `cardioid part`]
#
# Several machines with a shared folder: WORKER=1/4 on the first, WORKER=2/4 on the second, ... Each renders its share, and whoever finds all
# parts there merges them. Variables as in slurm.sh: ROUNDS, PARTS, OUT, ISA, TRIES, CARDIOID.
# The same command again goes on with what is there.
set -euo pipefail

if [ $# -lt 1 ]; then
    echo "usage: cluster/loop.sh SCENE [options of \`cardioid part\`]" >&2
    exit 1
fi
scene=$1
shift
name=$(basename "$scene")
ROUNDS=${ROUNDS:-256} PARTS=${PARTS:-16} OUT=${OUT:-${name%.*}.exr} ISA=${ISA:-avx2} TRIES=${TRIES:-20}
CARDIOID=${CARDIOID:-cardioid} WORKER=${WORKER:-1/1}
folder=$OUT.parts
mkdir -p "$folder"

files=()
for ((i = 1; i <= PARTS; i++)); do
    files+=("$folder/$i.part")
    (((i - 1) % ${WORKER#*/} == ${WORKER%/*} - 1)) || continue
    try=1
    while true; do
        status=0
        CARDIOID_ATTEMPT="$(hostname -s)-$$-$try" "$CARDIOID" part "$scene" --rounds "$ROUNDS" --part "$i/$PARTS" --isa "$ISA" \
            -o "$folder/$i.part" "$@" || status=$?
        [ "$status" != 0 ] || break
        # A process that was killed may do better next time, as one that says so may; an error never does.
        [ "$status" = 75 ] || [ "$status" -gt 128 ] || exit "$status"
        [ "$status" != 130 ] || exit "$status"
        [ "$try" -lt "$TRIES" ] || exit 75
        try=$((try + 1))
    done
done
status=0
"$CARDIOID" merge "${files[@]}" -o "$OUT" || status=$?
case $status in
0)
    rm -f "$folder"/*.part "$folder"/*.part.rounds "$folder"/.*.cardioid.tmp
    rmdir "$folder" || true
    ;;
75) [ "${WORKER#*/}" = 1 ] || echo "other workers have not finished: the last one merges" >&2 ;;
esac
exit "$status"
