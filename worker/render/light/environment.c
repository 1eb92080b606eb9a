/* The map is cut into cells between texel centres: column i from centre i to centre i + 1
 * (periodic), strip k from row k - 1 to row k, strips 0 and H from a row to its pole and half
 * as high. In a cell, radiance and density are both bilinear between four nodes.
 *
 * A pole's node: going straight over the pole from row 0 at u one meets row 0 at u + 1/2, so
 * the radiance at the pole, seen from column u, is P(u), the mean of the two. The density's
 * node there would be P sin(0) = 0; but where row 0 is darker than the row across, radiance
 * leaks into the strip that the row's own node R knows nothing of. With x from the pole (0)
 * to the row (1), radiance * sin(theta) is close to x (P (1 - x) + R x) sin(theta_row), whose
 * integral P / 6 + R / 3 a pole node of (P - R) / 3 reproduces; it is taken where positive.
 */
#include "worker/render/light/environment.h"

#include <float.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "worker/render/light/distribution.h"

/* Density and solid angle are evaluated this far from a pole (radians) for directions that are
 * nearer: at the pole itself both would be 0. */
#define POLE_SINE_MIN 1e-12f

enum mode { MODE_NONE, MODE_UNIFORM, MODE_IMPORTANCE };

struct environment {
    uint32_t width, height;   /* 0: constant */
    struct image map;         /* strength is multiplied in */
    double *row_sine;         /* [height] sin(theta) of the rows' centres */
    struct vec3 constant;
    float rotation;           /* turns, 0..1 */
    enum mode mode;
    int black;
    float mean_luminance;
    struct distribution cells; /* height + 1 strips x width; MODE_IMPORTANCE only */
    double density_scale;      /* node weight to solid-angle density times sin(theta) */
};

static double luminance(struct vec3 c)
{
    /* In double: the weights of the largest floats must not overflow when summed. */
    return 0.212656 * (double)c.x + 0.715158 * (double)c.y + 0.072186 * (double)c.z;
}

/* sin(pi v) for 0 <= v <= 1, precise at both ends. */
static double sine_pi(double v)
{
    return (double)det_sin((float)(PI_D * (v < 0.5 ? v : 1.0 - v)));
}

/* ---- nodes and cells ---------------------------------------------------------------------- */

static inline struct vec3 texel(const struct environment *env, uint32_t column, uint32_t row)
{
    const float *p = env->map.pixels + 3 * ((size_t)row * env->width + column);

    return (struct vec3){p[0], p[1], p[2]};
}

/* The texel of the same row half-way round; between two columns where the width is odd. */
static struct vec3 opposite(const struct environment *env, uint32_t column, uint32_t row)
{
    uint32_t width = env->width, a = (column + width / 2) % width;

    if (width % 2 == 0)
        return texel(env, a, row);
    return vec3_lerp(texel(env, a, row), texel(env, (a + 1) % width, row), 0.5f);
}

/* A cell, seen from the nearer pole: `near` is its edge on the pole's side. */
struct cell {
    struct vec3 near[2], far[2]; /* radiance at columns i and i + 1 */
    double near_weight[2], far_weight[2]; /* luminance * sin(theta); at a pole see above */
};

/* Which cell and where in it: what a direction is turned into. */
struct place {
    uint32_t column;  /* cell column, 0..width-1 */
    uint32_t strip;   /* counted from the nearer pole; 0 is the pole's */
    int south;        /* the nearer pole is the nadir */
    float x, y;       /* 0..1 from column to column, and from the near edge to the far one */
};

static inline void cell_load(const struct environment *env, const struct place *at, int weighted,
                             struct cell *cell)
{
    uint32_t last = env->height - 1;
    uint32_t columns[2] = {at->column, at->column + 1 < env->width ? at->column + 1 : 0};
    uint32_t far_step = at->strip < last ? at->strip : last;
    uint32_t far_row = at->south ? last - far_step : far_step;

