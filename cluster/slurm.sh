#!/usr/bin/env bash
#SBATCH --job-name=cardioid
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --signal=B:TERM@60
# Renders a scene on a Slurm cluster: the parts of a progressive picture as an array, and the merge of them.
#
#     sbatch [options of Slurm] cluster/slurm.sh SCENE [options of `cardioid part`]
#
# Variables, with their defaults:
#     ROUNDS=256     rounds of the picture
#     PARTS=16       parts, at most a sixteenth of the rounds
#     OUT=NAME.exr   the picture; NAME is that of the scene. Parts are kept in OUT.parts until the picture is whole
#     ISA=avx2       instruction set, which all nodes must have; parts of different sets are refused
#     TRIES=20       how many times missing parts are asked for
#     AT_ONCE=       parts that run at once, where not all may
#     PART_OPTIONS=  options of sbatch for parts, such as "--time=1:00:00 --cpus-per-task=8"
#     MERGE_OPTIONS= options of sbatch for the merge, such as "--mem=4G"
#     CARDIOID=cardioid   the program
# Folder and files must be on a disk that all nodes share. The same command again goes on with what is there.
set -euo pipefail

role=${CARDIOID_ROLE:-start}
# Slurm copies a script that is submitted, so that its name here is that of the copy, which can be submitted again.
script=${BASH_SOURCE[0]}
# Names of temporary files: two attempts at one part cannot harm each other.
export CARDIOID_ATTEMPT="${SLURM_ARRAY_JOB_ID:-${SLURM_JOB_ID:-shell}}_${SLURM_ARRAY_TASK_ID:-0}-${SLURM_RESTART_COUNT:-0}"

if [ $# -lt 1 ]; then
    echo "usage: sbatch cluster/slurm.sh SCENE [options of \`cardioid part\`]" >&2
    exit 1
fi
scene=$1
shift
name=$(basename "$scene")
export ROUNDS=${ROUNDS:-256} PARTS=${PARTS:-16} OUT=${OUT:-${name%.*}.exr} ISA=${ISA:-avx2} TRIES=${TRIES:-20}
export CARDIOID=${CARDIOID:-cardioid} AT_ONCE=${AT_ONCE:-} PART_OPTIONS=${PART_OPTIONS:-} MERGE_OPTIONS=${MERGE_OPTIONS:-}
export CARDIOID_TRY=${CARDIOID_TRY:-1}
folder=$OUT.parts

# The numbers of the parts that are not there, with commas between them.
missing() {
    local list='' i
    for ((i = 1; i <= PARTS; i++)); do
        [ -e "$folder/$i.part" ] || list+=",$i"
    done
    echo "${list#,}"
}

# Submits the missing parts, and a merge for when they have ended, whole or not. A second merge follows a first that fails or is killed.
submit() {
    local list parts merge again
    list=$(missing)
    local after=()
    if [ -n "$list" ]; then
        # shellcheck disable=SC2086 # several options
        parts=$(sbatch --parsable --export=ALL,CARDIOID_ROLE=part --array="$list${AT_ONCE:+%$AT_ONCE}" $PART_OPTIONS "$script" "$scene" "$@")
        after=(--dependency="afterany:${parts%%;*}")
        echo "parts $list: job ${parts%%;*}"
    fi
    # shellcheck disable=SC2086
    merge=$(sbatch --parsable --export=ALL,CARDIOID_ROLE=merge "${after[@]}" $MERGE_OPTIONS "$script" "$scene" "$@")
    # shellcheck disable=SC2086
    again=$(sbatch --parsable --export=ALL,CARDIOID_ROLE=merge --dependency="afternotok:${merge%%;*}" --kill-on-invalid-dep=yes \
        $MERGE_OPTIONS "$script" "$scene" "$@")
    echo "merge: job ${merge%%;*}, and ${again%%;*} if that one fails"
}

# Runs the program, and hands it the signal with which Slurm announces the end of the time; its exit code is this one's.
run() {
    "$@" &
    local child=$! status=0
    trap 'kill -TERM "$child" 2>/dev/null || true' TERM
    # A signal ends `wait` before the program has ended.
    while true; do
        status=0
        wait "$child" || status=$?
        kill -0 "$child" 2>/dev/null || break
    done
    return "$status"
}

# Renders a part, by its number.
part() {
    local i=$1
    shift
    run "$CARDIOID" part "$scene" --rounds "$ROUNDS" --part "$i/$PARTS" --isa "$ISA" -o "$folder/$i.part" "$@"
}

case $role in
start)
    mkdir -p "$folder"
    # Parts that are there already must be of this picture: `part` does nothing for one that is, and refuses another.
    for ((i = 1; i <= PARTS; i++)); do
        if [ -e "$folder/$i.part" ]; then part "$i" "$@"; fi
    done
    submit "$@"
    ;;
part)
    part "$SLURM_ARRAY_TASK_ID" "$@"
    ;;
merge)
    status=0
    if [ -z "$(missing)" ]; then
        files=()
        for ((i = 1; i <= PARTS; i++)); do files+=("$folder/$i.part"); done
        run "$CARDIOID" merge "${files[@]}" -o "$OUT" || status=$?
    else
        status=75
    fi
    case $status in
    0)
        # Also what attempts left that were killed: none of it is needed any more.
        rm -f "$folder"/*.part "$folder"/*.part.rounds "$folder"/.*.cardioid.tmp
        rmdir "$folder" || true
        ;;
    75)
        if [ "$CARDIOID_TRY" -ge "$TRIES" ]; then
            echo "parts $(missing) are missing after $CARDIOID_TRY tries; the log of their jobs says why" >&2
            exit 1
        fi
        CARDIOID_TRY=$((CARDIOID_TRY + 1))
        submit "$@"
        ;;
    *)
        exit "$status"
        ;;
    esac
    ;;
*)
    echo "CARDIOID_ROLE is $role, and must be start, part or merge" >&2
    exit 1
    ;;
esac
