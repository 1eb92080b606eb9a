#include "client/options/operator_list.h"

#include <stdio.h>
#include <string.h>

#include "client/follow/job_info.h"
#include "common/tonemap/tonemap.h"

enum { WIDTH = 100 }; /* columns to fill */

/* Words wrapped to WIDTH; lines after the first are indented by `indent`. `column`: the present one. */
static void print_wrapped(const char *text, int indent, int column)
{
    while (*text) {
        int length = (int)strcspn(text, " ");

        if (column > indent && column + 1 + length > WIDTH) {
            printf("\n%*s", indent, "");
            column = indent;
        } else if (column > indent) {
            putchar(' ');
            column++;
        }
        column += printf("%.*s", length, text);
        text += length;
        text += strspn(text, " ");
    }
    putchar('\n');
}

/* Can the parameter be set by an option of its name? --percentile can, although it is the command's. */
static int is_direct(const struct option *rows, const char *name)
{
    for (; rows->name; rows++)
        if (strcmp(rows->name, name) == 0)
            return strcmp(name, "percentile") == 0;
    return 1;
}

static void print_parameter(const struct tonemap_parameter *p, const struct option *rows)
{
    const char *before = "--", *after = " ";

    if (!is_direct(rows, p->name)) {
        before = "-p ";
        after = "=";
    }

    if (p->kind == TONEMAP_CHOICE) {
        printf("  %s%s%s", before, p->name, after);
        for (size_t i = 0; p->choices[i]; i++)
            printf("%s%s", i ? "|" : "", p->choices[i]);
        printf(" (default %s)\n", p->choices[(size_t)p->preset]);
    } else {
        printf("  %s%s%s%s %g..%g (default %g)\n", before, p->name, after,
               p->kind == TONEMAP_INTEGER ? "INTEGER" : "NUMBER", p->min, p->max, p->preset);
    }
    printf("      ");
    print_wrapped(p->help, 6, 6);
}

static void print_operator(const struct tonemap_operator *op, const struct option *rows)
{
    printf("%s\n  ", op->name);
    print_wrapped(op->summary, 2, 2);
    printf("  source: ");
    print_wrapped(op->source, 10, 10);
    if (op->file_load) {
        printf("  --lut FILE%s\n      ", op->file_required ? " (always needed)" : "");
        print_wrapped(op->file_help, 6, 6);
    }
    for (size_t p = 0; p < op->parameter_count; p++)
        print_parameter(&op->parameters[p], rows);
}

static json_t *parameter_json(const struct tonemap_parameter *p)
{
    static const char *const kinds[] = {
        [TONEMAP_NUMBER] = "number", [TONEMAP_INTEGER] = "integer", [TONEMAP_CHOICE] = "choice"};
    json_t *out = json_pack("{s:s, s:s}", "name", p->name, "kind", kinds[p->kind]);

    if (!out)
        return NULL;
    if (p->kind == TONEMAP_CHOICE) {
        json_t *words = json_array();

        for (size_t i = 0; p->choices[i]; i++)
            json_array_append_new(words, json_string(p->choices[i]));
        json_object_set_new(out, "choices", words);
        json_object_set_new(out, "default", json_string(p->choices[(size_t)p->preset]));
    } else {
        json_object_set_new(out, "min", json_number(p->min));
        json_object_set_new(out, "max", json_number(p->max));
        json_object_set_new(out, "default", json_number(p->preset));
    }
    json_object_set_new(out, "help", json_string(p->help));
    return out;
}

static json_t *operator_json(const struct tonemap_operator *op)
{
    json_t *parameters = json_array();

    for (size_t p = 0; p < op->parameter_count; p++)
        json_array_append_new(parameters, parameter_json(&op->parameters[p]));
    return json_pack("{s:s, s:s, s:s, s:s, s:o}", "name", op->name, "summary", op->summary, "source", op->source,
                     "file",
                     !op->file_load      ? "none"
                     : op->file_required ? "required"
                                         : "optional",
                     "parameters", parameters);
}

status operator_list_print(const struct option *rows, int json, struct error *err)
{
    size_t count;
    const struct tonemap_operator *const *operators = tonemap_operators(&count);
    json_t *list;

    if (!json) {
        for (size_t i = 0; i < count; i++) {
            if (i)
                putchar('\n');
            print_operator(operators[i], rows);
        }
        return STATUS_OK;
    }
    list = json_array();
    for (size_t i = 0; i < count; i++)
        json_array_append_new(list, operator_json(operators[i]));
    return json_print(json_pack("{s:o}", "operators", list), err);
}
