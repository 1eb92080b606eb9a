/* scene_validate_parts: the internals of scene_validate, shared by its files; only they include this.
 *
 * scene_validate.c           the scene's tables, one after another
 * scene_validate_material.c  materials, by the rows of material_fields.h
 * scene_validate_values.c    the parts of all rows: names, numbers, indices, blobs
 */
#pragma once

#include "common/scene/scene.h"

/* The place of an error: the table and the row. */
struct check_place {
    const char *table;
    uint32_t row;
    const char *material; /* its name, once that has been checked; NULL: not in a material */
    struct error *err;
};

/* ERR_INPUT with the place, the field and what is wrong with it. */
status check_complain(const struct check_place *at, const char *field, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
status check_name(const struct check_place *at, const char *name) MUST_CHECK;
status check_range(const struct check_place *at, const char *field, float value, float low, float high) MUST_CHECK;
status check_ranges(const struct check_place *at, const char *field, const float *values, int count, float low,
                    float high) MUST_CHECK;
status check_flag(const struct check_place *at, const char *field, int value) MUST_CHECK;
status check_enum(const struct check_place *at, const char *field, unsigned value, unsigned count) MUST_CHECK;
status check_index(const struct check_place *at, const char *field, uint32_t index, uint32_t count) MUST_CHECK;
/* -1: none. */
status check_reference(const struct check_place *at, const char *field, int32_t index, uint32_t count) MUST_CHECK;
status check_transform(const struct check_place *at, const char *field, const struct transform_stored *t) MUST_CHECK;
status check_coordinates(const struct check_place *at, const char *field, const double *values, int count) MUST_CHECK;
status check_transform_d(const struct check_place *at, const char *field, const struct transform_d *t) MUST_CHECK;
status check_blob(const struct check_place *at, const struct scene_blob *blob) MUST_CHECK;
status check_material(const struct check_place *at, const struct scene *scene,
                      const struct scene_material *m) MUST_CHECK;
