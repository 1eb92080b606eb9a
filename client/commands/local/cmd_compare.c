/* azulejo compare: are two pictures the same, and if not, how far apart? */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/commands/command.h"
#include "client/views/compare.h"
#include "client/follow/job_info.h"
#include "common/base/buffer.h"
#include "common/image/image_size.h"
#include "common/system/file.h"

static status picture_load(const char *path, struct image *out, struct image_size *size, struct error *err)
{
    struct buffer data = BUFFER_INIT;
    struct image_repairs repairs = {0};
    char said[IMAGE_REPAIRS_TEXT];
    status result = file_read(path, IMAGE_BYTES_MAX, &data, err);

    THEN(result, image_decode_hdr(out, data.data, data.size, path, &repairs, err));
    if (!image_size_of(data.data, data.size, size))
        memset(size, 0, sizeof *size);
    buffer_release(&data);
    if (result == STATUS_OK && image_repairs_say(&repairs, said))
        fprintf(stderr, "warning: %s: %s\n", path, said);
    return result;
}

/* Where `part` is a region of a picture of this size (--region), that region. */
static void crop(struct image *image, const struct image_size *part)
{
    if (image->width != part->whole_width || image->height != part->whole_height)
        return;
    for (uint32_t y = 0; y < part->height; y++)
        memmove(image->pixels + 3 * (size_t)y * part->width,
                image->pixels + 3 * ((size_t)(part->y + y) * image->width + part->x),
                3 * sizeof *image->pixels * part->width);
    image->width = part->width;
    image->height = part->height;
}

static void print_text(const struct comparison *c)
{
    if (c->identical) {
        printf("identical: every one of %" PRIu64 " pixels has the same bits\n", c->pixels);
        return;
    }
    printf("different: %" PRIu64 " of %" PRIu64 " pixels\n", c->differing_pixels, c->pixels);
    printf("  largest absolute difference  %.6g at column %u, row %u\n", c->max_absolute, c->worst_x,
           c->worst_y);
    printf("  largest relative difference  %.6g\n", c->max_relative);
    printf("  mean squared error           %.6g\n", c->mse);
    printf("  relative MSE                 %.6g  (root: %.4g %%)\n", c->relative_mse,
           100 * sqrt(c->relative_mse));
    printf("  means, relative difference   %+.4g %%  %+.4g %%  %+.4g %%  (R G B)\n",
           100 * c->mean_relative[0], 100 * c->mean_relative[1], 100 * c->mean_relative[2]);
    printf("  PSNR of the sRGB pictures    %.2f dB\n", c->psnr_db);
}

static json_t *comparison_json(const struct comparison *c)
{
    return json_pack("{s:b, s:I, s:I, s:o, s:o, s:[i, i], s:o, s:o, s:[o, o, o], s:o}", "identical", c->identical,
                     "pixels", (json_int_t)c->pixels, "differing_pixels", (json_int_t)c->differing_pixels,
                     "max_absolute", json_number(c->max_absolute), "max_relative", json_number(c->max_relative),
                     "worst_pixel", (int)c->worst_x, (int)c->worst_y, "mse", json_number(c->mse), "relative_mse",
                     json_number(c->relative_mse), "mean_relative", json_number(c->mean_relative[0]),
                     json_number(c->mean_relative[1]), json_number(c->mean_relative[2]), "psnr_db",
                     json_number(c->psnr_db));
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code, struct error *err)
{
    double max_relative_mse = -1;
    int json = 0, done;
    const struct option table[] = {
        {"max-relmse", 0, OPTION_REAL, &max_relative_mse, "X",
         "exit with 0 when the relative MSE is at most this (default: only when identical)", 0, 1e30,
         NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        {0},
    };
    struct image a = {0}, b = {0};
    struct image_size a_size, b_size;
    struct comparison comparison;
    struct positionals rest;
    status result = command_parse(command, table, argc, argv, 2, 2, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    result = picture_load(rest.items[0], &a, &a_size, err);
    THEN(result, picture_load(rest.items[1], &b, &b_size, err));
    if (result == STATUS_OK) {
        crop(&b, &a_size);
        crop(&a, &b_size);
        image_compare(&a, &b, &comparison);
        if (a_size.whole_width && b_size.whole_width && (a_size.x != b_size.x || a_size.y != b_size.y))
            result = error_set(err, STATUS_ERR_INPUT, "%s begins at column %u, row %u of its picture, %s at column %u, row %u: "
                               "they are different regions", rest.items[0], a_size.x, a_size.y, rest.items[1], b_size.x, b_size.y);
        else if (!comparison.same_size)
            result = error_set(err, STATUS_ERR_INPUT, "%s has %ux%u pixels, %s has %ux%u", rest.items[0], a.width,
                               a.height, rest.items[1], b.width, b.height);
        else if (json)
            result = json_print(comparison_json(&comparison), err);
        else
            print_text(&comparison);
    }
    if (result == STATUS_OK)
        *exit_code = max_relative_mse >= 0 ? !(comparison.relative_mse <= max_relative_mse) : !comparison.identical;
    image_release(&b);
    image_release(&a);
    return result;
}

const struct command command_compare = {
    .name = "compare",
    .group = COMMAND_PICTURES,
    .usage = "azulejo compare PICTURE REFERENCE [OPTION]...",
    .summary = "tell how far two EXR or HDR pictures are apart",
    .description = "Compare two EXR or Radiance HDR pictures. Exit status 0 when they are the same to the bit (or\n"
                   "within --max-relmse), 1 when they differ. A region (render --region) is compared with that part\n"
                   "of a whole picture. The relative MSE is pbrt's, mean((a-b)^2 / (b^2 + 0.01)).",
    .run = run,
};
