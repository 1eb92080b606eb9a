/* meshopt: the streams of EXT_meshopt_compression and KHR_meshopt_compression, as appendices A and B of the latter
 * describe them: attributes of versions 0 and 1, triangles, indices, and the filters of attributes.
 *
 * Our own, because libmeshoptimizer reads version 1 from 0.23 on only.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

enum meshopt_mode { MESHOPT_ATTRIBUTES, MESHOPT_TRIANGLES, MESHOPT_INDICES, MESHOPT_MODES };
enum meshopt_filter {
    MESHOPT_NONE,
    MESHOPT_OCTAHEDRAL,
    MESHOPT_QUATERNION,
    MESHOPT_EXPONENTIAL,
    MESHOPT_COLOR,
    MESHOPT_FILTERS
};

/* By enum; as the file spells them. */
extern const char *const meshopt_mode_names[MESHOPT_MODES];
extern const char *const meshopt_filter_names[MESHOPT_FILTERS];

enum { MESHOPT_STRIDE_MAX = 256 };

/* Each returns NULL, or what is wrong, in words that follow the place. */

/* Can `count` elements of `stride` bytes lie in a stream of `size_bytes`? To be asked before memory is taken: a byte of a
 * stream never makes more than 1024. */
const char *meshopt_check(enum meshopt_mode mode, enum meshopt_filter filter, size_t count, size_t stride,
                          size_t size_bytes);
/* Decode into out[count * stride]; what meshopt_check refuses must not come here. */
const char *meshopt_decode(enum meshopt_mode mode, enum meshopt_filter filter, size_t count, size_t stride,
                           const uint8_t *stream, size_t size_bytes, uint8_t *out);
