/* A job's video from its pictures. */
#include <inttypes.h>
#include <stdio.h>

#include "client/follow/fetch.h"
#include "client/options/output.h"
#include "client/follow/video.h"

#define FPS_DEFAULT 24.0 /* the wire's, where it says 0 */

static status check(const struct job_fetch *f, Azulejo__Wire__OutputKind *kind, struct error *err)
{
    unsigned formats = f->job->output ? output_message_formats(f->job->output) : 0;

    if (f->job->first_frame == f->job->last_frame)
        return error_set(err, STATUS_ERR_USAGE, "--video: job %" PRIu64 " has one frame only", f->job->job);
    if (!(formats & (OUTPUT_FORMAT_PNG | OUTPUT_FORMAT_JPEG)))
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         "--video: job %" PRIu64 " makes no PNG and no JPEG: 'azulejo develop %" PRIu64
                         " --format png' makes them",
                         f->job->job, f->job->job);
    *kind =
        formats & OUTPUT_FORMAT_PNG ? AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PNG : AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_JPEG;
    return STATUS_OK;
}

/* A frame without a picture is left out of the video. */
static status add_frames(struct job_fetch *f, const struct frame_list *only, struct video *v,
                         Azulejo__Wire__OutputKind kind, uint64_t *missing, uint64_t *count, struct error *err)
{
    uint64_t all = only->count ? only->count : (uint64_t)(f->job->last_frame - f->job->first_frame) + 1;
    struct buffer picture = BUFFER_INIT;
    status result = STATUS_OK;

    *missing = *count = 0;
    for (uint64_t i = 0; i < all && result == STATUS_OK; i++) {
        uint32_t frame = only->count ? only->items[i] : f->job->first_frame + (uint32_t)i;
        buffer_clear(&picture);
        result = job_fetch_picture(f, frame, kind, &picture, err);
        if (result == STATUS_ERR_NOT_FOUND) {
            ++*missing;
            result = STATUS_OK;
        } else if (result == STATUS_OK) {
            ++*count;
            result = video_add(v, f->connection, &picture, err);
        }
    }
    buffer_release(&picture);
    return result;
}

status job_fetch_video(struct job_fetch *f, const struct frame_list *only, struct error *err)
{
    double fps = f->job->settings && f->job->settings->fps > 0 ? (double)f->job->settings->fps : FPS_DEFAULT;
    Azulejo__Wire__OutputKind kind;
    struct video *v = NULL;
    uint64_t missing, count;
    status result = check(f, &kind, err);

    THEN(result,
         video_begin(&v, f->video, fps,
                     kind == AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PNG ? OUTPUT_FORMAT_PNG : OUTPUT_FORMAT_JPEG, err));
    THEN(result, add_frames(f, only, v, kind, &missing, &count, err));
    if (result == STATUS_OK && count == 0)
        result = error_set(err, STATUS_ERR_NOT_FOUND, "%s: no frame has a picture", f->video);
    THEN(result, video_end(v, f->connection, err));
    if (result == STATUS_OK && missing)
        fprintf(stderr, "%s: %" PRIu64 " frame%s without a picture left out\n", f->video, missing,
                missing == 1 ? " is" : "s are");
    if (result == STATUS_OK && !f->json)
        printf("%s  %" PRIu64 " frames at %g a second\n", f->video, count, fps);
    video_free(v);
    return result;
}
