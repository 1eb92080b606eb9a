/* The values of a PLY file, in text or binary. */
#include <math.h>
#include <string.h>

#include "client/import/builder/scan.h"
#include "client/import/ply/ply_parts.h"

static const size_t type_bytes[] = {0, 1, 1, 2, 2, 4, 4, 4, 8};

static status cut_short(const struct ply *p)
{
    return error_set(p->err, STATUS_ERR_INPUT, "the data is cut short after %zu bytes", (size_t)(p->end - p->start));
}

static status read_ascii(struct ply *p, double *out)
{
    const char *end = (const char *)p->end;
    size_t length;

    while (p->at < p->end && (*p->at == ' ' || (*p->at >= '\t' && *p->at <= '\r'))) {
        p->line += *p->at == '\n';
        p->at++;
    }
    if (p->at == p->end)
        return cut_short(p);
    length = scan_double((const char *)p->at, end, out);
    p->at += length;
    if (length == 0 || (p->at<p->end && * p->at> ' '))
        return error_set(p->err, STATUS_ERR_INPUT, "line %zu: is not a number", p->line);
    return STATUS_OK;
}

status ply_value_read(struct ply *p, enum ply_type type, double *out)
{
    size_t size = type_bytes[type];
    uint64_t bits = 0;
    float single;

    if (p->format == FORMAT_ASCII)
        return read_ascii(p, out);
    if ((size_t)(p->end - p->at) < size)
        return cut_short(p);
    for (size_t i = 0; i < size; i++)
        bits |= (uint64_t)p->at[p->format == FORMAT_LITTLE ? i : size - 1 - i] << 8 * i;
    p->at += size;
    switch (type) {
    case TYPE_I8: *out = (int8_t)bits; break;
    case TYPE_I16: *out = (int16_t)bits; break;
    case TYPE_I32: *out = (int32_t)bits; break;
    case TYPE_F32: {
        uint32_t low = (uint32_t)bits;
        memcpy(&single, &low, sizeof single);
        *out = (double)single;
        break;
    }
    case TYPE_F64: memcpy(out, &bits, sizeof *out); break;
    default: *out = (double)bits; break;
    }
    return STATUS_OK;
}

status ply_list_size(struct ply *p, const struct property *property, size_t *out)
{
    size_t least = p->format == FORMAT_ASCII ? 2 : type_bytes[property->type];
    size_t left;
    double count;

    TRY(ply_value_read(p, property->count_type, &count));
    left = (size_t)(p->end - p->at);
    if (!(count >= 0 && count == floor(count)))
        return error_set(p->err, STATUS_ERR_INPUT, "a list has %g values: line or byte %zu", count,
                         p->format == FORMAT_ASCII ? p->line : (size_t)(p->at - p->start));
    if (count > (double)left / (double)least)
        return cut_short(p);
    *out = (size_t)count;
    return STATUS_OK;
}

status ply_property_skip(struct ply *p, const struct property *property)
{
    size_t count = 1;
    double value;

    if (property->count_type != TYPE_NONE)
        TRY(ply_list_size(p, property, &count));
    if (p->format != FORMAT_ASCII) {
        size_t bytes = count * type_bytes[property->type];
        if ((size_t)(p->end - p->at) < bytes)
            return cut_short(p);
        p->at += bytes;
        return STATUS_OK;
    }
    for (size_t i = 0; i < count; i++)
        TRY(ply_value_read(p, property->type, &value));
    return STATUS_OK;
}

status ply_check_room(struct ply *p, const struct element *element)
{
    size_t least = 0;

    for (uint32_t i = 0; i < element->property_count; i++) {
        const struct property *property = &p->properties[element->first_property + i];
        least += p->format == FORMAT_ASCII           ? 2
                 : property->count_type != TYPE_NONE ? type_bytes[property->count_type]
                                                     : type_bytes[property->type];
    }
    /* + 1: the last value of a text needs no space after it. */
    if (least && element->count > ((size_t)(p->end - p->at) + 1) / least)
        return cut_short(p);
    return STATUS_OK;
}