    for (int c = 0; c < 2; c++)
        cell->far[c] = texel(env, columns[c], far_row);
    if (weighted)
        for (int c = 0; c < 2; c++)
            cell->far_weight[c] = luminance(cell->far[c]) * env->row_sine[far_row];
    if (at->strip > 0) {
        uint32_t near_row = at->south ? far_row + 1 : far_row - 1;

        for (int c = 0; c < 2; c++)
            cell->near[c] = texel(env, columns[c], near_row);
        if (weighted)
            for (int c = 0; c < 2; c++)
                cell->near_weight[c] = luminance(cell->near[c]) * env->row_sine[near_row];
        return;
    }
    for (int c = 0; c < 2; c++) {
        cell->near[c] = vec3_lerp(cell->far[c], opposite(env, columns[c], far_row), 0.5f);
        if (weighted) {
            double excess = luminance(cell->near[c]) - luminance(cell->far[c]);

            cell->near_weight[c] = excess > 0 ? excess / 3 * env->row_sine[far_row] : 0;
        }
    }
}

static inline struct vec3 cell_radiance(const struct cell *cell, float x, float y)
{
    return vec3_lerp(vec3_lerp(cell->near[0], cell->near[1], x),
                     vec3_lerp(cell->far[0], cell->far[1], x), y);
}

static inline double cell_weight(const struct cell *cell, double x, double y)
{
    double near = cell->near_weight[0] * (1 - x) + cell->near_weight[1] * x;
    double far = cell->far_weight[0] * (1 - x) + cell->far_weight[1] * x;

    return near * (1 - y) + far * y;
}

/* Distance from the nearer pole over pi. */
static inline float pole_distance(const struct environment *env, uint32_t strip, float y)
{
    float height = (float)env->height;

    return strip == 0 ? 0.5f * y / height : ((float)strip - 0.5f + y) / height;
}

/* What a direction means in the map. */
struct angles {
    float u;        /* 0..1, rotation undone */
    float distance; /* from the nearer pole over pi, 0..1/2 */
    float sine;     /* of theta */
    int south;      /* the nearer pole is the nadir */
};

static inline void place_of(const struct environment *env, const struct angles *angles,
                            struct place *at)
{
    float x = angles->u * (float)env->width - 0.5f, rows = angles->distance * (float)env->height;
    int32_t column = x < 0 ? -1 : (int32_t)x;

    at->x = x - (float)column;
    at->column = column < 0 ? env->width - 1 : (uint32_t)column;
    at->south = angles->south;
    if (rows < 0.5f) {
        at->strip = 0;
        at->y = 2.0f * rows;
        return;
    }
    rows -= 0.5f;
    at->strip = (uint32_t)rows + 1;
    at->y = rows - (float)(at->strip - 1);
    if (env->height == 1) { /* the equator is the far edge of both pole strips */
        at->strip = 0;
        at->y = 1.0f;
    }
}

/* ---- directions --------------------------------------------------------------------------- */

/* 0 if it is no direction. */
static inline int angles_of(const struct environment *env, struct vec3 d, struct angles *out)
{
    float radius2 = d.x * d.x + d.z * d.z, length2 = radius2 + d.y * d.y, u;

    if (!(length2 > 0 && length2 < INFINITY))
        return 0;
    /* Not acos(y), which knows nothing of angles below 3e-4 from a pole. */
    out->sine = sqrtf(radius2);
    out->distance = det_atan2(out->sine, fabsf(d.y)) * INV_PI_F;
    out->south = d.y < 0;
    u = 0.5f + det_atan2(d.z, d.x) * INV_2PI_F + env->rotation;
    out->u = u >= 1.0f ? u - 1.0f : u;
    return 1;
}

static inline struct vec3 direction_of(const struct environment *env, float u, float distance,
                                       int south, float *sine)
{
    float cos_theta, sin_phi, cos_phi;

    det_sincos((u - 0.5f - env->rotation) * (2.0f * PI_F), &sin_phi, &cos_phi);
    det_sincos(distance * PI_F, sine, &cos_theta);
    return (struct vec3){*sine * cos_phi, south ? -cos_theta : cos_theta, *sine * sin_phi};
}

/* Solid-angle density at a place of an importance-sampled map, `sine` of theta. */
static float place_pdf(const struct environment *env, const struct cell *cell,
                       const struct place *at, float sine)
{
    double y = (double)at->y, pdf;

    if (sine < POLE_SINE_MIN) {
        sine = POLE_SINE_MIN;
        y = (double)POLE_SINE_MIN * (2 / PI_D) * (double)env->height;
    }
    pdf = cell_weight(cell, (double)at->x, y) * env->density_scale / (double)sine;
    return pdf < (double)FLT_MAX ? (float)pdf : FLT_MAX;
}

