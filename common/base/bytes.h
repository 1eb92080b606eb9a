/* bytes: integers and floats as bytes, least significant byte first unless the name says big. Any
 * alignment. */
#ifndef AZULEJO_BASE_BYTES_H
#define AZULEJO_BASE_BYTES_H

#include <stdint.h>
#include <string.h>

static inline uint16_t bytes_get16(const uint8_t *b)
{
    return (uint16_t)(b[0] | b[1] << 8);
}

static inline uint32_t bytes_get32(const uint8_t *b)
{
    return (uint32_t)b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
}

static inline uint64_t bytes_get64(const uint8_t *b)
{
    return bytes_get32(b) | (uint64_t)bytes_get32(b + 4) << 32;
}

static inline float bytes_get_float(const uint8_t *b)
{
    uint32_t bits = bytes_get32(b);
    float value;

    memcpy(&value, &bits, sizeof value);
    return value;
}

static inline uint32_t bytes_get16_big(const uint8_t *b)
{
    return (uint32_t)b[0] << 8 | b[1];
}

static inline uint32_t bytes_get32_big(const uint8_t *b)
{
    return bytes_get16_big(b) << 16 | bytes_get16_big(b + 2);
}

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

static inline void bytes_put64(uint8_t *b, uint64_t value)
{
    bytes_put32(b, (uint32_t)value);
    bytes_put32(b + 4, (uint32_t)(value >> 32));
}

#endif
