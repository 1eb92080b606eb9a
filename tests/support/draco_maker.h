/* draco_maker: Draco streams for tests of the importer, made by libdraco's encoder. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Encode positions as attribute 0 and joints (bytes, may be NULL) as attribute 1. sequential: points keep their order.
 * Returns the bytes written to out[most]; 0: it does not fit. */
size_t draco_make(const float (*positions)[3], const uint8_t (*joints)[4], size_t points, const uint16_t *indices,
                  size_t triangles, int sequential, uint8_t *out, size_t most);

#ifdef __cplusplus
}
#endif
