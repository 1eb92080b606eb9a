#!/usr/bin/env bash
# clang-tidy and cppcheck over the sources; exits 1 when either finds something. Optional
# tools: apt-get install clang-tidy cppcheck. scripts/lint.sh FILE... looks at those only.
set -u
cd "$(dirname "$0")/.."
make -s build/gen/protocol/azulejo.pb-c.h build/gen/common/scene/scene.pb-c.h
if [ $# -gt 0 ]; then files=("$@"); else mapfile -t files < <(git ls-files '*.c' | grep -v '^tests/'); fi
found=0
flags=(-std=c17 -D_GNU_SOURCE "-DAZULEJO_VERSION=\"lint\"" -DAZULEJO_EMBREE=3 -I. -Ibuild/gen)
read -ra packages <<<"$(pkg-config --cflags libuv openssl sqlite3 jansson libpng OpenEXR libprotobuf-c)"
if command -v cppcheck >/dev/null; then
    cppcheck --quiet --std=c11 --enable=warning,performance,portability --inline-suppr --error-exitcode=1 \
        --suppress=missingInclude --suppress=missingIncludeSystem --suppress=normalCheckLevelMaxBranches \
        -j "$(nproc)" "${flags[@]:1:3}" -I. "${files[@]}" || found=1
else
    echo "cppcheck is not installed" >&2
fi
if command -v clang-tidy >/dev/null; then
    printf "%s\n" "${files[@]}" | xargs -P "$(nproc)" -I{} clang-tidy {} --quiet --warnings-as-errors='*' \
        --checks='-*,bugprone-*,clang-analyzer-core.*,clang-analyzer-unix.*,clang-analyzer-deadcode.*,-bugprone-easily-swappable-parameters,-bugprone-narrowing-conversions,-bugprone-implicit-widening-of-multiplication-result,-bugprone-reserved-identifier,-bugprone-branch-clone,-bugprone-macro-parentheses,-bugprone-assignment-in-if-condition,-bugprone-suspicious-include,-bugprone-sizeof-expression,-bugprone-suspicious-memory-comparison,-bugprone-integer-division,-bugprone-misplaced-widening-cast,-bugprone-too-small-loop-variable,-clang-analyzer-core.DivideZero,-clang-analyzer-core.CallAndMessage' \
        -- "${flags[@]}" "${packages[@]}" || found=1
else
    echo "clang-tidy is not installed" >&2
fi
exit "$found"
