#include "client/study/data/study_data.h"

#include <math.h>
#include <openssl/evp.h>
#include <string.h>

#include "client/study/data/study_fields.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/image/image.h"

#define FIELD(type, kind, member) {#member, kind, offsetof(type, member), NULL}
#define PART(type, kind, member, shape) {#member, kind, offsetof(type, member), &(shape)}
#define SHAPE(name, type) static const struct study_shape name = {sizeof(type), name##_fields}

static const struct study_field point_fields[] = {
    FIELD(struct study_point, STUDY_NUMBER, core_s),
    FIELD(struct study_point, STUDY_NUMBER, wall_s),
    FIELD(struct study_point, STUDY_NUMBER, samples),
    FIELD(struct study_point, STUDY_NUMBER, rays),
    FIELD(struct study_point, STUDY_INTERVAL, codes),
    FIELD(struct study_point, STUDY_NUMBER, psnr_db),
    FIELD(struct study_point, STUDY_INTERVAL, rmse),
    FIELD(struct study_point, STUDY_INTERVAL, relmse),
    FIELD(struct study_point, STUDY_INTERVAL, flip),
    FIELD(struct study_point, STUDY_INTERVAL, seeds),
    FIELD(struct study_point, STUDY_FLAG, reliable),
    FIELD(struct study_point, STUDY_NUMBER, top_share),
    FIELD(struct study_point, STUDY_TEXT, reason),
    {0},
};
SHAPE(point, struct study_point);

static const struct study_field fit_fields[] = {
    FIELD(struct study_fit, STUDY_INTERVAL, exponent),
    FIELD(struct study_fit, STUDY_NUMBER, pivot_core_s),
    FIELD(struct study_fit, STUDY_NUMBER, start_core_s),
    FIELD(struct study_fit, STUDY_INTERVAL, codes_at_pivot),
    {0},
};
SHAPE(fit, struct study_fit);

static const struct study_field crop_fields[] = {
    FIELD(struct study_crop, STUDY_NUMBER, core_s),
    FIELD(struct study_crop, STUDY_NUMBER, codes),
    FIELD(struct study_crop, STUDY_PIXELS, picture),
    {0},
};
SHAPE(crop, struct study_crop);

static const struct study_field region_fields[] = {
    FIELD(struct study_region, STUDY_TEXT, label),
    FIELD(struct study_region, STUDY_NUMBER, x),
    FIELD(struct study_region, STUDY_NUMBER, y),
    PART(struct study_region, STUDY_ITEMS, crops, crop),
    {0},
};
SHAPE(region, struct study_region);

static const struct study_field choice_fields[] = {
    FIELD(struct study_choice, STUDY_TEXT, name),
    FIELD(struct study_choice, STUDY_TEXT, words),
    FIELD(struct study_choice, STUDY_TEXT, note),
    FIELD(struct study_choice, STUDY_FLAG, baseline),
    FIELD(struct study_choice, STUDY_FLAG, unbiased),
    FIELD(struct study_choice, STUDY_FLAG, missed),
    FIELD(struct study_choice, STUDY_FLAG, by_target),
    FIELD(struct study_choice, STUDY_NUMBER, taken),
    PART(struct study_choice, STUDY_ITEMS, points, point),
    FIELD(struct study_choice, STUDY_NUMBER, gain_at),
    FIELD(struct study_choice, STUDY_INTERVAL, gain),
    FIELD(struct study_choice, STUDY_INTERVAL, floor),
    {0},
};
SHAPE(choice, struct study_choice);

static const struct study_field question_fields[] = {
    FIELD(struct study_question, STUDY_TEXT, title),
    PART(struct study_question, STUDY_ITEMS, choices, choice),
    {0},
};
SHAPE(question, struct study_question);

static const struct study_field effect_fields[] = {
    FIELD(struct study_effect, STUDY_TEXT, name),
    FIELD(struct study_effect, STUDY_INTERVAL, saved),
    FIELD(struct study_effect, STUDY_INTERVAL, bias),
    {0},
};
SHAPE(effect, struct study_effect);

static const struct study_field worker_fields[] = {
    FIELD(struct study_worker, STUDY_TEXT, name),
    FIELD(struct study_worker, STUDY_NUMBER, cores),
    {0},
};
SHAPE(worker, struct study_worker);

