/* image_smooth: means over a window, at the borders over what there is of it. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>

#include "common/base/memory.h"
#include "common/image/image.h"

enum { WIDTH = 9, HEIGHT = 6, CHANNELS = 3 };

static struct image picture_of(uint32_t width, uint32_t height)
{
    struct image image;

    assert_int_equal(image_init(&image, width, height, CHANNELS, NULL), STATUS_OK);
    for (size_t i = 0; i < (size_t)width * height * CHANNELS; i++)
        image.pixels[i] = (float)(i * i % 31) + (i % 11 == 0 ? 1e6f : 0);
    return image;
}

static void a_pixel_is_the_mean_around_it(void **state)
{
    (void)state;
    for (int radius = 0; radius < 12; radius += 1 + radius) { /* up to wider than the picture */
        struct image from = picture_of(WIDTH, HEIGHT), to = picture_of(WIDTH, HEIGHT);

        assert_int_equal(image_smooth(&to, (uint32_t)radius, NULL), STATUS_OK);
        for (int y = 0; y < HEIGHT; y++)
            for (int x = 0; x < WIDTH; x++)
                for (int c = 0; c < CHANNELS; c++) {
                    double sum = 0, got = (double)to.pixels[(y * WIDTH + x) * CHANNELS + c];
                    int count = 0;
                    for (int v = y - radius; v <= y + radius; v++)
                        for (int u = x - radius; u <= x + radius; u++)
                            if (v >= 0 && v < HEIGHT && u >= 0 && u < WIDTH) {
                                sum += (double)from.pixels[(v * WIDTH + u) * CHANNELS + c];
                                count++;
                            }
                    assert_true(fabs(got - sum / count) <= 1e-6 * fabs(sum / count));
                }
        image_release(&from);
        image_release(&to);
    }
}

static void one_pixel_stays(void **state)
{
    struct image one = picture_of(1, 1);
    float before = one.pixels[1];

    (void)state;
    assert_int_equal(image_smooth(&one, 2, NULL), STATUS_OK);
    assert_true(one.pixels[1] == before);
    image_release(&one);
}

static void without_memory_it_is_unchanged(void **state)
{
    struct image from = picture_of(WIDTH, HEIGHT), to = picture_of(WIDTH, HEIGHT);
    struct error err = {0};

    (void)state;
    mem_fault_arm(0, 1);
    assert_int_equal(image_smooth(&to, 2, &err), STATUS_ERR_NO_MEMORY);
    mem_fault_arm(-1, 0);
    assert_memory_equal(from.pixels, to.pixels, sizeof(float) * WIDTH * HEIGHT * CHANNELS);
    image_release(&from);
    image_release(&to);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_pixel_is_the_mean_around_it),
        cmocka_unit_test(one_pixel_stays),
        cmocka_unit_test(without_memory_it_is_unchanged),
    };

    return cmocka_run_group_tests_name("smooth", tests, NULL, NULL);
}
