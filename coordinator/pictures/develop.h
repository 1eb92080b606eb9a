/* develop: the one place that turns a film into files.
 *
 *   film --develop_frame--> EXR, manifest, and unless other frames' statistics count: PNG, JPEG
 *   stored pictures --develop_again--> PNG, JPEG, with the job's present output settings
 *
 * A development is made on the farm's thread (it copies what it needs of the job), run on any
 * thread, and freed. A frame's development reads the complete film itself, which no longer changes;
 * a preview's copies the film's present state.
 */
#pragma once

#include "common/base/buffer.h"
#include "common/base/status.h"
#include "common/image/image.h"
#include "coordinator/frame/frame.h"
#include "coordinator/job/queue.h"
#include "coordinator/store/store.h"

struct development;

/* ERR_NO_MEMORY, ERR_LIMIT. */
status development_new_frame(struct development **out, const struct job_frame *frame, struct error *err) MUST_CHECK;
/* Of the frame as it stands: its figures only (develop_figures), of a sample of frame->measure_tiles tiles, 0: of all. Then
 * development_take() until it returns 0. */
status development_new_measure(struct development **out, const struct job_frame *frame, struct error *err) MUST_CHECK;
/* The same for its picture. `look`: as in development_look; NULL: the job's. It is denoised by the fast method, if it is to be and is not larger
 * than this. */
enum { DEVELOP_DENOISED_PIXELS_MAX = 1 << 20 };
status development_new_preview(struct development **out, const struct job_frame *frame,
                               const struct output_settings *look, struct error *err) MUST_CHECK;
/* Copy the next tiles of the frame's film, which must be there, at most so many: a large one would hold the loop up. 0: it is
 * copied, and not looked at any more. */
enum { DEVELOP_TAKE_TILES = 512 };
int development_take(struct development *development);
/* Of a frame that is done, from its stored picture. */
status development_new_stored(struct development **out, const struct job *job, uint32_t frame,
                              struct error *err) MUST_CHECK;
void development_free(struct development *development);
/* Of a preview or a stored frame: tone map it with these settings instead of the job's, for develop_encode.
 * Which files there are stays the job's. */
void development_look(struct development *development, const struct output_settings *output);

/* Encode the frame's files, write them and its manifest, and note the frame as done. */
status develop_frame(struct development *development, struct store *store, struct error *err) MUST_CHECK;
/* Make the display pictures of a stored frame again, write them, and note it. Reads the stored
 * pictures of the frames whose statistics it is averaged with. */
status develop_again(struct development *development, struct store *store, struct error *err) MUST_CHECK;
/* Compute the figures, and keep them in the frame's history. */
status develop_figures(struct development *development, struct store *store, struct error *err) MUST_CHECK;
/* What figures were judged by, for the frame's next ones. */
struct frame_evidence development_evidence(const struct development *development);
/* What develop_figures or develop_frame found; NULL: nothing yet. */
const struct history_point *development_point(const struct development *development);
/* Of the picture without its noise, which this development made; NULL: it made none. */
const struct accuracy_figures *development_denoised(const struct development *development);
/* The frames around have changed since the frame was denoised, which is as before: its film was not kept. */
int development_is_as_before(const struct development *development);
/* The revision of the output settings used; -1 if the display pictures are left to develop_again. */
int64_t development_revision(const struct development *development);
/* Append the frame's manifest (common/scene/manifest.h) to `json`. */
status develop_manifest(struct development *development, const struct store *store, struct buffer *json,
                        struct error *err) MUST_CHECK;

/* The means of a frame that is done, from its files: 3 channels, or 4. ERR_NOT_FOUND: they are gone. */
status develop_read_picture(const struct store *store, uint64_t job, uint32_t frame, struct image *out,
                            struct error *err) MUST_CHECK;

/* The files' bytes, for previews and for tests; of a stored frame only the PNG; either buffer may be NULL. `store` may be NULL when
 * the tone mapping needs no file. A preview has no AOVs and averages no statistics, because earlier
 * frames may not be done. Its tiles without samples are filled from those around them (fill.h); its
 * header says which share has samples: azulejo:covered, 0..1. */
status develop_encode(struct development *development, const struct store *store, struct buffer *exr,
                      struct buffer *png, struct error *err) MUST_CHECK;