static const struct study_field map_fields[] = {
    FIELD(struct study_map, STUDY_NUMBER, columns),
    FIELD(struct study_map, STUDY_NUMBER, rows),
    FIELD(struct study_map, STUDY_NUMBERS, values),
    {0},
};
SHAPE(map, struct study_map);

static const struct study_field bin_fields[] = {
    FIELD(struct study_bin, STUDY_NUMBER, low),
    FIELD(struct study_bin, STUDY_NUMBER, high),
    FIELD(struct study_bin, STUDY_NUMBER, count),
    {0},
};
SHAPE(bin, struct study_bin);

static const struct study_field tail_fields[] = {
    FIELD(struct study_tail, STUDY_NUMBERS, pixels),
    FIELD(struct study_tail, STUDY_NUMBERS, error),
    FIELD(struct study_tail, STUDY_NUMBER, index),
    {0},
};
SHAPE(tail, struct study_tail);

static const struct study_field prediction_fields[] = {
    FIELD(struct study_prediction, STUDY_NUMBER, round),
    FIELD(struct study_prediction, STUDY_NUMBER, core_s_then),
    FIELD(struct study_prediction, STUDY_NUMBER, target_codes),
    FIELD(struct study_prediction, STUDY_INTERVAL, core_s),
    FIELD(struct study_prediction, STUDY_NUMBER, core_s_true),
    {0},
};
SHAPE(prediction, struct study_prediction);

static const struct study_field study_fields[] = {
    FIELD(struct study, STUDY_TEXT, scene),
    FIELD(struct study, STUDY_TEXT, machine),
    FIELD(struct study, STUDY_TEXT, date),
    FIELD(struct study, STUDY_TEXT, command),
    FIELD(struct study, STUDY_TEXT, version),
    FIELD(struct study, STUDY_TEXT, transform),
    FIELD(struct study, STUDY_TEXT, reference),
    FIELD(struct study, STUDY_NUMBER, clock_noise),
    FIELD(struct study, STUDY_NUMBER, width),
    FIELD(struct study, STUDY_NUMBER, height),
    FIELD(struct study, STUDY_NUMBER, cores),
    FIELD(struct study, STUDY_NUMBER, seed),
    FIELD(struct study, STUDY_NUMBER, traversal_share),
    FIELD(struct study, STUDY_NUMBER, target_codes),
    FIELD(struct study, STUDY_INTERVAL, target_core_s),
    FIELD(struct study, STUDY_NUMBER, price_core_hour),
    FIELD(struct study, STUDY_TEXT, currency),
    FIELD(struct study, STUDY_NUMBER, deadline_s),
    FIELD(struct study, STUDY_TEXT, deadline),
    FIELD(struct study, STUDY_FLAG, complete),
    PART(struct study, STUDY_ITEMS, points, point),
    PART(struct study, STUDY_PART, fit, fit),
    PART(struct study, STUDY_ITEMS, regions, region),
    PART(struct study, STUDY_ITEMS, questions, question),
    PART(struct study, STUDY_ITEMS, effects, effect),
    PART(struct study, STUDY_ITEMS, workers, worker),
    PART(struct study, STUDY_PART, tile_error, map),
    PART(struct study, STUDY_PART, tile_samples, map),
    PART(struct study, STUDY_ITEMS, histogram, bin),
    PART(struct study, STUDY_PART, tail, tail),
    PART(struct study, STUDY_ITEMS, predictions, prediction),
    {0},
};
const struct study_shape study_shape_study = {sizeof(struct study), study_fields};

/* ---- any structure by its shape ---------------------------------------------------------- */

void study_part_init(void *part, const struct study_shape *shape)
{
    static const struct study_interval unknown = {NAN, NAN, NAN};
    static const double nan_value = NAN;

    memset(part, 0, shape->size_bytes);
    for (const struct study_field *f = shape->fields; f->name; f++) {
        char *at = (char *)part + f->offset;

        if (f->kind == STUDY_NUMBER)
            memcpy(at, &nan_value, sizeof nan_value);
        else if (f->kind == STUDY_INTERVAL)
            memcpy(at, &unknown, sizeof unknown);
        else if (f->kind == STUDY_PART)
            study_part_init(at, f->shape);
    }
}

