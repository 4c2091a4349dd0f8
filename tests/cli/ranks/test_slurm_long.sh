#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# The job script of tools/manual/cluster.md on a Slurm of one node, which this test starts: it requeues itself after the
# signal, is pre-empted and requeued by Slurm, and ends with the model of an uninterrupted run. Skipped where Slurm is not
# installed (Debian: slurm-wlm, munge) or slurmd cannot run.
set -euo pipefail
# shellcheck source=tests/cli/cli_support.sh
source "$(dirname "$0")/../cli_support.sh"

for tool in munged slurmctld slurmd srun sbatch; do
    if ! PATH=$PATH:/usr/sbin:/sbin command -v "$tool" >/dev/null; then
        echo "skipped: $tool is missing (install slurm-wlm and munge)"
        exit 77
    fi
done
# shellcheck disable=SC2119 # no argument
if is_sanitized || [ ! -e "$SPAREGS_BUILD/ranks-openmpi.so" ]; then
    echo "skipped: needs the plug-in of Open MPI and a build without sanitizer"
    exit 77
fi

# ---- A Slurm of one node: partition high pre-empts partition low ----
slurm=$temporary/slurm
node=$(hostname -s)
user=$(id -un)
port=$((20000 + RANDOM % 20000))
export PATH=$SPAREGS_BUILD:$PATH:/usr/sbin:/sbin SLURM_CONF=$slurm/slurm.conf
daemons=()
stop_daemons() {
    for file in "$slurm/slurmd.pid" "$slurm/slurmctld.pid" "$slurm/munge.pid"; do
        [ ! -s "$file" ] || kill "$(cat "$file")" 2>/dev/null || true
    done
    [ "${#daemons[@]}" = 0 ] || wait "${daemons[@]}" 2>/dev/null || true
    rm -rf "$temporary"
}
trap stop_daemons EXIT
mkdir -p "$slurm/state" "$slurm/spool"
head -c 1024 /dev/urandom >"$slurm/munge.key"
chmod 700 "$slurm"
chmod 400 "$slurm/munge.key"
munged --force --key-file="$slurm/munge.key" --socket="$slurm/munge.sock" --pid-file="$slurm/munge.pid" \
    --log-file="$slurm/munge.log" --seed-file="$slurm/munge.seed" 2>"$slurm/munge.out" || {
    cat "$slurm/munge.out"
    echo "skipped: munged cannot run"
    exit 77
}
cat >"$SLURM_CONF" <<END
ClusterName=test
SlurmctldHost=$node(127.0.0.1)
SlurmctldPort=$port
SlurmdPort=$((port + 1))
AuthType=auth/munge
AuthInfo=socket=$slurm/munge.sock
CredType=cred/munge
SlurmUser=$user
SlurmdUser=$user
StateSaveLocation=$slurm/state
SlurmdSpoolDir=$slurm/spool
SlurmctldPidFile=$slurm/slurmctld.pid
SlurmdPidFile=$slurm/slurmd.pid
SlurmctldLogFile=$slurm/slurmctld.log
SlurmdLogFile=$slurm/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
ReturnToService=2
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=sched_interval=2,bf_interval=2
PreemptType=preempt/partition_prio
PreemptMode=REQUEUE
NodeName=$node NodeAddr=127.0.0.1 CPUs=$(nproc) State=UNKNOWN
PartitionName=low Nodes=ALL Default=YES MaxTime=60 PriorityTier=1 PreemptMode=REQUEUE State=UP
PartitionName=high Nodes=ALL MaxTime=60 PriorityTier=2 PreemptMode=OFF State=UP
END
# Containers have no cgroups to write to. Slurm 23 can do without; earlier versions need a plug-in that is then unused.
case $(slurmd -V) in
    *" 2"[0-2].*) echo "CgroupPlugin=cgroup/v1" ;;
    *) echo "CgroupPlugin=disabled" ;;
esac >"$slurm/cgroup.conf"
slurmctld -D >"$slurm/slurmctld.out" 2>&1 &
daemons+=($!)
slurmd -D >"$slurm/slurmd.out" 2>&1 &
daemons+=($!)

