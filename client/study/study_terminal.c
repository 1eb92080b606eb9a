/* The study in ten lines of a terminal. */
#include <math.h>
#include <stdio.h>

#include "client/study/study_files.h"
#include "client/study/data/study_words.h"
#include "client/terminal/must.h"
#include "client/terminal/table.h"

enum { CHOICE_LINES = 3, COLUMNS_MAX = 5 };
static const double errors[] = {50, 20, 5, 2, 1};

/* Move the buffer's text into the next cell of a table. */
static void add_cell(struct table *t, struct buffer *text)
{
    table_add(t, "%s", buffer_text(text));
    must_hold(text);
    buffer_clear(text);
}

/* The number of workers like the present ones that finish in time; 0: not known. */
static double workers_for(const struct study *s, double core_s)
{
    const double workers = s->workers.count ? (double)s->workers.count : 1;

    return s->deadline_s > 0 ? fmax(1, ceil(core_s / s->deadline_s / (study_rate(s) / workers))) : 0;
}

static void add_row(struct table *t, const struct study *s, double codes)
{
    const struct study_interval cost = study_cost_of(s, codes);
    struct buffer text = BUFFER_INIT;

    words_exact(&text, codes);
    buffer_puts(&text, "/255");
    add_cell(t, &text);
    words_number(&text, cost.value);
    words_range(&text, &cost, 1);
    add_cell(t, &text);
    words_time(&text, cost.value / study_rate(s));
    add_cell(t, &text);
    if (s->price_core_hour >= 0) {
        words_price(&text, cost.value / 3600 * s->price_core_hour, s->currency);
        add_cell(t, &text);
    }
    if (s->deadline_s > 0) {
        words_exact(&text, workers_for(s, cost.value));
        add_cell(t, &text);
    }
    buffer_release(&text);
}

static void print_costs(const struct study *s)
{
    char workers[64];
    const char *titles[COLUMNS_MAX] = {">ERROR", ">CORE-SECONDS", ">TIME"};
    size_t columns = 3;
    struct table table;

    snprintf(workers, sizeof workers, ">WORKERS FOR %s", s->deadline ? s->deadline : "THE DEADLINE");
    if (s->price_core_hour >= 0)
        titles[columns++] = ">COST";
    if (s->deadline_s > 0)
        titles[columns++] = workers;
    table_init(&table, titles, columns);
    for (size_t i = 0; i < sizeof errors / sizeof errors[0]; i++)
        add_row(&table, s, errors[i]);
    table_print(&table);
    table_release(&table);
}

/* Print a line from a buffer, without control characters, and empty the buffer. */
static void print_line(struct buffer *text)
{
    const int failed = text->failed;

    for (size_t i = 0; i < text->size; i++)
        putchar(text->data[i] < 0x20 || text->data[i] == 0x7f ? '?' : text->data[i]);
    putchar('\n');
    buffer_clear(text);
    text->failed = failed;
}

/* Those that matter most, one line each. */
static void print_choices(const struct study *s, struct buffer *text)
{
    size_t order[STUDY_LIST_MAX], lines = 0;

    study_order_questions(s, order);
    for (size_t i = 0; i < s->questions.count && lines < CHOICE_LINES; i++) {
        const struct study_question *q = &s->questions.items[order[i]];
        const struct study_choice *best = NULL;

        for (size_t k = 0; k < q->choices.count; k++) {
            const struct study_choice *c = &q->choices.items[k];
            const double weight = c->baseline ? 0 : study_choice_weight(s, c);
            if (weight > 0 && (!best || weight > study_choice_weight(s, best)))
                best = c;
        }
        if (!best)
            break;
        study_say_choice(text, s, best);
        print_line(text);
        lines++;
    }
}

void study_print(const struct study *s)
{
    struct buffer text = BUFFER_INIT;

    study_say_headline(&text, s);
    if (s->points.count) {
        buffer_puts(&text, " ");
        study_say_trust(&text, s);
    }
    print_line(&text);
    if (study_has_fit(s))
        print_costs(s);
    print_choices(s, &text);
    must_hold(&text);
    buffer_release(&text);
}
