/* needs: what must be true before a job is lent to workers, and on which of them.
 *
 * after       other jobs that must have been done. One that failed, was cancelled or was removed before it
 *             was done is waited for on and on: a retry may still finish it, and only a person can say
 *             that this job makes sense without it (steer_start). A job that was done once, also early,
 *             leaves the list: extending it later changes nothing.
 * not_before  a moment.
 * require     tags that a worker must have.
 * memory      that a worker must have; an estimate (need_of_scene) unless a person said it.
 */
#ifndef AZULEJO_COORDINATOR_NEEDS_H
#define AZULEJO_COORDINATOR_NEEDS_H

#include <stddef.h>
#include <stdint.h>

#include "common/base/tags.h"

enum { JOB_AFTER_MAX = 32 };

struct job_needs {
    uint64_t after[JOB_AFTER_MAX];
    uint32_t after_count;
    int64_t not_before;          /* seconds since 1970; 0: any time */
    char require[TAGS_TEXT_MAX + 1]; /* as made by tags_parse */
    uint64_t memory;             /* bytes; 0: not known */
    int memory_said;             /* by a person; then 0 means any */
};

struct scene;

/* What a worker needs at least for the scene, besides the program: the bytes of its meshes, images and grids
 * as files, and what Embree's tree takes for so many triangles. Images that are unpacked take more. */
uint64_t need_of_scene(const struct scene *scene, uint64_t packed_bytes);

/* Do a worker's tags and memory (0: not known) suffice? If not, `why` says what it lacks; size 0: it is not
 * wanted. */
int needs_fit(const struct job_needs *needs, uint64_t job, const char *tags, uint64_t memory, char *why,
              size_t why_size);

/* The jobs that are waited for as text, "3,17", and back: for the store. A text that is damaged gives fewer. */
enum { NEEDS_AFTER_TEXT_SIZE = JOB_AFTER_MAX * 21 + 1 };
const char *needs_after_text(char out[NEEDS_AFTER_TEXT_SIZE], const struct job_needs *needs);
void needs_after_parse(struct job_needs *needs, const char *text);

#endif
