/* needs_options: the options that say what a job waits for and which workers it needs. */
#ifndef AZULEJO_CLIENT_NEEDS_OPTIONS_H
#define AZULEJO_CLIENT_NEEDS_OPTIONS_H

#include "common/base/options.h"
#include "common/base/tags.h"
#include "protocol/azulejo.pb-c.h"

struct needs_options {
    const char *after, *not_before, *require;
    uint64_t memory;             /* UINT64_MAX: the coordinator estimates it */
};

#define NEEDS_OPTIONS_INIT {.memory = UINT64_MAX}

#define NEEDS_OPTION_ROWS(o)                                                                    \
    {"after", 0, OPTION_STRING, &(o).after, "JOB[,JOB]...",                                     \
     "wait until these jobs are done; 'azulejo start' ends the wait", 0, 0, NULL},              \
    {"not-before", 0, OPTION_STRING, &(o).not_before, "TIME",                                   \
     "wait until then: 20:00, '2026-03-01 20:00', 2026-03-01T20:00:00Z, or 2h from now", 0, 0, NULL}, \
    {"require", 0, OPTION_STRING, &(o).require, "TAG[,TAG]...",                                 \
     "only workers with all of these tags render it", 0, 0, NULL},     \
    {"memory", 0, OPTION_SIZE, &(o).memory, "SIZE",                                           \
     "only machines with this much memory render it, as in 12G; 0: any (default: an estimate "   \
     "from the scene's files and triangles)", 0, 0, NULL}

/* What they say. */
enum { NEEDS_AFTER_MAX = 32 };   /* the coordinator's limit */
struct needs_request {
    uint64_t after[NEEDS_AFTER_MAX];
    size_t after_count;
    int64_t not_before;
    char require[TAGS_TEXT_MAX + 1];
    uint64_t memory;
    int memory_said;
};

/* Call before the scene is read. ERR_USAGE. */
status needs_options_check(const struct needs_options *o, struct needs_request *out, struct error *err)
    MUST_CHECK;
/* `submit` points at `needs` afterwards. */
void needs_request_set(Azulejo__Wire__JobSubmit *submit, struct needs_request *needs);

#endif
