#include "common/film/matte.h"

#include <string.h>

#define NUMBER_MAX 16777216.0f /* whole numbers up to here are exact in a float */

/* A count in double: sums of units. */
struct sum {
    double number, samples;
};

/* Put it among the largest; returns the samples that lose their slot. */
static double keep(double out[MATTE_FLOATS], struct sum more)
{
    int at = MATTE_SLOTS;
    double lost = more.samples;

    while (at > 0) {
        const double number = out[2 * at - 1], samples = out[2 * at];
        if (samples > more.samples || (samples == more.samples && number < more.number))
            break;
        at--;
        lost = out[2 * MATTE_SLOTS];
    }
    if (at == MATTE_SLOTS)
        return lost;
    memmove(out + 2 * at + 3, out + 2 * at + 1, (size_t)(2 * (MATTE_SLOTS - 1 - at)) * sizeof *out);
    out[2 * at + 1] = more.number;
    out[2 * at + 2] = more.samples;
    return lost;
}

void matte_tally_add(struct matte_tally *tally, uint32_t number)
{
    for (uint32_t i = 0; i < tally->count; i++)
        if (tally->things[i].number == number) {
            tally->things[i].samples++;
            return;
        }
    if (tally->count < MATTE_TALLY_MAX)
        tally->things[tally->count++] = (struct matte_count){number, 1};
    else
        tally->lost++;
}

void matte_tally_get(const struct matte_tally *tally, double out[MATTE_FLOATS])
{
    memset(out, 0, MATTE_FLOATS * sizeof *out);
    out[0] = tally->lost;
    for (uint32_t i = 0; i < tally->count; i++)
        out[0] += keep(out, (struct sum){tally->things[i].number, tally->things[i].samples});
}

void matte_add(double sum[MATTE_FLOATS], const float more[MATTE_FLOATS])
{
    struct sum all[2 * MATTE_SLOTS];
    double lost = sum[0] + (double)more[0];
    uint32_t count = 0;

    for (int i = 0; i < MATTE_SLOTS && sum[2 * i + 2] > 0; i++)
        all[count++] = (struct sum){sum[2 * i + 1], sum[2 * i + 2]};
    for (int i = 0; i < MATTE_SLOTS && more[2 * i + 2] > 0; i++) {
        const struct sum one = {(double)more[2 * i + 1], (double)more[2 * i + 2]};
        uint32_t at = 0;
        while (at < count && all[at].number != one.number)
            at++;
        if (at == count)
            all[count++] = one;
        else
            all[at].samples += one.samples;
    }
    memset(sum, 0, MATTE_FLOATS * sizeof *sum);
    for (uint32_t i = 0; i < count; i++)
        lost += keep(sum, all[i]);
    sum[0] = lost;
}

static int is_whole(float value) { return value >= 0 && value <= NUMBER_MAX && value == (float)(uint32_t)value; }

int matte_is_valid(const float values[MATTE_FLOATS], uint32_t samples)
{
    double total = (double)values[0];
    int used = 0;

    for (int i = 0; i < MATTE_FLOATS; i++)
        if (!is_whole(values[i]))
            return 0;
    while (used < MATTE_SLOTS && values[2 * used + 2] > 0)
        used++;
    for (int i = 0; i < MATTE_SLOTS; i++) {
        const float number = values[2 * i + 1], count = values[2 * i + 2];
        if ((number > 0) != (i < used) || (count > 0) != (i < used))
            return 0;
        total += (double)count;
        for (int k = 0; k < i && i < used; k++)
            if (values[2 * k + 1] == number)
                return 0;
        if (i > 0 && i < used && (values[2 * i] < count || (values[2 * i] == count && values[2 * i - 1] > number)))
            return 0;
    }
    return total <= samples;
}
