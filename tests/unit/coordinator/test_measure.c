/* measure: a sample of a picture's tiles is shown as the picture is. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>

#include "common/base/memory.h"
#include "common/film/tiles.h"
#include "coordinator/pictures/measure.h"

enum { SIDE = 1024, SAMPLE_ACROSS = 8, SAMPLE_DOWN = 64 };

/* Of a pixel of the picture: from dark on the left to thirty times as bright on the right, and noise. */
static float light_at(uint32_t x, uint32_t y, uint32_t group)
{
    uint32_t random = ((y * SIDE + x) * 2 + group + 1) * 2654435761u;

    random ^= random >> 15;
    random *= 2246822519u;
    random ^= random >> 13;
    return (float)(1e-3 * pow(30, (double)x / SIDE) * (1 + 0.3 * ((double)(random >> 8) / (1 << 23) - 1)));
}

/* Of so many tiles; the i-th is the picture's tile_of(i). */
static struct measurement measure(uint32_t across, uint32_t down, uint32_t of_tiles, uint32_t (*tile_of)(uint32_t i))
{
    struct measurement m = {.width = across * TILE_SIZE, .height = down * TILE_SIZE, .tiles = across * down,
                            .of_tiles = of_tiles, .pixel_samples = (uint64_t)across * down * TILE_PIXELS_MAX * 32};

    m.samples = mem_calloc((size_t)m.tiles * GROUPS, sizeof *m.samples);
    m.subject = mem_calloc(m.tiles, sizeof *m.subject);
    m.tails = mem_calloc((size_t)m.tiles * GROUPS * TAIL_MAX, sizeof *m.tails);
    assert_true(m.samples && m.subject && m.tails);
    for (uint32_t g = 0; g < GROUPS; g++) {
        m.groups[g] = mem_calloc((size_t)m.width * m.height * 3, sizeof(float));
        assert_non_null(m.groups[g]);
        for (uint32_t i = 0; i < m.width * m.height * 3; i++) {
            const uint32_t x = i / 3 % m.width, y = i / 3 / m.width;
            const uint32_t tile = tile_of(y / TILE_SIZE * across + x / TILE_SIZE), row = SIDE / TILE_SIZE;

            m.groups[g][i] = light_at(tile % row * TILE_SIZE + x % TILE_SIZE, tile / row * TILE_SIZE + y % TILE_SIZE, g);
        }
    }
    for (uint32_t t = 0; t < m.tiles; t++) {
        m.subject[t] = 1;
        m.samples[t * GROUPS] = m.samples[t * GROUPS + 1] = 16;
    }
    return m;
}

static uint32_t itself(uint32_t i) { return i; }

/* Tiles beside each other come from different columns. */
static uint32_t spread(uint32_t i) { return i * 37 % (SIDE / TILE_SIZE * SIDE / TILE_SIZE); }

static double display_error(struct measurement m)
{
    struct tonemap_settings look;
    struct tonemap_context context = {.threads = 1};
    struct accuracy_figures figures;
    struct error err = {0};

    assert_int_equal(tonemap_settings_init(&look, "reinhard02", &err), STATUS_OK);
    assert_int_equal(measurement_figures(&m, &look, &context, 0, 0, &figures, NULL, &err), STATUS_OK);
    measurement_release(&m);
    return figures.display_error;
}

/* If its tiles were taken for neighbours, dark ones beside bright ones would raise the log-mean, and darken it. */
static void a_sample_has_the_brightness_of_the_picture(void **state)
{
    enum { TILES = SIDE / TILE_SIZE * SIDE / TILE_SIZE };
    const double whole = display_error(measure(SIDE / TILE_SIZE, SIDE / TILE_SIZE, 0, itself));
    const double sample = display_error(measure(SAMPLE_ACROSS, SAMPLE_DOWN, TILES, spread));

    (void)state;
    if (fabs(sample / whole - 1) > 0.01)
        fail_msg("a display error of %.3f, of a sample %.3f", whole, sample);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_sample_has_the_brightness_of_the_picture),
    };
    return cmocka_run_group_tests_name("measure", tests, NULL, NULL);
}
