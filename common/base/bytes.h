/* bytes: integers and floats as bytes, least significant byte first unless the name says big. Any alignment. */
#pragma once

#include <stdint.h>
#include <string.h>

static inline uint16_t bytes_get16(const uint8_t *b) { return (uint16_t)(b[0] | b[1] << 8); }

static inline uint32_t bytes_get32(const uint8_t *b)
{
    return (uint32_t)b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
}

static inline uint64_t bytes_get64(const uint8_t *b) { return bytes_get32(b) | (uint64_t)bytes_get32(b + 4) << 32; }

static inline float bytes_get_float(const uint8_t *b)
{
    uint32_t bits = bytes_get32(b);
    float value;

    memcpy(&value, &bits, sizeof value);
    return value;
}

static inline uint32_t bytes_get16_big(const uint8_t *b) { return (uint32_t)b[0] << 8 | b[1]; }

static inline uint32_t bytes_get32_big(const uint8_t *b) { return bytes_get16_big(b) << 16 | bytes_get16_big(b + 2); }

static inline void bytes_put16(uint8_t *b, uint16_t value)
{
    b[0] = (uint8_t)value;
    b[1] = (uint8_t)(value >> 8);
}

static inline void bytes_put32(uint8_t *b, uint32_t value)
{
    for (int i = 0; i < 4; i++)
        b[i] = (uint8_t)(value >> 8 * i);
}

static inline void bytes_put32_big(uint8_t *b, uint32_t value)
{
    for (int i = 0; i < 4; i++)
        b[i] = (uint8_t)(value >> (24 - 8 * i));
}

static inline void bytes_put64(uint8_t *b, uint64_t value)
{
    bytes_put32(b, (uint32_t)value);
    bytes_put32(b + 4, (uint32_t)(value >> 32));
}

/* In sequence: the place behind what was put; and what is at *in, which moves behind it. */
static inline uint8_t *bytes_add32(uint8_t *out, uint32_t value)
{
    bytes_put32(out, value);
    return out + 4;
}

static inline uint8_t *bytes_add64(uint8_t *out, uint64_t value)
{
    bytes_put64(out, value);
    return out + 8;
}

static inline uint8_t *bytes_add_double(uint8_t *out, double value)
{
    uint64_t bits;

    memcpy(&bits, &value, sizeof bits);
    return bytes_add64(out, bits);
}

static inline uint8_t *bytes_add_float(uint8_t *out, float value)
{
    uint32_t bits;

    memcpy(&bits, &value, sizeof bits);
    return bytes_add32(out, bits);
}

static inline uint32_t bytes_take32(const uint8_t **in)
{
    *in += 4;
    return bytes_get32(*in - 4);
}

static inline uint64_t bytes_take64(const uint8_t **in)
{
    *in += 8;
    return bytes_get64(*in - 8);
}

static inline double bytes_take_double(const uint8_t **in)
{
    uint64_t bits = bytes_take64(in);
    double value;

    memcpy(&value, &bits, sizeof value);
    return value;
}

static inline float bytes_take_float(const uint8_t **in)
{
    *in += 4;
    return bytes_get_float(*in - 4);
}