struct vec3 environment_radiance_pdf(const struct environment *env, struct vec3 direction,
                                     float *pdf)
{
    struct angles angles;
    struct place at;
    struct cell cell;

    *pdf = 0;
    if (!angles_of(env, direction, &angles))
        return vec3_splat(0);
    if (env->mode == MODE_UNIFORM)
        *pdf = 0.25f * INV_PI_F;
    if (env->width == 0 || env->black)
        return env->constant;
    place_of(env, &angles, &at);
    cell_load(env, &at, env->mode == MODE_IMPORTANCE, &cell);
    if (env->mode == MODE_IMPORTANCE)
        *pdf = place_pdf(env, &cell, &at, angles.sine);
    return cell_radiance(&cell, at.x, at.y);
}

struct vec3 environment_radiance(const struct environment *env, struct vec3 direction)
{
    struct angles angles;
    struct place at;
    struct cell cell;

    if (!angles_of(env, direction, &angles))
        return vec3_splat(0);
    if (env->width == 0 || env->black)
        return env->constant;
    place_of(env, &angles, &at);
    cell_load(env, &at, 0, &cell);
    return cell_radiance(&cell, at.x, at.y);
}

float environment_pdf(const struct environment *env, struct vec3 direction)
{
    float pdf;

    (void)environment_radiance_pdf(env, direction, &pdf);
    return pdf;
}

/* ---- sampling ----------------------------------------------------------------------------- */

/* x in [0, 1] with density proportional to a (1 - x) + b x; a + b > 0. The form without
 * cancellation; squares of floats' products stay inside double. */
static double sample_linear(double a, double b, double u)
{
    double x = u * (a + b) / (a + sqrt(a * a * (1 - u) + b * b * u));

    return x < 1 ? x : 1;
}

/* Ask for the texels of a block of columns on both edges of a strip: at random places in a map
 * beyond the cache, waiting for them one after the other is half of the time. */
static inline void block_prefetch(const struct environment *env, uint32_t strip, uint32_t column)
{
    uint32_t left = env->width - column;
    size_t row = strip > 0 ? strip - 1 : 0;
    uint32_t floats = 3 * (left < DISTRIBUTION_BLOCK ? left : DISTRIBUTION_BLOCK);

    for (int edge = 0; edge < 2; edge++, row += row + 1 < env->height) {
        const float *p = env->map.pixels + 3 * (row * env->width + column);

        for (uint32_t i = 0; i < floats; i += 16) /* 64 bytes a cache line */
            __builtin_prefetch(p + i);
    }
}

static int sample_map(const struct environment *env, float u, float v, struct vec3 *direction,
                      struct vec3 *radiance, float *pdf)
{
    struct distribution_cell chosen;
    struct place at;
    struct cell cell;
    double y, near, far;
    float map_u, sine;

    distribution_choose_block(&env->cells, u, v, &chosen);
    block_prefetch(env, chosen.row, chosen.column);
    distribution_choose_column(&env->cells, u, &chosen);
    at.column = chosen.column;
    at.south = chosen.row > env->height / 2;
    at.strip = at.south ? env->height - chosen.row : chosen.row;
    cell_load(env, &at, 1, &cell);

    near = cell.near_weight[0] + cell.near_weight[1];
    far = cell.far_weight[0] + cell.far_weight[1];
    if (!(near + far > 0))
        return 0;
    y = sample_linear(near, far, at.south ? 1 - chosen.row_fraction : chosen.row_fraction);
    near = cell.near_weight[0] * (1 - y) + cell.far_weight[0] * y;
    far = cell.near_weight[1] * (1 - y) + cell.far_weight[1] * y;
    if (!(near + far > 0))
        return 0;
    at.x = (float)sample_linear(near, far, chosen.column_fraction);
    at.y = (float)y;

    map_u = ((float)at.column + 0.5f + at.x) / (float)env->width;
    *direction = direction_of(env, map_u, pole_distance(env, at.strip, at.y), at.south, &sine);
    *radiance = cell_radiance(&cell, at.x, at.y);
    *pdf = place_pdf(env, &cell, &at, sine);
    return *pdf > 0;
}

