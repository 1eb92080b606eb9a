#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "common/cli/options.h"
#include "common/cli/terminal.h"

enum {
    WIDTH_LEAST = 40, /* narrower terminals break lines themselves */
    TEXT_AT = 32,     /* the column where helps begin */
    TEXT_LEAST = 40,  /* columns beside the options; with fewer, helps stand below */
    BELOW_AT = 8,
    NAMES_AT = 4,
    HELP_BYTES_MAX = 4096,
    GROUP_MAX = 128 /* options of a group */
};

static options_take_fn *take_help;
static void *take_user;
static const struct option_group *groups;
static int whole;

void options_take_help(options_take_fn *take, void *user)
{
    take_help = take;
    take_user = user;
}

void options_group_help(const struct option_group *list) { groups = list; }

void options_want_whole_help(void) { whole = 1; }

/* ---- text --------------------------------------------------------------------------------------- */

/* Columns that UTF-8 text takes: one a character. */
static size_t columns_of(const char *text, size_t bytes)
{
    size_t columns = 0;

    for (size_t i = 0; i < bytes; i++)
        columns += ((unsigned char)text[i] & 0xC0) != 0x80;
    return columns;
}

/* Print the words from column `at` on, and further lines from `indent` on. A list a|b|c may break behind a bar. */
static void print_words(const char *text, size_t at, size_t indent, size_t width)
{
    size_t space = 0, printed = 0;

    while (*text) {
        size_t bytes = strcspn(text, " |"), columns;

        bytes += text[bytes] == '|';
        columns = columns_of(text, bytes);
        if (printed > 0 && at + space + columns > width) {
            printf("\n%*s", (int)indent, "");
            at = indent;
        } else if (space && printed > 0) {
            putchar(' ');
            at++;
        }
        printed += fwrite(text, 1, bytes, stdout);
        at += columns;
        text += bytes;
        space = strspn(text, " ");
        text += space;
        space = space > 0;
    }
    putchar('\n');
}

static size_t help_width(void)
{
    const size_t width = terminal_columns(STDOUT_FILENO);

    return width > WIDTH_LEAST ? width : WIDTH_LEAST;
}

void options_print_words(const char *text, size_t indent) { print_words(text, indent, indent, help_width()); }

/* The bytes of the paragraph that begins here, with its last line's break, and whether all of its lines fit. A line
 * that begins with a space is laid out by hand and stands alone. */
static size_t paragraph_bytes(const char *text, size_t width, int *fits)
{
    size_t bytes = 0;

    *fits = 1;
    while (text[bytes] && text[bytes] != '\n' && (bytes == 0 || text[bytes] != ' ')) {
        size_t line = strcspn(text + bytes, "\n");
        int alone = text[bytes] == ' ';

        *fits = *fits && (alone || columns_of(text + bytes, line) <= width);
        bytes += line + (text[bytes + line] == '\n');
        if (alone)
            break;
    }
    return bytes ? bytes : 1;
}

static void print_paragraphs(const char *text, size_t width)
{
    while (*text) {
        int fits;
        size_t bytes = paragraph_bytes(text, width, &fits);
        char flat[HELP_BYTES_MAX];

        if (fits) {
            fwrite(text, 1, bytes, stdout);
            if (!text[bytes] && text[bytes - 1] != '\n')
                putchar('\n');
        } else {
            snprintf(flat, sizeof flat, "%.*s", (int)bytes, text);
            for (char *at = flat; *at; at++)
                *at = *at == '\n' ? ' ' : *at;
            print_words(flat, 0, 0, width);
        }
        text += bytes;
    }
}

/* ---- rows and groups ---------------------------------------------------------------------------- */

static void print_row(const struct option *o, size_t width)
{
    char head[64], help[HELP_BYTES_MAX];
    int below = width < TEXT_AT + TEXT_LEAST;
    size_t used = (size_t)snprintf(head, sizeof head, o->letter ? "-%c, " : "    ", o->letter);

    snprintf(head + used, sizeof head - used, "--%s%s%s", o->name, o->argument ? " " : "",
             o->argument ? o->argument : "");
    snprintf(help, sizeof help, o->kind == OPTION_CHOICE ? "%s [%s]" : "%s", o->help, o->choices);
    if (below || strlen(head) > TEXT_AT - 4)
        printf("  %s\n%*s", head, below ? BELOW_AT : TEXT_AT, "");
    else
        printf("  %-*s", TEXT_AT - 2, head);
    print_words(help, below ? BELOW_AT : TEXT_AT, below ? BELOW_AT : TEXT_AT, width);
}

