#!/usr/bin/env bash
# Renders a small scene on a Slurm cluster of two nodes on this machine, kills what can die, and compares the picture with that of one render.
#
#   tests/cluster/slurm.sh PROGRAM
#
# Needs root, and slurm-wlm and munge, which it installs where apt can. Where it cannot, it says so and ends with success. It starts munged,
# slurmctld and two slurmd without systemd, listening on loopback alone, and ends them again.
set -euo pipefail
program=$(realpath "$1")
checkout=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)

skip() {
    echo "tests/cluster: skipped: $1"
    exit 0
}
[ "$(id -u)" = 0 ] || skip "it needs root, to start the daemons of Slurm"
if ! command -v slurmctld >/dev/null || ! command -v slurmd >/dev/null || ! command -v munged >/dev/null; then
    command -v apt-get >/dev/null || skip "there is no Slurm, and no apt to install it"
    DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends slurm-wlm munge >/dev/null 2>&1 ||
        skip "apt cannot install slurm-wlm and munge"
fi

D=$(mktemp -d)
daemons=()
finish() {
    local status=$?
    # Only what was started here, by its number.
    for pid in "${daemons[@]}"; do kill "$pid" 2>/dev/null || true; done
    for pid in "${daemons[@]}"; do wait "$pid" 2>/dev/null || true; done
    if [ "$status" != 0 ]; then
        echo "tests/cluster: failed; logs:" >&2
        tail -n 20 "$D"/log/* "$D"/jobs/*.out >&2 || true
    fi
    rm -rf -- "$D"
    exit "$status"
}
trap finish EXIT

mkdir -p "$D/munge" "$D/state" "$D/log" "$D/spool-n1" "$D/spool-n2" "$D/jobs"
dd if=/dev/urandom of="$D/munge/munge.key" bs=128 count=1 status=none
chmod 600 "$D/munge/munge.key"
chown -R munge:munge "$D/munge"
chmod 711 "$D" "$D/munge"
host=$(hostname -s)
# Ports of their own, so that a cluster of this machine is left alone.
port=$((20000 + $$ % 20000))
cat >"$D/slurm.conf" <<CONF
ClusterName=cardioid
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$D/munge/munge.sock
CredType=cred/munge
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
SlurmctldPort=$port
StateSaveLocation=$D/state
SlurmdSpoolDir=$D/spool-%n
SlurmctldPidFile=$D/ctld.pid
SlurmdPidFile=$D/slurmd-%n.pid
SlurmctldLogFile=$D/log/ctld.log
SlurmdLogFile=$D/log/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
ReturnToService=2
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SlurmdTimeout=10
KillWait=5
SchedulerParameters=sched_interval=2,batch_sched_delay=1
DefMemPerCPU=500
NodeName=n[1-2] NodeHostname=$host NodeAddr=127.0.0.1 Port=[$((port + 1))-$((port + 2))] CPUs=1 RealMemory=2000 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
export SLURM_CONF=$D/slurm.conf

setpriv --reuid=munge --regid=munge --clear-groups munged --foreground --key-file="$D/munge/munge.key" \
    --socket="$D/munge/munge.sock" --pid-file="$D/munge/munged.pid" --log-file="$D/munge/munged.log" --seed-file="$D/munge/seed" \
    >/dev/null 2>&1 &
daemons+=($!)
slurmctld -D -f "$SLURM_CONF" >/dev/null 2>&1 &
daemons+=($!)
start_node() {
    slurmd -D -N "$1" -f "$SLURM_CONF" >/dev/null 2>&1 &
    node_pid=$!
    daemons+=("$node_pid")
    # No word of the shell when it is killed.
    disown
}
start_node n1
start_node n2
n2=$node_pid

# Waits until a command succeeds, up to so many seconds.
until_true() {
    local seconds=$1 end
    shift
    end=$((SECONDS + seconds))
    until "$@" >/dev/null 2>&1; do
        [ "$SECONDS" -lt "$end" ] || { echo "tests/cluster: not within $seconds s: $*" >&2; return 1; }
        sleep 0.2
    done
}
both_idle() { [ "$(sinfo -h -t idle -o %D)" = 2 ]; }
until_true 60 both_idle || skip "the daemons of Slurm do not work here"

cd "$D/jobs"
scene=$checkout/scenes/cornell-spheres.toml
options=(--resolution 64x48 --spp 4 --global-photons 3000 --caustic-photons 4000 --threads 1 -q)
isa=sse4.2
export CARDIOID=$program ROUNDS=64 PARTS=4 OUT=cluster.exr ISA=$isa TRIES=10
one_machine() {
    "$program" render "$scene" --integrator progressive --rounds 64 --isa "$isa" "${options[@]}" -o one.exr
}
submit() { sbatch --parsable --output="$D/jobs/%A-%a.out" "$checkout/cluster/slurm.sh" "$scene" "${options[@]}"; }
part_runs() { pgrep -f -- "^$program part .*cluster.exr.parts"; }
same() { "$program" compare one.exr "$1" --json | grep -q '"rmse": 0.0,'; }

one_machine
job=$(submit)
echo "tests/cluster: job $job: four parts on two nodes"
# A task is killed: its part lacks until the merge asks for it again.
kill_a_task() {
    local pid
    pid=$(pgrep -f -- "^$program part .*cluster.exr.parts" | head -n 1)
    kill -KILL "$pid"
}
until_true 60 kill_a_task
echo "tests/cluster: killed a task"
sleep 1
# A node's daemons die, and with them what they start; they come back after the controller has given the node up.
kill -KILL "$n2"
for pid in $(pgrep -f -- "^slurmstepd: \[.*\]" || true); do
    # Only the steps of this cluster: their parent was the daemon above.
    if [ "$(tr '\0' '\n' <"/proc/$pid/environ" 2>/dev/null | grep -c "^SLURM_CONF=$SLURM_CONF$")" != 0 ]; then
        kill -KILL "$pid" 2>/dev/null || true
        break
    fi
done
echo "tests/cluster: killed the daemon of a node"
until_true 60 part_runs || true
sleep 3
start_node n2
n2=$node_pid
# A running task is put back into the queue by hand.
running=$(squeue -h -t R -n cardioid -o %i | head -n 1)
if [ -n "$running" ] && scontrol requeue "$running" 2>/dev/null; then echo "tests/cluster: requeued $running"; fi

# Slurm holds back for two minutes what it puts into the queue again; this test does not wait for that.
release() {
    local held
    for held in $(squeue -h -t PD -o '%A %r' | awk '$2 == "BeginTime" { print $1 }'); do
        scontrol update JobId="$held" StartTime=now 2>/dev/null || true
    done
}
is_done() {
    release
    [ -e cluster.exr ] && [ ! -e cluster.exr.parts ]
}
until_true 300 is_done
asked=$(cat ./*.out | grep -c '^parts ')
[ "$asked" -ge 2 ] || { echo "tests/cluster: the killed task was not asked for again" >&2; exit 1; }
same cluster.exr || { echo "tests/cluster: the picture has other bits" >&2; exit 1; }
echo "tests/cluster: the picture has the bits of one render, $SECONDS s"
