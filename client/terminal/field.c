#include "client/terminal/field.h"

#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <unistd.h>

#include "client/terminal/table.h"
#include "common/cli/terminal.h"
#include "protocol/message.h"

enum { TEXT_BYTES = 2048, LABEL_COLUMNS = 10, INDENT = LABEL_COLUMNS + 4 };

/* Columns beside the label. */
static size_t room(FILE *file)
{
    size_t columns = isatty(fileno(file)) ? terminal_columns(fileno(file)) : SIZE_MAX;

    return columns > INDENT ? columns - INDENT : 1;
}

static void print(FILE *file, const char *label, const char *text)
{
    fprintf(file, "  %-*s  %s\n", LABEL_COLUMNS, label, text);
}

void field_print(FILE *file, const char *label, const char *text)
{
    char rest[TEXT_BYTES], line[TEXT_BYTES];
    size_t columns = room(file);
    const char *at = message_text(rest, sizeof rest, text);

    do {
        snprintf(line, sizeof line, "%s", at);
        text_fit_words(line, columns);
        print(file, label, line);
        label = "";
        at += strlen(line);
        at += strspn(at, " ");
    } while (*at);
}

void field_printf(FILE *file, const char *label, const char *format, ...)
{
    char text[TEXT_BYTES];
    va_list values;

    va_start(values, format);
    vsnprintf(text, sizeof text, format, values);
    va_end(values);
    field_print(file, label, text);
}

void field_print_phrases(FILE *file, const char *label, const char *text)
{
    char line[TEXT_BYTES];

    message_text(line, sizeof line, text);
    if (text_fit_phrases(line, room(file)))
        print(file, label, line);
    else
        field_print(file, label, text);
}
