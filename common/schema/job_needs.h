/* job_needs: what must be true before a job is lent to workers, and on which of them.
 *
 * after       other jobs that must have been done. One that failed, was cancelled or was removed before it
 *             was done is waited for on and on: a retry may still finish it, and only a person can say
 *             that this job makes sense without it (steer_start). A job that was done once, also early,
 *             leaves the list: extending it later changes nothing.
 * not_before  a moment.
 * require     tags that a worker must have.
 * memory      that a worker must have; an estimate (need_of_scene) unless a person said it.
 *
 * The settings of JOB_NEEDS (settings.h) are members, too. */
#pragma once

#include "common/base/tags.h"
#include "common/schema/settings.h"

enum { JOB_AFTER_MAX = 32 };

struct job_needs {
    uint64_t after[JOB_AFTER_MAX];
    uint32_t after_count;
    int64_t not_before;              /* seconds since 1970; 0: any time */
    char require[TAGS_TEXT_MAX + 1]; /* as made by tags_parse */
    uint64_t memory;                 /* bytes; 0: not known */
    int memory_said;                 /* by a person; then 0 means any */
#define NEED_OPTION(...)
#define NEED_SETTING(o, KIND, type, name, ...) type name;
    JOB_NEEDS(NEED_OPTION, NEED_SETTING, )
#undef NEED_OPTION
#undef NEED_SETTING
};

enum need_name {
#define NEED_OPTION(o, name, ...) NEED_##name,
#define NEED_SETTING(o, KIND, type, name, ...) NEED_##name,
    JOB_NEEDS(NEED_OPTION, NEED_SETTING, )
#undef NEED_OPTION
#undef NEED_SETTING
    NEED_COUNT
};
extern const struct setting job_needs_rows[NEED_COUNT];
