/* What jobs need of workers, and the estimate of memory. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "common/base/bytes_text.h"
#include "common/scene/scene.h"
#include "coordinator/job/needs.h"

#define GIB ((uint64_t)1 << 30)

static void fits(void **state)
{
    struct job_needs needs = {.require = "big,gpu", .memory = 12 * GIB};
    char why[256];

    (void)state;
    assert_true(needs_fit(&needs, 3, "big,fast,gpu", 16 * GIB, why, sizeof why));
    assert_true(needs_fit(&needs, 3, "big,gpu", 12 * GIB, why, sizeof why));
    assert_true(needs_fit(&needs, 3, "big,gpu", 0, why, sizeof why)); /* it does not say */
    assert_false(needs_fit(&needs, 3, "big", 16 * GIB, why, sizeof why));
    assert_string_equal(why, "it has no tag gpu, which job 3 requires");
    assert_false(needs_fit(&needs, 3, "big,gpu", 8 * GIB, why, sizeof why));
    assert_string_equal(why, "it has 8.0 GiB of memory, and job 3 needs an estimated 12.0 GiB");
    needs.memory_said = 1;
    assert_false(needs_fit(&needs, 3, "big,gpu", 8 * GIB, why, sizeof why));
    assert_string_equal(why, "it has 8.0 GiB of memory, and job 3 needs 12.0 GiB");
    needs.memory = 0;
    assert_true(needs_fit(&needs, 3, "big,gpu", 1, NULL, 0));
}

static void words(void **state)
{
    char text[BYTES_TEXT_SIZE];

    (void)state;
    assert_string_equal(bytes_text(text, 512), "512 B");
    assert_string_equal(bytes_text(text, 300 << 20), "300.0 MiB");
    assert_string_equal(bytes_text(text, 12 * GIB + GIB / 2), "12.5 GiB");
    assert_string_equal(bytes_text(text, 2048 * GIB), "2.0 TiB");
    assert_string_equal(bytes_text(text, UINT64_MAX), "16.0 EiB");
}

static void jobs_as_text(void **state)
{
    struct job_needs needs = {.after = {3, 17, UINT64_MAX}, .after_count = 3}, back = {0};
    char text[NEEDS_AFTER_TEXT_SIZE];

    (void)state;
    assert_string_equal(needs_after_text(text, &needs), "3,17,18446744073709551615");
    needs_after_parse(&back, text);
    assert_int_equal(back.after_count, 3);
    assert_memory_equal(back.after, needs.after, 3 * sizeof *needs.after);
    needs_after_parse(&back, "");
    assert_int_equal(back.after_count, 0);
    needs_after_parse(&back, "5,x");
    assert_int_equal(back.after_count, 1);
    needs.after_count = JOB_AFTER_MAX;
    for (uint32_t i = 0; i < JOB_AFTER_MAX; i++)
        needs.after[i] = UINT64_MAX;
    assert_int_equal(strlen(needs_after_text(text, &needs)), NEEDS_AFTER_TEXT_SIZE - 2);
}

static void a_blob_counts_once(void **state)
{
    struct scene_mesh meshes[3] = {{.triangle_count = 1000}, {.triangle_count = 1000}, {.triangle_count = 10}};
    struct scene scene;
    uint64_t one;

    (void)state;
    scene_init(&scene);
    scene.meshes = meshes;
    for (int i = 0; i < 3; i++)
        meshes[i].blob.size_bytes = i < 2 ? 50000 : 700;
    meshes[2].blob.digest.bytes[0] = 1;
    scene.mesh_count = 1;
    one = need_of_scene(&scene, 300);
    assert_in_range(one, 50300 + 30 * 1000, 50300 + 100 * 1000);
    scene.mesh_count = 3;
    assert_in_range(need_of_scene(&scene, 300) - one, 700 + 30 * 1010, 700 + 100 * 1010);
    scene.mesh_count = 0;
    scene.meshes = NULL;
    scene_release(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fits),
        cmocka_unit_test(words),
        cmocka_unit_test(jobs_as_text),
        cmocka_unit_test(a_blob_counts_once),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
