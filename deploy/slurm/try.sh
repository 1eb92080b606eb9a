#!/usr/bin/env bash
# Try workers.sbatch on a Slurm of one node that lives in a temporary folder: preemption with a grace
# time, scancel, the time limit, and a worker that cannot work. Ends with 0 if each did what it
# should. Takes two to three minutes.
#
# Needs Debian's slurm-wlm and munge, but neither a running Slurm, nor systemd, nor cgroups, nor root:
# the daemons run as this user and listen on 127.0.0.1 only. BUILD names the build tree.
# shellcheck disable=SC2317  # functions are called by name, through eval and the trap
set -eu
cd "$(dirname "$0")/../.."
root=$PWD
bin=$root/${BUILD:-build/release}/bin
PATH=$bin:$PATH:/usr/sbin
for tool in munged slurmctld slurmd sbatch srun scontrol scancel sinfo; do
    command -v "$tool" >/dev/null || { echo "$0: $tool is missing: apt-get install slurm-wlm munge" >&2; exit 2; }
done
[ -x "$bin/azulejo-worker" ] || { echo "$0: no programs in $bin: make first" >&2; exit 2; }

folder=$(mktemp -d "${TMPDIR:-/tmp}/azulejo-slurm-XXXXXX")
export SLURM_CONF=$folder/slurm.conf
daemons=() failed=0
clean_up() {
    scancel --user="$(id -un)" >/dev/null 2>&1 || true
    wait_for 30 "[ -z \"\$(squeue -h)\" ]" >/dev/null 2>&1 || true
    for ((i = ${#daemons[@]} - 1; i >= 0; i--)); do
        kill "${daemons[i]}" 2>/dev/null || true
        wait "${daemons[i]}" 2>/dev/null || true
    done
    rm -rf "$folder"
}

# wait_for SECONDS CONDITION: look until the shell condition holds; 1 when it does not in that time.
wait_for() {
    local end=$((SECONDS + $1))
    until eval "$2"; do
        [ $SECONDS -lt $end ] || return 1
        sleep 0.2
    done
}

# must SECONDS CONDITION WORDS: as wait_for, but the trial ends if it fails.
must() {
    wait_for "$1" "$2" && return
    echo "$0: waited $1 s for $3" >&2
    tail -n 20 "$folder"/*.log >&2
    exit 1
}

start() { # NAME COMMAND...
    "${@:2}" >"$folder/$1.out" 2>"$folder/$1.log" &
    daemons+=($!)
}

verdict() { # WORDS CONDITION
    if eval "$2"; then
        echo "ok      $1"
    else
        failed=1
        echo "NOT OK  $1. Wanted: $2"
        scontrol --oneliner show job "$job" | sed 's/^/        /'
        tail -n 5 "$folder/job-$job.log" | sed 's/^/        /'
    fi
}

# ---- a Slurm and a coordinator -------------------------------------------------------------

read -r port1 port2 < <(python3 - <<'PYTHON'
import socket
both = [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
print(*(s.getsockname()[1] for s in both))
PYTHON
)
host=$(hostname -s)
# linuxproc, task/none and no job accounting: nothing that needs cgroups. A requeued job may start
# again once its old credential has expired: after 5 s here, after two minutes by default.
cat >"$SLURM_CONF" <<CONF
ClusterName=azulejo-try
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port1
SlurmdPort=$port2
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthType=auth/munge
CredType=cred/munge
AuthInfo=socket=$folder/munge.socket,cred_expire=5
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
SwitchType=switch/none
SelectType=select/linear
ReturnToService=2
PreemptType=preempt/partition_prio
PreemptMode=REQUEUE
NodeName=$host NodeAddr=127.0.0.1 CPUs=2
PartitionName=low Nodes=ALL Default=YES PriorityTier=1 GraceTime=20
PartitionName=abrupt Nodes=ALL PriorityTier=1 GraceTime=0
PartitionName=high Nodes=ALL PriorityTier=2 PreemptMode=OFF
CONF
mkdir "$folder/state" "$folder/spool"
(umask 077 && head -c 64 /dev/urandom >"$folder/munge.key")
trap clean_up EXIT
start munged munged --foreground --force --socket="$folder/munge.socket" --key-file="$folder/munge.key" \
    --pid-file="$folder/munged.pid" --seed-file="$folder/munge.seed" --log-file="$folder/munged.log"
must 20 "[ -S '$folder/munge.socket' ]" "munged"
start slurmctld slurmctld -D
start slurmd slurmd -D
must 60 "sinfo -h -o %T 2>/dev/null | grep -q idle" "the node to be idle"

azulejo keygen -o "$folder/farm.key"
azulejo keygen --role client --from "$folder/farm.key" -o "$folder/client.key"
export AZULEJO_KEY=$folder/farm.key
start coordinator azulejo-coordinator --listen 127.0.0.1:0 --store "$folder/store"
must 20 "grep -qs '^listening on' '$folder/coordinator.out'" "the coordinator"
AZULEJO_COORDINATOR=$(sed -n 's/^listening on \([^ ]*\).*/\1/p' "$folder/coordinator.out")
export AZULEJO_COORDINATOR
azulejo submit scenes/cornell/cornell-area.gltf --size 640x480 --spp 1000000 >/dev/null

# ---- what is tried -------------------------------------------------------------------------

lend() { # [SBATCH OPTIONS]: workers.sbatch on the node
    sbatch --parsable --partition=low --nodes=1 --time=30 --chdir="$folder" --output="$folder/job-%j.log" "$@" \
        "$root/deploy/slurm/workers.sbatch"
}
field() { # JOB NAME
    scontrol --oneliner show job "$1" | grep -o "\b$2=[^ ]*" | cut -d= -f2
}
farm_has() { # COUNT of workers
    [ "$(azulejo workers --json | grep -o '"session"' | wc -l)" -eq "$1" ]
}
over() { # JOB: in a state that it does not leave
    [[ "$(field "$1" JobState)" =~ ^(COMPLETED|CANCELLED|FAILED|TIMEOUT|PREEMPTED|NODE_FAIL)$ ]]
}

preempt() { # PARTITION: lend to the farm in it, and let an urgent job have the node
    job=$(lend --partition="$1")
    must 60 "farm_has 1" "the worker to join"
    urgent=$(sbatch --parsable --partition=high --exclusive --output=/dev/null --wrap "sleep 2")
    must 60 "[ \$(field $urgent JobState) != PENDING ]" "the urgent job to get the node"
    verdict "the workers' job is in the queue again" "wait_for 30 '[ \"\$(field $job JobState)\" = PENDING ]'"
    verdict "the worker is back on the farm when the node is free" "wait_for 60 'farm_has 1'"
    verdict "requeued once" "[ \"\$(field $job Restarts)\" = 1 ]"
}

echo "preemption, GraceTime=0:"
preempt abrupt
scancel "$job"
must 60 "over $job && farm_has 0" "the cancelled job to end"

echo "preemption, GraceTime=20:"
preempt low
verdict "the worker gave the tiles back" "grep -q 'SIGTERM: finishing' '$folder/job-$job.log'"

echo "scancel:"
scancel "$job"
verdict "the job is cancelled and not requeued" \
    "wait_for 60 'over $job' && [ \"\$(field $job JobState)\$(field $job Restarts)\" = CANCELLED1 ]"
verdict "the farm has no worker" "wait_for 30 'farm_has 0'"

echo "a time limit of 2 minutes, SIGTERM to the script 60 s before:"
job=$(lend --time=2 --signal=B:TERM@60)
must 60 "farm_has 1" "the worker to join"
verdict "the job is completed and not requeued" \
    "wait_for 150 'over $job' && [ \"\$(field $job JobState)\$(field $job Restarts)\" = COMPLETED0 ]"
verdict "the worker gave the tiles back" "grep -q 'SIGTERM: finishing' '$folder/job-$job.log'"

echo "a key that is not a worker's:"
job=$(AZULEJO_KEY=$folder/client.key lend)
verdict "the job fails with the worker's exit status" \
    "wait_for 60 'over $job' && [ \"\$(field $job JobState) \$(field $job ExitCode)\" = 'FAILED 5:0' ]"

[ $failed -eq 0 ] && echo "workers.sbatch: as it should be" || echo "workers.sbatch: NOT as it should be"
exit $failed
