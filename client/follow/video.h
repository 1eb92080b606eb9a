/* video: an animation's pictures as a video, made by the ffmpeg program if it is installed.
 *
 * The pictures go to its standard input one after the other, as the PNG or JPEG files that they are. While ffmpeg is
 * slower than they come, the connection is kept alive. It appears under its name only when it is complete.
 */
#pragma once

#include "client/link/connection.h"
#include "client/options/output.h"
#include "common/base/buffer.h"
#include "common/base/status.h"

#define VIDEO_OPTION_ROW(path)                                                                    \
    {"video", 0, OPTION_STRING, &(path), "FILE",                                                  \
     "also make a video of the animation (.mp4, .mov, .mkv or .webm) at the job's --fps; needs the "  \
     "ffmpeg program",                                                                             \
     0, 0, NULL}

struct video;

/* Before expensive work: does the name end in a kind of video, and is there ffmpeg? ERR_USAGE, ERR_UNSUPPORTED. */
status video_check(const char *path, struct error *err) MUST_CHECK;

/* Start ffmpeg for pictures of this format at so many frames a second. ERR_UNSUPPORTED, ERR_IO. */
status video_begin(struct video **out, const char *path, double fps, enum output_format format,
                   struct error *err) MUST_CHECK;
/* `c` may be NULL. ERR_IO with ffmpeg's own words. */
status video_add(struct video *v, struct connection *c, const struct buffer *picture, struct error *err) MUST_CHECK;
/* The video is complete: give it its name. */
status video_end(struct video *v, struct connection *c, struct error *err) MUST_CHECK;
/* Removes what is not complete; NULL is fine. */
void video_free(struct video *v);
