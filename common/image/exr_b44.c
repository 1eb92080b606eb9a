/* B44 and B44A, decoded here because OpenEXRCore 3.1.5 decodes them wrongly for pictures whose sides are not multiples
 * of four and for channels that are not halves.
 *
 * A chunk holds channel after channel. Channels that are not HALF are stored unchanged. A HALF channel is divided into
 * blocks of 4 x 4 samples, in rows, those past the edges padded. A block takes 14 bytes: the first sample (16 bits,
 * most significant first), a shift (6 bits), and 15 differences of 6 bits in the order below; or 3 bytes, if the shift
 * is 13 or more: all samples are the first one (B44A's flat block). Samples are in an order-preserving code: positive
 * halves with the top bit set, negative ones complemented. (OpenEXR's technical introduction, "Data Compression".)
 */
#include <string.h>

#include "common/base/bytes.h"
#include "common/image/exr_context.h"
#include "common/image/half.h"

enum { BLOCK_SIDE = 4, BLOCK_SAMPLES = 16, BLOCK_BYTES = 14, FLAT_BYTES = 3, FLAT_SHIFT = 13 };

struct b44_input {
    const uint8_t *at, *end;
};

static uint16_t from_ordered(uint16_t code) { return code & 0x8000 ? code & 0x7fff : (uint16_t)~code; }

/* 0 when the chunk ends too early. */
static int read_block(struct b44_input *in, uint16_t samples[BLOCK_SAMPLES])
{
    static const uint8_t order[BLOCK_SAMPLES - 1] = {4, 8,  12, 1, 5, 9,  13, 2,
                                                     6, 10, 14, 3, 7, 11, 15};
    uint16_t codes[BLOCK_SAMPLES];
    unsigned shift, bit = 22;

    if (in->end - in->at < FLAT_BYTES)
        return 0;
    codes[0] = (uint16_t)(in->at[0] << 8 | in->at[1]);
    shift = in->at[2] >> 2;
    if (shift >= FLAT_SHIFT) {
        for (int i = 0; i < BLOCK_SAMPLES; i++)
            samples[i] = from_ordered(codes[0]);
        in->at += FLAT_BYTES;
        return 1;
    }
    if (in->end - in->at < BLOCK_BYTES)
        return 0;
    for (int i = 0; i < BLOCK_SAMPLES - 1; i++, bit += 6) {
        unsigned two = (unsigned)in->at[bit / 8] << 8;
        int difference;

        if (bit / 8 + 1 < BLOCK_BYTES)
            two |= in->at[bit / 8 + 1];
        difference = (int)(two >> (10 - bit % 8) & 0x3f) - 0x20;
        /* The first column goes down from the sample above, the others from the left. */
        codes[order[i]] = (uint16_t)(codes[order[i] - (order[i] % 4 == 0 ? 4 : 1)] + difference * (1 << shift));
    }
    for (int i = 0; i < BLOCK_SAMPLES; i++)
        samples[i] = from_ordered(codes[i]);
    in->at += BLOCK_BYTES;
    return 1;
}

/* Channels marked perceptually linear are coded as exp(x / 8). */
static uint16_t undo_exponential(uint16_t coded)
{
    float value = half_to_float(coded);

    if (!(value > 0.0f) || isinf(value))
        return 0;
    return half_from_float((float)(8.0 * det_log_d((double)value)));
}

/* One channel of the chunk: its samples of line y go to out + y * line_stride. */
static exr_result_t decode_channel(const exr_coding_channel_info_t *channel, int32_t height, uint8_t *out,
                                   size_t line_stride, struct b44_input *in)
{
    size_t line_bytes = (size_t)channel->width * (size_t)channel->bytes_per_element;

    if (channel->data_type != EXR_PIXEL_HALF) {
        for (int32_t y = 0; y < height; y++, in->at += line_bytes) {
            if ((size_t)(in->end - in->at) < line_bytes)
                return EXR_ERR_CORRUPT_CHUNK;
            memcpy(out + (size_t)y * line_stride, in->at, line_bytes);
        }
        return EXR_ERR_SUCCESS;
    }
    for (int32_t y = 0; y < height; y += BLOCK_SIDE)
        for (int32_t x = 0; x < channel->width; x += BLOCK_SIDE) {
            uint16_t samples[BLOCK_SAMPLES];

            if (!read_block(in, samples))
                return EXR_ERR_CORRUPT_CHUNK;
            for (int i = 0; i < BLOCK_SAMPLES; i++) {
                int32_t to_y = y + i / BLOCK_SIDE, to_x = x + i % BLOCK_SIDE;

                if (to_y < height && to_x < channel->width)
                    bytes_put16(out + (size_t)to_y * line_stride + 2 * (size_t)to_x,
                                channel->p_linear ? undo_exponential(samples[i]) : samples[i]);
            }
        }
    return EXR_ERR_SUCCESS;
}

exr_result_t exr_b44_decompress(exr_decode_pipeline_t *pipeline)
{
    struct b44_input in = {pipeline->packed_buffer,
                           (const uint8_t *)pipeline->packed_buffer + pipeline->chunk.packed_size};
    exr_result_t result = EXR_ERR_SUCCESS;
    size_t line_stride = 0, start = 0;

    if (pipeline->unpacked_buffer == pipeline->packed_buffer)
        return EXR_ERR_SUCCESS; /* stored unchanged, because coding did not make it smaller */
    if (pipeline->chunk.packed_size == pipeline->chunk.unpacked_size) {
        memcpy(pipeline->unpacked_buffer, pipeline->packed_buffer, pipeline->chunk.packed_size);
        return EXR_ERR_SUCCESS;
    }
    for (int c = 0; c < pipeline->channel_count; c++) {
        const exr_coding_channel_info_t *channel = &pipeline->channels[c];

        if (channel->x_samples != 1 || channel->y_samples != 1 || channel->width != pipeline->chunk.width)
            return EXR_ERR_FEATURE_NOT_IMPLEMENTED;
        line_stride += (size_t)channel->width * (size_t)channel->bytes_per_element;
    }
    if (line_stride * (size_t)pipeline->chunk.height != pipeline->chunk.unpacked_size)
        return EXR_ERR_CORRUPT_CHUNK;
    for (int c = 0; result == EXR_ERR_SUCCESS && c < pipeline->channel_count; c++) {
        const exr_coding_channel_info_t *channel = &pipeline->channels[c];

        result = decode_channel(channel, pipeline->chunk.height, (uint8_t *)pipeline->unpacked_buffer + start,
                                line_stride, &in);
        start += (size_t)channel->width * (size_t)channel->bytes_per_element;
    }
    return result;
}
