/* metric_text: the text format of Prometheus, version 0.0.4. */
#pragma once

#include "common/base/buffer.h"
#include "common/base/histogram.h"

#define METRIC_CONTENT_TYPE "text/plain; version=0.0.4; charset=utf-8"

/* The two lines before a metric's values. `type`: "counter", "gauge", "histogram". */
void metric_begin(struct buffer *out, const char *name, const char *type, const char *help);
/* A value, with pairs of a label's name and its text, which may be anything, ended by NULL. */
void metric_value(struct buffer *out, const char *name, double value, ...) __attribute__((sentinel));
/* Both, of a metric without labels. */
void metric_one(struct buffer *out, const char *name, const char *type, const char *help, double value);
void metric_histogram(struct buffer *out, const char *name, const char *help, const struct histogram *histogram);