static void items_release(char *at, const struct study_shape *shape)
{
    struct study_any_list list;

    memcpy(&list, at, sizeof list);
    for (size_t i = 0; shape && i < list.count; i++)
        study_part_release((char *)list.items + i * shape->size_bytes, shape);
    mem_free(list.items);
}

void study_part_release(void *part, const struct study_shape *shape)
{
    for (const struct study_field *f = shape->fields; f->name; f++) {
        char *at = (char *)part + f->offset;

        if (f->kind == STUDY_TEXT) {
            char *text;
            memcpy(&text, at, sizeof text);
            mem_free(text);
        } else if (f->kind == STUDY_PIXELS) {
            struct study_picture picture;
            memcpy(&picture, at, sizeof picture);
            mem_free(picture.rgb);
        } else if (f->kind == STUDY_PART) {
            study_part_release(at, f->shape);
        } else if (f->kind == STUDY_ITEMS || f->kind == STUDY_NUMBERS) {
            items_release(at, f->kind == STUDY_ITEMS ? f->shape : NULL);
        }
    }
    study_part_init(part, shape);
}

void *study_list_add(void *at, const struct study_shape *shape, size_t most)
{
    struct study_any_list list;
    char *item;

    memcpy(&list, at, sizeof list);
    must_(list.count < most && mem_grow_(&list.items, &list.capacity, list.count + 1, shape->size_bytes));
    item = (char *)list.items + list.count++ * shape->size_bytes;
    study_part_init(item, shape);
    memcpy(at, &list, sizeof list);
    return item;
}

void study_numbers_add(void *at, double value)
{
    struct study_any_list list;

    memcpy(&list, at, sizeof list);
    must_(list.count < STUDY_NUMBERS_MAX && mem_grow_(&list.items, &list.capacity, list.count + 1, sizeof value));
    memcpy((char *)list.items + list.count++ * sizeof value, &value, sizeof value);
    memcpy(at, &list, sizeof list);
}

/* ---- the study ----------------------------------------------------------------------------- */

void study_init(struct study *s) { study_part_init(s, &study_shape_study); }

void study_release(struct study *s) { study_part_release(s, &study_shape_study); }

#define ADDER(type, function, parent, list, shape)                  \
    struct type *function(parent)                                   \
    {                                                               \
        return study_list_add((list), &(shape), STUDY_LIST_MAX);    \
    }
ADDER(study_point, study_add_point, study_points *points, points, point)
ADDER(study_region, study_add_region, struct study *s, &s->regions, region)
ADDER(study_crop, study_add_crop, struct study_region *owner, &owner->crops, crop)
ADDER(study_question, study_add_question, struct study *s, &s->questions, question)
ADDER(study_choice, study_add_choice, struct study_question *owner, &owner->choices, choice)
ADDER(study_effect, study_add_effect, struct study *s, &s->effects, effect)
ADDER(study_worker, study_add_worker, struct study *s, &s->workers, worker)
ADDER(study_bin, study_add_bin, struct study *s, &s->histogram, bin)
ADDER(study_prediction, study_add_prediction, struct study *s, &s->predictions, prediction)

void study_text_set(char **text, const char *value)
{
    char *copy = value ? must(mem_strdup(value)) : NULL;

    mem_free(*text);
    *text = copy;
}

void study_base64(struct buffer *out, const void *data, size_t size_bytes)
{
    size_t length = 4 * ((size_bytes + 2) / 3);
    uint8_t *to;

    buffer_reserve(out, length + 1); /* EVP_EncodeBlock ends with a NUL */
    to = must(buffer_append_space(out, length));
    EVP_EncodeBlock(to, data, (int)size_bytes);
}

status study_picture_png(struct buffer *out, const struct study_picture *picture, struct error *err)
{
    static const struct picture_options exact = {.plain = 1};
    struct image image = {0};
    status result;

    TRY(image_init(&image, picture->width, picture->height, 3, err));
    for (size_t i = 0; i < (size_t)picture->width * picture->height * 3; i++)
        image.pixels[i] = (float)picture->rgb[i] / 255.0F;
    result = png_encode_as(out, &image, &exact, err);
    image_release(&image);
    return result;
}
