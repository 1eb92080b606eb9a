#!/usr/bin/env bash
# make new-tonemap NAME=x: a tone mapper's file, its row, a test and a section of the manual. What
# is made builds and passes; replace the curve, the source and the numbers. See docs/EXTENDING.md.
set -eu
cd "$(dirname "$0")/.."
name=${1:-}
if ! [[ $name =~ ^[a-z][a-z0-9_]*$ ]]; then
    echo "new-tonemap: NAME must be lower case letters, digits and _, as in: make new-tonemap NAME=filmic" >&2
    exit 2
fi
file=common/tonemap/$name.c test=tests/unit/tonemap/test_$name.c
for path in "$file" "$test"; do
    if [ -e "$path" ]; then
        echo "new-tonemap: $path exists already: choose another NAME" >&2
        exit 2
    fi
done
shown=${name//_/-}

cat >"$file" <<END
/* TODO: what the curve does, and its formula:
 *
 *   out = x / (1 + x / white)
 *
 * on each channel, light in and light out.
 */
#include <math.h>

#include "common/tonemap/operators.h"

enum { WHITE };

static const struct tonemap_parameter parameters[] = {
    [WHITE] = {"white", 0.1, 1000.0, 1.0, "the most that comes out", TONEMAP_NUMBER, NULL},
};

static void ${name}_row(const void *user, float *rgb, uint32_t width)
{
    const double white = *(const double *)user;

    for (size_t i = 0; i < (size_t)width * 3; i++) {
        double x = (double)rgb[i];
        rgb[i] = (float)fmin(x / (1.0 + x / white), 1.0);
    }
}

static status ${name}_apply(const struct tonemap_frame *frame, const double *state,
                            struct error *err)
{
    (void)state;
    (void)err;
    tonemap_each_row(frame, ${name}_row, &frame->values[WHITE]);
    return STATUS_OK;
}

const struct tonemap_operator tonemap_$name = {
    .name = "$shown",
    .summary = "TODO: one sentence.",
    .source = "TODO: author, title, where and when it was published",
    .parameters = parameters,
    .parameter_count = sizeof parameters / sizeof *parameters,
    .apply = ${name}_apply,
};
END

cat >"$test" <<END
/* $shown against numbers that its paper gives. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "common/tonemap/tonemap.h"

static void test_curve(void **state)
{
    /* TODO: light in, light out, computed elsewhere in double. */
    static const double probes[][2] = {{0, 0}, {0.18, 0.15254237}, {1, 0.5}, {3, 0.75}};
    struct tonemap_context context = {.threads = 1, .linear = 1};
    struct tonemap_settings settings;
    struct error err = {0};

    (void)state;
    assert_int_equal(tonemap_settings_init(&settings, "$shown", &err), STATUS_OK);
    for (size_t i = 0; i < sizeof probes / sizeof *probes; i++) {
        struct image in, out;
        assert_int_equal(image_init(&in, 1, 1, 3, &err), STATUS_OK);
        in.pixels[0] = in.pixels[1] = in.pixels[2] = (float)probes[i][0];
        assert_int_equal(tonemap_apply(&out, &in, &settings, &context, &err), STATUS_OK);
        assert_float_equal(out.pixels[0], probes[i][1], 1e-6);
        image_release(&in);
        image_release(&out);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_curve)};

    return cmocka_run_group_tests_name("$shown", tests, NULL, NULL);
}
END

python3 - "$name" "$shown" <<'END'
import sys
name, shown = sys.argv[1:]

path = "common/tonemap/operators.h"
text = open(path).read()
before = "    X(lut) "
assert before in text
row = "    X(%s)" % name
text = text.replace(before, row + " " * max(1, 29 - len(row)) + "\\\n" + before, 1)
open(path, "w").write(text)

path = "docs/TONEMAPPING.md"
text = open(path).read()
before = "### lut\n"
assert before in text
text = text.replace(before, "### %s\nTODO: source, what it does, parameters with ranges and presets.\n\n%s" % (shown, before), 1)
open(path, "w").write(text)
END

echo "made $file and $test; added a row to common/tonemap/operators.h and a section to docs/TONEMAPPING.md"
echo "next: replace what says TODO, then: make -s tests && tests/run.sh 'unit/tonemap'"
