/* sky_guide: sampling, and densities. The guide is made by sky_guide_build.c. */
#include "worker/render/light/environment/sky_guide.h"

#include "worker/render/light/environment/environment_map.h"

/* The density of a direction of the map: of the windows alone, or of all. */
static real windows_pdf(const struct environment *env, const struct sky_region *region, real u, real v)
{
    real pdf = 0;

    for (uint32_t i = 0, first = environment_first_window(env); first + i < env->part_count; i++) {
        const real odds = region->window_start[i + 1] - region->window_start[i];

        if (odds > 0)
            pdf += odds * density_at(&env->parts[first + i], u, v) / environment_part_share(env, first + i);
    }
    return region->window_share * pdf;
}

static uint32_t cell_index(real at, uint32_t count)
{
    const uint32_t i = (uint32_t)(int32_t)(at * (real)count);

    return i < count ? i : count - 1;
}

static real cell_odds(const struct sky_region *region, uint32_t row, uint32_t column)
{
    return (1 - region->window_share) * distribution_row_odds(&region->cells, row) *
           (real)(int32_t)distribution_width(&region->cells, row, column) / DISTRIBUTION_WHOLE;
}

static real pdf_at(const struct sky_guide *g, const struct environment *env, const struct sky_region *region,
                   const struct lat_long *at)
{
    const real v = at->south ? 1 - at->distance : at->distance;
    const uint32_t row = cell_index(v, SKY_ROWS), column = cell_index(at->u, SKY_COLUMNS);

    return cell_odds(region, row, column) * density_at(&g->cells[row * SKY_COLUMNS + column], at->u, v) +
           windows_pdf(env, region, at->u, v);
}

real sky_guide_pdf(const struct sky_guide *g, const struct environment *env, const struct sky_region *region,
                   struct vec3 direction)
{
    struct lat_long at;

    lat_long_of(environment_to_map(env, direction), &at);
    return pdf_at(g, env, region, &at);
}

struct vec3 sky_guide_radiance(const struct sky_guide *g, const struct environment *env,
                               const struct sky_region *region, struct vec3 direction, real *pdf)
{
    struct lat_long at;

    lat_long_of(environment_to_map(env, direction), &at);
    *pdf = pdf_at(g, env, region, &at);
    return env->width == 0 ? env->constant : environment_read(env, &at);
}

static int aim_at_window(const struct sky_guide *g, const struct environment *env, const struct sky_region *region,
                         real u, real v, struct vec3 *direction, real *pdf)
{
    const uint32_t first = environment_first_window(env);
    struct density_choice choice;
    struct lat_long at;
    uint32_t i = 0;
    struct vec3 d;

    while (first + i + 1 < env->part_count && u >= region->window_start[i + 1])
        i++;
    u = light_rescaled(u, region->window_start[i], region->window_start[i + 1] - region->window_start[i]);
    density_choose(&env->parts[first + i], u, v, &choice);
    d = environment_chosen(&choice);
    *direction = vec3_normalize(environment_from_map(env, d));
    lat_long_of(d, &at);
    *pdf = pdf_at(g, env, region, &at);
    return *pdf > 0;
}

int sky_guide_aim(const struct sky_guide *g, const struct environment *env, const struct sky_region *region, real u,
                  real v, struct vec3 *direction, real *pdf)
{
    struct distribution_cell cell;
    struct density_choice choice;
    struct lat_long at;
    struct vec3 d;

    u = real_min(real_max(u, 0), REAL_BELOW_ONE);
    v = real_min(real_max(v, 0), REAL_BELOW_ONE);
    if (v < region->window_share)
        return aim_at_window(g, env, region, u, light_rescaled(v, 0, region->window_share), direction, pdf);
    v = light_rescaled(v, region->window_share, 1 - region->window_share);
    distribution_choose(&region->cells, u, v, &cell);
    density_choose(&g->cells[cell.row * SKY_COLUMNS + cell.column], real_min(cell.column_fraction, REAL_BELOW_ONE),
                   real_min(cell.row_fraction, REAL_BELOW_ONE), &choice);
    d = environment_chosen(&choice);
    *direction = vec3_normalize(environment_from_map(env, d));
    *pdf = cell_odds(region, cell.row, cell.column) * choice.pdf;
    if (region->window_share > 0) {
        lat_long_of(d, &at);
        *pdf += windows_pdf(env, region, at.u, at.south ? 1 - at.distance : at.distance);
    }
    return *pdf > 0;
}
