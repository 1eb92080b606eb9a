/* JPEG through libjpeg-turbo, to memory. The accurate integer transform has the same bits with SIMD and without. */
#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>

#include <jpeglib.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/image/quantize.h"

struct jpeg_writer {
    struct jpeg_error_mgr errors; /* first: libjpeg hands this back */
    struct jpeg_compress_struct jpeg;
    jmp_buf jump;
    char message[JMSG_LENGTH_MAX];
    unsigned char *bytes; /* libjpeg's, from malloc */
    unsigned long size;
};

static void writer_fail(j_common_ptr jpeg)
{
    struct jpeg_writer *writer = (struct jpeg_writer *)(void *)jpeg->err;

    jpeg->err->format_message(jpeg, writer->message);
    longjmp(writer->jump, 1);
}

static void writer_ignore(j_common_ptr jpeg UNUSED, int level UNUSED) {}

static status write_jpeg(struct jpeg_writer *w, const struct image *image, const struct picture_options *how,
                         uint8_t *row, struct error *err)
{
    if (setjmp(w->jump))
        return error_set(err, STATUS_ERR_INTERNAL, "JPEG: %s", w->message);
    jpeg_create_compress(&w->jpeg);
    jpeg_mem_dest(&w->jpeg, &w->bytes, &w->size);
    w->jpeg.image_width = image->width;
    w->jpeg.image_height = image->height;
    w->jpeg.input_components = 3;
    w->jpeg.in_color_space = JCS_RGB;
    jpeg_set_defaults(&w->jpeg);
    jpeg_set_quality(&w->jpeg, how->quality > 0 ? how->quality : JPEG_QUALITY_DEFAULT, TRUE);
    w->jpeg.dct_method = JDCT_ISLOW;
    w->jpeg.optimize_coding = TRUE;
    for (int c = 0; c < 3; c++)
        w->jpeg.comp_info[c].h_samp_factor = w->jpeg.comp_info[c].v_samp_factor = 1;
    jpeg_start_compress(&w->jpeg, TRUE);
    for (uint32_t y = 0; y < image->height; y++) {
        JSAMPROW rows[] = {row};

        quantize_row8(image, y, how->plain, row);
        jpeg_write_scanlines(&w->jpeg, rows, 1);
    }
    jpeg_finish_compress(&w->jpeg);
    return STATUS_OK;
}

status jpeg_encode(struct buffer *out, const struct image *image, const struct picture_options *how, struct error *err)
{
    struct jpeg_writer w = {.bytes = NULL};
    uint8_t *row;
    status s;

    if (image->channels < 3)
        return error_set(err, STATUS_ERR_INTERNAL, "a JPEG is made of 3 channels, not of %u",
                         (unsigned)image->channels);
    if (image->width > JPEG_MAX_DIMENSION || image->height > JPEG_MAX_DIMENSION)
        return error_set(err, STATUS_ERR_LIMIT,
                         "a JPEG may have %ld pixels a side, and the picture is %u x %u: choose PNG",
                         (long)JPEG_MAX_DIMENSION, image->width, image->height);
    row = mem_alloc_array(image->width, 3);
    NEED(row, err, "a JPEG");
    w.jpeg.err = jpeg_std_error(&w.errors);
    w.errors.error_exit = writer_fail;
    w.errors.emit_message = writer_ignore;
    s = write_jpeg(&w, image, how, row, err);
    if (s == STATUS_OK) {
        buffer_append(out, w.bytes, w.size);
        s = buffer_ok(out) ? STATUS_OK : error_no_memory(err, "a JPEG");
    }
    jpeg_destroy_compress(&w.jpeg);
    free(w.bytes);
    mem_free(row);
    return s;
}
