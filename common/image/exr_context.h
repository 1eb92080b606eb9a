/* exr_context: OpenEXRCore's context over memory instead of files, shared by reading and writing.
 * Messages of the library go to a text instead of standard error, and its memory comes from
 * common/base/memory. Private to common/image.
 */
#pragma once

#include <openexr.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

/* The data of a context; must outlive it. */
struct exr_stream {
    const uint8_t *data; /* reading */
    size_t size_bytes;
    struct buffer *out; /* writing */
    char message[256];  /* the library's first error message; empty if there was none */
    int starved;        /* memory ran out, whatever the library reports in the end */
    int oversized;      /* the library asked for a block above the limit: the file's claim */
};

/* An initialiser with limits, allocators, the error handler and the stream's functions. From here
 * to exr_stream_finish() the calling thread works on this one stream. */
exr_context_initializer_t exr_stream_initializer(struct exr_stream *stream);

/* End the context (NULL is fine); for writing, the offset table goes out here. */
exr_result_t exr_stream_finish(exr_context_t *context);

/* Turn a result other than EXR_ERR_SUCCESS into a status that names the file. */
status exr_stream_error(const struct exr_stream *stream, exr_result_t result, const char *name, struct error *err);

/* The decompression step of a decoding pipeline for B44 and B44A. */
exr_result_t exr_b44_decompress(exr_decode_pipeline_t *pipeline);

/* Read the same file through OpenEXR's older C API. In OpenEXR 3.1 only that API decodes DWAA, DWAB
 * and subsampled chroma, but only first parts, only channels outside layers, and only to half.
 * `width` and `height` are the data window's, checked; `channels` is 3, or 4 with alpha. */
struct image;
status exr_decode_rgba(struct image *out, const uint8_t *data, size_t size_bytes, const char *name, uint32_t width,
                       uint32_t height, uint32_t channels, struct error *err) MUST_CHECK;
