/* Where -o puts the pictures. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "client/follow/destination.h"
#include "client/follow/fetch.h"
#include "client/options/job_options.h"
#include "tests/support/scratch_folder.h"

static void expect(const char *out, uint32_t frames, unsigned formats, uint32_t frame, const char *extension,
                   const char *path)
{
    struct destination d;
    struct buffer got = BUFFER_INIT;
    struct error err = {0};

    assert_int_equal(destination_init(&d, out, 0, "scene", frames, &err), STATUS_OK);
    assert_int_equal(d.formats, formats);
    destination_path(&d, frame, extension, &got);
    assert_string_equal(buffer_text(&got), path);
    buffer_release(&got);
    destination_release(&d);
}

static void names(void **state)
{
    (void)state;
    expect(NULL, 1, OUTPUT_FORMAT_BOTH, 1, "exr", "scene.exr");
    expect("", 1, OUTPUT_FORMAT_BOTH, 1, "exr", "scene.exr");
    expect(".", 1, OUTPUT_FORMAT_BOTH, 1, "png", "scene.png");
    expect("pic", 1, OUTPUT_FORMAT_BOTH, 1, "png", "pic.png");
    expect("out/pic", 1, OUTPUT_FORMAT_BOTH, 1, "png", "out/pic.png");
    expect("/pic", 1, OUTPUT_FORMAT_BOTH, 1, "png", "/pic.png");
    expect("out/", 1, OUTPUT_FORMAT_BOTH, 1, "png", "out/scene.png");
    expect("/tmp", 1, OUTPUT_FORMAT_BOTH, 1, "png", "/tmp/scene.png");
    expect("pic.exr", 1, OUTPUT_FORMAT_EXR, 1, "exr", "pic.exr");
    expect("out/pic.PNG", 1, OUTPUT_FORMAT_PNG, 1, "png", "out/pic.png");
    expect("pic.jpg", 1, OUTPUT_FORMAT_JPEG, 1, "jpg", "pic.jpg");
    expect("out/pic.jpeg", 3, OUTPUT_FORMAT_JPEG, 2, "jpg", "out/pic-0002.jpeg");
    /* Only the known extensions are taken off. */
    expect("v1.5", 1, OUTPUT_FORMAT_BOTH, 1, "exr", "v1.5.exr");
    expect("a.exr/pic", 1, OUTPUT_FORMAT_BOTH, 1, "exr", "a.exr/pic.exr");
}

/* Commands that bring a job's files: anything but a picture's file is a folder. */
static void of_jobs(void **state)
{
    static const struct {
        const char *out, *folder, *base;
        unsigned formats;
    } rows[] = {
        {NULL, ".", NULL, OUTPUT_FORMAT_ALL},        {"frames", "frames", NULL, OUTPUT_FORMAT_ALL},
        {"out/", "out/", NULL, OUTPUT_FORMAT_ALL},   {"v1.5", "v1.5", NULL, OUTPUT_FORMAT_ALL},
        {"pic.exr/", "pic.exr/", NULL, OUTPUT_FORMAT_ALL}, {"pic.exr", ".", "pic", OUTPUT_FORMAT_EXR},
        {"a/b.jpeg", "a", "b", OUTPUT_FORMAT_JPEG},  {"/tmp", "/tmp", NULL, OUTPUT_FORMAT_ALL},
    };
    struct destination d;
    struct error err = {0};

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        assert_int_equal(destination_of_job(&d, rows[i].out, OUTPUT_FORMAT_ALL, &err), STATUS_OK);
        assert_string_equal(d.folder, rows[i].folder);
        assert_int_equal(d.base == NULL, rows[i].base == NULL);
        if (d.base)
            assert_string_equal(d.base, rows[i].base);
        assert_int_equal(d.formats, rows[i].formats);
        destination_release(&d);
    }
    assert_int_equal(destination_of_job(&d, "a.exr", OUTPUT_FORMAT_PNG | OUTPUT_FORMAT_JPEG, &err), STATUS_ERR_USAGE);
}

static void formats_are_chosen(void **state)
{
    struct destination d;
    struct error err = {0};

    (void)state;
    assert_int_equal(destination_init(&d, "pic", OUTPUT_FORMAT_ALL, "scene", 1, &err), STATUS_OK);
    assert_int_equal(d.formats, OUTPUT_FORMAT_ALL);
    destination_release(&d);
    assert_int_equal(destination_init(&d, "pic.png", OUTPUT_FORMAT_PNG, "scene", 1, &err), STATUS_OK);
    destination_release(&d);
    assert_int_equal(destination_init(&d, "pic.png", OUTPUT_FORMAT_ALL, "scene", 1, &err), STATUS_ERR_USAGE);
    assert_non_null(strstr(err.text, "--format"));
}

static void frames_are_numbered(void **state)
{
    (void)state;
    expect("pic", 48, OUTPUT_FORMAT_BOTH, 7, "exr", "pic-0007.exr");
    expect("pic.exr", 48, OUTPUT_FORMAT_EXR, 12345, "exr", "pic-12345.exr");
    expect("out/", 2, OUTPUT_FORMAT_BOTH, 0, "png", "out/scene-0000.png");
}

static void folders_are_proved(void **state)
{
    char folder[SCRATCH_PATH];
    char path[64];
    struct error err = {0};

    (void)state;
    scratch_folder(folder);
    snprintf(path, sizeof path, "%s/a/b", folder);
    assert_int_equal(fetch_check_folder(path, &err), STATUS_OK);
    /* Nothing is left behind: the folders can be removed at once. */
    assert_int_equal(rmdir(path), 0);
    path[strlen(path) - 2] = 0;
    assert_int_equal(rmdir(path), 0);
    assert_int_equal(rmdir(folder), 0);
    assert_int_equal(fetch_check_folder("/dev/null", &err), STATUS_ERR_IO);
    assert_int_equal(fetch_check_folder("/dev/null/a", &err), STATUS_ERR_IO);
    assert_int_equal(fetch_check_folder("/proc", &err), STATUS_ERR_IO);
    assert_non_null(strstr(err.text, "/proc"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(names),
        cmocka_unit_test(of_jobs),
        cmocka_unit_test(formats_are_chosen),
        cmocka_unit_test(frames_are_numbered),
        cmocka_unit_test(folders_are_proved),
    };

    return cmocka_run_group_tests_name("client/destination", tests, NULL, NULL);
}
