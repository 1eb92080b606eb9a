/* The parts of the rows of every table: names, numbers, indices, blobs. */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "common/scene/pack/scene_validate_parts.h"

status check_complain(const struct check_place *at, const char *field, const char *format, ...)
{
    char what[128];
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(what, sizeof what, format, arguments);
    va_end(arguments);
    if (at->material && *at->material)
        return error_set(at->err, STATUS_ERR_INPUT, "the scene's %s[%u].%s %s (material \"%s\")", at->table, at->row,
                         field, what, at->material);
    return error_set(at->err, STATUS_ERR_INPUT, "the scene's %s[%u].%s %s", at->table, at->row, field, what);
}

/* UTF-8 without control characters: names are printed on terminals and web pages. */
static int name_is_clean(const char *name)
{
    const uint8_t *p = (const uint8_t *)name;

    for (; *p; p++) {
        uint32_t code = *p;
        int more = 0;

        if (code < 0x20 || code == 0x7f)
            return 0;
        if (code >= 0xf8 || (code >= 0x80 && code < 0xc0))
            return 0;
        if (code >= 0xf0)
            more = 3, code &= 0x07;
        else if (code >= 0xe0)
            more = 2, code &= 0x0f;
        else if (code >= 0xc0)
            more = 1, code &= 0x1f;
        for (int i = 0; i < more; i++) {
            if ((p[1] & 0xc0) != 0x80)
                return 0;
            code = code << 6 | (*++p & 0x3f);
        }
        /* Overlong forms, surrogates, C1 controls and codes beyond Unicode. */
        if ((more == 1 && code < 0xa0) || (more == 2 && code < 0x800) || (more == 3 && code < 0x10000) ||
            code > 0x10ffff || (code >= 0xd800 && code < 0xe000))
            return 0;
    }
    return 1;
}

status check_name(const struct check_place *at, const char *name)
{
    if (!name)
        return check_complain(at, "name", "is missing");
    if (strlen(name) > SCENE_NAME_MAX)
        return check_complain(at, "name", "is longer than 255 bytes");
    if (!name_is_clean(name))
        return check_complain(at, "name", "is not UTF-8 text without control characters");
    return STATUS_OK;
}

status check_range(const struct check_place *at, const char *field, float value, float low, float high)
{
    if (!(value >= low && value <= high))
        return check_complain(at, field, "is %g: must be %g to %g", (double)value, (double)low, (double)high);
    return STATUS_OK;
}

status check_ranges(const struct check_place *at, const char *field, const float *values, int count, float low,
                    float high)
{
    status result = STATUS_OK;

    for (int i = 0; i < count && result == STATUS_OK; i++)
        result = check_range(at, field, values[i], low, high);
    return result;
}

status check_flag(const struct check_place *at, const char *field, int value)
{
    return value == 0 || value == 1 ? STATUS_OK : check_complain(at, field, "must be 0 or 1");
}

status check_enum(const struct check_place *at, const char *field, unsigned value, unsigned count)
{
    return value < count ? STATUS_OK : check_complain(at, field, "is not a known kind");
}

status check_index(const struct check_place *at, const char *field, uint32_t index, uint32_t count)
{
    if (index < count)
        return STATUS_OK;
    return check_complain(at, field, "is %u: there are %u", index, count);
}

status check_reference(const struct check_place *at, const char *field, int32_t index, uint32_t count)
{
    if (index < 0)
        return index == -1 ? STATUS_OK : check_complain(at, field, "is below -1");
    return check_index(at, field, (uint32_t)index, count);
}

status check_transform(const struct check_place *at, const char *field, const struct transform_stored *t)
{
    return check_ranges(at, field, &t->m[0][0], 12, -SCENE_COORDINATE_MAX, SCENE_COORDINATE_MAX);
}

status check_coordinates(const struct check_place *at, const char *field, const double *values, int count)
{
    const double most = (double)SCENE_COORDINATE_MAX;

    for (int i = 0; i < count; i++)
        if (!(values[i] >= -most && values[i] <= most))
            return check_complain(at, field, "is %g: must be %g to %g", values[i], -most, most);
    return STATUS_OK;
}

status check_transform_d(const struct check_place *at, const char *field, const struct transform_d *t)
{
    return check_coordinates(at, field, &t->m[0][0], 12);
}

status check_blob(const struct check_place *at, const struct scene_blob *blob)
{
    if (blob->size_bytes == 0 || blob->size_bytes > SCENE_BLOB_BYTES_MAX)
        return check_complain(at, "blob", "is empty or too large");
    return STATUS_OK;
}
