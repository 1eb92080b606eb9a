#include "coordinator/job/needs.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "common/base/bytes_text.h"
#include "common/base/memory.h"
#include "common/scene/scene.h"

/* Embree's tree and the arrays that it keeps, for each triangle of a mesh (tests/farm/test_order.py compares
 * it with a worker's memory). */
enum { TREE_BYTES_PER_TRIANGLE = 64 };

uint64_t need_of_scene(const struct scene *scene, uint64_t packed_bytes)
{
    struct scene_blob *blobs = NULL;
    struct error err = {0};
    uint64_t need = packed_bytes;
    size_t count = 0;

    if (scene_blobs(scene, &blobs, &count, &err) != STATUS_OK)
        return 0;
    for (size_t i = 0; i < count; i++)
        need += blobs[i].size_bytes;
    mem_free(blobs);
    for (uint32_t i = 0; i < scene->mesh_count; i++)
        need += (uint64_t)scene->meshes[i].triangle_count * TREE_BYTES_PER_TRIANGLE;
    return need;
}

int needs_fit(const struct job_needs *needs, uint64_t job, const char *tags, uint64_t memory, char *why,
              size_t why_size)
{
    char has[BYTES_TEXT_SIZE], wants[BYTES_TEXT_SIZE], missing[TAG_MAX + 1];

    if (!tags_have(tags, needs->require, missing)) {
        snprintf(why, why_size, "it has no tag %s, which job %" PRIu64 " requires", missing, job);
        return 0;
    }
    if (memory > 0 && needs->memory > memory) {
        snprintf(why, why_size, "it has %s of memory, and job %" PRIu64 " needs %s%s", bytes_text(has, memory), job,
                 needs->memory_said ? "" : "an estimated ", bytes_text(wants, needs->memory));
        return 0;
    }
    return 1;
}

void needs_waited(struct job_needs *needs)
{
    needs->after_count = 0;
    needs->not_before = 0;
}

const char *needs_after_text(char out[NEEDS_AFTER_TEXT_SIZE], const struct job_needs *needs)
{
    size_t used = 0;

    out[0] = 0;
    for (uint32_t i = 0; i < needs->after_count; i++)
        used += (size_t)snprintf(out + used, NEEDS_AFTER_TEXT_SIZE - used, "%s%" PRIu64, i ? "," : "", needs->after[i]);
    return out;
}

void needs_after_parse(struct job_needs *needs, const char *text)
{
    needs->after_count = 0;
    while (*text && needs->after_count < JOB_AFTER_MAX) {
        char *end;
        uint64_t job = strtoull(text, &end, 10);
        if (end == text)
            return;
        needs->after[needs->after_count++] = job;
        text = end + (*end == ',');
    }
}
