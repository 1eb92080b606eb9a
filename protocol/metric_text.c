#include "protocol/metric_text.h"

#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>

#include "protocol/message.h"

enum { LABEL_MAX = 512 };

void metric_begin(struct buffer *out, const char *name, const char *type, const char *help)
{
    buffer_printf(out, "# HELP %s %s\n# TYPE %s %s\n", name, help, name, type);
}

/* Whole numbers as such: they are exact up to 2^53. */
static void put_number(struct buffer *out, double value)
{
    if (isnan(value))
        buffer_puts(out, "NaN");
    else if (isinf(value))
        buffer_puts(out, value > 0 ? "+Inf" : "-Inf");
    else if (value == floor(value) && fabs(value) < 0x1p53)
        buffer_printf(out, "%.0f", value);
    else
        buffer_printf(out, "%.15g", value);
}

static void put_label(struct buffer *out, const char *name, const char *text)
{
    char clean[LABEL_MAX];

    buffer_printf(out, "%s=\"", name);
    for (const char *c = message_text(clean, sizeof clean, text); *c; c++)
        buffer_printf(out, *c == '\\' || *c == '"' ? "\\%c" : "%c", *c);
    buffer_puts(out, "\"");
}

void metric_value(struct buffer *out, const char *name, double value, ...)
{
    const char *label, *before = "{";
    va_list labels;

    buffer_puts(out, name);
    va_start(labels, value);
    while ((label = va_arg(labels, const char *))) {
        buffer_puts(out, before);
        put_label(out, label, va_arg(labels, const char *));
        before = ",";
    }
    va_end(labels);
    buffer_puts(out, before[0] == '{' ? " " : "} ");
    put_number(out, value);
    buffer_puts(out, "\n");
}

void metric_one(struct buffer *out, const char *name, const char *type, const char *help, double value)
{
    metric_begin(out, name, type, help);
    metric_value(out, name, value, NULL);
}

void metric_histogram(struct buffer *out, const char *name, const char *help, const struct histogram *histogram)
{
    char bucket[128], sum[128], count[128], bound[32];
    uint64_t below = 0;

    snprintf(bucket, sizeof bucket, "%s_bucket", name);
    snprintf(sum, sizeof sum, "%s_sum", name);
    snprintf(count, sizeof count, "%s_count", name);
    metric_begin(out, name, "histogram", help);
    for (int i = 0; i < HISTOGRAM_CLASSES; i++) {
        below += histogram->count[i];
        snprintf(bound, sizeof bound, "%g", histogram_bounds_s[i]);
        metric_value(out, bucket, (double)below, "le", isinf(histogram_bounds_s[i]) ? "+Inf" : bound, NULL);
    }
    metric_value(out, sum, (double)histogram->sum_ns / 1e9, NULL);
    metric_value(out, count, (double)below, NULL);
}
