/* wire: converts a job's description between messages and C types. */
#pragma once

#include "common/base/buffer.h"
#include "coordinator/job/queue.h"
#include "protocol/azulejo.pb-c.h"

/* A digest of exactly the settings that decide the display values. */
status wire_output_digest(struct digest *out, const struct output_settings *in, struct error *err) MUST_CHECK;

/* Tone mapping settings as bytes, to be stored, and back. ERR_CORRUPT. */
status wire_tonemap_pack(const struct tonemap_settings *in, struct buffer *out, struct error *err) MUST_CHECK;
status wire_tonemap_unpack(struct tonemap_settings *out, const void *data, size_t size_bytes,
                           struct error *err) MUST_CHECK;

/* A new job in state QUEUED from a JobSubmit, every range checked. ERR_INPUT, ERR_PROTOCOL,
 * ERR_LIMIT, ERR_NO_MEMORY. `camera_count`: of its scene, UINT32_MAX when not known. */
status wire_job_get(struct job **out, const Azulejo__Wire__JobSubmit *in, uint32_t camera_count,
                    struct error *err) MUST_CHECK;

/* The JobSubmit of a job as bytes, for the store, and back. ERR_CORRUPT. */
status wire_job_pack(const struct job *job, struct buffer *out, struct error *err) MUST_CHECK;
/* Are both the same, apart from what can be changed later: output settings, priority and needs? */
status wire_job_same(const struct job *a, const struct job *b, int *same, struct error *err) MUST_CHECK;
/* Is `estimate` an estimate of this job: the same scene, frames and settings except the cap, and no
 * more samples than the job allows? */
status wire_job_estimated(const struct job *estimate, const struct job *job, int *same, struct error *err) MUST_CHECK;
status wire_job_unpack(struct job **out, const void *data, size_t size_bytes, struct error *err) MUST_CHECK;

/* A point of a frame's history, and what its message points at, if that is known. Stays where it is. */
struct wire_point {
    Azulejo__Wire__HistoryPoint message;
    Azulejo__Wire__Figures figures, denoised;
};
void wire_point_set(struct wire_point *out, const struct history_point *point);