# await SECONDS COMMAND...: until the command succeeds.
await() {
    local limit=$((10 * $1))
    shift
    for ((i = 0; i < limit; ++i)); do
        if "$@" >/dev/null 2>&1; then return 0; fi
        sleep 0.1
    done
    return 1
}
node_is_idle() { [ "$(sinfo -h -p low -o %T)" = idle ]; }
if ! await 30 node_is_idle; then
    tail -n 3 "$slurm/slurmctld.out" "$slurm/slurmd.out" || true
    echo "skipped: slurmctld or slurmd cannot run here"
    exit 77
fi
if ! srun --mpi=list 2>&1 | grep -q pmix || ! timeout 60 srun --mpi=pmix hostname >"$temporary/srun" 2>&1; then
    cat "$temporary/srun" 2>/dev/null || true
    echo "skipped: srun has no PMIx"
    exit 77
fi

# ---- The script of the manual, on this node, with a short training ----
options="--downscale 4 --eval --iterations 1500 --threads 1 --quiet --checkpoint-every 100000"
export HOME=$temporary/home
mkdir -p "$HOME"
cd "$temporary"
ln -s "$room" scene
awk '/^```/ { inside = /^```sh/; text = ""; next }
     inside { text = text $0 "\n"; if (/scontrol requeue/) found = 1 }
     inside && /^exit/ && found { printf "%s", text; exit }' "$SPAREGS_SOURCE/tools/manual/cluster.md" >guide.sh
check the_manual_has_a_script test "$(head -n 1 guide.sh)" = "#!/bin/bash"
sed "s/--iterations 30000/$options/" guide.sh >job.sh
check the_script_is_adapted grep -q -- "--iterations 1500" job.sh
out=$HOME/out/room
# shellcheck disable=SC2086 # several words
run 0 train "$room" $options -o "$temporary/whole"
hash=$(jq -r .model_hash "$temporary/whole/summary.json")

job=$(sbatch --parsable --nodes=1 --ntasks-per-node=2 --overcommit --output="$temporary/job.log" job.sh)
last_command="sbatch job.sh"
state() { scontrol show job "$job" | grep -o "$1=[^ ]*" | cut -d= -f2; }
is() { [ "$(state "$1")" = "$2" ]; }
rows() { wc -l <"$out/train.csv" 2>/dev/null || echo 0; }
has_rows() { [ "$(rows)" -ge "$1" ]; }
# Slurm holds a requeued job for two minutes.
start_now() { scontrol update JobId="$job" StartTime=now; }
show_log() { sed 's/^/      /' "$temporary/job.log" | tail -n 20; }

# the_script_requeues_its_job: the signal that --signal sends before the time limit
check "the_job_trains" await 120 has_rows 2
scancel --signal=USR2 "$job"
check the_job_is_requeued await 120 is JobState PENDING
check once is Restarts 1
check the_state_is_saved test -s "$out/checkpoint/state.bin"
json "$out/summary.json" '.stop_reason == "signal" and .ranks == 2'
at=$(jq .iterations "$out/summary.json")

# a_job_of_higher_priority_preempts_it
start_now
check it_trains_again await 120 has_rows $((at / 100 + 4))
urgent=$(sbatch --parsable -p high --exclusive --output="$temporary/urgent.log" --wrap true)
check the_job_is_preempted await 120 is JobState PENDING
check twice is Restarts 2
saved_later() { jq -e ".stop_reason == \"signal\" and .iterations > $at" "$out/summary.json"; }
check the_state_is_saved_again await 60 saved_later
job_is_gone() { [ -z "$(squeue -h -j "$urgent")" ]; }
check the_urgent_job_ends await 120 job_is_gone

# it_ends_with_the_model_of_an_uninterrupted_run
start_now
check the_job_ends await 300 is JobState COMPLETED
check successfully is ExitCode 0:0
json "$out/summary.json" ".iterations == 1500 and .ranks == 2 and .model_hash == \"$hash\""
[ "$failures" = 0 ] || show_log
echo "job $job: requeued by itself at iteration $at, pre-empted, model $hash"
cd /
finish
