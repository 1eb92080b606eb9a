/* Through ImfCRgbaFile.h. It opens only paths, so the bytes are passed to it as an anonymous file.
 * Its values are halves: no loss for DWA, which itself codes colour as halves.
 */
#include <errno.h>
#include <inttypes.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include <ImfCRgbaFile.h>

#include "common/base/memory.h"
#include "common/image/exr_context.h"
#include "common/image/half.h"
#include "common/image/image.h"

/* ImfErrorMessage() is one text for all threads. */
static pthread_mutex_t rgba_lock = PTHREAD_MUTEX_INITIALIZER;

/* An anonymous file with `data` in it; -1 with errno set. */
static int lend_bytes(const uint8_t *data, size_t size_bytes)
{
    int file = memfd_create("azulejo-exr", MFD_CLOEXEC);

    while (file >= 0 && size_bytes > 0) {
        ssize_t written = write(file, data, size_bytes);

        if (written < 0 && errno == EINTR)
            continue;
        if (written <= 0) {
            close(file);
            return -1;
        }
        data += written;
        size_bytes -= (size_t)written;
    }
    return file;
}

/* Row by row, so that no second picture is held: every line is decoded to the same memory. */
static int read_rows(ImfInputFile *in, struct image *out, ImfRgba *row, int x_min, int y_min)
{
    /* The library adds x * x_stride + y * y_stride to the base, with x from x_min on. */
    ImfRgba *base = (ImfRgba *)((uintptr_t)row - (uintptr_t)((intptr_t)x_min * (intptr_t)sizeof *row));

    if (!ImfInputSetFrameBuffer(in, base, 1, 0))
        return 0;
    for (uint32_t y = 0; y < out->height; y++) {
        float *to = out->pixels + (size_t)out->channels * y * out->width;

        if (!ImfInputReadPixels(in, y_min + (int)y, y_min + (int)y))
            return 0;
        for (uint32_t x = 0; x < out->width; x++) {
            to[0] = half_to_float(row[x].r);
            to[1] = half_to_float(row[x].g);
            to[2] = half_to_float(row[x].b);
            if (out->channels == 4)
                to[3] = half_to_float(row[x].a);
            to += out->channels;
        }
    }
    return 1;
}

status exr_decode_rgba(struct image *out, const uint8_t *data, size_t size_bytes, const char *name, uint32_t width,
                       uint32_t height, uint32_t channels, struct error *err)
{
    ImfInputFile *in = NULL;
    ImfRgba *row = NULL;
    char path[64];
    int file, x_min, y_min, x_max, y_max;
    status st;

    memset(out, 0, sizeof *out);
    file = lend_bytes(data, size_bytes);
    if (file < 0)
        return error_set(err, STATUS_ERR_IO, "%s: no anonymous file for its bytes: %s", name, strerror(errno));
    st = image_init(out, width, height, channels, err);
    if (st != STATUS_OK) {
        error_prefix(err, "%s", name);
        goto done;
    }
    row = mem_calloc(width, sizeof *row);
    if (!row) {
        st = error_no_memory(err, "a scan line");
        goto done;
    }
    snprintf(path, sizeof path, "/proc/self/fd/%d", file);
    pthread_mutex_lock(&rgba_lock);
    in = ImfOpenInputFile(path);
    if (in)
        ImfHeaderDataWindow(ImfInputHeader(in), &x_min, &y_min, &x_max, &y_max);
    if (in && (x_max - (int64_t)x_min + 1 != width || y_max - (int64_t)y_min + 1 != height))
        st = error_set(err, STATUS_ERR_INPUT, "%s: its parts disagree about the data window", name);
    else if (!in || !read_rows(in, out, row, x_min, y_min))
        st = error_set(err, STATUS_ERR_INPUT, "%s: the OpenEXR file is damaged or cut short (%s)", name,
                       ImfErrorMessage());
    if (in)
        ImfCloseInputFile(in);
    pthread_mutex_unlock(&rgba_lock);
done:
    mem_free(row);
    close(file);
    if (st != STATUS_OK)
        image_release(out);
    return st;
}
