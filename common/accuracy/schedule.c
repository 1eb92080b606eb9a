#include "common/accuracy/schedule.h"

#include <openssl/evp.h>
#include <stdio.h>
#include <string.h>
#include <zlib.h>

#include "common/film/tiles.h"

enum { SCHEDULE_VERSION = 1 };

status schedule_encode(struct buffer *text, uint32_t width, uint32_t height, uint32_t spp, const uint8_t *passes,
                       struct error *err)
{
    uLong count = (uLong)tile_count(width, height) * GROUPS;
    uLongf packed_bytes = compressBound(count);
    struct buffer packed = BUFFER_INIT;
    uint8_t *space = buffer_append_space(&packed, packed_bytes), *letters;
    size_t length;
    status s = STATUS_OK;

    if (!space || compress2(space, &packed_bytes, passes, count, Z_BEST_COMPRESSION) != Z_OK) {
        buffer_release(&packed);
        return error_no_memory(err, "a schedule");
    }
    length = (packed_bytes + 2) / 3 * 4;
    buffer_printf(text, "%d %ux%u %u ", SCHEDULE_VERSION, width, height, spp);
    letters = buffer_append_space(text, length + 1); /* and the NUL that is written after them */
    if (letters) {
        EVP_EncodeBlock(letters, space, (int)packed_bytes);
        text->size--;
    } else {
        s = error_no_memory(err, "a schedule");
    }
    buffer_release(&packed);
    return s;
}

/* The base64 letters' bytes; -1: not base64. */
static int decode_letters(const char *letters, size_t length, uint8_t *out)
{
    int bytes = length % 4 == 0 && length > 0 && length < 1 << 30
                    ? EVP_DecodeBlock(out, (const unsigned char *)letters, (int)length)
                    : -1;

    for (size_t i = length; bytes > 0 && i > length - 2 && letters[i - 1] == '='; i--)
        bytes--;
    return bytes;
}

static status check_passes(const uint8_t *passes, uint32_t tiles, uint32_t spp, struct error *err)
{
    for (uint32_t i = 0; i < tiles * GROUPS; i++)
        if (passes[i] > pass_count(spp, i % GROUPS))
            return error_set(err, STATUS_ERR_INPUT, "the schedule is damaged: tile %u has more than %u samples a pixel",
                             i / GROUPS, spp);
    return STATUS_OK;
}

status schedule_decode(const char *text, uint32_t *width, uint32_t *height, uint32_t *spp, struct buffer *passes,
                       struct error *err)
{
    struct buffer packed = BUFFER_INIT;
    unsigned version = 0;
    int begins = 0, packed_bytes = -1;
    uLongf count;
    uint8_t *space, *out;
    status s;

    *width = *height = *spp = 0;
    if (sscanf(text, "%u %ux%u %u %n", &version, width, height, spp, &begins) != 4 || begins == 0)
        return error_set(err, STATUS_ERR_INPUT, "the schedule is damaged");
    if (version != SCHEDULE_VERSION)
        return error_set(err, STATUS_ERR_INPUT, "the schedule is of version %u; this release reads %d", version,
                         SCHEDULE_VERSION);
    if (*width < 1 || *height < 1 || *width > SETTINGS_SIZE_MAX || *height > SETTINGS_SIZE_MAX || *spp < 1 ||
        *spp > SETTINGS_SPP_MAX)
        return error_set(err, STATUS_ERR_INPUT, "the schedule is damaged: %ux%u pixels, %u samples", *width, *height,
                         *spp);
    count = (uLongf)tile_count(*width, *height) * GROUPS;
    space = buffer_append_space(&packed, strlen(text + begins) + 1);
    out = space ? buffer_append_space(passes, count) : NULL;
    if (!out) {
        buffer_release(&packed);
        return error_no_memory(err, "a schedule");
    }
    packed_bytes = decode_letters(text + begins, strlen(text + begins), space);
    if (packed_bytes < 0 || uncompress(out, &count, space, (uLong)packed_bytes) != Z_OK ||
        count != (uLongf)tile_count(*width, *height) * GROUPS)
        s = error_set(err, STATUS_ERR_INPUT, "the schedule is damaged");
    else
        s = check_passes(out, tile_count(*width, *height), *spp, err);
    buffer_release(&packed);
    return s;
}
