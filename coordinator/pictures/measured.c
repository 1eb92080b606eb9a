#include "coordinator/pictures/measured.h"

#include <inttypes.h>
#include <time.h>

#include "common/base/bytes.h"
#include "common/base/memory.h"

/* The count stops at this number. */
enum { DELIVERERS_MAX = 1 << 24 };

static uint32_t last_deliverer(const struct film *film)
{
    uint32_t last = 0;

    for (uint32_t t = 0; t < film_tile_count(film); t++)
        for (uint32_t g = 0; g < GROUPS; g++)
            for (uint32_t p = 0; p < film_tile_passes(film, t, g); p++) {
                uint32_t who = film_deliverer(film, t, g, p);
                last = who > last ? who : last;
            }
    return last;
}

/* Call `use` for each deliverer of the film, once. 0: no memory. */
static int each_deliverer(const struct film *film, void (*use)(void *user, uint32_t number), void *user)
{
    uint32_t last = last_deliverer(film);
    uint8_t *seen = last < DELIVERERS_MAX ? mem_calloc(last + 1, 1) : NULL;

    for (uint32_t t = 0; seen && t < film_tile_count(film); t++)
        for (uint32_t g = 0; g < GROUPS; g++)
            for (uint32_t p = 0; p < film_tile_passes(film, t, g); p++) {
                uint32_t who = film_deliverer(film, t, g, p);
                if (!seen[who])
                    use(user, who);
                seen[who] = 1;
            }
    mem_free(seen);
    return seen != NULL;
}

static void count_one(void *user, uint32_t number UNUSED) { ++*(uint32_t *)user; }

uint32_t measured_workers(const struct film *film)
{
    uint32_t count = 0;

    (void)!each_deliverer(film, count_one, &count);
    return count;
}

static void append_one(void *user, uint32_t number)
{
    uint8_t bytes[4];

    bytes_put32(bytes, number);
    buffer_append(user, bytes, sizeof bytes);
}

status measured_deliverers(const struct film *film, struct buffer *out, struct error *err)
{
    return each_deliverer(film, append_one, out) && buffer_ok(out) ? STATUS_OK : error_no_memory(err, "who rendered a frame");
}

static void write_date(struct buffer *out, const char *name, int64_t seconds)
{
    char text[32] = "";
    time_t when = (time_t)seconds;
    struct tm parts;

    if (seconds > 0 && gmtime_r(&when, &parts))
        (void)strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &parts);
    buffer_printf(out, ", \"%s\": \"%s\"", name, text);
}

void measured_write(struct buffer *out, const struct measured *m)
{
    buffer_printf(out, "{\"job\": %" PRIu64, m->job);
    if (m->workers)
        buffer_printf(out, ", \"workers\": %u", m->workers);
    write_date(out, "submitted", m->submitted_at);
    write_date(out, "written", m->written_at);
    buffer_printf(out, ", \"cpu_seconds\": %.3f, \"trace_seconds\": %.3f}", (double)m->cpu_ns * 1e-9,
                  (double)m->trace_ns * 1e-9);
}
