/* develop: the one place that turns a film into files.
 *
 * A development is made on the farm's thread (it copies what it needs of the job), run on any
 * thread, and freed. A frame's development reads the complete film itself, which no longer changes;
 * a preview's copies the film's present state.
 */
#ifndef AZULEJO_COORDINATOR_DEVELOP_H
#define AZULEJO_COORDINATOR_DEVELOP_H

#include "common/base/buffer.h"
#include "common/base/status.h"
#include "coordinator/frame.h"
#include "coordinator/queue.h"
#include "coordinator/store.h"

struct development;

/* ERR_NO_MEMORY, ERR_LIMIT. */
status development_new_frame(struct development **out, const struct job_frame *frame,
                             struct error *err) MUST_CHECK;
status development_new_preview(struct development **out, const struct job_frame *frame,
                               struct error *err) MUST_CHECK;
void development_free(struct development *development);

/* Encode the frame's files, write them and its manifest, and note the frame as done. */
status develop_frame(struct development *development, struct store *store, struct error *err)
    MUST_CHECK;
/* Append the preview as PNG to `png`. */
status develop_preview(struct development *development, struct buffer *png, struct error *err)
    MUST_CHECK;

/* Append the frame's manifest (common/scene/manifest.h) to `json`. */
status develop_manifest(const struct development *development, const struct store *store,
                        struct buffer *json, struct error *err) MUST_CHECK;

/* The files' bytes, for develop_frame and for tests; either buffer may be NULL. */
status develop_encode(struct development *development, struct buffer *exr, struct buffer *png,
                      struct error *err) MUST_CHECK;

#endif
