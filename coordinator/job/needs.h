/* needs: which workers a job fits (job_needs.h), and what its scene needs of them. */
#pragma once

#include <stddef.h>

#include "common/schema/job_needs.h"

struct scene;

/* What a worker needs at least for the scene, besides the program: the bytes of its meshes, images and grids
 * as files, and what Embree's tree takes for so many triangles. Images that are unpacked take more. */
uint64_t need_of_scene(const struct scene *scene, uint64_t packed_bytes);

/* Do a worker's tags and memory (0: not known) suffice? If not, `why` says what it lacks; size 0: it is not wanted. */
int needs_fit(const struct job_needs *needs, uint64_t job, const char *tags, uint64_t memory, char *why,
              size_t why_size);

/* The jobs that are waited for as text, "3,17", and back: for the store. A text that is damaged gives fewer. */
enum { NEEDS_AFTER_TEXT_SIZE = JOB_AFTER_MAX * 21 + 1 };
const char *needs_after_text(char out[NEEDS_AFTER_TEXT_SIZE], const struct job_needs *needs);
void needs_after_parse(struct job_needs *needs, const char *text);
/* It waits for no job and no moment any more. */
void needs_waited(struct job_needs *needs);
