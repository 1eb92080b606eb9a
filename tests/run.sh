#!/usr/bin/env bash
# Run every test and end with "N passed, N failed". A test is a program or script that prints TAP lines ("ok N - name",
# "not ok N - name"); one that prints none, dies or runs past its limit counts as one failure. BUILD names the build tree.
# tests/run.sh PATTERN runs only the tests whose path matches. tests/run.sh --changed (make check) runs, for about a minute
# and a half, the quickest first, programs and files that are not as they were when they last passed, and a few farms
# whatever has changed.
#
# Programs compute, in one lane a core and with less priority; farms and pages mostly wait, in lanes of their own beside
# them. The slowest begin first: as in the last run in this tree, else in tests/slowest.txt.
#
# Their folders are in memory where there is room and TMPDIR does not say otherwise: farms wait for the disk at every
# change of their store. make steady and make test-elsewhere leave them on the disk.
#
# What depends on the order of processes and threads (farms, pages, units) and fails runs once more at the end, alone.
# If it passes there it is "unsteady": it is named, both logs are kept, and more than UNSTEADY_MAX such files fail the
# run. Statistical and numerical tests have fixed seeds and never run again; nor does anything under a sanitizer, where
# one race seen once is a finding.
set -u
cd "$(dirname "$0")/.."
export BUILD=${BUILD:-build/release}
export CMOCKA_MESSAGE_OUTPUT=TAP
export ASAN_OPTIONS=${ASAN_OPTIONS:-detect_leaks=1:abort_on_error=0:allocator_may_return_null=1}
export UBSAN_OPTIONS=${UBSAN_OPTIONS:-print_stacktrace=1}
export TSAN_OPTIONS=${TSAN_OPTIONS:-suppressions=$PWD/tests/support/tsan.supp:halt_on_error=0:exitcode=66}
export LSAN_OPTIONS=${LSAN_OPTIONS:-suppressions=$PWD/tests/support/lsan.supp}
SECONDS=0
changed_only=0
[ "${1:-}" != --changed ] || { changed_only=1; shift; }
pattern=${1:-.}
smoke='^tests/farm/test_(fault_loop|health|keys|previews|region|rot|scene_files|stalled_disk|web_metrics)\.py$'
CHANGED_S=75  # after so long none begins
limit_s=${TEST_LIMIT_S:-900}
UNSTEADY_MAX=2
again='^tests/(farm|web|blender|unit)/'
# Farms share the cores with one another and with programs: each deadline is three times as long.
[[ $BUILD =~ address|thread|undefined|debug ]] || export FARM_PATIENCE=${FARM_PATIENCE:-3}
[[ $BUILD =~ address|thread|undefined ]] && again='^$'
compute_lanes=${TEST_LANES:-$(nproc)}
farm_lanes=${TEST_FARM_LANES:-$(($(nproc) + 2))}
logs=$BUILD/test-logs
counts=$logs/counts
times=$logs/times
failed_once=$logs/failed-once
left_out=$logs/left-out
passed_as=$logs/passed-as
# Not by a wrapper that looks for it each time, as pyenv's does.
python=/usr/bin/python3 # for which the system's packages hold modules
[ -x "$python" ] || python=$(command -v python3)
mkdir -p "$logs" "$passed_as"
memory_gb() {  # free for files in memory
    { df --output=avail -k /dev/shm | tail -n 1; awk '/^MemAvailable/ { print $2 }' /proc/meminfo; } 2>/dev/null |
        sort -n | awk 'NR == 1 { print int($1 / 1048576) }'
}
if [ -z "${TMPDIR:-}" ] && [ -w /dev/shm ] && [ "$(memory_gb)" -ge 4 ]; then
    TMPDIR=$(mktemp -d /dev/shm/azulejo-tests-XXXXXX) || exit 2
    export TMPDIR
    trap 'rm -rf "$TMPDIR"' EXIT
fi
cat tests/slowest.txt "$times" >"$logs/times-before" 2>/dev/null
: >"$counts"
: >"$times"
: >"$failed_once"
: >"$left_out"

# A build without the page (make WEB=0) skips its tests, by name.
skip_web() {
    [ "${WEB:-1}" = 0 ] || return 1
    [[ $1 =~ ^tests/web/|test_web_[a-z_]*\.py$ ]] || { [[ $1 =~ \.c$ ]] && grep -qE '"(web|coordinator/page)/' "$1"; } || return 1
    echo "skip $1 (this build has no page: WEB=0)"
    echo "0 0 1" >>"$counts"
}

# Lines go out in one write each, so that tests side by side do not mix theirs.
run_one() {
    local name=$1 log ok bad skip rc how began=$EPOCHREALTIME
    shift
    log=$logs/$(echo "$name" | tr '/' '_').log
    timeout "$limit_s" "$@" >"$log" 2>&1 </dev/null
    rc=$?
    # Wall seconds, then the CPU seconds of what this lane waited for.
    times >"$log.times"
    awk -v from="$began" -v to="$EPOCHREALTIME" -v name="$name" '
        NR == 2 { split($1, u, /[ms]/); split($2, s, /[ms]/)
                  printf "%.1f %.1f %s\n", to - from, 60 * (u[1] + s[1]) + u[2] + s[2], name }' "$log.times" >>"$times"
    rm "$log.times"
    # A skipped test is "ok N # SKIP" in TAP, and "not ok N # SKIP" in cmocka's.
    skip=$(grep -cE '^[[:space:]]*(not )?ok [0-9].*# ?[sS][kK][iI][pP]' "$log")
    ok=$(grep -E '^[[:space:]]*ok [0-9]' "$log" | grep -cvE '# ?[sS][kK][iI][pP]')
    bad=$(grep -E '^[[:space:]]*not ok [0-9]' "$log" | grep -cvE '# ?[sS][kK][iI][pP]')
    if [ "$bad" -eq 0 ] && { [ "$rc" -ne 0 ] || [ $((ok + skip)) -eq 0 ]; }; then bad=1; fi
    how="$ok ok, $bad failed, exit $rc"
    [ "$rc" -ne 124 ] || how="time-out after $limit_s s, $ok ok"
    if [ "$bad" -eq 0 ]; then
        echo "ok   $name ($ok)"
        what_runs "$@" >"$passed_as/${name//\//_}"
    elif [ "$alone" -eq 0 ] && [[ $name =~ $again ]]; then
        mv "$log" "${log%.log}.first.log"
        echo "$name $*" >>"$failed_once"
        printf '%s\n' "once $name ($how): it runs again at the end
$(faults_of "${log%.log}.first.log")"
        return
    else
        printf '%s\n' "FAIL $name ($how)
$(faults_of "$log")"
    fi
    echo "$ok $bad $skip" >>"$counts"
}

