/* JPEG through libjpeg-turbo, from memory. Decodes grey, RGB (any YCbCr) and the four-ink CMYK and
 * YCCK of print, inks to RGB without a profile. Uses the accurate integer transform and the smooth
 * chroma upsampling, whose SIMD and C versions give the same bits. */
#include <setjmp.h>
#include <stdio.h>
#include <string.h>

#include <jpeglib.h>

#include <jerror.h>

#include "common/base/memory.h"
#include "common/image/image.h"

enum { JPEG_SCANS_MAX = 200 }; /* a progressive picture has about ten */
/* A byte of a picture without any detail becomes at most about 2500 (one bit a block, the coarsest sampling). */
#define JPEG_EXPANSION_MAX 4096.0
#define JPEG_WORK_BYTES ((size_t)64 << 20) /* beside twice the decoded size */

struct jpeg_failure {
    struct jpeg_error_mgr base; /* first: libjpeg hands this back */
    jmp_buf jump;
    char message[JMSG_LENGTH_MAX];
};

static void jpeg_fail(j_common_ptr jpeg)
{
    struct jpeg_failure *failure = (struct jpeg_failure *)(void *)jpeg->err;

    jpeg->err->format_message(jpeg, failure->message);
    longjmp(failure->jump, 1);
}

/* Warnings that mean that pixels are missing or wrong are errors here; others are ignored. */
static void jpeg_judge_message(j_common_ptr jpeg, int level)
{
    if (level >= 0)
        return;
    switch (jpeg->err->msg_code) {
    case JWRN_JPEG_EOF:
    case JWRN_HIT_MARKER:
    case JWRN_HUFF_BAD_CODE:
    case JWRN_ARITH_BAD_CODE:
    case JWRN_MUST_RESYNC: jpeg_fail(jpeg); break;
    default: break;
    }
}

static void jpeg_print_nothing(j_common_ptr jpeg) { (void)jpeg; }

/* Called repeatedly: the place to stop a picture of thousands of empty scans. */
static void jpeg_check_scans(j_common_ptr jpeg)
{
    j_decompress_ptr d = (j_decompress_ptr)jpeg;

    if (jpeg->is_decompressor && d->input_scan_number > JPEG_SCANS_MAX)
        ERREXIT(jpeg, JERR_BAD_PROGRESSION);
}

/* Inks to RGB in place. With an Adobe marker the inks are stored inverted, as all programs that write such files do. */
static void convert_inks(const uint8_t *cmyk, uint8_t *rgb, uint32_t width, int inverted)
{
    for (uint32_t x = 0; x < width; x++) {
        const uint8_t *ink = cmyk + 4 * (size_t)x;
        unsigned black = inverted ? ink[3] : 255u - ink[3];

        for (int c = 0; c < 3; c++) {
            unsigned light = inverted ? ink[c] : 255u - ink[c];
            rgb[3 * (size_t)x + (size_t)c] = (uint8_t)((light * black + 127) / 255);
        }
    }
}

static status check_plausible(const struct jpeg_decompress_struct *d, size_t size_bytes, const char *name,
                              struct error *err)
{
    double decoded = (double)d->image_width * d->image_height * d->num_components;

    if (decoded / JPEG_EXPANSION_MAX > (double)size_bytes)
        return error_set(err, STATUS_ERR_INPUT,
                         "%s: %zu bytes cannot hold the %u x %u pixels that the header claims; "
                         "the file is damaged or cut short",
                         name, size_bytes, (unsigned)d->image_width, (unsigned)d->image_height);
    return STATUS_OK;
}

/* Everything that may longjmp; no variable here outlives the jump. `*row` is freed by the caller. */
static status read_jpeg(struct jpeg_decompress_struct *d, struct jpeg_failure *failure,
                        struct jpeg_progress_mgr *progress, struct image8 *out, uint8_t **row, const uint8_t *data,
                        size_t size_bytes, const char *name, struct error *err)
{
    status st;
    int inks;

    if (setjmp(failure->jump))
        return error_set(err, STATUS_ERR_INPUT, "%s: the JPEG is damaged or cut short (%s)", name, failure->message);
    jpeg_create_decompress(d);
    d->progress = progress;
    jpeg_mem_src(d, data, size_bytes);
    jpeg_read_header(d, TRUE);
    TRY(check_plausible(d, size_bytes, name, err));
    inks = d->jpeg_color_space == JCS_CMYK || d->jpeg_color_space == JCS_YCCK;
    if (inks)
        d->out_color_space = JCS_CMYK;
    else if (d->jpeg_color_space == JCS_GRAYSCALE)
        d->out_color_space = JCS_GRAYSCALE;
    else if (d->num_components == 3)
        d->out_color_space = JCS_RGB;
    else
        return error_set(err, STATUS_ERR_UNSUPPORTED, "%s: a JPEG of %d channels; grey, RGB and CMYK are supported",
                         name, d->num_components);
    d->dct_method = JDCT_ISLOW;
    d->do_fancy_upsampling = TRUE;
    st = image8_init(out, d->image_width, d->image_height, d->out_color_space == JCS_GRAYSCALE ? 1 : 3, 8, err);
    if (st != STATUS_OK) {
        error_prefix(err, "%s", name);
        return st;
    }
    d->mem->max_memory_to_use = (long)(2 * (size_t)d->image_width * d->image_height * 4 + JPEG_WORK_BYTES);
    *row = mem_alloc_array(d->image_width, 4);
    NEED(*row, err, "a texture's row");
    jpeg_start_decompress(d);
    while (d->output_scanline < d->output_height) {
        uint8_t *to = out->pixels + (size_t)d->output_scanline * out->width * out->channels;
        JSAMPROW rows[1] = {inks ? *row : to};

        jpeg_read_scanlines(d, rows, 1);
        if (inks)
            convert_inks(*row, to, out->width, d->saw_Adobe_marker);
    }
    jpeg_finish_decompress(d);
    return STATUS_OK;
}

status jpeg_decode(struct image8 *out, const uint8_t *data, size_t size_bytes, const char *name, struct error *err)
{
    struct jpeg_decompress_struct d;
    struct jpeg_failure failure;
    struct jpeg_progress_mgr progress;
    uint8_t *row = NULL;
    status st;

    memset(out, 0, sizeof *out);
    memset(&d, 0, sizeof d);
    memset(&failure, 0, sizeof failure);
    memset(&progress, 0, sizeof progress);
    d.err = jpeg_std_error(&failure.base);
    failure.base.error_exit = jpeg_fail;
    failure.base.emit_message = jpeg_judge_message;
    failure.base.output_message = jpeg_print_nothing;
    progress.progress_monitor = jpeg_check_scans;
    st = read_jpeg(&d, &failure, &progress, out, &row, data, size_bytes, name, err);
    jpeg_destroy_decompress(&d);
    mem_free(row);
    if (st != STATUS_OK)
        image8_release(out);
    return st;
}
