#include "client/follow/video.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "client/link/child.h"
#include "client/link/signals.h"
#include "client/terminal/must.h"
#include "common/system/file.h"
#include "common/base/memory.h"

enum { POLL_MS = 100, STOP_LIMIT_MS = 2000, WORDS_BYTES = 400, ARGUMENTS_MAX = 40 };

struct video {
    char *path, *part, *log; /* the video, the file that it is until it is complete, ffmpeg's words */
    struct child ffmpeg;
    int pipe; /* -1: closed */
};

/* What is called so, and how it is coded. */
static const struct {
    const char *extension;
    const char *coder[8];
} kinds[] = {
    {"mp4", {"-c:v", "libx264", "-crf", "18", "-movflags", "+faststart"}},
    {"mov", {"-c:v", "libx264", "-crf", "18", "-movflags", "+faststart"}},
    {"mkv", {"-c:v", "libx264", "-crf", "18"}},
    {"webm", {"-c:v", "libvpx-vp9", "-crf", "24", "-b:v", "0"}},
};
enum { KINDS = sizeof kinds / sizeof *kinds };

static int kind_of(const char *path)
{
    for (int i = 0; i < KINDS; i++)
        if (strcasecmp(file_extension(path), kinds[i].extension) == 0)
            return i;
    return -1;
}

static status find_ffmpeg(struct buffer *program, struct error *err)
{
    if (child_find_program("ffmpeg", program, NULL) == STATUS_OK) {
        must_hold(program);
        return STATUS_OK;
    }
    return error_set(err, STATUS_ERR_UNSUPPORTED,
                     "--video: the program ffmpeg is not installed: on Debian, apt-get install ffmpeg");
}

status video_check(const char *path, struct error *err)
{
    struct buffer program = BUFFER_INIT;
    status result;

    if (kind_of(path) < 0)
        return error_set(err, STATUS_ERR_USAGE,
                         "--video %s: the name decides the kind of video: end it in .mp4, .mov, .mkv or "
                         ".webm",
                         path);
    result = find_ffmpeg(&program, err);
    buffer_release(&program);
    return result;
}

/* yuv420p is what players take; it needs even sides. The pictures are sRGB, the video says so. */
static size_t arguments_set(const char *out[ARGUMENTS_MAX], const char *program, const char *fps,
                            enum output_format format, const char *const coder[8], const char *part)
{
    const char *const start[] = {
        program, "-y", "-hide_banner", "-loglevel", "error", "-f", "image2pipe", "-c:v",
        format == OUTPUT_FORMAT_PNG ? "png" : "mjpeg", "-framerate", fps, "-i", "pipe:0", "-vf",
        "scale=out_color_matrix=bt709:out_range=tv,pad=ceil(iw/2)*2:ceil(ih/2)*2,format=yuv420p",
        "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1"};
    size_t count = sizeof start / sizeof *start;

    memcpy(out, start, sizeof start);
    for (int i = 0; i < 8 && coder[i]; i++)
        out[count++] = coder[i];
    out[count++] = part;
    out[count] = NULL;
    return count;
}

static status start(struct video *v, double fps, enum output_format format, struct error *err)
{
    struct buffer program = BUFFER_INIT;
    const char *arguments[ARGUMENTS_MAX];
    char rate[32];
    int ends[2] = {-1, -1};
    status result = find_ffmpeg(&program, err);

    if (result == STATUS_OK && pipe2(ends, O_CLOEXEC) != 0)
        result = error_set(err, STATUS_ERR_IO, "no pipe to ffmpeg: %s", strerror(errno));
    if (result == STATUS_OK) {
        snprintf(rate, sizeof rate, "%.9g", fps);
        arguments_set(arguments, buffer_text(&program), rate, format, kinds[kind_of(v->path)].coder, v->part);
        result = child_start_fed(&v->ffmpeg, "ffmpeg", (char *const *)arguments, v->log, ends[0], -1, SIGKILL, err);
    }
    if (ends[0] >= 0)
        close(ends[0]);
    v->pipe = ends[1];
    if (result == STATUS_OK && fcntl(v->pipe, F_SETFL, O_NONBLOCK) != 0)
        result = error_set(err, STATUS_ERR_IO, "no pipe to ffmpeg: %s", strerror(errno));
    buffer_release(&program);
    return result;
}