static void print_help_row(size_t width)
{
    const struct option row = {.name = "help", .letter = 'h', .help = "print this"};

    print_row(&row, width);
}

struct shown {
    const struct option *rows[GROUP_MAX];
    size_t count;
};

static void show(struct shown *shown, const struct option *o)
{
    if (o && shown->count < GROUP_MAX)
        shown->rows[shown->count++] = o;
}

static int is_named(const char *names, const char *name)
{
    size_t length = strlen(name);

    for (; *names; names += strcspn(names, " "), names += *names == ' ')
        if (strcspn(names, " ") == length && memcmp(names, name, length) == 0)
            return 1;
    return 0;
}

static int is_in_any(const char *name)
{
    for (const struct option_group *g = groups; g->title; g++)
        if (is_named(g->names, name))
            return 1;
    return 0;
}

/* The group's options that stand in the table before its first title, in the group's order. */
static void collect(struct shown *out, const struct option *table, const struct option_group *group)
{
    out->count = 0;
    for (const char *at = group->names; *at; at += strcspn(at, " "), at += *at == ' ')
        show(out, option_find(table, at, strcspn(at, " ")));
    if (!group->names[0])
        for (const struct option *o = table; o->name && o->kind != OPTION_GROUP; o++)
            show(out, is_in_any(o->name) ? NULL : o);
}

/* "title: --a, --b", the title without what stands in brackets. */
static void print_names(const char *title, const struct shown *shown, size_t width)
{
    char line[HELP_BYTES_MAX];
    size_t used = (size_t)snprintf(line, sizeof line, "  %.*s", (int)strcspn(title, "(:"), title);

    while (used > 0 && line[used - 1] == ' ')
        used--;
    used += (size_t)snprintf(line + used, sizeof line - used, ":");
    for (size_t i = 0; i < shown->count && used < sizeof line; i++)
        used += (size_t)snprintf(line + used, sizeof line - used, " --%s", shown->rows[i]->name);
    printf("  ");
    print_words(line + 2, 2, NAMES_AT, width);
}

static void print_group(const char *title, const struct shown *shown, int described, size_t width)
{
    if (!described) {
        print_names(title, shown, width);
        return;
    }
    putchar('\n');
    print_words(title, 0, 0, width);
    for (size_t i = 0; i < shown->count; i++)
        print_row(shown->rows[i], width);
}

/* Of a long table the first group is described, and of the others only the names are given, unless all is wanted. */
static void print_long_table(const char *command, const struct option *table, size_t width)
{
    struct shown shown;

    for (const struct option_group *g = groups; g->title; g++) {
        collect(&shown, table, g);
        if (shown.count > 0)
            print_group(g->title, &shown, whole || g == groups, width);
        if (g != groups)
            continue;
        print_help_row(width);
        if (!whole) {
            char line[128];
            snprintf(line, sizeof line,
                     "more options, which 'azulejo help %.*s' describes:", (int)strcspn(command, " "), command);
            putchar('\n');
            print_words(line, 0, 0, width);
        }
    }
}

/* The groups that have a title in the table itself. */
static void print_titled(const struct option *o, int described, size_t width)
{
    while (o->name) {
        const char *title = o->help;
        struct shown shown = {.count = 0};

        for (o++; o->name && o->kind != OPTION_GROUP; o++)
            show(&shown, o);
        print_group(title, &shown, described, width);
    }
}

/* Its lines, "usage: " before the first. */
static void print_usage(const char *usage, size_t width)
{
    char line[HELP_BYTES_MAX];

    for (const char *label = "usage: "; *usage; label = "       ") {
        usage += strspn(usage, " ");
        snprintf(line, sizeof line, "%.*s", (int)strcspn(usage, "\n"), usage);
        fputs(label, stdout);
        print_words(line, strlen(label), strlen(label), width);
        usage += strcspn(usage, "\n");
        usage += *usage == '\n';
    }
    putchar('\n');
}

void options_print_help(const char *usage, const char *description, const struct option *table)
{
    const size_t width = help_width();
    const struct option *titled = table;

    if (take_help) {
        take_help(take_user, usage, table);
        return;
    }
    while (titled->name && titled->kind != OPTION_GROUP)
        titled++;
    print_usage(usage, width);
    print_paragraphs(description, width);
    if (groups && titled - table > OPTIONS_PLAIN_MAX) {
        print_long_table(usage + strcspn(usage, " ") + 1, table, width);
        print_titled(titled, whole, width);
        return;
    }
    if (table->name)
        printf("\noptions:\n");
    for (const struct option *o = table; o < titled; o++)
        print_row(o, width);
    print_help_row(width);
    print_titled(titled, 1, width);
}
