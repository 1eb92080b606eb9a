#include "client/views/effects_view.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "client/terminal/format.h"
#include "client/terminal/table.h"
#include "common/scene/scene_effects.h"
#include "common/scene/manifest.h"
#include "protocol/message.h"

enum { LINE_COLUMNS = 78, NAME_SIZE = 64 };

static void append(char out[CAUSE_TEXT_SIZE], const char *format, ...) __attribute__((format(printf, 2, 3)));
static void append(char out[CAUSE_TEXT_SIZE], const char *format, ...)
{
    size_t used = strlen(out);
    va_list args;

    va_start(args, format);
    vsnprintf(out + used, CAUSE_TEXT_SIZE - used, format, args);
    va_end(args);
}

static void append_caller(char out[CAUSE_TEXT_SIZE], const char *kind, const char *name, uint32_t index)
{
    if (*kind)
        append(out, "%.32s ", kind);
    if (*name)
        append(out, "\"%.48s\"", name);
    else
        append(out, "%u", index);
}

void cause_text(const struct effect_cause *cause, char out[CAUSE_TEXT_SIZE])
{
    const char *kind = cause->kind;
    uint32_t named = 1;

    snprintf(out, CAUSE_TEXT_SIZE, "%s", kind ? "" : "-");
    if (!kind)
        return;
    append_caller(out, kind, cause->name, cause->index);
    for (; named < CAUSE_NAMES && named <= EFFECT_CAUSES_ALSO && cause->also[named - 1].kind; named++) {
        const struct effect_caller *other = &cause->also[named - 1];
        append(out, named + 1 == cause->count ? " and " : ", ");
        append_caller(out, strcmp(other->kind, kind) == 0 ? "" : other->kind, other->name, other->index);
        kind = other->kind;
    }
    if (cause->count > named)
        append(out, " and %u more", cause->count - named);
}

void name_list_add(struct name_list *list, const char *name)
{
    char safe[NAME_SIZE];

    if (list->count++ == 0)
        list->column = printf("\n%s: ", list->title) - 1;
    else if (list->column > LINE_COLUMNS)
        list->column = printf(",\n  ") - 2;
    else
        list->column += printf(", ");
    list->column += printf("%s", message_text(safe, sizeof safe, name));
}

void name_list_end(struct name_list *list)
{
    if (list->count > 0)
        printf("\n");
}

status manifest_parse(json_t **out, const uint8_t *data, size_t size_bytes, struct error *err)
{
    json_error_t why;

    *out = NULL;
    if (size_bytes > MANIFEST_BYTES_MAX)
        return error_set(err, STATUS_ERR_PROTOCOL, "the manifest has %zu bytes, more than %d", size_bytes,
                         MANIFEST_BYTES_MAX);
    *out = json_loadb((const char *)data, size_bytes, JSON_REJECT_DUPLICATES, &why);
    if (!*out)
        return error_set(err, STATUS_ERR_PROTOCOL, "the manifest is not JSON, line %d: %s", why.line, why.text);
    if (json_integer_value(json_object_get(*out, "azulejo_effects")) != MANIFEST_VERSION) {
        json_decref(*out);
        *out = NULL;
        return error_set(err, STATUS_ERR_PROTOCOL,
                         "the manifest is of another version than %d: fetch it with the release of "
                         "the coordinator",
                         MANIFEST_VERSION);
    }
    return STATUS_OK;
}

static const char *text_of(const json_t *object, const char *key)
{
    const char *text = json_string_value(json_object_get(object, key));

    return text ? text : "";
}

/* The cell that lists the causes of an effect. */
static void add_cause(struct table *table, const json_t *row)
{
    const json_t *from = json_object_get(row, "cause"), *also = json_object_get(from, "also"), *other;
    struct effect_cause cause = {0};
    char text[CAUSE_TEXT_SIZE];
    size_t i;

    if (from) {
        cause.kind = text_of(from, "kind");
        cause.name = text_of(from, "name");
        cause.index = (uint32_t)json_integer_value(json_object_get(from, "index"));
        cause.count = (uint32_t)json_integer_value(json_object_get(from, "count"));
    }
    json_array_foreach(also, i, other) if (i < EFFECT_CAUSES_ALSO)
        cause.also[i] = (struct effect_caller){
            text_of(other, "kind"), text_of(other, "name"),
            (uint32_t)json_integer_value(json_object_get(other, "index"))};
    cause_text(&cause, text);
    table_add(table, "%s", text);
}

static void add_share(struct table *table, const json_t *share)
{
    if (json_is_number(share))
        table_add(table, "%.1f %%", 100 * json_number_value(share));
    else
        table_add(table, "-");
}