static char *beside(const char *path, const char *what)
{
    char *folder = must(file_dirname(path));
    struct buffer name = BUFFER_INIT;
    char *out;

    buffer_printf(&name, ".azulejo-%ld-%s", (long)getpid(), what);
    must_hold(&name);
    out = must(file_join(folder, buffer_text(&name)));
    buffer_release(&name);
    mem_free(folder);
    return out;
}

status video_begin(struct video **out, const char *path, double fps, enum output_format format, struct error *err)
{
    struct video *v = must(mem_calloc(1, sizeof *v));
    char *folder = must(file_dirname(path));
    status result;

    *out = NULL;
    v->pipe = -1;
    v->path = must(mem_strdup(path));
    v->part = beside(path, file_basename(path));
    v->log = beside(path, "ffmpeg.log");
    result = file_make_folder(folder, err);
    THEN(result, start(v, fps, format, err));
    mem_free(folder);
    if (result != STATUS_OK)
        video_free(v);
    else
        *out = v;
    return result;
}

/* ffmpeg has ended without success. */
static status failure(struct video *v, struct error *err)
{
    struct buffer words = BUFFER_INIT;
    char end[128];
    size_t length;

    child_describe_end(&v->ffmpeg, end, sizeof end);
    if (file_read(v->log, 1 << 20, &words, NULL) != STATUS_OK)
        buffer_clear(&words);
    length = words.size < WORDS_BYTES ? words.size : WORDS_BYTES;
    while (length > 0 && words.data[length - 1] == '\n')
        length--;
    for (size_t i = 0; i < length; i++)
        if (words.data[i] < ' ')
            words.data[i] = ' ';
    error_set(err, STATUS_ERR_IO, "%s: ffmpeg %s%s%.*s", v->path, end, length ? ": " : "", (int)length,
              length ? (const char *)words.data : "");
    buffer_release(&words);
    return STATUS_ERR_IO;
}

/* Nothing can be done at the moment: keep the coordinator's connection alive. */
static status idle(struct connection *c, struct error *err)
{
    if (c)
        connection_pump(c, 0);
    if (signals_stop())
        return error_set(err, STATUS_ERR_JOB_FAILED, "interrupted; no video is written");
    return STATUS_OK;
}

status video_add(struct video *v, struct connection *c, const struct buffer *picture, struct error *err)
{
    size_t at = 0;

    while (at < picture->size) {
        ssize_t n = write(v->pipe, picture->data + at, picture->size - at);
        struct pollfd room = {.fd = v->pipe, .events = POLLOUT};

        if (n > 0) {
            at += (size_t)n;
            continue;
        }
        if (errno == EINTR)
            continue;
        if (errno == EPIPE) {
            children_stop(&v->ffmpeg, 1, STOP_LIMIT_MS);
            return failure(v, err);
        }
        if (errno != EAGAIN)
            return error_set(err, STATUS_ERR_IO, "ffmpeg takes no picture: %s", strerror(errno));
        TRY(idle(c, err));
        (void)poll(&room, 1, POLL_MS);
    }
    return STATUS_OK;
}

status video_end(struct video *v, struct connection *c, struct error *err)
{
    close(v->pipe);
    v->pipe = -1;
    while (!child_has_ended(&v->ffmpeg)) {
        struct pollfd wake = {.fd = signals_fd(), .events = POLLIN};
        TRY(idle(c, err));
        (void)poll(&wake, 1, POLL_MS / 5);
    }
    if (v->ffmpeg.wait_status != 0)
        return failure(v, err);
    if (rename(v->part, v->path) != 0)
        return error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", v->path, strerror(errno));
    return file_sync_folder_of(v->path, err);
}

void video_free(struct video *v)
{
    if (!v)
        return;
    if (v->pipe >= 0)
        close(v->pipe);
    if (v->ffmpeg.pid && !v->ffmpeg.ended)
        children_stop(&v->ffmpeg, 1, STOP_LIMIT_MS);
    if (v->part)
        unlink(v->part);
    if (v->log)
        unlink(v->log);
    mem_free(v->path);
    mem_free(v->part);
    mem_free(v->log);
    mem_free(v);
}
