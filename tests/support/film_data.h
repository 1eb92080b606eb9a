/* film_data: results of units as a pure function of their names, for tests of the film. */
#pragma once

#include "common/film/film.h"

/* Positive numbers of very different magnitudes, of a hash. */
float film_data_spread(uint32_t h);
/* A unit's result, with magnitudes far apart so that the order of additions shows in the sums' last bits,
 * and AOVs if the film has any. `sums` has room for TILE_FLOATS_MAX. */
struct unit_result film_data_unit(const struct film *film, uint32_t tile, uint32_t group, uint32_t pass, float *sums);
/* Merge a unit; fails the test unless it is taken. */
enum film_merge_result film_data_give(struct film *film, const struct unit_result *unit);
/* Make it and merge it; fails the test unless it is taken. */
enum film_merge_result film_data_merge(struct film *film, uint32_t tile, uint32_t group, uint32_t pass);
/* A film with everything wanted, and both groups frozen with plain codes. */
struct film *film_data_new(uint32_t width, uint32_t height, uint32_t spp, uint32_t aovs);
/* The same with every unit merged in order. */
struct film *film_data_whole(uint32_t width, uint32_t height, uint32_t spp, uint32_t aovs);
/* Fails the test unless pictures, errors and the bytes of every tile's state are the same. */
void film_data_assert_same(const struct film *a, const struct film *b);
