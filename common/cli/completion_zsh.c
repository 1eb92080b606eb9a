/* zsh: a function that gives each command's table to _arguments. */
#include "common/cli/completion.h"

static void put_quoted(struct buffer *out, const char *text)
{
    for (; *text; text++)
        buffer_printf(out, *text == '\'' ? "'\\''" : "%c", *text);
}

/* A help text within a quoted specification. */
static void put_help(struct buffer *out, const char *text)
{
    struct buffer escaped = BUFFER_INIT;

    completion_put_help(&escaped, text, "[]:\\");
    if (!buffer_ok(&escaped))
        out->failed = 1;
    else
        put_quoted(out, buffer_text(&escaped));
    buffer_release(&escaped);
}

static void put_action(const struct completion *c, struct buffer *out, enum completion_value value, const char *words)
{
    switch (value) {
    case COMPLETE_FILE: buffer_puts(out, "_files"); return;
    case COMPLETE_FOLDER: buffer_puts(out, "_files -/"); return;
    case COMPLETE_WORDS: buffer_printf(out, "(%s)", words); return;
    case COMPLETE_LIST: buffer_printf(out, "_sequence compadd - %s", words); return;
    case COMPLETE_JOB: case COMPLETE_JOBS: case COMPLETE_FILE_OR_JOB:
        buffer_puts(out, " _"); /* after a space it gets its own arguments only */
        completion_put_function(c, out);
        buffer_puts(out, value == COMPLETE_JOBS ? "_jobs names" : value == COMPLETE_JOB ? "_jobs numbers"
                                                                                     : "_jobs files");
        return;
    case COMPLETE_NOTHING: case COMPLETE_TEXT: return;
    }
}

static void put_option(const struct completion *c, struct buffer *out, const struct completion_option *o)
{
    const char *equals = o->value == COMPLETE_NOTHING ? "" : "=";

    buffer_puts(out, " \\\n            ");
    if (o->repeats && o->letter)
        buffer_printf(out, "'*'");
    else if (o->letter)
        buffer_printf(out, "'(-%c --%s)'", o->letter, o->name);
    if (o->letter)
        buffer_printf(out, "{-%c%s,--%s%s}'[", o->letter, *equals ? "+" : "", o->name, equals);
    else
        buffer_printf(out, "'%s--%s%s[", o->repeats ? "*" : "", o->name, equals);
    put_help(out, o->help);
    buffer_puts(out, "]");
    if (*equals) {
        buffer_puts(out, ":");
        put_help(out, o->argument);
        buffer_puts(out, ":");
        put_action(c, out, o->value, o->words);
    }
    buffer_puts(out, "'");
}

static void put_command(const struct completion *c, struct buffer *out, const struct completion_command *command)
{
    buffer_puts(out, "_arguments -s -S '(- *)'{-h,--help}'[print the help]'");
    for (size_t i = 0; i < command->count; i++)
        put_option(c, out, &command->options[i]);
    if (command->value != COMPLETE_NOTHING) {
        buffer_printf(out, " \\\n            '*: :");
        put_action(c, out, command->value, command->words);
        buffer_puts(out, "'");
    }
}

static void put_jobs(const struct completion *c, struct buffer *out)
{
    buffer_puts(out, "_");
    completion_put_function(c, out);
    buffer_puts(out, "_jobs() {\n"
                     "    local -a found\n"
                     "    local key rest\n"
                     "    while IFS=$'\\t' read -r key rest; do\n"
                     "        [[ $1 != names && $key == *[^0-9]* ]] && continue\n"
                     "        found+=(\"${${key//\\\\/\\\\\\\\}//:/\\\\:}:$rest\")\n"
                     "    done < <(\"$all[1]\" completion --jobs -- \"${(@)all[2,-1]}\" 2>/dev/null)\n"
                     "    (( $#found )) && _describe -V job found\n"
                     "    [[ $1 == files ]] && _files\n"
                     "    return 0\n"
                     "}\n");
}

void completion_write_zsh(const struct completion *c, struct buffer *out)
{
    int has_commands = c->count > 0 && c->commands[0].name != NULL;

    buffer_printf(out, "#compdef %s\n# zsh completion, made by 'azulejo completion zsh'\n", c->program);
    if (has_commands)
        put_jobs(c, out);
    buffer_printf(out, "_%s", c->program); /* also the file's name, which zsh loads by it */
    buffer_puts(out, "() {\n    local -a all commands\n    all=(\"${(@Q)words}\")\n");
    if (has_commands) {
        buffer_puts(out, "    if (( CURRENT == 2 )); then\n        commands=(\n");
        for (size_t i = 0; i < c->count; i++) {
            buffer_printf(out, "            '%s:", c->commands[i].name);
            put_help(out, c->commands[i].summary);
            buffer_puts(out, "'\n");
        }
        buffer_puts(out, "            'help:list the commands')\n        _describe command commands\n        return\n    fi\n"
                         "    shift words\n    (( CURRENT-- ))\n    case $words[1] in\n");
        for (size_t i = 0; i < c->count; i++) {
            buffer_printf(out, "    %s)\n        ", c->commands[i].name);
            put_command(c, out, &c->commands[i]);
            buffer_puts(out, " ;;\n");
        }
        buffer_puts(out, "    esac\n");
    } else if (c->count > 0) {
        buffer_puts(out, "    ");
        put_command(c, out, &c->commands[0]);
        buffer_puts(out, "\n");
    }
    buffer_printf(out, "}\nif [[ $funcstack[1] == _%s ]]; then\n    _%s \"$@\"\nelse\n    compdef _%s %s\nfi\n",
                  c->program, c->program, c->program, c->program);
}