int environment_sample(const struct environment *env, float u, float v, struct vec3 *direction,
                       struct vec3 *radiance, float *pdf)
{
    float y, radius, sine, cosine;

    u = float_min(float_max(u, 0.0f), ONE_MINUS_EPSILON);
    v = float_min(float_max(v, 0.0f), ONE_MINUS_EPSILON);
    if (env->mode == MODE_IMPORTANCE)
        return sample_map(env, u, v, direction, radiance, pdf);
    *direction = vec3_make(0, 1, 0);
    *radiance = vec3_splat(0);
    *pdf = 0;
    if (env->mode == MODE_NONE)
        return 0;
    y = 1.0f - 2.0f * v;
    radius = 2.0f * sqrtf(v * (1.0f - v));
    det_sincos(u * (2.0f * PI_F), &sine, &cosine);
    *direction = vec3_make(radius * cosine, y, radius * sine);
    *radiance = environment_radiance(env, *direction);
    *pdf = 0.25f * INV_PI_F;
    return 1;
}

/* ---- making ------------------------------------------------------------------------------- */

/* Integral over v of a row's bilinear weight times sin(pi v), times pi / 2: the row's share of
 * the mean over the sphere. Rows 0 and H - 1 also own the strip to the pole: averaged over u
 * the radiance there is the row's. Gauss-Legendre, five points an interval of at most 1/H. */
static double row_share(uint32_t row, uint32_t height)
{
    static const double node[3] = {0.0, 0.53846931010568309104, 0.90617984593866399280};
    static const double weight[3] = {0.56888888888888888889, 0.47862867049936646804,
                                     0.23692688505618908751};
    double h = 1.0 / height, centre = (row + 0.5) * h, sum = 0;

    for (int side = -1; side <= 1; side += 2) {
        int to_pole = side < 0 ? row == 0 : row == height - 1;
        double length = to_pole ? 0.5 * h : h;

        for (int i = -2; i <= 2; i++) {
            double x =
                0.5 + (i < 0 ? -0.5 : 0.5) * node[i < 0 ? -i : i]; /* from the centre, 0..1 */

            sum += weight[i < 0 ? -i : i] * 0.5 * length * (to_pole ? 1.0 : 1.0 - x) *
                   sine_pi(centre + side * length * x);
        }
    }
    return sum * PI_D / 2;
}

/* Multiply the strength in, and mend what no radiance can be. Returns the largest value. */
static float scale_pixels(struct image *map, float strength)
{
    size_t count = (size_t)map->width * map->height * 3;
    float largest = 0;

    for (size_t i = 0; i < count; i++) {
        float value = map->pixels[i], scaled = value > 0 ? value * strength : 0.0f;

        if (!(scaled < FLT_MAX)) /* the product of infinity and 0 too */
            scaled = strength > 0 ? FLT_MAX : 0.0f;
        if (scaled != value)
            map->pixels[i] = scaled;
        largest = scaled > largest ? scaled : largest;
    }
    return largest;
}

static void measure_mean(struct environment *env)
{
    double mean = 0;

    for (uint32_t row = 0; row < env->height; row++) {
        double sum = 0;

        for (uint32_t column = 0; column < env->width; column++)
            sum += luminance(texel(env, column, row));
        mean += sum / env->width * row_share(row, env->height);
    }
    env->mean_luminance = mean < (double)FLT_MAX ? (float)mean : FLT_MAX;
}

static status build_cells(struct environment *env, struct error *err)
{
    double *weights = NULL;
    status st = distribution_init(&env->cells, env->height + 1, env->width, err);

    if (st != STATUS_OK)
        return st;
    weights = mem_alloc_array(env->width, sizeof *weights);
    if (!weights)
        return error_no_memory(err, "the environment's importance table");
    for (uint32_t row = 0; row <= env->height; row++) {
        int south = row > env->height / 2, pole = row == 0 || row == env->height;
        struct place at = {.strip = south ? env->height - row : row, .south = south};

        for (at.column = 0; at.column < env->width; at.column++) {
            struct cell cell;

            cell_load(env, &at, 1, &cell);
            weights[at.column] = 0.25 * (cell.near_weight[0] + cell.near_weight[1] +
                                         cell.far_weight[0] + cell.far_weight[1]);
        }
        distribution_set_row(&env->cells, row, weights, pole ? 0.5 : 1.0);
    }
    mem_free(weights);
    if (!distribution_finish(&env->cells)) {
        /* Luminance below the smallest double: no importance to speak of. */
        distribution_release(&env->cells);
        env->mode = MODE_UNIFORM;
        return STATUS_OK;
    }
    /* Density in (u, v) over d omega = 2 pi^2 sin(theta) du dv. */
    env->density_scale =
        (double)env->width * (double)env->height / env->cells.total / (2 * PI_D * PI_D);
    return STATUS_OK;
}

