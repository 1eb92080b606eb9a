#include "tests/support/pbrt_text.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "common/system/file.h"
#include "common/base/memory.h"
#include "tests/support/gltf_maker.h"
#include "tests/support/scratch_folder.h"

void pbrt_whole(const char *text, const char *folder, struct import_result *out)
{
    const struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct error err = {0};

    if (import_scene_memory(text, strlen(text), "a.pbrt", folder, &options, out, &err) != STATUS_OK)
        fail_msg("%s", err.text);
}

void pbrt_world(const char *world, struct import_result *out)
{
    struct buffer text = BUFFER_INIT;

    buffer_printf(&text, RIGHT_HANDED "WorldBegin\n%s", world);
    pbrt_whole(buffer_text(&text), NULL, out);
    buffer_release(&text);
}

status pbrt_read_only(const char *text)
{
    const struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct import_result result;
    struct error err = {0};
    status s = import_scene_memory(text, strlen(text), "a.pbrt", NULL, &options, &result, &err);

    import_result_release(&result);
    return s;
}

void pbrt_refused(const char *text, const char *words)
{
    const struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct import_result result;
    struct error err = {0};

    assert_int_not_equal(import_scene_memory(text, strlen(text), "a.pbrt", NULL, &options, &result, &err), STATUS_OK);
    assert_says(&err, words);
    assert_int_equal(result.blob_count, 0);
    import_result_release(&result);
}

int pbrt_has_warned(const struct import_result *r, const char *words)
{
    for (size_t i = 0; i < r->warning_count; i++) {
        char list[256], *rest, *word;
        int all = 1;
        snprintf(list, sizeof list, "%s", words);
        for (word = strtok_r(list, "|", &rest); word; word = strtok_r(NULL, "|", &rest))
            all = all && strstr(r->warnings[i], word);
        if (all)
            return 1;
    }
    return 0;
}

void pbrt_warned(const struct import_result *r, const char *words)
{
    if (pbrt_has_warned(r, words))
        return;
    for (size_t i = 0; i < r->warning_count; i++)
        print_error("warning: %s\n", r->warnings[i]);
    fail_msg("no warning says \"%s\"", words);
}

struct scene_material pbrt_material_of(const char *directive, struct import_result *out)
{
    struct buffer text = BUFFER_INIT;

    buffer_printf(&text, RIGHT_HANDED "WorldBegin\n" LAMP "%s\n" TRIANGLE, directive);
    pbrt_whole(buffer_text(&text), NULL, out);
    buffer_release(&text);
    assert_int_equal(out->scene.instance_count, 1);
    return out->scene.materials[out->scene.instances[0].material];
}

char *pbrt_folder_make(void)
{
    char folder[SCRATCH_PATH], *copy;

    scratch_folder(folder);
    copy = mem_strdup(folder);
    assert_non_null(copy);
    return copy;
}

void pbrt_folder_put(const char *folder, const char *name, const void *data, size_t size_bytes)
{
    char *path = file_join(folder, name);

    assert_non_null(path);
    assert_int_equal(file_write_atomic(path, data, size_bytes, NULL), STATUS_OK);
    mem_free(path);
}

void pbrt_folder_remove(char *folder)
{
    DIR *open = opendir(folder);

    assert_non_null(open);
    for (struct dirent *entry = readdir(open); entry; entry = readdir(open)) {
        char *path = file_join(folder, entry->d_name);
        if (entry->d_name[0] != '.')
            assert_int_equal(unlink(path), 0);
        mem_free(path);
    }
    closedir(open);
    assert_int_equal(rmdir(folder), 0);
    mem_free(folder);
}
