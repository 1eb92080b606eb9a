/* record_hooks: how a kernel writes down what its path does (record.h).
 *
 * Only where KERNEL_RECORDS is 1, in kernels/recording.c, do the macros say anything; in every other kernel
 * they are nothing at all. A hook reads what the path computed and changes none of it.
 */
#ifndef AZULEJO_RENDER_RECORD_HOOKS_H
#define AZULEJO_RENDER_RECORD_HOOKS_H

#include "worker/render/record.h"

#ifndef KERNEL_RECORDS
#define KERNEL_RECORDS 0
#endif

/* Where the thread writes; NULL: no record is wanted. */
extern _Thread_local struct sample_record *record_now;

/* The vertex being written, NULL: none. */
struct record_vertex *record_vertex(void);
/* The next vertex, with everything absent. */
struct record_vertex *record_vertex_next(void);
/* The light that was chosen: a row of LIGHT_KINDS and what it samples. */
void record_light_kind(const struct render_scene *scene, int kind, const char *text,
                       const void *light);

#if KERNEL_RECORDS
/* RECORD(statements): `recorded` is the vertex being written. */
#define RECORD(...)                                         \
    do {                                                    \
        struct record_vertex *recorded = record_vertex();   \
        if (recorded) {                                     \
            __VA_ARGS__;                                    \
        }                                                   \
    } while (0)
/* The first reason counts. */
#define RECORD_END(NAME)                                            \
    do {                                                            \
        if (record_now && record_now->end == RECORD_END_NONE)       \
            record_now->end = RECORD_END_##NAME;                    \
    } while (0)
#define RECORD_BEGIN(path, met, v) record_begin(path, met, v)
#else
#define RECORD(...) ((void)0)
#define RECORD_BEGIN(path, met, v) ((void)0)
#define RECORD_END(NAME) ((void)0)
#endif

#endif
