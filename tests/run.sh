#!/usr/bin/env bash
# Run every test and end with "N passed, N failed". A test is a program or script that
# prints TAP lines ("ok N - name", "not ok N - name"); one that prints none, dies or runs
# past its limit counts as one failure. BUILD names the build tree.
# tests/run.sh PATTERN runs only the tests whose path matches.
set -u
cd "$(dirname "$0")/.."
export BUILD=${BUILD:-build/release}
export CMOCKA_MESSAGE_OUTPUT=TAP
export ASAN_OPTIONS=${ASAN_OPTIONS:-detect_leaks=1:abort_on_error=0:allocator_may_return_null=1}
export UBSAN_OPTIONS=${UBSAN_OPTIONS:-print_stacktrace=1}
export TSAN_OPTIONS=${TSAN_OPTIONS:-suppressions=$PWD/tests/support/tsan.supp:halt_on_error=0:exitcode=66}
export LSAN_OPTIONS=${LSAN_OPTIONS:-suppressions=$PWD/tests/support/lsan.supp}
pattern=${1:-.}
limit_s=${TEST_LIMIT_S:-900}
lanes=${TEST_LANES:-$(nproc)}
logs=$BUILD/test-logs
counts=$logs/counts
mkdir -p "$logs"
: >"$counts"

# A build without the page (make WEB=0) skips its tests, by name.
skip_web() {
    [ "${WEB:-1}" = 0 ] || return 1
    [[ $1 =~ ^tests/web/|test_web_[a-z_]*\.py$ ]] || { [[ $1 =~ \.c$ ]] && grep -q '"coordinator/web/' "$1"; } || return 1
    echo "skip $1 (this build has no page: WEB=0)"
    echo "0 0 1" >>"$counts"
}

run_one() {
    local name=$1 log ok bad skip rc began=$SECONDS
    shift
    log=$logs/$(echo "$name" | tr '/' '_').log
    timeout "$limit_s" "$@" >"$log" 2>&1 </dev/null
    rc=$?
    # A skipped test is "ok N # SKIP" in TAP, and "not ok N # SKIP" in cmocka's.
    skip=$(grep -cE '^[[:space:]]*(not )?ok [0-9].*# ?[sS][kK][iI][pP]' "$log")
    ok=$(grep -E '^[[:space:]]*ok [0-9]' "$log" | grep -cvE '# ?[sS][kK][iI][pP]')
    bad=$(grep -E '^[[:space:]]*not ok [0-9]' "$log" | grep -cvE '# ?[sS][kK][iI][pP]')
    if [ "$bad" -eq 0 ] && { [ "$rc" -ne 0 ] || [ $((ok + skip)) -eq 0 ]; }; then bad=1; fi
    # One write each, so that tests side by side do not mix their lines.
    echo "$ok $bad $skip" >>"$counts"
    if [ "$bad" -gt 0 ]; then
        printf '%s\n' "FAIL $name ($ok ok, $bad failed, exit $rc, $((SECONDS - began)) s)
$(grep -vE '^[[:space:]]*ok ' "$log" | tail -n 60 | sed 's/^/    /')"
    else
        echo "ok   $name ($ok, $((SECONDS - began)) s)"
    fi
}

# Programs that use one core run side by side; farms, which use all of them, one after the other.
in_lane() {
    while [ "$(jobs -rp | wc -l)" -ge "$lanes" ]; do wait -n; done
    run_one "$@" &
}

for test in $(find tests/unit tests/statistics tests/numerics -name 'test_*.c' 2>/dev/null | sort); do
    [[ $test =~ $pattern ]] || continue
    skip_web "$test" && continue
    in_lane "${test%.c}" "$BUILD/${test%.c}"
done
for target in $(find tests/fuzz -name 'fuzz_*.c' 2>/dev/null | sort); do
    [[ $target =~ $pattern ]] || continue
    skip_web "$target" && continue
    base=$(basename "$target" .c)
    in_lane "tests/fuzz/$base" "$BUILD/tests/fuzz/${base}_replay" "tests/fuzz/corpus/${base#fuzz_}"
done
wait
for test in $(find tests/farm tests/fault tests/web -name 'test_*.py' 2>/dev/null | sort); do
    [[ $test =~ $pattern ]] || continue
    # The long ones about administration, unusual ways to the page and its edges: in make test-web.
    [[ $pattern == . && $test =~ ^tests/web/test_(admin|edges|ways)\.py$ ]] && continue
    skip_web "$test" && continue
    run_one "$test" python3 "$test"
done
echo
read -r passed failed skipped < <(awk '{ p += $1; f += $2; s += $3 } END { print p + 0, f + 0, s + 0 }' "$counts")
if [ "$skipped" -gt 0 ]; then
    echo "$passed passed, $failed failed, $skipped skipped"
else
    echo "$passed passed, $failed failed"
fi
[ "$failed" -eq 0 ]