status environment_new(struct environment **out, struct image *map, float rotate_deg,
                       float strength, enum env_sampling sampling, struct error *err)
{
    struct environment *env = mem_calloc(1, sizeof *env);
    double turns = (double)rotate_deg / 360.0;
    status st = STATUS_OK;

    *out = NULL;
    if (!env) {
        image_release(map);
        return error_no_memory(err, "the environment");
    }
    env->map = *map;
    memset(map, 0, sizeof *map);
    if (env->map.channels != 3 || env->map.width == 0 || env->map.height == 0) {
        st = error_set(err, STATUS_ERR_INPUT,
                       "the environment map is %u x %u with %u channels; it must have 3 channels",
                       env->map.width, env->map.height, env->map.channels);
        goto done;
    }
    if (!isfinite(rotate_deg) || !isfinite(strength) || strength < 0) {
        st = error_set(err, STATUS_ERR_INPUT,
                       "environment rotation %g degrees, strength %g: both must be finite and the "
                       "strength at least 0", (double)rotate_deg, (double)strength);
        goto done;
    }
    turns -= floor(turns);
    env->rotation = turns < 1 ? (float)turns : 0.0f;
    env->width = env->map.width;
    env->height = env->map.height;
    env->black = scale_pixels(&env->map, strength) == 0;
    if (env->black)
        goto done;
    env->mode = sampling == ENV_SAMPLING_IMPORTANCE ? MODE_IMPORTANCE
                : sampling == ENV_SAMPLING_UNIFORM  ? MODE_UNIFORM
                                                    : MODE_NONE;
    measure_mean(env);
    env->row_sine = mem_alloc_array(env->height, sizeof *env->row_sine);
    if (!env->row_sine) {
        st = error_no_memory(err, "the environment");
        goto done;
    }
    for (uint32_t row = 0; row < env->height; row++)
        env->row_sine[row] = sine_pi((row + 0.5) / env->height);
    if (env->mode == MODE_IMPORTANCE)
        st = build_cells(env, err);
done:
    if (st != STATUS_OK) {
        environment_free(env);
        return st;
    }
    *out = env;
    return STATUS_OK;
}

status environment_new_constant(struct environment **out, struct vec3 radiance,
                                enum env_sampling sampling, struct error *err)
{
    struct environment *env;

    *out = NULL;
    if (!vec3_is_finite(radiance) || vec3_min(radiance) < 0)
        return error_set(err, STATUS_ERR_INPUT,
                         "the environment's radiance (%g, %g, %g) must be finite and not negative",
                         (double)radiance.x, (double)radiance.y, (double)radiance.z);
    env = mem_calloc(1, sizeof *env);
    if (!env)
        return error_no_memory(err, "the environment");
    env->constant = radiance;
    env->black = vec3_is_black(radiance);
    env->mean_luminance = (float)luminance(radiance);
    env->mode = env->black || sampling == ENV_SAMPLING_BSDF ? MODE_NONE : MODE_UNIFORM;
    *out = env;
    return STATUS_OK;
}

void environment_free(struct environment *env)
{
    if (!env)
        return;
    distribution_release(&env->cells);
    mem_free(env->row_sine);
    image_release(&env->map);
    mem_free(env);
}

int environment_is_black(const struct environment *env)
{
    return env->black;
}

size_t environment_bytes(const struct environment *env)
{
    size_t texels = (size_t)env->width * env->height;

    return sizeof *env + texels * 3 * sizeof(float) +
           (env->row_sine ? env->height * sizeof *env->row_sine : 0) +
           (env->cells.rows ? distribution_bytes(&env->cells) : 0);
}

float environment_mean_luminance(const struct environment *env)
{
    return env->mean_luminance;
}
