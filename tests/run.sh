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
passed=0 failed=0 skipped=0
logs=$BUILD/test-logs
mkdir -p "$logs"

# A build without the page (make WEB=0) skips its tests, by name.
skip_web() {
    [ "${WEB:-1}" = 0 ] || return 1
    [[ $1 =~ ^tests/web/|test_web_[a-z_]*\.py$ ]] || { [[ $1 =~ \.c$ ]] && grep -q '"coordinator/web/' "$1"; } || return 1
    echo "skip $1 (this build has no page: WEB=0)"
    skipped=$((skipped + 1))
}

run_one() {
    local name=$1 log ok bad skip rc
    shift
    log=$logs/$(echo "$name" | tr '/' '_').log
    timeout "$limit_s" "$@" >"$log" 2>&1 </dev/null
    rc=$?
    # A skipped test is "ok N # SKIP" in TAP, and "not ok N # SKIP" in cmocka's.
    skip=$(grep -cE '^[[:space:]]*(not )?ok [0-9].*# ?[sS][kK][iI][pP]' "$log")
    ok=$(grep -E '^[[:space:]]*ok [0-9]' "$log" | grep -cvE '# ?[sS][kK][iI][pP]')
    bad=$(grep -E '^[[:space:]]*not ok [0-9]' "$log" | grep -cvE '# ?[sS][kK][iI][pP]')
    if [ "$bad" -eq 0 ] && { [ "$rc" -ne 0 ] || [ $((ok + skip)) -eq 0 ]; }; then bad=1; fi
    passed=$((passed + ok)) failed=$((failed + bad)) skipped=$((skipped + skip))
    if [ "$bad" -gt 0 ]; then
        echo "FAIL $name ($ok ok, $bad failed, exit $rc)"
        grep -vE '^[[:space:]]*ok ' "$log" | tail -n 60 | sed 's/^/    /'
    else
        echo "ok   $name ($ok)"
    fi
}

for test in $(find tests/unit tests/statistics tests/numerics -name 'test_*.c' 2>/dev/null | sort); do
    [[ $test =~ $pattern ]] || continue
    skip_web "$test" && continue
    run_one "${test%.c}" "$BUILD/${test%.c}"
done
for target in $(find tests/fuzz -name 'fuzz_*.c' 2>/dev/null | sort); do
    [[ $target =~ $pattern ]] || continue
    skip_web "$target" && continue
    base=$(basename "$target" .c)
    run_one "tests/fuzz/$base" "$BUILD/tests/fuzz/${base}_replay" "tests/fuzz/corpus/${base#fuzz_}"
done
for test in $(find tests/farm tests/fault tests/web -name 'test_*.py' 2>/dev/null | sort); do
    [[ $test =~ $pattern ]] || continue
    # The long ones about administration and unusual ways to the page: in make test-web.
    [[ $pattern == . && $test =~ ^tests/web/test_(admin|ways)\.py$ ]] && continue
    skip_web "$test" && continue
    run_one "$test" python3 "$test"
done
echo
if [ "$skipped" -gt 0 ]; then
    echo "$passed passed, $failed failed, $skipped skipped"
else
    echo "$passed passed, $failed failed"
fi
[ "$failed" -eq 0 ]