/* The effects that ran, with their shares of the time, and the time that belongs to none. */
static void print_ran(const json_t *rows, const json_t *time)
{
    static const char *const titles[] = {"EFFECT", ">SHARE", "CALLED FOR BY"};
    const json_t *none = json_object_get(time, "no_effect"), *row;
    struct table table;
    size_t i;

    table_init(&table, titles, 3);
    json_array_foreach(rows, i, row) {
        table_add(&table, "%s", text_of(row, "effect"));
        add_share(&table, json_object_get(row, "share"));
        add_cause(&table, row);
    }
    if (json_is_number(none)) {
        table_add(&table, "(none of them)");
        add_share(&table, none);
        table_add(&table, "any picture: rays, what they meet, sums");
    }
    printf("\n");
    table_print(&table);
    table_release(&table);
}

static void print_switched_off(const json_t *rows)
{
    static const char *const titles[] = {"SWITCHED OFF", "CALLED FOR BY"};
    struct table table;
    const json_t *row;
    size_t i;

    if (json_array_size(rows) == 0)
        return;
    table_init(&table, titles, 2);
    json_array_foreach(rows, i, row) {
        table_add(&table, "%s", text_of(row, "effect"));
        add_cause(&table, row);
    }
    printf("\n");
    table_print(&table);
    table_release(&table);
}

/* One line of the stages, the largest first. */
static void print_time(const json_t *time)
{
    const json_t *share = json_object_get(time, "share");
    char printed[STAGE_COUNT] = {0};
    struct name_list list = NAME_LIST_INIT("time");

    for (int i = 0; i < STAGE_COUNT; i++) {
        double most = -1;
        int next = -1;
        char text[NAME_SIZE];
        for (int k = 0; k < STAGE_COUNT; k++) {
            const json_t *value = json_object_get(share, stage_name((enum stage)k));
            if (!printed[k] && json_is_number(value) && json_number_value(value) > most) {
                most = json_number_value(value);
                next = k;
            }
        }
        if (next < 0)
            break;
        printed[next] = 1;
        snprintf(text, sizeof text, "%s %.1f %%", stage_name((enum stage)next), 100 * most);
        name_list_add(&list, text);
    }
    name_list_end(&list);
    if (json_number_value(json_object_get(time, "looks")) > 0)
        /* 1.96 standard errors of a share of a half. */
        printf("(by %.0f looks at the threads: 19 of 20 shares are right to %.1f %% of the whole)\n",
               json_number_value(json_object_get(time, "looks")),
               98 / sqrt(json_number_value(json_object_get(time, "looks"))));
}

static void print_work(const json_t *work)
{
    char samples[FORMAT_SIZE], rays[FORMAT_SIZE], cpu[FORMAT_SIZE];

    printf("\nwork: %s samples, %s rays, %s of CPU time\n",
           format_count(samples, json_number_value(json_object_get(work, "samples"))),
           format_count(rays, json_number_value(json_object_get(work, "rays"))),
           format_duration(cpu, json_number_value(json_object_get(work, "cpu_s"))));
    if (json_number_value(json_object_get(work, "samples")) < json_number_value(json_object_get(work, "frame_samples")))
        printf("(the coordinator was restarted: earlier counts are missing)\n");
}

static void print_audit(const json_t *audit)
{
    long long units = (long long)json_integer_value(json_object_get(audit, "units"));

    if (units > 0)
        printf("audit: another worker had rendered %lld unit%s again, with the same bits\n", units, units == 1 ? "" : "s");
    else if (audit)
        printf("audit: not audited: no other worker had rendered any of its units again when it was done\n");
}

void manifest_print(const json_t *m)
{
    const json_t *ran = json_object_get(m, "ran"), *idle = json_object_get(m, "not_called_for"), *name;
    struct name_list list = NAME_LIST_INIT("not called for, so not simulated");
    char variant[NAME_SIZE], renderer[2 * NAME_SIZE];
    size_t i;

    printf("job %lld, frame %lld: %zu effects, rendered by the \"%s\" kernel of %s\n",
           (long long)json_integer_value(json_object_get(m, "job")),
           (long long)json_integer_value(json_object_get(m, "frame")), json_array_size(ran),
           message_text(variant, sizeof variant, text_of(json_object_get(m, "kernel"), "variant")),
           message_text(renderer, sizeof renderer, text_of(json_object_get(m, "kernel"), "renderer")));
    print_ran(ran, json_object_get(m, "time"));
    print_switched_off(json_object_get(m, "switched_off"));
    json_array_foreach(idle, i, name) { name_list_add(&list, json_is_string(name) ? json_string_value(name) : "?"); }
    name_list_end(&list);
    print_work(json_object_get(m, "work"));
    print_audit(json_object_get(m, "audit"));
    print_time(json_object_get(m, "time"));
}