# The digest of the program or file in a command.
what_runs() {
    local word
    for word; do
        [[ $word == "$BUILD"/* || $word == tests/*.py ]] && { sha256sum "$word"; return; }
    done
}

# Of the commands from standard input those whose program or file is not as it was when it last passed; of farms those
# of the smoke test, too.
not_as_passed() {
    local name rest
    while read -r name rest; do
        # shellcheck disable=SC2086  # the words of a command
        [[ $name =~ $smoke ]] || ! what_runs $rest | cmp -s - "$passed_as/${name//\//_}" && echo "$name $rest"
    done
}

faults_of() {
    grep -vE '^[[:space:]]*ok |^# [|]' "$1" | tail -n 60 | sed 's/^/    /'
}

# Commands from standard input, a line each, in so many lanes.
run_lanes() {
    local lanes=$1 line
    while read -r line; do
        while [ "$(jobs -rp | wc -l)" -ge "$lanes" ]; do wait -n; done
        [ "$changed_only" = 0 ] || [ "$SECONDS" -lt "$CHANGED_S" ] || { echo "${line%% *}" >>"$left_out"; continue; }
        # shellcheck disable=SC2086  # the words of a command
        run_one $line &
    done
    wait
}

# Names and commands from standard input, those that took longest first.
slowest_first() {
    awk -v before="$logs/times-before" '
        BEGIN { while ((getline < before) > 0) took[$3] = $1 }
        { print ($1 in took ? took[$1] : 1) "\t" $0 }' |
        sort -srn | cut -f 2-
}

list_programs() {
    local test base
    for test in $(find tests/unit tests/statistics tests/numerics -name 'test_*.c' 2>/dev/null | sort); do
        [[ $test =~ $pattern ]] || continue
        skip_web "$test" >&2 && continue
        echo "${test%.c} nice $BUILD/${test%.c}"
    done
    for test in $(find tests/fuzz -name 'fuzz_*.c' 2>/dev/null | sort); do
        [[ $test =~ $pattern ]] || continue
        skip_web "$test" >&2 && continue
        base=$(basename "$test" .c)
        echo "tests/fuzz/$base nice $BUILD/tests/fuzz/${base}_replay tests/fuzz/corpus/${base#fuzz_}"
    done
}

list_farms() {
    local test
    for test in $(find tests/farm tests/web tests/blender -name 'test_*.py' 2>/dev/null | sort); do
        [[ $test =~ $pattern ]] || continue
        # The long ones about administration, unusual ways to the page and its edges: in make test-web.
        [[ $pattern == . && $test =~ ^tests/web/test_(admin|edges|ways)\.py$ ]] && continue
        # Two minutes of Blender: in make test-blender.
        [[ $pattern == . && $test =~ ^tests/blender/ ]] && continue
        skip_web "$test" >&2 && continue
        echo "$test $python $test"
    done
}

alone=0
in_order() {
    if [ "$changed_only" = 1 ]; then not_as_passed | slowest_first | tac; else slowest_first; fi
}
list_farms | in_order | run_lanes "$farm_lanes" &
list_programs | in_order | run_lanes "$compute_lanes" &
wait

alone=1
unsteady=0
while read -r line; do
    before=$(awk '{ f += $2 } END { print f + 0 }' "$counts")
    # shellcheck disable=SC2086  # the words of a command
    (run_one $line)  # a shell of its own, whose times are this test's
    if [ "$(awk '{ f += $2 } END { print f + 0 }' "$counts")" -eq "$before" ]; then
        echo "unsteady ${line%% *} (failed once, passed alone); both logs are in $logs"
        unsteady=$((unsteady + 1))
    fi
done <"$failed_once"
if [ "$unsteady" -gt "$UNSTEADY_MAX" ]; then
    echo "FAIL $unsteady files are unsteady; at most $UNSTEADY_MAX may be"
    echo "0 1 0" >>"$counts"
fi

[ ! -s "$left_out" ] || echo "left out, which make test runs: $(wc -l <"$left_out") files ($left_out)"
echo
echo "The slowest: seconds, of them CPU"
sort -rn "$times" | head -n 20 | awk '{ printf "%7.1f %6.1f  %s\n", $1, $2, $3 }'
awk -v wall="$SECONDS" '{ s += $2 } END { printf "Seconds in all: %d, of them CPU %.0f\n\n", wall, s }' "$times"
read -r passed failed skipped < <(awk '{ p += $1; f += $2; s += $3 } END { print p + 0, f + 0, s + 0 }' "$counts")
if [ "$skipped" -gt 0 ]; then
    echo "$passed passed, $failed failed, $skipped skipped"
else
    echo "$passed passed, $failed failed"
fi
[ "$failed" -eq 0 ]
