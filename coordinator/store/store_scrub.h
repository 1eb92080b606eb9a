/* store_scrub: looks for what flipped or was cut at rest, in a store that is in use: blobs, outputs, rows of the database,
 * over and over.
 *
 *   blobs    a damaged one is removed, and asked for again as one that is lost
 *   outputs  a damaged one is noted as if it had been fetched (store_output_check): it is made again
 *   rows     of a job: its number is in the report, and its row is written again from memory. Of anything else: said only
 *
 * It holds no more than the names of one folder. One thread at a time. */
#pragma once

#include <stdint.h>

#include "common/base/status.h"

struct store;
struct scrub;

enum { SCRUB_FAULTS_MAX = 16, SCRUB_LINE = 320 };

/* Of one step. */
struct scrub_report {
    uint64_t files;  /* looked at to their ends, */
    uint32_t faults; /* of which these were damaged; rows count as files */
    uint32_t line_count;
    char lines[SCRUB_FAULTS_MAX][SCRUB_LINE]; /* what, where, and what becomes of it; of the first ones */
    uint32_t job_count;
    uint64_t jobs[SCRUB_FAULTS_MAX]; /* whose rows are to be written again */
    int is_round;                    /* everything has been looked at once */
};

struct scrub *scrub_new(struct store *store); /* NULL: out of memory */
void scrub_free(struct scrub *scrub);         /* NULL is fine */
/* Look on, at no more than so many bytes. What cannot be read is skipped. [any thread] */
void scrub_step(struct scrub *scrub, uint64_t bytes, struct scrub_report *report);
